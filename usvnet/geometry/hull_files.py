"""Hull files: where the seven keypoints sit on a known boat, and how well that is known.

The hull frame: x forward, y to port, z up, in metres, with the origin amidships on the resting waterline::

    keypoints:
      bow: [0.73, 0.0, 0.16]
      ...
    scale_std: 0.02
    point_std_m: 0.005

``scale_std``, the relative standard deviation of the boat's size, and ``point_std_m``, that of each coordinate, may
be left out (then 0).
"""

from pathlib import Path

import torch
from torch import Tensor

from usvnet.files import atomic_write
from usvnet.geometry.yaml_files import (
    as_mapping,
    as_numbers,
    decimal_text,
    read_mapping,
    read_std,
    refuse_unknown,
    require,
)
from usvnet.types import KEYPOINT_NAMES, NUM_KEYPOINTS, Hull

LENGTHS_M = (0.1, 200.0)
"""Shorter is in other units, and longer, too."""
OFF_WATER = 0.02
"""How far from the resting waterline its two points may lie, as a share of the length."""
KEYS = ("keypoints", "scale_std", "point_std_m")


def load_hull(path: Path | str) -> Hull:
    """Read a hull file as one float32 hull (a batch of 1).

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file and key that is missing, unknown or not as expected.
    """
    path = Path(path)
    where = f"{path}: keypoints"
    content = read_mapping(path)
    keypoints = as_mapping(require(content, "keypoints", f"{path}"), where)
    refuse_unknown(content, KEYS, f"{path}")
    refuse_unknown(keypoints, KEYPOINT_NAMES, where)
    rows = []
    for name in KEYPOINT_NAMES:
        row = as_numbers(require(keypoints, name, where), f"{where}: {name}")
        if len(row) != 3:
            raise ValueError(f"{where}: {name}: expected x, y and z, got {len(row)} numbers")
        rows.append(row)
    scale_std, point_std_m = (torch.tensor([read_std(content, key, f"{path}")]) for key in KEYS[1:])
    _check_shape(torch.tensor(rows, dtype=torch.float64), where)
    return Hull(torch.tensor([rows]), scale_std, point_std_m)


def _check_shape(points_m: Tensor, where: str) -> None:
    """Insist on a boat in the hull frame: a z that is measured from the keel would make every range wrong."""
    bow, left, right, stem, aft_left, aft_right, aft = points_m
    length_m = float(bow[0] - aft[0])
    if not LENGTHS_M[0] <= length_m <= LENGTHS_M[1]:
        raise ValueError(
            f"{where}: bow lies {length_m:g} m ahead of stern_bottom, expected {LENGTHS_M[0]:g} to {LENGTHS_M[1]:g} m: "
            "x points forward, in metres"
        )
    if left[1] <= right[1] or aft_left[1] <= aft_right[1]:
        raise ValueError(f"{where}: expected greater y of bow_left and stern_left than of the right ones")
    if stem[0] <= aft[0]:
        raise ValueError(f"{where}: expected bow_bottom at greater x than stern_bottom")
    for name, point in (("bow_bottom", stem), ("stern_bottom", aft)):
        if abs(float(point[2])) > OFF_WATER * length_m:
            raise ValueError(f"{where}: {name}: z is {point[2]:g}, expected 0, on the resting waterline")


def save_hull(hull: Hull, path: Path | str) -> None:
    """Write one hull (a batch of 1) so that :func:`load_hull` gives it back bit by bit (as float32).

    Raises:
        ValueError: another shape, or numbers that are not finite.
    """
    points = hull.points_m
    if points.shape != (1, NUM_KEYPOINTS, 3) or not all(bool(torch.isfinite(field).all()) for field in hull):
        raise ValueError(f"{path}: expected one hull of 7 x 3 finite numbers, got shape {tuple(points.shape)}")
    lines = ["# metres, hull frame: x forward, y port, z up, origin amidships on the resting waterline", "keypoints:"]
    for name, keypoint in zip(KEYPOINT_NAMES, points[0]):
        lines.append(f"  {name}: [{', '.join(decimal_text(coordinate) for coordinate in keypoint)}]")
    lines += [f"scale_std: {decimal_text(hull.scale_std[0])}", f"point_std_m: {decimal_text(hull.point_std_m[0])}"]
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")
