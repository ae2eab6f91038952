"""How well the horizon found in a picture tells pitch and roll, by scene, on a rendered dataset with true attitudes.

python benchmarks/horizon_error.py --root datasets/diverse --output out --edge_m 6000
"""

import csv
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jsonargparse import auto_cli
from rich.console import Console
from rich.progress import track

from usvnet.data.horizon_detector import find_horizon
from usvnet.data.pictures import read_picture
from usvnet.data.reader import read_cameras
from usvnet.data.records import Faults
from usvnet.files import atomic_write
from usvnet.geometry.camera import make_camera, with_attitude
from usvnet.geometry.horizon import flat_edge
from usvnet.simulator.dataset_writer import read_truths
from usvnet.types import Camera

WRONG_DEG = 0.3
HEADER = f"""| Scenes | pictures | seen | refused | pitch RMS deg | median | 95 % | roll RMS deg | median | 95 % | \
within 2 sigmas | off by > {WRONG_DEG} deg |
| :--- | ---: | ---: | :--- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |"""


@dataclass
class Case:
    """One picture, and what was found in it."""

    image: str
    scene: str
    shore: str
    """open, shore, or empty where the dataset does not say."""
    true: Camera
    reason: str = ""
    error_deg: tuple[float, float] = (math.nan, math.nan)
    scores: tuple[float, float] = (math.nan, math.nan)
    """Errors in standard deviations."""


def main(
    root: Path,
    output: Path,
    pitch_std_deg: float = 0.6,
    roll_std_deg: float = 0.8,
    edge_m: float | None = None,
    every: int = 1,
) -> None:
    """Look for the horizon in every picture around its true attitude, disturbed, and write ``<root>.md`` and ``.csv``.

    Args:
        root: a dataset with true attitudes in frames.csv, or one that ``usvnet simulate`` is still rendering.
        output: folder of the results.
        pitch_std_deg: disturbance of the pitch that the detector is given, and the sigma it is told.
        roll_std_deg: the same of the roll.
        edge_m: where the drawn water, which is flat, ends; by default it is the curved earth's.
        every: look at one picture in so many.
    """
    cases = list(from_truths(root) if not (root / "frames.csv").is_file() else from_table(root))[::every]
    stds = [math.radians(pitch_std_deg), math.radians(roll_std_deg)]
    for number, case in enumerate(track(cases, "Looking for horizons", console=Console(stderr=True), transient=True)):
        pitch, roll = case.true.pitch_rad.item(), case.true.roll_rad.item()
        drawn = np.random.default_rng([3, number]).normal(0, stds)
        camera = with_attitude(case.true, pitch + drawn[0], roll + drawn[1], *stds)
        edge = None if edge_m is None else flat_edge(case.true, edge_m)
        sight = find_horizon(read_picture(root / "images" / case.image), camera, edge)
        case.reason = sight.reason
        if sight.attitude is not None:
            found = [angle.item() for angle in sight.attitude]
            errors = (found[0] - pitch, found[1] - roll)
            case.error_deg = (math.degrees(errors[0]), math.degrees(errors[1]))
            case.scores = (errors[0] / found[2], errors[1] / found[3])
    write(cases, output, root.name)


def from_table(root: Path) -> Iterator[Case]:
    """Pictures of a dataset whose frames.csv has true attitudes."""
    cameras = read_cameras(root / "cameras", Faults())
    with (root / "frames.csv").open(newline="") as stream:
        for row in csv.DictReader(stream):
            camera = cameras[row["camera"]]
            angles = (math.radians(float(row[f"true_{name}_deg"])) for name in ("pitch", "roll"))
            kind = row.get("shore_kind", "")
            shore = {"": "", "none": "open"}.get(kind, "shore")
            yield Case(row["image"], row["scene"], shore, with_attitude(camera, *angles))


def from_truths(root: Path) -> Iterator[Case]:
    """Pictures of a dataset that is being rendered."""
    for truth in read_truths(root):
        spec = truth["spec"]
        camera = spec["camera"]
        true = make_camera(
            camera["K"],
            camera["size_px"],
            camera["distortion"],
            **{key: camera[key] for key in ("height_m", "pitch_rad", "roll_rad", "height_std_m")},
        )
        yield Case(truth["image"], spec["scene"], "open" if spec["shore"]["kind"] == "none" else "shore", true)


def write(cases: list[Case], output: Path, name: str) -> None:
    """Write the table by scene and every picture's result, and show the table."""
    groups: dict[str, list[Case]] = {}
    for case in cases:
        groups.setdefault(f"{case.scene} {case.shore}".strip(), []).append(case)
    lines = [HEADER, *(row(tag, groups[tag]) for tag in sorted(groups)), row("all", cases), ""]
    with atomic_write(output / f"{name}.md") as temporary:
        temporary.write_text("\n".join(lines))
    with atomic_write(output / f"{name}.csv") as temporary, temporary.open("w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(["image", "scene", "shore", "reason", "pitch_error_deg", "roll_error_deg"])
        for case in cases:
            errors = ["" if math.isnan(error) else f"{error:.5f}" for error in case.error_deg]
            table.writerow([case.image, case.scene, case.shore, case.reason, *errors])
    print("\n".join(lines))


def row(tag: str, cases: list[Case]) -> str:
    """One line of the table."""
    seen = [case for case in cases if not case.reason]
    refused = Counter(case.reason for case in cases if case.reason)
    reasons = ", ".join(f"{reason} {count}" for reason, count in refused.most_common())
    cells = [tag, f"{len(cases)}", f"{len(seen)}", reasons]
    if not seen:
        return f"| {' | '.join(cells)} |" + " |" * 8
    errors = np.abs([case.error_deg for case in seen])
    for angle in errors.T:
        spread = (math.sqrt(np.mean(angle**2)), np.median(angle), np.quantile(angle, 0.95))
        cells += [f"{value:.3f}" for value in spread]
    inside = np.mean(np.abs([case.scores for case in seen]) < 2)
    cells += [f"{100 * inside:.0f} %", f"{int((errors.max(1) > WRONG_DEG).sum())}"]
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
