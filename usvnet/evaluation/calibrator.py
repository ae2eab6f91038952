"""Calibrating the range intervals of a checkpoint on laser-ranged boats that it was not trained on."""

from pathlib import Path

import torch

from usvnet.checkpoints import load_model, write_intervals
from usvnet.data.dataset import BoatDataset
from usvnet.evaluation.conformal import MIN_BOATS, fit_intervals
from usvnet.evaluation.evaluator import frame_truths
from usvnet.evaluation.predictions import predict_pictures
from usvnet.evaluation.range_metrics import ranged_boats
from usvnet.evaluation.records import RANGE_CONFIDENCE
from usvnet.intervals import IntervalFactors


def calibrate_checkpoint(
    checkpoint: Path | str,
    dataset: BoatDataset,
    split: str,
    batch_size: int = 16,
    range_confidence: float = RANGE_CONFIDENCE,
) -> dict[str, IntervalFactors]:
    """Find the interval factors of a checkpoint, write them into it, and say what they are.

    Args:
        checkpoint: written by train.py; earlier factors are replaced.
        dataset: a split that was not trained on, letterboxed and not augmented.
        split: its name.
        batch_size: pictures a batch.
        range_confidence: score that a boat needs to count.

    Returns:
        The factors by estimator, 1 where there were too few boats.

    Raises:
        FileNotFoundError: no such checkpoint.
        ValueError: not a checkpoint of usvnet; a damaged picture.
    """
    truths = [frame_truths(frame) for frame in dataset.frames]
    readings = sum(truth.range_m > 0 for labelled in truths for truth in labelled)
    if readings < MIN_BOATS:  # nothing to predict for
        factors: dict[str, IntervalFactors] = {}
        print(f"intervals not calibrated: {readings} laser readings in {split}, expected at least {MIN_BOATS}")
    else:
        model = load_model(checkpoint).to("cuda" if torch.cuda.is_available() else "cpu")
        records = [picture.boats for picture in predict_pictures(model, dataset, batch_size)]
        factors = fit_intervals(ranged_boats(records, truths, range_confidence))
        print(f"intervals calibrated on the laser-ranged boats of {split}: {_told(factors)}")
    write_intervals(checkpoint, factors)
    return factors


def _told(factors: dict[str, IntervalFactors]) -> str:
    return ", ".join(
        f"{name} x {found.factor_90:.2f} ({found.boats} boats)"
        if found.boats
        else f"{name} not (fewer than {MIN_BOATS} boats)"
        for name, found in factors.items()
    )
