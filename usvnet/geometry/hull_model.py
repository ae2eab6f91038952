"""Hulls: the shape that stands in for an unknown one, and moving hulls with their pictures."""

from collections.abc import Sequence

import torch

from usvnet.types import FLIP_INDEX, Hull

GENERIC_SHAPE = (
    (0.50, 0.000, 0.157),
    (0.30, 0.114, 0.134),
    (0.30, -0.114, 0.134),
    (0.38, 0.000, 0.000),
    (-0.50, 0.138, 0.110),
    (-0.50, -0.138, 0.110),
    (-0.50, 0.000, 0.000),
)
"""Keypoints over length: the mean of the eight small monohulls in data/sample/hulls, each divided by its length."""
GENERIC_LENGTH_M = 1.1
"""Mean length of the same eight."""
GENERIC_SCALE_STD = 1.0
"""A boat of which nothing is known may well be three times as long or as short: its size says little of its range."""
GENERIC_POINT_STD = 0.10
"""Share of the length by which a coordinate of an unknown boat strays. It is 0.017 among those eight, which are of a
kind, and 0.033 among the simulator's 84 hulls of five families, where beams stray by 0.05 and those of catamarans by
0.10, all four together: the fit takes coordinates to stray each for itself, and with the 0.03 that this was, the fused
range of a boat of another family was worse than that of its waterline keypoint alone."""


def generic_hull(batch: int = 1) -> Hull:
    """The hull to use when none is known, ``batch`` times; float32."""
    one = torch.ones(batch)
    return Hull(
        points_m=(GENERIC_LENGTH_M * torch.tensor(GENERIC_SHAPE)).expand(batch, -1, -1),
        scale_std=GENERIC_SCALE_STD * one,
        point_std_m=GENERIC_POINT_STD * GENERIC_LENGTH_M * one,
    )


def stack_hulls(hulls: Sequence[Hull]) -> Hull:
    """Join batches of hulls into one."""
    return Hull(*(torch.cat(field) for field in zip(*hulls)))


def hull_to(hull: Hull, device: torch.device | str | None = None, dtype: torch.dtype | None = None) -> Hull:
    """Move every tensor of a hull to a device and dtype."""
    return Hull(*(field.to(device=device, dtype=dtype) for field in hull))


def mirror_hull(hull: Hull) -> Hull:
    """The hull that a mirrored picture shows: y turned round, port and starboard changed over."""
    across = torch.tensor([1.0, -1.0, 1.0], dtype=hull.points_m.dtype, device=hull.points_m.device)
    return hull._replace(points_m=hull.points_m[:, list(FLIP_INDEX)] * across)
