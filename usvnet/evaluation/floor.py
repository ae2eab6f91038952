"""The Cramer-Rao floor: the least range error that the network's own pixel noise allows.

How far keypoints fall from their labels is measured, keypoint by keypoint and distance bin by distance bin, and carried
through the geometry, together with what the camera file does not know exactly, at the labelled places. To first order
no unbiased estimator of the same points does better; each estimator has its own floor, for it looks at other points. An
RMSE above the floor comes from what neither counts: gross errors, bias, water that the camera file says nothing of.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from usvnet.data.records import Frame
from usvnet.evaluation.range_metrics import RangedBoat, group_boats, usable_errors
from usvnet.evaluation.records import ESTIMATORS, BoatRecord, FloatArray
from usvnet.evaluation.reranging import native_cases, range_cases
from usvnet.geometry.ranging import RangingLayer
from usvnet.losses.covariances import FREEDOM, GAUSSIAN_SCALE
from usvnet.types import NUM_KEYPOINTS

MIN_ERRORS = 10
"""Fewer errors of one keypoint say too little: those of all keypoints stand in for them."""


@dataclass(frozen=True)
class Floor:
    """Of one estimator on a set of laser-ranged boats; nan where there are none."""

    n: int
    rmse_m: float
    floor_m: float
    """Root of the mean square over the same boats of the least standard deviation."""

    @property
    def ratio(self) -> float:
        """RMSE over floor: 1 is as good as the keypoints allow."""
        return self.rmse_m / self.floor_m if self.floor_m > 0 else math.nan


@dataclass(frozen=True)
class FloorScores:
    """By estimator, over everything and by distance bin."""

    overall: dict[str, Floor]
    by_distance: dict[str, dict[str, Floor]]
    waterline_noise_px: dict[str, float]
    """By distance bin, the robust vertical standard deviation of the waterline keypoints."""


def score_floor(ranged: Sequence[RangedBoat], frames: Sequence[Frame], curved_water: bool) -> FloorScores:
    """Work out the floor of every estimator.

    Args:
        ranged: laser-ranged boats, in native pixels; those that were missed are left out.
        frames: the pictures that their ``picture`` counts in.
        curved_water: as the predictions were made.
    """
    ranged = [item for item in ranged if item.boat is not None]
    least_std_m: dict[str, list[FloatArray]] = {name: [] for name in ESTIMATORS}
    by_distance, noise_px = {}, {}
    for distance, members in group_boats(ranged)[1].items():
        covariance_px2, box_std_px = pixel_noise(members)
        ranging = RangingLayer(curved_water, box_bottom_std_px=box_std_px)
        cases = native_cases([(_as_labelled(item, covariance_px2), frames[item.picture]) for item in members])
        with torch.inference_mode():
            exact = range_cases(cases, ranging)
        ranged_by = {
            name: np.array([item.boat is not None and item.boat.ranges[name].usable for item in members])
            for name in ESTIMATORS
        }
        stds = {name: e.slant_std_m.numpy()[e.valid.numpy() & ranged_by[name]] for name, e in exact.items()}
        by_distance[distance] = {name: _floor(members, name, stds[name]) for name in ESTIMATORS}
        noise_px[distance] = math.sqrt((covariance_px2[3, 1, 1] + covariance_px2[6, 1, 1]) / 2)
        for name in ESTIMATORS:
            least_std_m[name].append(stds[name])
    overall = {name: _floor(ranged, name, np.concatenate([np.zeros(0), *least_std_m[name]])) for name in ESTIMATORS}
    return FloorScores(overall, by_distance, noise_px)


def pixel_noise(ranged: Sequence[RangedBoat]) -> tuple[FloatArray, float]:
    """Robust covariance (7, 2, 2) of each keypoint's error, px^2, and standard deviation of the box's bottom, px."""
    boats = [(item.boat, item.truth) for item in ranged if item.boat is not None]
    errors = np.array([boat.keypoints_px - truth.keypoints_px for boat, truth in boats]).reshape(-1, NUM_KEYPOINTS, 2)
    labelled = np.array([truth.visibility > 0 for _, truth in boats]).reshape(-1, NUM_KEYPOINTS)
    bottoms = np.array([boat.box_px[[2, 3]] - truth.box_px[[2, 3]] for boat, truth in boats]).reshape(-1, 2)
    pooled = robust_covariance(errors[labelled])
    each = [errors[labelled[:, k], k] for k in range(NUM_KEYPOINTS)]
    covariance = np.array([robust_covariance(of) if len(of) >= MIN_ERRORS else pooled for of in each])
    return covariance, math.sqrt(robust_covariance(bottoms)[1, 1])


def robust_covariance(errors: FloatArray, steps: int = 100) -> FloatArray:
    """Covariance (2, 2) about zero of errors (n, 2) by the likelihood of :func:`usvnet.losses.covariances.robust_nll`.

    Its maximum, found by reweighting: S = mean of (nu + 2) / (kappa + m^2) e e^T. Gaussian errors have their own
    covariance; bow and stern taken for each other hardly count. The floor of decoding where there is no error at all.
    """
    least = 1e-4 * np.eye(2)
    covariance = least if not len(errors) else errors.T @ errors / len(errors) + least
    for _ in range(steps if len(errors) else 0):
        mahalanobis2 = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(covariance), errors)
        weight = (FREEDOM + 2) / (GAUSSIAN_SCALE + mahalanobis2)
        covariance = (weight[:, None] * errors).T @ errors / len(errors) + least
    return np.asarray(covariance, np.float64)


def _as_labelled(item: RangedBoat, covariance_px2: FloatArray) -> BoatRecord:
    """The boat where its label has it (unlabelled keypoints stay where they were found), with the measured noise."""
    if item.boat is None:
        raise ValueError("a missed boat has no record")
    labelled = item.truth.visibility[:, None] > 0
    return dataclasses.replace(
        item.boat,
        box_px=item.truth.box_px,
        keypoints_px=np.where(labelled, item.truth.keypoints_px, item.boat.keypoints_px),
        keypoint_covariance_px2=covariance_px2,
    )


def _floor(ranged: Sequence[RangedBoat], estimator: str, least_std_m: FloatArray) -> Floor:
    error_m, _ = usable_errors(ranged, estimator)
    return Floor(
        n=len(error_m),
        rmse_m=float(np.sqrt(np.mean(error_m**2))) if len(error_m) else math.nan,
        floor_m=float(np.sqrt(np.mean(least_std_m**2))) if len(least_std_m) else math.nan,
    )
