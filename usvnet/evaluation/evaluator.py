"""The whole evaluation: predictions once, then scores, tables and pictures."""

import dataclasses
import hashlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import torch

from usvnet import __version__
from usvnet.checkpoints import load_model, sha256
from usvnet.data.dataset import BoatDataset
from usvnet.data.records import Frame
from usvnet.evaluation.floor import score_floor
from usvnet.evaluation.html.page import Evaluation, write_page
from usvnet.evaluation.overlay import write_overlays
from usvnet.evaluation.predictions import Meta, predict_dataset, read_predictions
from usvnet.evaluation.range_metrics import ranged_boats
from usvnet.evaluation.records import RANGE_CONFIDENCE, TruthRecord, comparable_range_m
from usvnet.evaluation.report import print_report, write_report
from usvnet.evaluation.scores import Scores, score
from usvnet.evaluation.uncertainty_report import draw_reliability
from usvnet.model import USVNet
from usvnet.network.variants import check_picture_size


class PageRequest(NamedTuple):
    """Asks for the HTML page."""

    path: Path
    """The file to write."""
    checkpoint: str
    """Where the weights came from."""
    configuration: str = ""
    """Every setting, as YAML."""


def evaluate_checkpoint(
    checkpoint: Path | str,
    dataset: BoatDataset,
    split: str,
    output_dir: Path | str | None = None,
    *,
    batch_size: int = 16,
    range_confidence: float = RANGE_CONFIDENCE,
    overwrite: bool = False,
    report: Path | str | bool = False,
    configuration: str = "",
) -> Scores:
    """Evaluate a trained checkpoint on a split: write everything to a folder and print the tables.

    Args:
        checkpoint: written by train.py.
        dataset: the split, letterboxed and not augmented.
        split: its name.
        output_dir: where the results go; by default :func:`default_output`.
        batch_size: pictures a batch.
        range_confidence: score that a boat needs before it is ranged, in [0, 1].
        overwrite: predict anew even where the folder holds predictions.
        report: also write everything as one HTML page; True calls it ``report.html`` and puts it with the results.
        configuration: every setting, as YAML, for that page.

    Raises:
        FileNotFoundError: no such checkpoint.
        ValueError: not a checkpoint of usvnet; pictures of a size that its network does not take; a damaged picture;
            or the folder holds predictions made with something else.
    """
    model = load_model(checkpoint).to("cuda" if torch.cuda.is_available() else "cpu")
    check_picture_size(model.network, "image_size", max(dataset.size_px))
    output_dir = default_output(checkpoint, split) if output_dir is None else Path(output_dir)
    meta = prediction_meta(model, dataset, split) | {"checkpoint_sha256": sha256(checkpoint)}
    path = output_dir / "report.html" if report is True else Path(report) if report else None
    scores = evaluate(
        model,
        dataset,
        output_dir,
        meta,
        batch_size=batch_size,
        range_confidence=range_confidence,
        overwrite=overwrite,
        page=None if path is None else PageRequest(path, str(checkpoint), configuration),
    )
    print_report(scores, _title(model))
    print(f"written to {output_dir}: report.md, metrics.json, predictions.jsonl, tables and overlays")
    if path is not None:
        print(f"open {path} in a browser")
    return scores


def unlike_training(stamp: Mapping[str, Any], image_size: int, native_size: int | None) -> list[str]:
    """How pictures are shown to a network otherwise than it was made for, each in the rest of a sentence.

    Args:
        stamp: of its checkpoint.
        image_size: side of what it is shown.
        native_size: side of what its second look is shown, if anything.
    """
    sentences = []
    trained_size = stamp.get("image_size")
    if trained_size not in (None, image_size):
        sentences.append(
            f"was trained for pictures of {trained_size} px and is shown {image_size}: data.eval_image_size"
        )
    if stamp.get("refine") and native_size is None:
        sentences.append("has a second look, which is left out: data.native_size, the longer side of the pictures")
    return sentences


def evaluate(
    model: USVNet,
    dataset: BoatDataset,
    output_dir: Path | str,
    meta: Meta,
    *,
    batch_size: int = 16,
    range_confidence: float = RANGE_CONFIDENCE,
    overwrite: bool = False,
    page: PageRequest | None = None,
) -> Scores:
    """Predict, unless the folder holds these very predictions already, then score and write everything.

    Args:
        model: on the device to use.
        dataset: letterboxed and not augmented.
        output_dir: gets predictions.jsonl, ``overlays/`` and the files of
            :func:`usvnet.evaluation.report.write_report`.
        meta: what the predictions depend on, see :func:`prediction_meta`.
        batch_size: pictures a batch.
        range_confidence: score that a boat needs before it is ranged, in [0, 1].
        overwrite: predict anew even where the folder holds predictions.
        page: the HTML page to write, if any.

    Raises:
        ValueError: the folder holds predictions made with something else, ``range_confidence`` is not a share, or a
            picture is damaged.
    """
    if not 0 <= range_confidence <= 1:
        raise ValueError(f"range_confidence: got {range_confidence}, expected a score in [0, 1]")
    output_dir = Path(output_dir)
    path = output_dir / "predictions.jsonl"
    if overwrite or not path.is_file():
        predict_dataset(model, dataset, path, meta, batch_size)
    pictures = read_predictions(path, meta)
    if [picture.image for picture in pictures] != [frame.name for frame in dataset.frames]:
        raise ValueError(f"{path}: got other pictures than the {len(dataset.frames)} of the dataset: delete it")
    records = [picture.boats for picture in pictures]
    truths = [frame_truths(frame) for frame in dataset.frames]
    calibration_boats = {name: found.boats for name, found in model.intervals.factors().items()}
    ranged = ranged_boats(records, truths, range_confidence)
    scores = dataclasses.replace(
        score(records, truths, range_confidence, calibration_boats),
        floor=score_floor(ranged, dataset.frames, model.ranging.curved_water),
    )
    sheets = write_overlays(dataset.frames, records, truths, output_dir / "overlays", range_confidence)
    if ranged:
        sheets = [output_dir / "reliability.png", *sheets]
        draw_reliability(ranged, scores.intervals, sheets[0])
    write_report(scores, output_dir, _title(model), {"pictures": len(pictures), **meta}, sheets)
    if page is not None:
        told = Evaluation(
            model=_title(model),
            frames=dataset.frames,
            records=records,
            truths=truths,
            scores=scores,
            curved_water=model.ranging.curved_water,
            made_with={"checkpoint": page.checkpoint, **meta},
            configuration=page.configuration,
        )
        write_page(told, page.path)
    return scores


def default_output(checkpoint: Path | str, split: str) -> Path:
    """``runs/x/checkpoints/best.ckpt`` is evaluated in ``runs/x/evaluation/best_test``."""
    checkpoint = Path(checkpoint)
    return checkpoint.parent.parent / "evaluation" / f"{checkpoint.stem}_{split}"


def prediction_meta(model: USVNet, dataset: BoatDataset, split: str) -> Meta:
    """Everything that predictions depend on, but the weights."""
    return {
        "usvnet": __version__,
        "torch": torch.__version__,
        "variant": model.variant,
        "max_boats": model.max_boats,
        "score_threshold": model.score_threshold,
        "iou_threshold": model.iou_threshold,
        "curved_water": model.ranging.curved_water,
        "keypoint_share": model.noise.get_share(),
        "size_std": model.noise.get_size_std(),
        "intervals": {name: list(found) for name, found in model.intervals.factors().items()},
        "image_size": list(dataset.size_px),
        "native_size": dataset.native_px,
        "split": split,
        "frames_sha256": frames_sha256(dataset.frames),
    }


def frames_sha256(frames: Sequence[Frame]) -> str:
    """Hash names, pictures, cameras and hulls (labels and ranges may change without a new prediction).

    Raises:
        FileNotFoundError: a picture is not there.
    """
    digest = hashlib.sha256()
    for frame in frames:
        digest.update(frame.name.encode())
        digest.update(frame.image_path.read_bytes())
        for tensor in (*frame.camera, *frame.hull):
            digest.update(tensor.numpy().tobytes())
    return digest.hexdigest()


def frame_truths(frame: Frame) -> list[TruthRecord]:
    """The labelled boats of a picture, in native pixels."""
    return [
        TruthRecord(
            box_px=frame.boxes_px[n],
            keypoints_px=frame.keypoints_px[n],
            visibility=frame.visibility[n],
            range_m=comparable_range_m(
                frame.range_m[n], frame.reference[n], frame.keypoints_px[n], frame.visibility[n]
            ),
            range_std_m=float(frame.range_std_m[n]),
            reference=int(frame.reference[n]),
            scene=frame.scene,
        )
        for n in range(len(frame.boxes_px))
    ]


def _title(model: USVNet) -> str:
    return f"usvnet-{model.variant}"
