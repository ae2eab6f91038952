"""Ranging without the network: boats whose pixels are known, through the real geometry, as often as one likes."""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from usvnet.data.records import Frame
from usvnet.evaluation.range_metrics import RangedBoat
from usvnet.evaluation.records import ESTIMATORS, BoatRecord, RangeRecord
from usvnet.geometry.camera import camera_to, stack_cameras
from usvnet.geometry.hull_model import hull_to, stack_hulls
from usvnet.geometry.ranging import RangingLayer
from usvnet.intervals import UNCALIBRATED, IntervalFactors
from usvnet.keypoint_noise import KeypointNoise
from usvnet.types import Camera, Hull, RangeEstimate, Reason


@dataclass(frozen=True, eq=False)
class Cases:
    """C boats, each seen by its own camera; float64."""

    keypoints_px: Tensor
    """(C, 7, 2)"""
    covariance_px2: Tensor
    """(C, 7, 2, 2)"""
    boxes_px: Tensor
    """(C, 4)"""
    camera: Camera
    """C cameras."""
    hull: Hull
    """C hulls."""

    @property
    def count(self) -> int:
        """C."""
        return len(self.boxes_px)

    def repeat(self, times: int) -> "Cases":
        """Every boat ``times`` over: all of them, then all of them again."""

        def repeated(tensor: Tensor) -> Tensor:
            return tensor.repeat(times, *[1] * (tensor.dim() - 1))

        return Cases(
            repeated(self.keypoints_px),
            repeated(self.covariance_px2),
            repeated(self.boxes_px),
            Camera(*map(repeated, self.camera)),
            Hull(*map(repeated, self.hull)),
        )

    def with_noise(self, share: float, size_std: float = 0.0) -> "Cases":
        """The same boats, their keypoints doubted by ``share`` of a boat's size more, and that by ``size_std``."""
        noise = KeypointNoise()
        noise.set_share(share)
        noise.set_size_std(size_std)
        covariance_px2 = noise(self.covariance_px2, self.boxes_px)
        return dataclasses.replace(self, covariance_px2=covariance_px2, hull=noise.resized(self.hull))


def native_cases(boats: Sequence[tuple[BoatRecord, Frame]]) -> Cases:
    """Predicted boats with the frames they are in, both in native pixels."""
    return Cases(
        torch.from_numpy(np.stack([boat.keypoints_px for boat, _ in boats])),
        torch.from_numpy(np.stack([boat.keypoint_covariance_px2 for boat, _ in boats])),
        torch.from_numpy(np.stack([boat.box_px for boat, _ in boats])),
        camera_to(stack_cameras([frame.camera for _, frame in boats]), dtype=torch.float64),
        hull_to(stack_hulls([frame.hull for _, frame in boats]), dtype=torch.float64),
    )


def range_cases(cases: Cases, ranging: RangingLayer) -> dict[str, RangeEstimate]:
    """Every estimator's answer, each of shape (C,), by its name in :class:`usvnet.types.Prediction`."""
    keypoints_px, covariance_px2 = cases.keypoints_px.unsqueeze(1), cases.covariance_px2.unsqueeze(1)
    ranges = ranging(keypoints_px, covariance_px2, cases.boxes_px.unsqueeze(1), cases.camera, cases.hull)
    named = {name: getattr(ranges, name) for name in ESTIMATORS}
    return {name: RangeEstimate(*(field.squeeze(1) for field in estimate)) for name, estimate in named.items()}


def slants_m(cases: Cases, ranging: RangingLayer) -> dict[str, Tensor]:
    """Slant ranges (C,) by estimator, inf where there is none."""
    return {
        name: torch.where(estimate.valid, estimate.slant_m, torch.inf)
        for name, estimate in range_cases(cases, ranging).items()
    }


def range_anew(
    ranged: Sequence[RangedBoat],
    cases: Cases,
    ranging: RangingLayer,
    factors: Mapping[str, IntervalFactors] | None = None,
) -> list[RangedBoat]:
    """The same boats with the ranges that other pixels, covariances or cameras give.

    Args:
        ranged: laser-ranged boats; those that were missed stay missed.
        cases: one for each that was found, in the same order.
        ranging: the geometry.
        factors: of the intervals, by estimator; none leaves the standard deviations raw.

    Raises:
        ValueError: not as many cases as found boats.
    """
    found = sum(item.boat is not None for item in ranged)
    if cases.count != found:
        raise ValueError(f"got {cases.count} cases for {found} boats that were found")
    with torch.inference_mode():
        estimates = range_cases(cases, ranging)
    applied = {name: (factors or {}).get(name, UNCALIBRATED) for name in ESTIMATORS}
    anew, case = [], itertools.count()
    for item in ranged:
        boat = item.boat
        if boat is not None:
            n = next(case)
            ranges = {name: _record(estimates[name], n, applied[name]) for name in ESTIMATORS}
            boat = dataclasses.replace(boat, ranges=ranges)
        anew.append(dataclasses.replace(item, boat=boat))
    return anew


def _record(estimate: RangeEstimate, n: int, factors: IntervalFactors) -> RangeRecord:
    """The n-th of the estimates of shape (C,)."""
    return RangeRecord(
        slant_m=float(estimate.slant_m[n]),
        slant_std_m=float(estimate.slant_std_m[n]) * factors.factor_90,
        horizontal_m=float(estimate.horizontal_m[n]),
        bearing_rad=float(estimate.bearing_rad[n]),
        position_m=estimate.position_m[n].numpy(),
        valid=bool(estimate.valid[n]),
        reason=Reason(int(estimate.reason[n])),
        factors=factors,
    )
