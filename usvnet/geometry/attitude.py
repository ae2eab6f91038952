"""Pitch and roll from several sources, each with its standard deviation, joined into one.

A source is the mount, an IMU, or the horizon in the picture (:mod:`usvnet.geometry.horizon`). One that says nothing
about a picture has an infinite standard deviation there.
"""

from typing import List, NamedTuple, Tuple

import torch
from torch import Tensor

from usvnet.types import Camera

MIN_STD_RAD = 1e-9
"""So that a standard deviation of 0 has a finite weight."""


class Attitude(NamedTuple):
    """How B cameras stand in the level frame; the fields are the arguments of ``with_attitude`` after the camera."""

    pitch_rad: Tensor
    """(B,) optical axis below the horizontal."""
    roll_rad: Tensor
    """(B,) clockwise seen from behind."""
    pitch_std_rad: Tensor
    """(B,) inf where the source says nothing."""
    roll_std_rad: Tensor
    """(B,) inf where the source says nothing."""


class Combined(NamedTuple):
    """Several sources as one."""

    attitude: Attitude
    consistent: Tensor
    """(B,) bool, False where two sources contradict each other, and the widest of them was taken alone."""


def camera_attitude(camera: Camera) -> Attitude:
    """The attitude that cameras have now: their mount's, unless it was replaced."""
    return Attitude(camera.pitch_rad, camera.roll_rad, camera.pitch_std_rad, camera.roll_std_rad)


def combine(sources: List[Attitude], gate: float = 4.0, min_std_rad: float = MIN_STD_RAD) -> Combined:
    """Join independent sources by inverse variance, x = sum(x_i / s_i^2) / sum(1 / s_i^2), for each angle.

    Two sources contradict each other where their difference in either angle has a chi-squared, of one degree of
    freedom, above ``gate`` squared: then one of them is wrong by more than it says, and the source with the largest
    (finite) standard deviations is taken alone, because it promises least.

    Args:
        sources: at least one; their errors are taken as independent.
        gate: largest difference that counts as chance, in standard deviations of that difference.
        min_std_rad: smaller standard deviations count as this.
    """
    pitch = torch.stack([source.pitch_rad for source in sources])
    roll = torch.stack([source.roll_rad for source in sources])
    pitch_std = torch.stack([source.pitch_std_rad for source in sources]).clamp_min(min_std_rad)
    roll_std = torch.stack([source.roll_std_rad for source in sources]).clamp_min(min_std_rad)
    worst = torch.zeros_like(pitch[0])
    for i in range(len(sources)):
        for j in range(i):
            worst = torch.maximum(worst, _chi_squared(pitch, pitch_std, i, j))
            worst = torch.maximum(worst, _chi_squared(roll, roll_std, i, j))
    consistent = worst <= gate * gate

    spread = pitch_std * pitch_std + roll_std * roll_std
    widest = torch.where(torch.isfinite(spread), spread, -torch.ones_like(spread)).argmax(0, keepdim=True)
    mean_pitch, mean_pitch_std = _weighted_mean(pitch, pitch_std)
    mean_roll, mean_roll_std = _weighted_mean(roll, roll_std)
    attitude = Attitude(
        torch.where(consistent, mean_pitch, pitch.gather(0, widest)[0]),
        torch.where(consistent, mean_roll, roll.gather(0, widest)[0]),
        torch.where(consistent, mean_pitch_std, pitch_std.gather(0, widest)[0]),
        torch.where(consistent, mean_roll_std, roll_std.gather(0, widest)[0]),
    )
    return Combined(attitude, consistent)


def _chi_squared(angle: Tensor, std: Tensor, i: int, j: int) -> Tensor:
    difference = angle[i] - angle[j]
    return difference * difference / (std[i] * std[i] + std[j] * std[j])


def _weighted_mean(angle: Tensor, std: Tensor) -> Tuple[Tensor, Tensor]:
    """Mean (B,) and standard deviation (B,) of sources (S, B); the first source's angle where none says anything."""
    weight = (1 / std) ** 2  # in this order the gradient at infinity is 0
    total = weight.sum(0)
    known = total > 0
    safe = torch.where(known, total, torch.ones_like(total))
    mean = (weight * angle).sum(0) / safe
    return (
        torch.where(known, mean, angle[0]),
        torch.where(known, torch.rsqrt(safe), torch.full_like(total, float("inf"))),
    )
