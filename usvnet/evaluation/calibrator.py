"""Calibrating a checkpoint on boats that it was not trained on: its keypoints' noise, their size, its intervals."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import torch

from usvnet.checkpoints import STAMP, load_model, read_checkpoint, write_calibration
from usvnet.data.dataset import BoatDataset
from usvnet.data.records import Frame
from usvnet.evaluation.conformal import MIN_BOATS, fit_intervals
from usvnet.evaluation.evaluator import frame_truths
from usvnet.evaluation.keypoint_calibration import MIN_KEYPOINTS, fit_keypoint_share
from usvnet.evaluation.predictions import predict_pictures
from usvnet.evaluation.range_metrics import RangedBoat, ranged_boats
from usvnet.evaluation.records import RANGE_CONFIDENCE, match_boats
from usvnet.evaluation.reranging import native_cases, range_anew
from usvnet.evaluation.size_calibration import fit_size_std
from usvnet.geometry.ranging import RangingLayer
from usvnet.intervals import IntervalFactors


def calibrate_checkpoint(
    checkpoint: Path | str,
    dataset: BoatDataset,
    split: str,
    batch_size: int = 16,
    range_confidence: float = RANGE_CONFIDENCE,
) -> dict[str, IntervalFactors]:
    """Find keypoint noise, doubt of sizes and interval factors of a checkpoint, write them into it, and tell them.

    Args:
        checkpoint: written by train.py; an earlier calibration is replaced, unless nothing can be fitted.
        dataset: a split that was not trained on, letterboxed and not augmented.
        split: its name.
        batch_size: pictures a batch.
        range_confidence: score that a boat needs to count.

    Returns:
        The factors by estimator, 1 where there were too few boats; none where no interval was calibrated.

    Raises:
        FileNotFoundError: no such checkpoint.
        ValueError: not a checkpoint of usvnet; a damaged picture.
    """
    earlier = read_checkpoint(checkpoint)[STAMP].get("intervals", {})
    truths = [frame_truths(frame) for frame in dataset.frames]
    readings = sum(truth.range_m > 0 for labelled in truths for truth in labelled)
    keypoints = sum(int((truth.visibility > 0).sum()) for labelled in truths for truth in labelled)
    share, size_std, factors, share_fits = 0.0, 0.0, dict[str, IntervalFactors](), False
    if keypoints >= MIN_KEYPOINTS or readings >= MIN_BOATS:  # else there is nothing to predict for
        model = load_model(checkpoint).to("cuda" if torch.cuda.is_available() else "cpu")
        model.noise.set_share(0.0)
        model.noise.set_size_std(0.0)
        records = [picture.boats for picture in predict_pictures(model, dataset, batch_size)]
        matches = zip(records, truths, strict=True)
        pairs = [pair for boats, known in matches for pair in zip(match_boats(boats, known, range_confidence), known)]
        found = [(boat, truth) for boat, truth in pairs if boat is not None]
        share = fit_keypoint_share(found)
        share_fits = sum(int((truth.visibility > 0).sum()) for _, truth in found) >= MIN_KEYPOINTS
        ranged = ranged_boats(records, truths, range_confidence)
        size_std = fit_size_std(ranged, dataset.frames, share, model.ranging.curved_water)
        factors = fit_intervals(add_noise(ranged, dataset.frames, share, size_std, model.ranging.curved_water))
        if share_fits:
            print(f"keypoints of {split} stray by {100 * share:.1f} % of a boat's size beyond what their heatmaps say")
        print(f"boats of {split} are drawn larger or smaller than they are by {100 * size_std:.1f} %")
    if readings < MIN_BOATS:
        factors = {}
        print(f"intervals not calibrated: {readings} laser readings in {split}, expected at least {MIN_BOATS}")
    else:
        print(f"intervals calibrated on the laser-ranged boats of {split}: {_told(factors)}")
    intervals_fit = any(fitted.boats for fitted in factors.values())
    if not share_fits and not intervals_fit:
        print(f"{checkpoint}: its calibration is left as it is, for nothing can be fitted on {split}")
        return {}
    if earlier and not intervals_fit:
        print(f"{checkpoint}: its earlier interval factors are removed, for they belong to another doubt of keypoints")
    write_calibration(checkpoint, share, size_std, factors)
    return factors


def add_noise(
    ranged: Sequence[RangedBoat], frames: Sequence[Frame], share: float, size_std: float, curved_water: bool
) -> list[RangedBoat]:
    """What the same boats would have been ranged to with those doubts; ``box_bottom`` has no part in it."""
    found = [(item.boat, frames[item.picture]) for item in ranged if item.boat is not None]
    if not found:
        return list(ranged)
    cases = native_cases(found).with_noise(share, size_std)
    anew = []
    for before, after in zip(ranged, range_anew(ranged, cases, RangingLayer(curved_water))):
        if before.boat is not None and after.boat is not None:
            ranges = after.boat.ranges | {"box_bottom": before.boat.ranges["box_bottom"]}
            after = dataclasses.replace(after, boat=dataclasses.replace(after.boat, ranges=ranges))
        anew.append(after)
    return anew


def _told(factors: dict[str, IntervalFactors]) -> str:
    return ", ".join(
        f"{name} x {found.factor_90:.2f} ({found.boats} boats)"
        if found.boats
        else f"{name} not (fewer than {MIN_BOATS} boats)"
        for name, found in factors.items()
    )
