"""Hull files: where the seven keypoints sit on a known boat.

The hull frame: x forward, y to port, z up, in metres, with the origin amidships on the resting waterline::

    keypoints:
      bow: [0.73, 0.0, 0.16]
      ...
"""

from pathlib import Path

import torch
from torch import Tensor

from usvnet.files import atomic_write
from usvnet.geometry.yaml_files import as_mapping, as_numbers, decimal_text, read_mapping, refuse_unknown, require
from usvnet.types import KEYPOINT_NAMES, NUM_KEYPOINTS


def load_hull(path: Path | str) -> Tensor:
    """Read the keypoints (7, 3) of a hull, float32 metres, in the order of ``KEYPOINT_NAMES``.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file and key that is missing, unknown or not three finite numbers.
    """
    path = Path(path)
    where = f"{path}: keypoints"
    keypoints = as_mapping(require(read_mapping(path), "keypoints", f"{path}"), where)
    refuse_unknown(keypoints, KEYPOINT_NAMES, where)
    rows = []
    for name in KEYPOINT_NAMES:
        row = as_numbers(require(keypoints, name, where), f"{where}: {name}")
        if len(row) != 3:
            raise ValueError(f"{where}: {name}: expected x, y and z, got {len(row)} numbers")
        rows.append(row)
    return torch.tensor(rows)


def save_hull(keypoints_m: Tensor, path: Path | str) -> None:
    """Write the keypoints (7, 3) of a hull, metres, so that :func:`load_hull` gives them back bit by bit (as float32).

    Raises:
        ValueError: another shape, or numbers that are not finite.
    """
    if keypoints_m.shape != (NUM_KEYPOINTS, 3) or not bool(torch.isfinite(keypoints_m).all()):
        raise ValueError(f"{path}: expected 7 x 3 finite numbers, got shape {tuple(keypoints_m.shape)}")
    lines = ["# metres, hull frame: x forward, y port, z up, origin amidships on the resting waterline", "keypoints:"]
    for name, keypoint in zip(KEYPOINT_NAMES, keypoints_m):
        lines.append(f"  {name}: [{', '.join(decimal_text(coordinate) for coordinate in keypoint)}]")
    with atomic_write(path) as temporary:
        temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")
