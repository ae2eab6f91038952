"""A camera's height, pitch and roll from what it sees: weighted least squares over readings whose geometry is known.

Every reading says how far below the horizontal its ray should point, and that hardly depends on how far away it is, so
that Gauss and Newton's method (in float64) converges from any mount of the right order:

    range D       sin d = (h (2 R + h) + D^2) / (2 (R + h) D)       on the curved water, from the law of cosines
    point (X, Z, up)   tan d = (h - up) / hypot(X, Z)                and its azimuth, but for one heading of the camera
    horizon       d = dip(h)

The camera file's sigmas are priors. What is held fixed keeps its sigma, which then counts in the others' (they are
"consider" parameters): a pitch found with a height that is 2 cm wrong is wrong, too.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from usvnet.geometry.mount_readings import MountReading
from usvnet.geometry.rays import level_rotation, trace_pixels
from usvnet.geometry.water import effective_radius_m, horizon_dip_rad
from usvnet.types import Camera

NAMES = ("height", "pitch", "roll", "heading")
HEADING = 3
MAX_STEPS = 50
TOLERANCE = 1e-10
WORST_HEIGHT_STD = 0.5
"""Share of its height up to which a camera's height counts as found,"""
WORST_ANGLE_STD_RAD = math.radians(5)
"""and the same for an angle."""
CHANCE = 0.01
"""A chi-squared less likely than this says that the readings are worse than they claim."""


class MountFit(NamedTuple):
    """A mount and how well it is known."""

    camera: Camera
    """The camera (B = 1) with its new mount and sigmas."""
    residuals: Tensor
    """(N,) of each reading in standard deviations: how far its ray is below where it should be."""
    residuals_px: Tensor
    """(N,) the same in rows of the picture, turned with its roll."""
    chi_squared: float
    degrees_of_freedom: int
    probability: float
    """Of a chi-squared this large by chance; 1 without degrees of freedom."""
    inflation: float
    """Factor on the sigmas, above 1 where the readings scatter by more than they claim."""
    correlation: float
    """Between the errors of height and pitch; a camera file cannot keep it. 0 where one of them is held fixed."""


def fit_mount(
    readings: Sequence[MountReading], camera: Camera, hold: Sequence[str] = (), priors: bool = True
) -> MountFit:
    """Estimate how a camera is mounted.

    Args:
        readings: what it saw.
        camera: its lens, the mount to begin from, and the mount's sigmas; a sigma of 0 is not known.
        hold: which of ``height``, ``pitch`` and ``roll`` are taken as they are.
        priors: let the mount and its sigmas count as one more reading each.

    Raises:
        ValueError: the readings leave something open that is not held fixed, saying what.
    """
    camera = Camera(*(field.double() for field in camera))
    start = torch.cat([camera.height_m, camera.pitch_rad, camera.roll_rad, torch.zeros(1, dtype=torch.float64)])
    stds = torch.cat([camera.height_std_m, camera.pitch_std_rad, camera.roll_std_rad, torch.zeros(1).double()])
    has_points = bool(_points(readings))
    free = torch.tensor([name not in hold for name in NAMES[:HEADING]] + [has_points])
    known = free & (stds > 0) & priors
    prior = torch.where(known, 1 / torch.where(known, stds, torch.ones_like(stds)) ** 2, torch.zeros_like(stds))
    if not bool(free[:HEADING].any()):
        raise ValueError("height, pitch and roll are all held fixed, expected at least one to find")
    sights, wave_std_m = _look(readings, camera), camera.wave_std_m.item()
    guessed = bool(free[0] & ~known[0])
    _check_pixels(readings, sights, camera, math.inf if guessed else float(stds[0]))

    state = start.clone()
    if guessed:  # no camera is higher than what it ranges is far, and there the slopes say nothing
        state[0] = min([float(state[0]), *(0.95 * reading.range_m for reading in readings if reading.kind == "range")])
    if has_points:
        state[HEADING] = _heading(state, readings, sights)
    for _ in range(MAX_STEPS):
        misses, J = _linearise(state, readings, sights, wave_std_m)
        information = J.T @ J + torch.diag(prior)
        _check_observable(information[free][:, free], state, free)
        pull = J.T @ misses + prior * (state - start)
        step = torch.zeros_like(state)
        step[free] = torch.linalg.solve(information[free][:, free], -pull[free])
        step[0] = step[0].clamp(-state[0] / 2, state[0])  # the camera stays above the water
        state = state + step
        if bool((step.abs() < TOLERANCE).all()):
            break
    else:
        raise ValueError(
            f"no mount was found in {MAX_STEPS} steps from a height of {float(start[0]):g} m: a reading or the "
            "camera file's mount may be wrong by far"
        )

    misses, J = _linearise(state, readings, sights, wave_std_m)
    information = J.T @ J + torch.diag(prior)
    inverse = torch.linalg.inv(information[free][:, free])
    gain = inverse @ information[free][:, ~free]
    chi_squared = float((misses**2).sum() + (prior * (state - start) ** 2).sum())
    freedom = len(misses) + int(known.sum()) - int(free.sum())
    probability = _probability(chi_squared, freedom)
    inflation = math.sqrt(chi_squared / freedom) if probability < CHANCE else 1.0
    covariance = torch.diag(stds**2)
    by_focal = inverse @ _pull_of_focal(state, readings, camera, wave_std_m, prior * (state - start))[free]
    held = gain @ torch.diag(stds[~free] ** 2) @ gain.T + torch.outer(by_focal, by_focal)
    covariance[free.nonzero(), free.nonzero().T] = inverse * inflation**2 + held
    new_stds = covariance.diagonal().sqrt()
    both = bool(free[:2].all())
    mounted = camera._replace(
        height_m=state[:1],
        pitch_rad=state[1:2],
        roll_rad=state[2:3],
        height_std_m=new_stds[:1],
        pitch_std_rad=new_stds[1:2],
        roll_std_rad=new_stds[2:3],
    )
    residuals = misses[: len(readings)]
    return MountFit(
        camera=mounted,
        residuals=residuals,
        residuals_px=residuals * _stds(state, readings, sights, wave_std_m)[: len(readings)] * camera.K[0, 1, 1],
        chi_squared=chi_squared,
        degrees_of_freedom=freedom,
        probability=probability,
        inflation=inflation,
        correlation=float(covariance[0, 1] / (new_stds[0] * new_stds[1])) if both else 0.0,
    )


def _pull_of_focal(
    state: Tensor, readings: Sequence[MountReading], camera: Camera, wave_std_m: float, pull: Tensor
) -> Tensor:
    """How a focal length wrong by its standard deviation pulls at a fitted state (4,), where ``pull`` held it."""
    wrong = camera._replace(K=camera.K.clone())
    wrong.K[:, [0, 1], [0, 1]] *= 1 + camera.focal_std_px / camera.K[:, 1, 1]
    misses, J = _linearise(state, readings, _look(readings, wrong), wave_std_m)
    return J.T @ misses + pull


class _Sights(NamedTuple):
    """The readings' rays in the camera frame, traced once."""

    rays: Tensor
    """(N, 3) unit vectors."""
    by_px: Tensor
    """(N, 3, 2) their derivative to the pixel."""
    valid: Tensor
    """(N,) bool."""


def _look(readings: Sequence[MountReading], camera: Camera) -> _Sights:
    level = torch.zeros_like(camera.pitch_rad)
    pixels = torch.tensor([[[reading.u_px, reading.v_px] for reading in readings]], dtype=torch.float64)
    found = trace_pixels(pixels, camera._replace(pitch_rad=level, roll_rad=level))
    focal = torch.stack([camera.K[0, 0, 0], camera.K[0, 1, 1]])
    return _Sights(found.direction[0], found.direction_by_xy[0] / focal, found.valid[0])


def _rotation(state: Tensor) -> Tensor:
    return level_rotation(state[1:2], state[2:3])[0]


def _linearise(
    state: Tensor, readings: Sequence[MountReading], sights: _Sights, wave_std_m: float
) -> tuple[Tensor, Tensor]:
    """Misses (M,) in standard deviations, N depressions and then the points' azimuths, and their Jacobian (M, 4)."""
    stds = _stds(state, readings, sights, wave_std_m)
    misses, jacobian = _misses(state, readings, sights)
    return misses / stds, jacobian / stds[:, None]


def _misses(state: Tensor, readings: Sequence[MountReading], sights: _Sights) -> tuple[Tensor, Tensor]:
    """Angles (M,) by which rays point below where they should, then those by which points lie too far right.

    With them their Jacobian (M, 4) to height, pitch, roll and heading. Pitch turns a direction about X, roll about the
    optical axis (0, sin pitch, cos pitch).
    """
    x, y, z = torch.unbind(sights.rays @ _rotation(state).T, -1)
    sp, cp = torch.sin(state[1]), torch.cos(state[1])
    level = torch.sqrt(x * x + z * z)
    expected, by_height = _depressions(state[0], readings)
    zero = torch.zeros_like(x)
    down = torch.stack([-by_height, z / level, cp * x / level, zero], -1)
    points = _points(readings)
    bearing = torch.tensor([math.atan2(readings[i].right_m, readings[i].forward_m) for i in points]).double()
    turn = torch.atan2(x, z)[points] + state[HEADING] - bearing
    right = torch.stack([zero, x * y / level**2, sp - cp * y * z / level**2, zero + 1], -1)[points]
    misses = torch.cat([torch.atan2(y, level) - expected, torch.atan2(torch.sin(turn), torch.cos(turn))])
    return misses, torch.cat([down, right])


def _depressions(height_m: Tensor, readings: Sequence[MountReading]) -> tuple[Tensor, Tensor]:
    """Angle (N,) below the horizontal where each reading should be seen from ``height_m`` (), and its derivative."""
    radius = effective_radius_m()
    centre = radius + height_m
    angles, slopes = [], []
    for reading in readings:
        if reading.kind == "range":
            distance = reading.range_m
            sine = ((height_m * (radius + centre) + distance**2) / (2 * centre * distance)).clamp(max=1 - 1e-9)
            angles.append(torch.asin(sine))
            slopes.append((1 / distance - sine / centre) / torch.sqrt(1 - sine**2))
        elif reading.kind == "point":
            below, along = height_m - reading.up_m, math.hypot(reading.right_m, reading.forward_m)
            angles.append(torch.atan(below / along))
            slopes.append(along / (along**2 + below**2))
        else:
            dip = horizon_dip_rad(height_m)
            angles.append(dip)
            slopes.append(radius / (centre**2 * torch.sin(dip)))
    return torch.stack(angles), torch.stack(slopes)


def _stds(state: Tensor, readings: Sequence[MountReading], sights: _Sights, wave_std_m: float) -> Tensor:
    """Standard deviations (M,) of the misses, rad: of the pixel, the range, and the waves under a ranged point."""
    R = _rotation(state)
    direction = sights.rays @ R.T
    level = direction[:, 0] ** 2 + direction[:, 2] ** 2  # squared cosine of the depression
    by_px = R @ sights.by_px
    pixel = torch.tensor([reading.pixel_std_px for reading in readings]).double()
    variance = pixel**2 * (by_px[:, 1] ** 2).sum(-1) / level
    for i, reading in enumerate(readings):
        if reading.kind == "range":  # d = asin(h / D), near enough
            by_height = 1 / (reading.range_m * torch.sqrt(level[i]))
            by_range = by_height * state[0] / reading.range_m
            variance[i] += (by_range * reading.range_std_m) ** 2 + (by_height * wave_std_m) ** 2
    points = _points(readings)
    across = (direction[:, 2:] * by_px[:, 0] - direction[:, :1] * by_px[:, 2]) / level[:, None]
    azimuth = pixel**2 * (across**2).sum(-1)
    return torch.cat([variance, azimuth[points]]).sqrt()


def _points(readings: Sequence[MountReading]) -> list[int]:
    return [i for i, reading in enumerate(readings) if reading.kind == "point"]


def _heading(state: Tensor, readings: Sequence[MountReading], sights: _Sights) -> float:
    """Heading of the camera by the first surveyed point, with the mount as it is."""
    first = _points(readings)[0]
    direction = _rotation(state) @ sights.rays[first]
    return math.atan2(readings[first].right_m, readings[first].forward_m) - math.atan2(direction[0], direction[2])


def _check_pixels(readings: Sequence[MountReading], sights: _Sights, camera: Camera, height_std_m: float) -> None:
    height_m = camera.height_m.item()
    least_m = max(height_m / 2 if math.isinf(height_std_m) else height_m - 3 * height_std_m, 0)
    width, height = camera.size_px[0].tolist()
    for reading, has_ray in zip(readings, sights.valid.tolist()):
        if not (-0.5 <= reading.u_px <= width - 0.5 and -0.5 <= reading.v_px <= height - 0.5) or not has_ray:
            raise ValueError(
                f"line {reading.line}: pixel ({reading.u_px:g}, {reading.v_px:g}) is outside the camera's "
                f"{width:g} x {height:g} picture, or its lens has no ray for it"
            )
        if reading.kind == "range" and reading.range_m <= least_m:
            raise ValueError(
                f"line {reading.line}: range_m is {reading.range_m:g}, expected more than {least_m:g}: the camera is "
                f"{height_m:g} m above the water"
            )


def _check_observable(information: Tensor, state: Tensor, free: Tensor) -> None:
    """Insist that no direction of the free parameters is left open, by the eigenvectors of their information."""
    worst = torch.tensor([WORST_HEIGHT_STD * float(state[0]), *[WORST_ANGLE_STD_RAD] * HEADING]).double()[free]
    values, vectors = torch.linalg.eigh(worst[:, None] * information * worst)
    if values[0] >= 1:
        return
    names = [name for name, is_free in zip(NAMES, free.tolist()) if is_free]
    share = vectors[:, 0].abs() / vectors[:, 0].abs().max()
    open_ones = [name for name, part in zip(names, share.tolist()) if part > 0.2]
    if len(open_ones) == 1:
        raise ValueError(f"the readings do not say the {open_ones[0]}: {_remedy(open_ones)}")
    raise ValueError(f"the readings cannot tell {' and '.join(open_ones)} apart: {_remedy(open_ones)}")


def _remedy(names: Sequence[str]) -> str:
    advice = {
        "height": "add ranges at other distances, near ones above all",
        "pitch": "add readings far away or the horizon",
        "roll": "add readings near the left and right edge of the picture",
        "heading": "add a surveyed point",
    }
    return f"{advice[names[0]]}, state its sigma in the camera file, or hold {names[0]} fixed"


def _probability(chi_squared: float, freedom: int) -> float:
    if freedom <= 0:
        return 1.0
    half = torch.tensor([freedom / 2, chi_squared / 2], dtype=torch.float64)
    return float(torch.special.gammaincc(half[0], half[1]))
