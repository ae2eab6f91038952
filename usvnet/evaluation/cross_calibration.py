"""Coverage known better: every boat scored with a calibration that has not seen it, and no boat set aside for that.

Laser-ranged boats are dealt by picture into K folds; what is calibrated for one fold is fitted on all the others (Vovk,
Cross-conformal predictors, 2015, without its pooling of p-values). Over all folds together a calibrated coverage comes
close to its nominal one by construction, for each fold is held against a quantile of boats like its own. What this can
prove or refute is what no fold is calibrated on: coverage in groups, such as distance bins.
"""

from collections.abc import Callable, Sequence

import numpy as np

from usvnet.evaluation.range_metrics import RangedBoat, usable_errors
from usvnet.intervals import Z_90

Calibrate = Callable[[Sequence[RangedBoat], Sequence[RangedBoat]], list[RangedBoat]]
"""Fits on its first argument and returns its second, calibrated."""


def deal_folds(ranged: Sequence[RangedBoat], folds: int, seed: int) -> list[list[RangedBoat]]:
    """Deal boats into folds whose numbers of pictures differ by at most one; those of one picture stay together.

    Raises:
        ValueError: fewer than two folds, or fewer pictures than folds.
    """
    pictures = np.unique([item.picture for item in ranged])
    if not 2 <= folds <= len(pictures):
        raise ValueError(f"folds: expected 2 to {len(pictures)}, the pictures with a laser-ranged boat, got {folds}")
    order = np.random.default_rng(seed).permutation(pictures)
    fold_of = {int(picture): place % folds for place, picture in enumerate(order)}
    return [[item for item in ranged if fold_of[item.picture] == fold] for fold in range(folds)]


def cross_calibrate(
    ranged: Sequence[RangedBoat], calibrate: Calibrate, folds: int = 10, seed: int = 0
) -> list[RangedBoat]:
    """Calibrate every fold on the others.

    Args:
        ranged: laser-ranged boats that were not trained on; ``picture`` tells their pictures apart.
        calibrate: fits everything that is fitted, and may return a boat more than once (disturbed anew, say).
        folds: how many.
        seed: of the dealing.

    Returns:
        What ``calibrate`` returned for the folds, one after the other.
    """
    dealt = deal_folds(ranged, folds, seed)
    calibrated = []
    for held_out in range(folds):
        others = [item for fold, members in enumerate(dealt) if fold != held_out for item in members]
        calibrated += calibrate(others, dealt[held_out])
    return calibrated


def coverage_std(ranged: Sequence[RangedBoat], estimator: str) -> float:
    """Standard error of the share of readings inside the calibrated 90 % interval, pictures being independent.

    sqrt(sum over pictures of (sum of hit - coverage)^2) / n, for boats of one picture, or draws of one boat, may hit or
    miss together. nan where there is no range.
    """
    hits: dict[int, list[bool]] = {}
    for item in ranged:
        error_m, estimates = usable_errors([item], estimator)
        if estimates:
            hits.setdefault(item.picture, []).append(bool(abs(error_m[0]) <= Z_90 * estimates[0].slant_std_m))
    n = sum(map(len, hits.values()))
    if not n:
        return float("nan")
    coverage = sum(map(sum, hits.values())) / n
    return float(np.sqrt(sum((sum(of) - coverage * len(of)) ** 2 for of in hits.values())) / n)
