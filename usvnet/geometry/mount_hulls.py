"""A fixed camera's pitch and roll from boats of known shape, wherever they were: nobody measures a range.

How large a boat looks tells how far away it is, and so how far below the horizontal its waterline should be seen; what
is missing is the camera's error. One boat tells that badly, but the mount is wrong by the same angle for all of them.
So may be their size: a network that draws keypoints 2 % too close together shifts every range by the same share, while
a wrong pitch shifts it by one that grows with the range. Boats near and far tell one from the other.

Each boat is fitted by itself (:mod:`usvnet.geometry.hull_fit`), which gives the mean m_i and the covariance C_i of u,
its size and the camera's height, pitch, roll and focal length in their standard deviations, under a unit prior. What
the boat alone says of them is the information L_i = C_i^-1 - I with L_i u = C_i^-1 m_i, and all of them together say

    (P + sum_i L_i) u = P p + sum_i C_i^-1 m_i,

P being the prior's information and p its mean, seen from the mount about which the fits are linear. Waves lift every
boat by itself: the height at one boat is the mount's and a share that counts for this boat only.
"""

import math
from typing import NamedTuple

import torch
from torch import Tensor

from usvnet.geometry.camera import camera_to
from usvnet.geometry.hull_fit import HullFit, chi_squared_limit, fit_hulls
from usvnet.geometry.hull_model import hull_to
from usvnet.geometry.hull_sight import sight_hulls
from usvnet.geometry.lens import Undistorted, undistort
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import Camera, Hull

SHARED = [3, 6, 7, 8, 9]
"""Of the fit's state: size, and the camera's height, pitch, roll and focal length."""
SIZE, HEIGHT, PITCH, ROLL = 0, 1, 2, 3
SIZE_STD = 0.03
"""How much larger or smaller than they are a network may draw all boats."""
UNKNOWN_STD_RAD = math.radians(3)
"""Of a pitch or roll whose standard deviation is given as 0: not known."""
LEAST_BOATS = 5
GROUPS = 20
"""Of boats that follow each other: the mount is found again without each of them."""
MAX_ROUNDS = 20
TOLERANCE = 1e-4
"""Standard deviations that the mount still moves by when it counts as found."""


class HullMount(NamedTuple):
    """A mount found from boats, and how well it is known."""

    camera: Camera
    """The camera (B = 1) with new pitch and roll, and their sigmas."""
    size: float
    """How much larger than their hull the boats are drawn, as a factor."""
    size_std: float
    fits: Tensor
    """(C,) bool, whether a boat fits the hull and was used."""


def fit_mount_to_hulls(
    keypoints_px: Tensor,
    covariance_px2: Tensor,
    camera: Camera,
    hull: Hull,
    size_std: float = SIZE_STD,
    curved_water: bool = False,
) -> HullMount:
    """Find pitch and roll of a camera that saw C boats of one hull, in the order in which it saw them.

    The sigmas are what the keypoints' covariances say, or, if that is more, what the scatter between groups of boats
    says (a jackknife): frames of one video err together.

    Args:
        keypoints_px: (C, 7, 2)
        covariance_px2: (C, 7, 2, 2)
        camera: its lens, and the mount to begin from with its sigmas (B = 1).
        hull: of the boats (B = 1).
        size_std: how much larger or smaller all boats may be drawn, as one standard deviation.
        curved_water: whether the water is curved.

    Raises:
        ValueError: too few of the boats fit the hull.
    """
    camera, hull = camera_to(camera, dtype=torch.float64), hull_to(hull, dtype=torch.float64)
    start = camera._replace(pitch_std_rad=_known(camera.pitch_std_rad), roll_std_rad=_known(camera.roll_std_rad))
    stds = torch.cat([start.pitch_std_rad, start.roll_std_rad])
    by_size = torch.hypot(hull.scale_std, torch.tensor(size_std).double())
    waves = start.wave_std_m.square() / (start.height_std_m.square() + start.wave_std_m.square()).clamp_min(1e-12)
    prior = torch.ones(len(SHARED), dtype=torch.float64)
    prior[HEIGHT] = 1 / (1 - waves).clamp_min(1e-6)
    count, ranging = len(keypoints_px), RangingLayer(curved_water)
    sized, covariance_px2 = Hull(*_repeated(hull._replace(scale_std=by_size), count)), covariance_px2.double()
    lens = undistort(keypoints_px.double(), Camera(*_repeated(camera, count)))  # no mount has a part in it

    mount, moved = start, torch.zeros(2, dtype=torch.float64)
    for _ in range(MAX_ROUNDS):
        fit = _fit(lens, covariance_px2, Camera(*_repeated(mount, count)), sized, ranging)
        misfit = (fit.cost / chi_squared_limit(fit.degrees_of_freedom))[:, 0]
        fits = (misfit <= ranging.misfit_limit) & (fit.degrees_of_freedom[:, 0] > 0)
        if int(fits.sum()) < LEAST_BOATS:
            raise ValueError(f"{int(fits.sum())} of {len(fits)} boats fit the hull, expected at least {LEAST_BOATS}")
        information, pull = _said_by_each(fit, waves)
        information, pull = information[fits], pull[fits]
        mean = torch.zeros_like(prior)
        mean[[PITCH, ROLL]] = -moved
        shared = _solve(information.sum(0), pull.sum(0), prior, mean)
        step = shared[[PITCH, ROLL]]
        moved = moved + step
        mount = mount._replace(
            pitch_rad=start.pitch_rad + moved[:1] * stds[:1], roll_rad=start.roll_rad + moved[1:] * stds[1:]
        )
        if float(step.abs().max()) < TOLERANCE:
            break

    claimed = torch.linalg.inv(torch.diag(prior) + information.sum(0)).diagonal().sqrt()
    std = torch.maximum(claimed, _jackknife_std(information, pull, prior, mean))
    found = mount._replace(pitch_std_rad=std[PITCH] * stds[:1], roll_std_rad=std[ROLL] * stds[1:])
    log_size, log_size_std = (float(value[SIZE] * by_size) for value in (shared, std))
    return HullMount(found, math.exp(log_size), log_size_std, fits)


def _known(std_rad: Tensor) -> Tensor:
    return torch.where(std_rad > 0, std_rad, torch.full_like(std_rad, UNKNOWN_STD_RAD))


def _repeated(one: Camera | Hull, count: int) -> list[Tensor]:
    """The fields of one camera or hull for each of ``count`` boats."""
    return [field.expand(count, *field.shape[1:]) for field in one]


def _fit(lens: Undistorted, covariance_px2: Tensor, camera: Camera, hull: Hull, ranging: RangingLayer) -> HullFit:
    """Every boat in a picture of its own: (C, 1, ...)."""
    stds = (ranging.boat_roll_std_rad, ranging.boat_pitch_std_rad)
    with torch.no_grad():
        return fit_hulls(sight_hulls(lens, covariance_px2.unsqueeze(1), camera, hull, *stds, ranging.curvature_per_m))


def _said_by_each(fit: HullFit, waves: Tensor) -> tuple[Tensor, Tensor]:
    """L_i (C, 5, 5) and L_i u_i (C, 5), the part of the height that is this boat's alone left open.

    Args:
        fit: of C boats.
        waves: (1,) share of the waves in the variance of the height at a boat.
    """
    covariance = fit.covariance[:, 0][:, SHARED][:, :, SHARED]
    inverse = torch.linalg.inv(covariance)
    pull = (inverse * fit.state[:, 0, SHARED].unsqueeze(1)).sum(-1)
    information = inverse - torch.eye(len(SHARED), dtype=inverse.dtype)
    by_height = information[:, :, HEIGHT]
    share = waves / (1 + waves * by_height[:, HEIGHT])  # Woodbury's identity
    freed = information - share[:, None, None] * by_height.unsqueeze(2) * by_height.unsqueeze(1)
    return freed, pull - (share * pull[:, HEIGHT]).unsqueeze(1) * by_height


def _solve(information: Tensor, pull: Tensor, prior: Tensor, mean: Tensor) -> Tensor:
    """The u (5,) that boats with this information (5, 5) and pull (5,) and the prior say together."""
    return torch.linalg.solve(torch.diag(prior) + information, prior * mean + pull)


def _jackknife_std(information: Tensor, pull: Tensor, prior: Tensor, mean: Tensor, groups: int = GROUPS) -> Tensor:
    """Standard deviations (5,) of u by the scatter of the answers without each group of neighbouring boats."""
    parts = torch.arange(len(pull)).tensor_split(min(groups, len(pull)))
    whole, all_pull = information.sum(0), pull.sum(0)
    without = torch.stack(
        [_solve(whole - information[part].sum(0), all_pull - pull[part].sum(0), prior, mean) for part in parts]
    )
    count = len(parts)
    return ((without - without.mean(0)).square().sum(0) * (count - 1) / count).sqrt()
