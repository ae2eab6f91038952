"""How much a network loses on scenes it was not trained for: a table by scene tag, as Markdown.

python benchmarks/domain_shift.py --checkpoint best.ckpt --roots '[datasets/diverse, datasets/shift]' --output out
"""

import json
from dataclasses import asdict
from pathlib import Path

from jsonargparse import auto_cli

from usvnet.checkpoints import load_model, sha256
from usvnet.data import read_dataset
from usvnet.data.dataset import BoatDataset
from usvnet.evaluation.evaluator import frame_truths, prediction_meta
from usvnet.evaluation.predictions import predict_dataset, read_predictions
from usvnet.evaluation.scores import Scores, finite, score
from usvnet.files import atomic_write

HEADER = """| Scenes | pictures | boats | mAP50-95 (1/7) | mAP50-95 (0.025) | keypoint median px | ranged | missed | \
median rel. error | MAE m |
| :--- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"""


def main(
    checkpoint: Path,
    roots: list[Path],
    output: Path,
    image_size: int = 640,
    split: str = "test",
    batch_size: int = 8,
    native_size: int | None = None,
) -> None:
    """Predict once, score each dataset as a whole and by scene.

    Args:
        checkpoint: written by train.py.
        roots: dataset folders, the one like the training's first.
        output: folder for predictions, ``table.md`` and ``scores.json``.
        image_size: side of the square picture that the network sees.
        split: of each dataset.
        batch_size: pictures a batch.
        native_size: side of the pictures that keypoints are refined on, where the network does that.
    """
    model = load_model(checkpoint)
    lines, scores = [HEADER], {}
    for root in roots:
        frames = read_dataset(root, split)
        dataset = BoatDataset(frames, image_size, native_px=native_size)
        path = output / f"{root.name}.jsonl"
        meta = prediction_meta(model, dataset, split) | {"checkpoint_sha256": sha256(checkpoint)}
        if not path.is_file():
            predict_dataset(model, dataset, path, meta, batch_size)
        records = [picture.boats for picture in read_predictions(path, meta)]
        truths = [frame_truths(frame) for frame in frames]
        tags = sorted({frame.scene or "" for frame in frames})
        for tag in ["", *tags] if len(tags) > 1 else [""]:
            chosen = [i for i, frame in enumerate(frames) if tag in ("", frame.scene)]
            name = f"{root.name} {tag or 'all'}"
            scores[name] = score([records[i] for i in chosen], [truths[i] for i in chosen])
            lines.append(row(name, scores[name]))
    table = "\n".join([*lines, ""])
    for file, text in (
        ("table.md", table),
        ("scores.json", json.dumps(finite({name: asdict(found) for name, found in scores.items()}), indent=1)),
    ):
        with atomic_write(output / file) as temporary:
            temporary.write_text(text, encoding="utf-8")
    print(table)


def row(name: str, scores: Scores) -> str:
    """One line of the table."""
    ranges = scores.ranges.overall.get("waterline")
    pose, strict, keypoints = scores.pose, scores.pose_strict, scores.keypoints.overall
    figures = [f"{scores.pictures}", f"{pose.boats}", f"{pose.map50_95:.3f}", f"{strict.map50_95:.3f}"]
    figures.append(f"{keypoints.median_px:.2f}")
    if ranges is None:
        figures += ["0", "0", "-", "-"]
    else:
        figures += [f"{ranges.n}", f"{ranges.missed}", f"{100 * ranges.median_relative_error:.1f} %"]
        figures.append(f"{ranges.mae_m:.2f}")
    return f"| {name} | {' | '.join(figures)} |"


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
