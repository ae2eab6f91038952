"""A picture of a rendered dataset: a spread of its frames with their labels, to see at a glance what is in it."""

from collections import defaultdict
from itertools import chain, zip_longest
from pathlib import Path

import cv2
import numpy as np

from usvnet.data.pictures import read_picture
from usvnet.files import atomic_write
from usvnet.simulator.dataset_writer import IMAGES, read_truths
from usvnet.simulator.truth import Truth, numbers_or_nan
from usvnet.visualize import INK, BoatDrawing, Picture, contact_sheet, draw_boats

LONGEST_PX = 480
"""Longer side of a picture in the sheet."""


def draw_contact_sheet(root: Path, path: Path, columns: int = 4, rows: int = 6) -> None:
    """Draw a PNG of frames from every scene, each with its tag, number, ranges and keypoints.

    Args:
        root: the folder of the dataset.
        path: the PNG to write.
        columns: pictures beside each other.
        rows: pictures below each other, at most.

    Raises:
        ValueError: there is no frame, or a file is damaged.
    """
    chosen = _spread(list(read_truths(root)), columns * rows)
    if not chosen:
        raise ValueError(f"{root}: no frames to draw")
    pictures = _on_one_size([_draw(root, truth) for truth in chosen])
    sheet = contact_sheet(pictures, columns, [_caption(truth) for truth in chosen])
    with atomic_write(path) as temporary:
        cv2.imwrite(str(temporary), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))


def _spread(truths: list[Truth], most: int) -> list[Truth]:
    """As many of each scene, of each those at even steps, scene by scene."""
    scenes: dict[str, list[Truth]] = defaultdict(list)
    for truth in truths:
        scenes[truth["spec"]["scene"]].append(truth)
    share = -(-most // max(1, len(scenes)))
    queues = [[members[i] for i in _even_steps(len(members), share)] for _, members in sorted(scenes.items())]
    turns = [truth for truth in chain.from_iterable(zip_longest(*queues)) if truth is not None][:most]
    return sorted(turns, key=lambda truth: (truth["spec"]["scene"], truth["image"]))


def _even_steps(length: int, most: int) -> list[int]:
    return [i * length // most for i in range(most)] if length > most else list(range(length))


def _draw(root: Path, truth: Truth) -> Picture:
    """The picture, its longer side fitted to the sheet, with its boats."""
    picture = read_picture(root / IMAGES / truth["image"])
    scale = LONGEST_PX / max(picture.shape[:2])
    size_px = (max(1, round(picture.shape[1] * scale)), max(1, round(picture.shape[0] * scale)))
    fitted = cv2.resize(picture, size_px, interpolation=cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST)
    boats = [_drawing(boat, np.array(size_px) / truth["size_px"]) for boat in truth["boats"]]
    return draw_boats(fitted.astype(np.uint8), boats, scale=1)


def _on_one_size(pictures: list[Picture]) -> list[Picture]:
    """Set each picture in the middle of a ground that is large enough for all."""
    height, width = (max(sides) for sides in zip(*(picture.shape[:2] for picture in pictures)))
    tiles = []
    for picture in pictures:
        tile = np.full((height, width, 3), INK, np.uint8)
        top, left = (height - picture.shape[0]) // 2, (width - picture.shape[1]) // 2
        tile[top : top + picture.shape[0], left : left + picture.shape[1]] = picture
        tiles.append(tile)
    return tiles


def _drawing(boat: Truth, scale: np.ndarray) -> BoatDrawing:
    visibility = np.array(boat["visibility"])
    keypoints_px = np.where(visibility[:, None] > 0, numbers_or_nan(boat["keypoints_px"]), np.nan)
    box_px = numbers_or_nan(boat["box_px"]).reshape(2, 2)

    def move(points_px: np.ndarray) -> np.ndarray:
        return scale * (points_px + 0.5) - 0.5  # pixel centres are integers

    slant_m = np.nanmin(numbers_or_nan(boat["slant_m"]), initial=np.inf)
    return BoatDrawing(move(box_px).reshape(4), move(keypoints_px), visibility == 2, (f"{slant_m:.2f} m",))


def _caption(truth: Truth) -> str:
    spec = truth["spec"]
    words = [f"{spec['scene']}   {truth['image'].removesuffix('.jpg')}   {spec['camera_name']}"]
    return "   ".join(words if truth["boats"] else [*words, "no boat"])
