"""The paper's Table 5 on a dataset: predicted keypoints ranged anew with a camera that is wrong, no network needed."""

from pathlib import Path

import torch

from usvnet.data.reader import read_dataset
from usvnet.evaluation.evaluator import frame_truths, frames_sha256
from usvnet.evaluation.predictions import read_meta, read_predictions
from usvnet.evaluation.range_metrics import ranged_boats
from usvnet.evaluation.records import ESTIMATORS
from usvnet.evaluation.reranging import native_cases
from usvnet.evaluation.sensitivity import SetErrors, set_errors
from usvnet.evaluation.sensitivity_settings import SensitivitySettings
from usvnet.geometry.ranging import RangingLayer


def predictions_errors(path: Path, data: Path, split: str, settings: SensitivitySettings) -> list[SetErrors]:
    """Errors of every laser-ranged boat that was found, for every disturbance.

    Args:
        path: the predictions.jsonl of an evaluation.
        data: the dataset that was predicted.
        split: the split that was predicted.
        settings: disturbances, draws and seed; curved water is as it was for the predictions.

    Raises:
        FileNotFoundError: no such file or dataset.
        ValueError: the predictions are of something else than the split, or no laser-ranged boat was found.
    """
    meta, pictures = read_meta(path), read_predictions(path)
    frames = read_dataset(data, split)
    if meta.get("frames_sha256") != frames_sha256(frames):
        raise ValueError(
            f"{path}: made of other pictures, cameras or hulls than the {split} split of {data} has now, or with "
            "another source of attitude than its files"
        )
    ranged = ranged_boats([picture.boats for picture in pictures], [frame_truths(frame) for frame in frames])
    found = [(item.boat, frames[item.picture], item.truth.range_m) for item in ranged if item.boat is not None]
    if not found:
        raise ValueError(f"{path}: none of its boats has a laser reading in the {split} split of {data}")
    cases = native_cases([(boat, frame) for boat, frame, _ in found])
    cases = cases.with_noise(0.0, meta.get("size_std", 0.0))  # the covariances were predicted with their share already
    reading_m = torch.tensor([range_m for *_, range_m in found], dtype=torch.float64)
    return set_errors(
        cases,
        dict.fromkeys(ESTIMATORS, reading_m),
        settings.disturbances,
        RangingLayer(bool(meta["curved_water"])),
        torch.Generator().manual_seed(settings.seed),
        draws=max(1, settings.draws // cases.count),
    )
