"""Writing a rendered frame whole or not at all.

A frame is ``images/<split>/<number>.jpg`` and ``frames/<split>/<number>.json``, its truth. The truth is written last
and each file appears in one piece, so a frame with a truth is whole, whenever the program was stopped. Labels and
tables are made of the truths when all frames are there (:mod:`usvnet.commands.simulated_dataset`).
"""

import re
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from usvnet.files import atomic_write
from usvnet.simulator.rendered import BoatTruth, RenderedFrame
from usvnet.simulator.truth import Truth, frame_truth, read_truth, truth_text
from usvnet.types import KEYPOINT_NAMES, NUM_KEYPOINTS

IMAGES, TRUTHS = "images", "frames"
LEFTOVER = re.compile(r"\.[\w-]+\.\w{8}\.\w+")
"""The names that :func:`usvnet.files.atomic_write` gives to files that are not finished."""


def truth_path(root: Path, name: str) -> Path:
    """Where the truth of a picture lies; ``name`` is its path below images/."""
    return (root / TRUTHS / name).with_suffix(".json")


def whole_pictures(root: Path) -> list[str]:
    """The names of all pictures that are there with their truths, sorted."""
    names = []
    for path in sorted((root / TRUTHS).glob("*/[!.]*.json")):
        name = path.relative_to(root / TRUTHS).with_suffix(".jpg").as_posix()
        if all(file.is_file() and file.stat().st_size > 0 for file in (path, root / IMAGES / name)):
            names.append(name)
    return names


def whole_frames(root: Path) -> set[int]:
    """The numbers of all frames that are whole."""
    return {int(Path(name).stem) for name in whole_pictures(root)}


def write_frame(root: Path, frame: RenderedFrame) -> None:
    """Write picture and truth of a frame below ``root``, replacing what is there.

    Raises:
        ValueError: picture and labels do not fit together; nothing is written.
        OSError: they cannot be written.
    """
    check_frame(frame)
    data, text = _jpeg(frame), truth_text(frame_truth(frame))
    target = truth_path(root, frame.spec.name)
    target.unlink(missing_ok=True)  # no old truth may stand beside a new picture
    with atomic_write(root / IMAGES / frame.spec.name) as temporary:
        temporary.write_bytes(data)
    with atomic_write(target) as temporary:
        temporary.write_text(text, encoding="utf-8")


def read_truths(root: Path) -> Iterator[Truth]:
    """Read the truths of all whole frames, in the order of their pictures' names.

    Raises:
        ValueError: naming the file that is damaged.
    """
    for name in whole_pictures(root):
        yield read_truth(truth_path(root, name))


def remove_leftovers(root: Path) -> int:
    """Remove the unfinished files of a run that was killed, and pictures whose truth it did not come to.

    Returns:
        How many there were.
    """
    leftovers = [path for path in root.rglob(".*") if LEFTOVER.fullmatch(path.name) and path.is_file()]
    for path in (root / IMAGES).glob("*/[!.]*.jpg"):  # the reader would take one for a picture without boats
        if not truth_path(root, path.relative_to(root / IMAGES).as_posix()).is_file():
            leftovers.append(path)
    for path in leftovers:
        path.unlink()
    return len(leftovers)


def check_frame(frame: RenderedFrame) -> None:
    """Insist that a frame can be written and read again: sizes, finite labels, all of them inside the picture.

    Raises:
        ValueError: what is wrong.
    """
    width, height = (int(size) for size in frame.spec.camera.size_px[0])
    if frame.picture.shape != (height, width, 3) or frame.picture.dtype != np.uint8:
        found = f"{frame.picture.dtype} {frame.picture.shape}"
        raise ValueError(f"the picture is {found}, expected uint8 ({height}, {width}, 3) as its camera")
    for i, boat in enumerate(frame.boats):
        try:
            _check_boat(boat, np.array([width, height]))
        except ValueError as error:
            raise ValueError(f"boat {i} ({boat.spec.hull.name}): {error}") from None


def _check_boat(boat: BoatTruth, size_px: np.ndarray) -> None:
    low, high = boat.box_px.reshape(2, 2)
    if not (np.isfinite(boat.box_px).all() and (low < high).all() and _inside(boat.box_px.reshape(2, 2), size_px)):
        raise ValueError(f"its box is {boat.box_px.tolist()}, expected x1 < x2 and y1 < y2 inside the picture")
    if boat.keypoints_px.shape != (NUM_KEYPOINTS, 2) or not np.isin(boat.visibility, (0, 1, 2)).all():
        raise ValueError(f"keypoints {boat.keypoints_px.shape}, visibility {boat.visibility.tolist()}")
    for name, point_px, visibility in zip(KEYPOINT_NAMES, boat.keypoints_px, boat.visibility):
        if visibility and not _inside(point_px, size_px):
            raise ValueError(f"{name} is at {point_px.tolist()} px with visibility {visibility}, outside the picture")


def _inside(points_px: np.ndarray, size_px: np.ndarray) -> bool:
    """Whether all points (..., 2) are in the picture, pixel centres being integers (NaN is not)."""
    return bool(((points_px >= -0.5) & (points_px <= size_px - 0.5)).all())


def _jpeg(frame: RenderedFrame) -> bytes:
    options = [cv2.IMWRITE_JPEG_QUALITY, frame.spec.sensor.jpeg_quality]
    done, data = cv2.imencode(".jpg", cv2.cvtColor(frame.picture, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise ValueError(f"OpenCV cannot write a JPEG of {frame.picture.shape}")
    return data.tobytes()
