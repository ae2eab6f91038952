"""What a dataset looks like to people: tables for the terminal and the picture of its labels (the paper's Figure 6)."""

import math
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.table import Table

from usvnet.data.records import Frame
from usvnet.files import atomic_write
from usvnet.types import KEYPOINT_NAMES

COLOURS = "viridis"
INK = "0.25"
NO_SCENE = "none"


class Labelled(Protocol):
    """What a :class:`~usvnet.data.records.Frame` and a picture that is not in a dataset yet have in common."""

    @property
    def scene(self) -> str | None:
        """Its tag."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""

    @property
    def boxes_px(self) -> NDArray[np.float64]:
        """x1, y1, x2, y2 (n, 4)."""

    @property
    def visibility(self) -> NDArray[np.int64]:
        """Of each keypoint (n, 7)."""

    @property
    def range_m(self) -> NDArray[np.float64]:
        """What the laser read (n,), 0 where it read nothing."""


Splits = Mapping[str, Sequence[Labelled]]
"""The pictures of each split."""


def split_table(frames: Splits) -> Table:
    """Pictures, boats, empty pictures and laser ranges of each split."""
    table = _table("Splits", "split", "pictures", "boats", "empty", "ranges")
    for split, members in frames.items():
        boats = [len(frame.boxes_px) for frame in members]
        ranges = sum(int((frame.range_m > 0).sum()) for frame in members)
        table.add_row(split, str(len(members)), str(sum(boats)), str(boats.count(0)), str(ranges))
    return table


def scene_table(frames: Splits) -> Table:
    """Pictures of each scene and split."""
    counts = {split: Counter(frame.scene or NO_SCENE for frame in members) for split, members in frames.items()}
    table = _table("Pictures by scene", "scene", *counts, "all")
    for scene in sorted(set().union(*counts.values())):
        row = [count[scene] for count in counts.values()]
        table.add_row(scene, *(str(number) for number in (*row, sum(row))))
    return table


def camera_table(frames: dict[str, list[Frame]], names: Mapping[str, str]) -> Table:
    """The cameras as the pictures saw through them, attitudes from smallest to largest.

    Args:
        frames: the pictures of each split.
        names: the camera's name by the picture's.
    """
    groups: dict[str, list[Frame]] = defaultdict(list)
    for frame in (frame for members in frames.values() for frame in members):
        groups[names[frame.name]].append(frame)
    table = _table("Cameras", "camera", "size\npx", "focal\npx", "height\nm", "pitch\ndeg", "roll\ndeg", "pictures")
    for name, members in sorted(groups.items()):
        (width, height), camera = members[0].size_px, members[0].camera
        pitch = [math.degrees(frame.camera.pitch_rad.item()) for frame in members]
        roll = [math.degrees(frame.camera.roll_rad.item()) for frame in members]
        table.add_row(
            name,
            f"{width} x {height}",
            f"{camera.K[0, 0, 0].item():.1f}",
            f"{camera.height_m.item():.2f}",
            f"{min(pitch):.1f} to {max(pitch):.1f}",
            f"{min(roll):.1f} to {max(roll):.1f}",
            str(len(members)),
        )
    return table


def size_table(frames: Splits) -> Table:
    """How large the boxes and how long the ranges are."""
    every = [frame for members in frames.values() for frame in members]
    boxes = _column([frame.boxes_px for frame in every], (4,))
    ranges = _column([frame.range_m for frame in every], ())
    table = _table("Sizes", "", "smallest", "5 %", "median", "95 %", "largest")
    for name, values in {
        "box width px": boxes[:, 2] - boxes[:, 0],
        "box height px": boxes[:, 3] - boxes[:, 1],
        "range m": ranges[ranges > 0],
    }.items():
        if len(values):
            table.add_row(name, *(f"{value:.1f}" for value in np.quantile(values, (0, 0.05, 0.5, 0.95, 1))))
    return table


def draw_labels(frames: Sequence[Labelled], path: Path) -> None:
    """Write a PNG: boats by scene, keypoint visibility, boxes, their centres and sizes, ranges by scene."""
    figure = Figure(figsize=(13, 8), layout="constrained")
    panels = figure.subplots(2, 3)
    boxes = _column([frame.boxes_px.reshape(-1, 2, 2) / frame.size_px for frame in frames], (2, 2))
    size, centre = boxes[:, 1] - boxes[:, 0], boxes.mean(1)
    _draw_instances(panels[0, 0], frames)
    _draw_boxes(panels[0, 1], size)
    _draw_visibility(panels[0, 2], _column([frame.visibility for frame in frames], (len(KEYPOINT_NAMES),)))
    _draw_density(panels[1, 0], centre, "centre x", "centre y", reach=1.0)
    panels[1, 0].invert_yaxis()
    _draw_density(panels[1, 1], size, "width", "height", reach=1.1 * size.max(initial=0.02))
    _draw_ranges(panels[1, 2], frames)
    with atomic_write(path) as temporary:
        figure.savefig(temporary, dpi=120)


def _table(title: str, first: str, *numbers: str) -> Table:
    table = Table(first, title=title)
    for name in numbers:
        table.add_column(name, justify="right")
    return table


def _column(parts: list[NDArray], shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Join what each frame has, also when there are no frames."""
    return np.concatenate([np.zeros((0, *shape)), *parts])


def _scenes(frames: Sequence[Labelled]) -> dict[str, list[Labelled]]:
    groups: dict[str, list[Labelled]] = defaultdict(list)
    for frame in frames:
        groups[frame.scene or NO_SCENE].append(frame)
    return dict(sorted(groups.items()))


def _draw_instances(axes: Axes, frames: Sequence[Labelled]) -> None:
    counts = {scene: sum(len(frame.boxes_px) for frame in members) for scene, members in _scenes(frames).items()}
    axes.bar_label(axes.bar(list(counts), list(counts.values()), color=INK))
    axes.margins(y=0.1)
    axes.set(title="Boats", xlabel="scene", ylabel="number")


def _draw_boxes(axes: Axes, size: NDArray[np.float64]) -> None:
    outline = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) / 2
    axes.add_collection(LineCollection(list(outline * size[:, None]), colors=INK, linewidths=0.5, alpha=0.4))
    reach = 0.55 * max(size.max(initial=0.0), 0.02)
    axes.set(title="Boxes, laid over each other", xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    axes.set(xlabel="fraction of the picture's width", ylabel="fraction of its height")


def _draw_visibility(axes: Axes, visibility: NDArray[np.float64]) -> None:
    left = np.zeros(len(KEYPOINT_NAMES))
    for value, name, colour in ((2, "seen", "tab:green"), (1, "hidden", "tab:orange"), (0, "outside", "0.8")):
        count = (visibility == value).sum(0)
        axes.barh(KEYPOINT_NAMES, count, left=left, label=name, color=colour)
        left += count
    axes.invert_yaxis()
    axes.set(xlabel="number")
    axes.set_title("Keypoints", loc="left")
    style = {"fontsize": "small", "handlelength": 1.0, "columnspacing": 1.0, "borderaxespad": 0.1}
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, frameon=False, **style)


def _draw_density(axes: Axes, points: NDArray[np.float64], x: str, y: str, reach: float) -> None:
    axes.hist2d(points[:, 0], points[:, 1], bins=40, range=((0, reach), (0, reach)), cmap=COLOURS, cmin=1)
    axes.set(title=f"Box {x} and {y}", xlabel=f"{x}, fraction of the picture", ylabel=f"{y}, fraction of the picture")


def _draw_ranges(axes: Axes, frames: Sequence[Labelled]) -> None:
    ranges = {scene: _column([frame.range_m for frame in members], ()) for scene, members in _scenes(frames).items()}
    measured = {scene: values[values > 0] for scene, values in ranges.items() if (values > 0).any()}
    axes.set(title="Laser ranges", xlabel="slant range, m", ylabel="number")
    if not measured:
        axes.text(0.5, 0.5, "none", ha="center", transform=axes.transAxes, color=INK)
        return
    axes.hist(list(measured.values()), bins=20, stacked=True, label=[f"scene {scene}" for scene in measured])
    axes.legend()
