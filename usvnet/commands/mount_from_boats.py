"""The other way of ``usvnet calibrate-mount``: from predictions of boats whose hull is known, and no measured range."""

import json
import math
from pathlib import Path

import numpy as np
import torch
from rich.console import Console
from rich.table import Table

from usvnet.evaluation.predictions import read_predictions
from usvnet.evaluation.records import BoatRecord
from usvnet.geometry.hull_files import load_hull
from usvnet.geometry.mount_hulls import HullMount, fit_mount_to_hulls
from usvnet.types import Camera
from usvnet.wording import counted

SAYS_NOTHING = 0.9
"""A sigma that stays above this share of its prior's has learnt nothing."""
OFTEN = 0.2
"""Share of boats that do not fit their hull from which on somebody should look."""


def mount_from_boats(predictions: Path, camera: Camera, hull: Path, console: Console) -> Camera:
    """Find the mount and say how well.

    Args:
        predictions: of ``usvnet predict``: pictures of this camera, in which every boat is of the hull.
        camera: with a first guess of the mount.
        hull: hull file.
        console: where to say it.

    Returns:
        The camera with its new pitch and roll, and their sigmas.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a damaged file, pictures of another size than the camera's, or too few boats that fit.
    """
    if not predictions.is_file():
        raise FileNotFoundError(f"{predictions}: no such file")
    boats = [boat for picture in read_predictions(predictions) for boat in picture.boats]
    check_sizes(predictions, (int(camera.size_px[0, 0]), int(camera.size_px[0, 1])))
    try:
        found = fit_mount_to_hulls(*_stacked(boats), camera, load_hull(hull))
    except ValueError as error:
        raise ValueError(f"{predictions}: {error}") from None
    console.print(_table(camera, found))
    for sentence in _cautions(camera, found):
        console.print(f"[yellow]caution[/]: {sentence}")
    return found.camera


def check_sizes(predictions: Path, size_px: tuple[int, int]) -> None:
    """See that pictures are of the camera's size.

    Raises:
        ValueError: naming the first line of a picture that is not.
    """
    with predictions.open(encoding="utf-8") as stream:
        for number, line in enumerate(stream, start=1):
            seen_px = json.loads(line).get("size_px")
            if seen_px is not None and tuple(seen_px) != size_px:
                raise ValueError(
                    f"{predictions}:{number}: picture of {seen_px[0]} x {seen_px[1]}, expected {size_px[0]} x "
                    f"{size_px[1]} as its camera"
                )


def _stacked(boats: list[BoatRecord]) -> tuple[torch.Tensor, torch.Tensor]:
    """Keypoints (C, 7, 2) and their covariances (C, 7, 2, 2)."""
    if not boats:
        return torch.zeros(0, 7, 2), torch.zeros(0, 7, 2, 2)
    fields = ([boat.keypoints_px for boat in boats], [boat.keypoint_covariance_px2 for boat in boats])
    keypoints_px, covariance_px2 = (torch.from_numpy(np.stack(field)) for field in fields)
    return keypoints_px, covariance_px2


def _table(before: Camera, found: HullMount) -> Table:
    used = f"{int(found.fits.sum())} of {counted(len(found.fits), 'boat')}"
    table = Table(title=f"Mount: {used} fit the hull")
    for heading in ("", "before", "found", "sigma"):
        table.add_column(heading, justify="left" if not heading else "right")
    after = found.camera
    for name, old, new, std in (
        ("pitch (deg)", before.pitch_rad, after.pitch_rad, after.pitch_std_rad),
        ("roll (deg)", before.roll_rad, after.roll_rad, after.roll_std_rad),
    ):
        table.add_row(name, *(f"{math.degrees(value.item()):.3f}" for value in (old, new, std)))
    table.add_row("boats' size (%)", "100.0", f"{100 * found.size:.1f}", f"{100 * found.size_std:.1f}")
    return table


def _cautions(before: Camera, found: HullMount) -> list[str]:
    sentences = []
    if (amiss := 1 - float(found.fits.double().mean())) > OFTEN:
        sentences.append(f"{amiss:.0%} of the boats do not fit the hull: is it theirs?")
    for name, old, new in (
        ("pitch", before.pitch_std_rad, found.camera.pitch_std_rad),
        ("roll", before.roll_std_rad, found.camera.roll_std_rad),
    ):
        if 0 < SAYS_NOTHING * old.item() < new.item():
            sentences.append(f"the boats say hardly anything about the {name}: show them near, far and aside")
    return sentences
