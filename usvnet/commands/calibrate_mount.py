"""``usvnet calibrate-mount``: a few readings of known geometry in, a camera file with its mount and sigmas out."""

import math
from pathlib import Path
from typing import Literal

import torch
from rich.console import Console
from rich.table import Table

from usvnet.commands.mount_from_boats import mount_from_boats
from usvnet.geometry.camera import camera_to
from usvnet.geometry.camera_files import load_camera, save_camera
from usvnet.geometry.mount_fit import CHANCE, HEADING, NAMES, MountFit, fit_mount
from usvnet.geometry.mount_readings import MountReading, read_mount_readings
from usvnet.types import Camera

MOUNT = NAMES[:HEADING]
OUTLIER_STDS = 3.5
SAYS_NOTHING = 0.98
"""A sigma that stays above this share of its prior's has learnt nothing."""


def calibrate_mount(
    readings: str,
    *,
    camera: str,
    output: str,
    hull: Path | None = None,
    hold: str = "",
    priors: bool = True,
    overwrite: bool = False,
) -> None:
    """Find a camera's height, pitch and roll, with their sigmas, from what it sees at known places.

    The readings are a CSV file with a header. A line is a point on the water and its range (u_px, v_px, range_m
    [, range_std_m]); or, with kind = point, a surveyed point (u_px, v_px, right_m, forward_m, up_m: from the water
    below the camera); or, with kind = horizon, a point of the sea's horizon (u_px, v_px). pixel_std_px says how well a
    pixel was picked (1 if left out), image is any text. Ranges near and far, to the left and right, tell most.

    Without any reading, pitch and roll of a fixed camera can be found from a boat of known hull that was driven about
    before it, near, far and aside: give the predictions.jsonl that usvnet predict wrote of it, and its hull.

    Args:
        readings: The CSV file, or predictions.jsonl.
        camera: Camera file with the calibrated lens and a first guess of the mount.
        output: Camera file to write: the same lens, the mount that was found, and its sigmas.
        hull: Hull file of the boats in predictions.jsonl.
        hold: What is not to be found but taken from the camera file, e.g. height,roll.
        priors: Let the mount in the camera file count as far as its sigmas go; a sigma of 0 is taken as not known.
        overwrite: Let the output be a file that exists, such as the camera file itself.

    Raises:
        ValueError: a faulty line, or readings that leave something open, saying what.
        FileNotFoundError: no such file.
    """
    held = [name.strip() for name in hold.split(",") if name.strip()]
    for name in held:
        if name not in MOUNT:
            raise ValueError(f"hold: expected some of {', '.join(MOUNT)} with commas between them, got '{name}'")
    target = Path(output)
    if target.suffix not in (".yaml", ".yml"):
        raise ValueError(f"output must end in .yaml or .yml, got {output!r}")
    if target.exists() and not overwrite:
        raise ValueError(f"{target}: is there already; choose another output, or add --overwrite")
    before, console = load_camera(camera), Console(soft_wrap=True)
    if Path(readings).suffix == ".jsonl":
        if hull is None or held or not priors:
            raise ValueError(f"{readings}: predictions need --hull, and take neither --hold nor --priors false")
        write_mount(mount_from_boats(Path(readings), before, hull, console), camera, target, console)
        return
    if hull is not None:
        raise ValueError(f"hull: readings name their places; it goes with predictions.jsonl, got {readings}")
    rows = read_mount_readings(readings)
    try:
        fit = fit_mount(rows, before, held, priors)
    except ValueError as error:
        raise ValueError(f"{readings}: {error}") from None

    console.print(_residual_table(rows, fit))
    console.print(_mount_table(before, fit, held))
    for sentence in _cautions(before, fit, held, priors):
        console.print(f"[yellow]caution[/]: {sentence}")
    write_mount(fit.camera, camera, target, console)


def write_mount(mounted: Camera, camera: str, target: Path, console: Console) -> None:
    """Write a camera file in the style of the one that the camera came from."""
    opencv = Path(camera).read_text(encoding="utf-8-sig").startswith("%YAML:")
    style: Literal["ros", "opencv"] = "opencv" if opencv else "ros"
    save_camera(camera_to(mounted, dtype=torch.float32), target, style, name=target.stem)
    console.print(f"wrote {target}")


def _residual_table(rows: list[MountReading], fit: MountFit) -> Table:
    table = Table(title="Residuals: by how much each reading is seen lower than it should be")
    for heading in ("line", "image", "kind", "px", "sigmas"):
        table.add_column(heading, justify="left" if heading in ("image", "kind") else "right")
    for row, pixels, stds in zip(rows, fit.residuals_px.tolist(), fit.residuals.tolist()):
        colour = "red" if abs(stds) > OUTLIER_STDS else ""
        table.add_row(str(row.line), row.image, row.kind, f"{pixels:+.2f}", f"{stds:+.2f}", style=colour)
    return table


def _mount_table(before: Camera, fit: MountFit, held: list[str]) -> Table:
    table = Table(title=f"Mount: chi-squared {fit.chi_squared:.1f} with {fit.degrees_of_freedom} degrees of freedom")
    for heading in ("", "before", "found", "sigma"):
        table.add_column(heading, justify="left" if not heading else "right")
    for name, old, new, std in zip(MOUNT, _mount(before), _mount(fit.camera), _mount_stds(fit.camera)):
        unit, scale = ("m", 1.0) if name == "height" else ("deg", math.degrees(1))
        found = "held" if name in held else f"{scale * new:.4f}"
        table.add_row(f"{name} ({unit})", f"{scale * old:.4f}", found, f"{scale * std:.4f}")
    return table


def _cautions(before: Camera, fit: MountFit, held: list[str], priors: bool) -> list[str]:
    sentences = []
    if fit.inflation > 1:
        sentences.append(
            f"the readings scatter more than they claim (chi-squared this large has a chance of {fit.probability:.1g}, "
            f"below {CHANCE:g}): the sigmas were multiplied by {fit.inflation:.2f}; look at the largest residuals"
        )
    if fit.degrees_of_freedom <= 0:
        sentences.append("no reading is left over to check the others: add some")
    if abs(fit.correlation) > 0.9:
        sentences.append(
            f"the errors of height and pitch go together (correlation {fit.correlation:+.3f}), which a camera file "
            "cannot say: ranges like those of the readings are better than its sigmas promise"
        )
    for name, old, new in zip(MOUNT, _mount_stds(before), _mount_stds(fit.camera)):
        if priors and name not in held and 0 < SAYS_NOTHING * fit.inflation * old < new:
            sentences.append(f"the readings say nothing about the {name}: its prior stands")
    return sentences


def _mount(camera: Camera) -> list[float]:
    return [value.item() for value in (camera.height_m, camera.pitch_rad, camera.roll_rad)]


def _mount_stds(camera: Camera) -> list[float]:
    return [std.item() for std in (camera.height_std_m, camera.pitch_std_rad, camera.roll_std_rad)]
