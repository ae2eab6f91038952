"""How much larger or smaller than it is a network draws a boat, measured on laser-ranged boats it was not trained on.

Where nobody knows the camera's attitude, a boat of known hull is as far as it looks large. So the boats are ranged anew
with a pitch and roll that are known to a few degrees only, and the standard deviation of their size is that which makes
the laser's readings most likely, under a Student t, so that a bow taken for a stern does not rule it. Whatever else
makes sizes wrong (a hull file that is not exact, a focal length) counts with it.

The labels' keypoints do not tell it: on sixscenes-v0 the size itself errs by less than 1 %. What misleads the fit by
3 % is how flat, or from which side, a boat is drawn.
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import torch

from usvnet.data.records import Frame
from usvnet.evaluation.conformal import MIN_BOATS
from usvnet.evaluation.range_metrics import RangedBoat
from usvnet.evaluation.reranging import Cases, native_cases, range_cases
from usvnet.geometry.ranging import RangingLayer
from usvnet.losses.covariances import FREEDOM

UNKNOWN_STD_RAD = math.radians(2)
"""Of pitch and roll: so much that the waterline says next to nothing beside the size."""
SIZE_STDS = (0.0, 0.005, 0.007, 0.01, 0.014, 0.02, 0.025, 0.03, 0.035, 0.04, 0.05, 0.06, 0.08, 0.1)
"""Those that are tried."""
GAUSSIAN_SCALE = 2.762267
"""Of the t in one dimension, for which Gaussian errors ask for their own variance: with a unit Gaussian z and nu = 4
degrees of freedom the condition is E[z^2 / (kappa + z^2)] = 1 / (nu + 1)."""


def fit_size_std(
    ranged: Sequence[RangedBoat], frames: Sequence[Frame], share: float, curved_water: bool = False
) -> float:
    """The standard deviation of the logarithm of a boat's size as it is drawn.

    Args:
        ranged: laser-ranged boats, in native pixels, with the covariances of the heatmaps alone.
        frames: the pictures that their ``picture`` counts in.
        share: doubt of their keypoints, see :func:`usvnet.evaluation.keypoint_calibration.fit_keypoint_share`.
        curved_water: as the predictions were made.

    Returns:
        0 where there are fewer than :data:`usvnet.evaluation.conformal.MIN_BOATS` boats of a hull that is known.
    """
    known = [item for item in ranged if item.boat is not None and _is_known(frames[item.picture])]
    if len(known) < MIN_BOATS:
        return 0.0
    boats = [(item.boat, frames[item.picture]) for item in known if item.boat is not None]
    cases = _unknown_attitude(native_cases(boats))
    reading_m = torch.tensor([item.truth.range_m for item in known], dtype=torch.float64)
    ranging = RangingLayer(curved_water, misfit_limit=math.inf)  # the same boats every time, whatever fits
    losses = [_loss(cases.with_noise(share, size_std), reading_m, ranging) for size_std in SIZE_STDS]
    return SIZE_STDS[int(np.argmin(losses))]


def _is_known(frame: Frame) -> bool:
    return bool(frame.hull.scale_std.item() <= max(SIZE_STDS))


def _unknown_attitude(cases: Cases) -> Cases:
    std_rad = torch.full_like(cases.camera.pitch_std_rad, UNKNOWN_STD_RAD)
    camera = cases.camera._replace(pitch_std_rad=std_rad, roll_std_rad=std_rad)
    return dataclasses.replace(cases, camera=camera)


def _loss(cases: Cases, reading_m: torch.Tensor, ranging: RangingLayer) -> float:
    """Mean negative log likelihood of the logarithms of readings (C,) under the hull's ranges, without its constant."""
    with torch.inference_mode():
        hull = range_cases(cases, ranging)["hull"]
    relative_std = hull.slant_std_m / hull.slant_m
    score = (hull.slant_m / reading_m).log() / relative_std
    loss = relative_std.log() + (FREEDOM + 1) / 2 * torch.log1p(score.square() / GAUSSIAN_SCALE)
    return float(loss[hull.valid].mean())
