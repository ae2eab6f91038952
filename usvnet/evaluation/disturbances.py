"""What can be wrong between the water and the range, one kind at a time: exactly, and to first order.

A disturbance is the error of what is believed: ``pitch_deg`` of 0.3 ranges with a pitch that is 0.3 degrees more than
the true one. Water that stands higher at the boat by ``wave_m`` is a camera believed that much too high.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from usvnet.evaluation.reranging import Cases, slants_m
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import NUM_KEYPOINTS, Camera


def _focal(camera: Camera, amount: Tensor) -> Camera:
    """Fy wrong by the amount, fx by the same share."""
    K = camera.K.clone()
    share = 1 + amount / camera.K[:, 1, 1]
    K[:, 0, 0], K[:, 1, 1] = camera.K[:, 0, 0] * share, camera.K[:, 1, 1] * share
    return camera._replace(K=K)


def _centre(camera: Camera, amount: Tensor, axis: int) -> Camera:
    K = camera.K.clone()
    K[:, axis, 2] = camera.K[:, axis, 2] + amount
    return camera._replace(K=K)


def _radial(camera: Camera, amount: Tensor) -> Camera:
    distortion = camera.distortion.clone()
    distortion[:, 0] = camera.distortion[:, 0] + amount
    return camera._replace(distortion=distortion)


def _height(camera: Camera, amount: Tensor) -> Camera:
    return camera._replace(height_m=camera.height_m + amount)


@dataclass(frozen=True)
class Disturbance:
    """One kind of error."""

    title: str
    unit: str
    change: Callable[[Camera, Tensor], Camera] | None
    """What it does to C cameras, given C amounts; None for noise of the pixels."""
    noise: bool = False
    """Whether its amount is a standard deviation, new at every boat, or an error that stays."""


DISTURBANCES = {
    "focal_px": Disturbance("focal length", "px", _focal),
    "pitch_deg": Disturbance(
        "pitch", "deg", lambda camera, deg: camera._replace(pitch_rad=camera.pitch_rad + torch.deg2rad(deg))
    ),
    "roll_deg": Disturbance(
        "roll", "deg", lambda camera, deg: camera._replace(roll_rad=camera.roll_rad + torch.deg2rad(deg))
    ),
    "height_m": Disturbance("height", "m", _height),
    "centre_u_px": Disturbance("principal point, u", "px", lambda camera, px: _centre(camera, px, 0)),
    "centre_v_px": Disturbance("principal point, v", "px", lambda camera, px: _centre(camera, px, 1)),
    "distortion_k1": Disturbance("lens distortion k1", "", _radial),
    "keypoint_px": Disturbance("keypoints", "px", None, noise=True),
    "wave_m": Disturbance("waves", "m", _height, noise=True),
}
"""By the name that a configuration gives it."""


def amount_shape(name: str, count: int) -> tuple[int, ...]:
    """Shape of the amounts of a disturbance of ``count`` boats: pixels stray each for itself, the box as the last."""
    return (count, NUM_KEYPOINTS + 1, 2) if DISTURBANCES[name].change is None else (count,)


def fixed_amount(name: str, value: float, count: int) -> Tensor:
    """The same error at every one of ``count`` boats."""
    return torch.full(amount_shape(name, count), value, dtype=torch.float64)


def drawn_amount(name: str, std: float, count: int, generator: torch.Generator) -> Tensor:
    """A Gaussian error for each of ``count`` boats."""
    return std * torch.randn(amount_shape(name, count), dtype=torch.float64, generator=generator)


def disturb(cases: Cases, name: str, amount: Tensor) -> Cases:
    """The same boats with something wrong.

    Args:
        cases: C boats.
        name: of the disturbance, a key of :data:`DISTURBANCES`.
        amount: of the shape :func:`amount_shape` gives, in the unit of the name.
    """
    change = DISTURBANCES[name].change
    if change is not None:
        return replace(cases, camera=change(cases.camera, amount))
    return replace(
        cases,
        keypoints_px=cases.keypoints_px + amount[:, :NUM_KEYPOINTS],
        boxes_px=cases.boxes_px + amount[:, NUM_KEYPOINTS].repeat(1, 2),
    )


def slopes(cases: Cases, name: str, ranging: RangingLayer) -> dict[str, Tensor]:
    """Derivative of every estimator's slant range (C,) to the amount of a disturbance, by autograd.

    Returns:
        By estimator, of the shape :func:`amount_shape` gives; 0 where there is no range.
    """
    amount = fixed_amount(name, 0.0, cases.count).requires_grad_()
    found = slants_m(disturb(cases, name, amount), ranging)
    derivatives = {}
    for estimator, slant in found.items():
        total = torch.where(slant.isfinite(), slant, 0.0).sum()
        (derivatives[estimator],) = torch.autograd.grad(total, amount, retain_graph=True)
    return derivatives


def first_order_m(slope: Tensor, amount: Tensor) -> Tensor:
    """Change of range (C,) to first order."""
    return (slope * amount).flatten(1).sum(1) if slope.dim() > 1 else slope * amount


def first_order_std_m(slope: Tensor, std: float) -> Tensor:
    """Standard deviation of the range (C,) to first order, where every amount strays by ``std`` for itself."""
    return std * slope.flatten(1).norm(dim=1) if slope.dim() > 1 else std * slope.abs()


def known_stds(camera: Camera, keypoint_std_px: float) -> dict[str, float]:
    """How well each thing is known, by disturbance: the keypoints, and what a camera file (a batch of 1) says."""
    return {
        "keypoint_px": keypoint_std_px,
        "focal_px": float(camera.focal_std_px[0]),
        "pitch_deg": math.degrees(float(camera.pitch_std_rad[0])),
        "roll_deg": math.degrees(float(camera.roll_std_rad[0])),
        "height_m": float(camera.height_std_m[0]),
        "wave_m": float(camera.wave_std_m[0]),
    }
