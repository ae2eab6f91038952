"""Accuracy beside the peer's: same data, picture size, epochs and seeds, both scored by this project's evaluation.

    python benchmarks/accuracy.py --root datasets/sixscenes-v0 --peer_python PEER/bin/python --output runs/accuracy

PEER is an environment as ``peer/environment.py`` describes it. Both are trained for every seed, unless checkpoints are
given; then both predict the test split, ours ranges its boats itself, and the peer's are ranged by the paper's formula:
its waterline keypoint nearer to the camera, met with flat water. Each stage leaves its files in ``--output`` and is not
done again; training goes on where it was stopped.
"""

import json
import shutil
import statistics
import subprocess
import sys
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
import yaml
from jsonargparse import auto_cli

from usvnet.data import read_dataset
from usvnet.data.dataset import BoatDataset
from usvnet.data.records import Frame
from usvnet.evaluation.evaluator import evaluate_checkpoint, frame_truths
from usvnet.evaluation.records import ESTIMATORS, BoatRecord, RangeRecord
from usvnet.evaluation.scores import Scores, finite, score
from usvnet.evaluation.tables import Cell, Column, Table
from usvnet.files import atomic_write
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import WATERLINE_KEYPOINTS

HERE = Path(__file__).resolve().parent
NO_RANGE = RangeRecord(float("inf"), float("inf"), float("inf"), 0.0, np.zeros(3), valid=False)
FIGURES: tuple[tuple[str, Callable[[Scores], float]], ...] = (
    ("strict mAP50-95", lambda scores: scores.pose_strict.map50_95),
    ("mAP50-95", lambda scores: scores.pose.map50_95),
    ("mAP50", lambda scores: scores.pose.map50),
    ("keypoint median px", lambda scores: scores.keypoints.overall.median_px),
    ("waterline RMSE m", lambda scores: scores.ranges.overall["waterline"].rmse_m),
    ("waterline MAE m", lambda scores: scores.ranges.overall["waterline"].mae_m),
    ("missed", lambda scores: float(scores.ranges.overall["waterline"].missed)),
)
"""What is compared: of the first three more is better, of the others less."""
DIFFERENCES = 3


def train_ours(folder: Path, experiment: Path, options: dict[str, object]) -> Path:
    """Train with train.py, from the last checkpoint where there is one."""
    checkpoints, done = folder / "checkpoints", folder / "trained"
    if not done.is_file():
        resume = (checkpoints / "last.ckpt").is_file()
        command = [sys.executable, str(HERE.parent / "train.py"), "--config", str(experiment)]
        options |= {
            "run_dir": folder,
            "evaluate_after": "false",
            "export_after": "false",
            "resume": str(resume).lower(),
        }
        subprocess.run([*command, *(f"--{key}={value}" for key, value in options.items())], check=True)
        done.touch()
    best = checkpoints / "best.ckpt"
    return best if best.is_file() else checkpoints / "last.ckpt"


def train_peer(python: str, folder: Path, root: Path, options: dict[str, object]) -> Path:
    """Train the peer in its own environment, on labels of its own, beside which it keeps its cache."""
    done = folder / "trained"
    if not done.is_file():
        data = folder / "data"
        if not (data / "data.yaml").is_file():
            data.mkdir(parents=True, exist_ok=True)
            shutil.copytree(root / "labels", data / "labels", dirs_exist_ok=True)
            (data / "images").unlink(missing_ok=True)
            (data / "images").symlink_to((root / "images").resolve())
            shutil.copy(root / "data.yaml", data / "data.yaml")
        command = [python, str(HERE / "peer" / "train.py"), "--data", str(data / "data.yaml"), "--out", str(folder)]
        subprocess.run([*command, *(f"--{key}={value}" for key, value in options.items())], check=True)
        done.touch()
    return folder / "train" / "weights" / "best.pt"


def peer_boats(
    python: str, weights: Path, frames: list[Frame], folder: Path, image_size: int
) -> list[list[BoatRecord]]:
    """Let the peer predict, unless it has, and range what it found."""
    folder.mkdir(parents=True, exist_ok=True)
    predictions, listed = folder / "predictions.jsonl", folder / "pictures.txt"
    if not predictions.is_file():
        listed.write_text("\n".join(str(frame.image_path.resolve()) for frame in frames) + "\n")
        command = [python, str(HERE / "peer" / "predict.py"), "--weights", str(weights), "--pictures", str(listed)]
        subprocess.run([*command, "--imgsz", str(image_size), "--out", str(predictions)], check=True)
    lines = [json.loads(line) for line in predictions.read_text().splitlines()]
    if [line["picture"] for line in lines] != [str(frame.image_path.resolve()) for frame in frames]:
        raise ValueError(f"{predictions}: got other pictures than those of the test split: delete it")
    return [[ranged(boat, frame) for boat in line["boats"]] for line, frame in zip(lines, frames, strict=True)]


def ranged(boat: dict[str, Any], frame: Frame) -> BoatRecord:
    """The peer's boat with the paper's two ranges: of the bottom of its box, and of its nearer waterline keypoint."""
    box, keypoints = np.array(boat["box_px"]), np.array(boat["keypoints_px"])
    points = np.stack([[(box[0] + box[2]) / 2, box[3]], *keypoints[list(WATERLINE_KEYPOINTS)]])
    points_px = torch.from_numpy(points)[None]
    estimate = RangingLayer().range_points(points_px, torch.zeros(1, len(points), 2, 2).double(), frame.camera)
    found = [
        RangeRecord(
            slant_m=float(estimate.slant_m[0, n]),
            slant_std_m=float(estimate.slant_std_m[0, n]),
            horizontal_m=float(estimate.horizontal_m[0, n]),
            bearing_rad=float(estimate.bearing_rad[0, n]),
            position_m=estimate.position_m[0, n].double().numpy(),
            valid=bool(estimate.valid[0, n]),
        )
        for n in range(len(points))
    ]
    known = {"box_bottom": found[0], "waterline": min(found[1:], key=lambda record: record.slant_m)}
    return BoatRecord(
        box_px=box,
        score=boat["score"],
        keypoints_px=keypoints,
        keypoint_covariance_px2=np.zeros((len(keypoints), 2, 2)),
        visibility=np.array(boat["visibility"]),
        ranges={name: known.get(name, NO_RANGE) for name in ESTIMATORS},
    )


def comparison(ours: list[Scores], peers: list[Scores]) -> Table:
    """A row for each seed and program, and what lies between the means: a difference of scores, a ratio of errors."""
    rows: list[list[Cell]] = []
    for name, all_scores in (("ours", ours), ("peer", peers)):
        rows += [[name, str(n), *(figure(scores) for _, figure in FIGURES)] for n, scores in enumerate(all_scores)]
    if ours and peers:
        means = [[statistics.fmean(figure(s) for s in found) for _, figure in FIGURES] for found in (ours, peers)]
        pairs = list(zip(*means, strict=True))
        between: list[Cell] = [mine - other for mine, other in pairs[:DIFFERENCES]]
        between += [mine / other if other else None for mine, other in pairs[DIFFERENCES:]]
        rows.append(["ours - peer, or ours / peer", "mean", *between])
    return Table(
        title="Accuracy on the test split",
        columns=[Column(title) for title in ("Program", "seed", *(title for title, _ in FIGURES))],
        rows=rows,
        strong=frozenset({len(rows) - 1}),
        note="strict: OKS sigma 0.025; the other mAPs: 1/7. The last row: difference of mAPs, ratio of errors.",
    )


def main(
    root: Path,
    output: Path,
    peer_python: str | None = None,
    experiment: Path = HERE.parent / "configs" / "experiment" / "sixscenes.yaml",
    variant: str = "n",
    peer_model: str = "yolo11n-pose.yaml",
    image_size: int = 320,
    epochs: int = 40,
    batch_size: int = 8,
    seeds: list[int] = [0],  # noqa: B006 (a default on the command line)
    settings: dict[str, Any] | None = None,
    ours: list[Path] | None = None,
    peer: list[Path] | None = None,
) -> None:
    """Train, predict, score, compare.

    Args:
        root: dataset folder with YOLO-pose labels.
        output: folder of everything that is made.
        peer_python: Python of the peer's environment; without it only ours is scored.
        experiment: what ours is trained with; size, epochs, batch and seed are put in their place.
        variant: our network.
        peer_model: the peer's network.
        image_size: side of the picture in training, validation and test, of both.
        epochs: of both.
        batch_size: of both.
        seeds: a training of each program for each of them.
        settings: further keys of our training configuration, e.g. ``{model.range_loss_start_epoch: 30}``.
        ours: trained checkpoints of ours, in the place of training.
        peer: trained checkpoints of the peer's, in the place of training.
    """
    frames = read_dataset(root, "test")
    dataset = BoatDataset(frames, image_size)
    truths = [frame_truths(frame) for frame in frames]
    our_scores, peer_scores = [], []
    for n, seed in enumerate(seeds if ours is None else range(len(ours))):
        options: dict[str, object] = {
            "data.root": root,
            "data.image_size": image_size,
            "data.eval_image_size": image_size,
            "data.batch_size": batch_size,
            "model.variant": variant,
            "trainer.max_epochs": epochs,
            "seed_everything": seed,
            **{key: yaml.safe_dump(value).removesuffix("...\n").strip() for key, value in (settings or {}).items()},
        }
        checkpoint = ours[n] if ours else train_ours(output / f"ours-seed-{seed}", experiment, options)
        our_scores.append(evaluate_checkpoint(checkpoint, dataset, "test", output / f"ours-{n}-test"))
    if peer_python:
        for n, seed in enumerate(seeds if peer is None else range(len(peer))):
            options = {"model": peer_model, "imgsz": image_size, "epochs": epochs, "batch": batch_size, "seed": seed}
            weights = peer[n] if peer else train_peer(peer_python, output / f"peer-seed-{seed}", root, options)
            records = peer_boats(peer_python, weights, frames, output / f"peer-{n}-test", image_size)
            peer_scores.append(score(records, truths))
    table = comparison(our_scores, peer_scores)
    content = {
        "settings": {
            "variant": variant,
            "peer_model": peer_model,
            "image_size": image_size,
            "epochs": epochs,
            "batch_size": batch_size,
            "seeds": seeds,
        },
        "ours": [asdict(scores) for scores in our_scores],
        "peer": [asdict(scores) for scores in peer_scores],
    }
    with atomic_write(output / "accuracy.json") as temporary:
        temporary.write_text(json.dumps(finite(content), indent=1))
    with atomic_write(output / "accuracy.md") as temporary:
        temporary.write_text(table.to_markdown(), encoding="utf-8")
    print(table.to_markdown())


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
