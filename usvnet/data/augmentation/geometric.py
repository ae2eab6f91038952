"""Another view of a picture: turned, zoomed, shifted, mirrored, and its camera and labels with it."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from usvnet.data.augmentation.config import AugmentationConfig
from usvnet.data.pictures import Picture
from usvnet.data.records import Frame
from usvnet.data.transforms import (
    Affine,
    fit_matrix,
    mirror_frame,
    mirror_matrix,
    move_frame,
    resize_matrix,
    turn_frame,
    warp,
)

TRIES = 10
"""How often a zoom that loses every boat is drawn anew."""


class Source(NamedTuple):
    """A picture as it comes from the cache, perhaps shrunk, with its frame in native pixels."""

    picture: Picture
    frame: Frame

    def native_matrix(self) -> Affine:
        """Say where the picture's pixels lie in the native picture."""
        return resize_matrix((self.picture.shape[1], self.picture.shape[0]), self.frame.size_px)


class View(NamedTuple):
    """A picture with its frame, both in the same pixels."""

    picture: Picture
    frame: Frame


def plain_view(source: Source, size_px: tuple[int, int]) -> View:
    """Fit a picture whole into ``size_px`` (width, height)."""
    letterbox = fit_matrix(source.frame.size_px, size_px)
    picture = warp(source.picture, letterbox @ source.native_matrix(), size_px)
    return View(picture, move_frame(source.frame, letterbox, size_px))


def shrink_view(view: View, size_px: tuple[int, int]) -> View:
    """Show a view in ``size_px`` (width, height)."""
    A = resize_matrix(view.frame.size_px, size_px)
    return View(warp(view.picture, A, size_px), move_frame(view.frame, A, size_px))


def random_view(
    source: Source,
    size_px: tuple[int, int],
    config: AugmentationConfig,
    rng: np.random.Generator,
    part_px: tuple[int, int] | None = None,
) -> View:
    """Draw a turn, a zoom, a shift and a mirror so that at least one boat stays in the frame, if there is one.

    Args:
        source: the picture.
        size_px: width and height of the frame that the whole picture would fill at a zoom of 1.
        config: how far each may go.
        rng: what decides.
        part_px: width and height of the frame that is wanted, None for ``size_px``; a smaller one shows less of the
            picture at the same scale.
    """
    part_px = part_px or size_px
    letterbox = fit_matrix(source.frame.size_px, size_px)
    native, turn = source.frame, np.eye(3)
    if config.roll_deg > 0:
        native, turn = turn_frame(native, math.radians(rng.uniform(-config.roll_deg, config.roll_deg)))
    centres_px = native.boxes_px.reshape(-1, 2, 2).mean(1) * np.diag(letterbox)[:2] + letterbox[:2, 2]
    for _ in range(TRIES):
        focus_px = rng.choice(centres_px) if len(centres_px) else None
        A = random_affine(config, size_px, part_px, rng, focus_px) @ letterbox
        frame = move_frame(native, A, part_px)
        if len(frame.boxes_px) or not len(centres_px):
            break
    else:
        A, frame = letterbox, move_frame(native, letterbox, part_px)
    if rng.random() < config.mirror:
        frame, A = mirror_frame(frame), mirror_matrix(part_px[0]) @ A
    return View(warp(source.picture, A @ turn @ source.native_matrix(), part_px), frame)


def random_affine(
    config: AugmentationConfig,
    size_px: tuple[int, int],
    part_px: tuple[int, int],
    rng: np.random.Generator,
    focus_px: NDArray[np.float64] | None = None,
) -> Affine:
    """Draw a zoom and a shift that bring a picture of ``size_px`` (width, height) into a frame of ``part_px``.

    The picture keeps the frame filled (or, where it is smaller, stays whole), give or take ``translate`` of the frame.
    Within that, ``focus_px`` (a boat's centre) is sent to a place drawn evenly from the frame's middle 70 %: a plain
    zoom about the centre would cut off nearly every boat that is not in the middle.
    """
    zoom = math.exp(rng.uniform(math.log(config.zoom[0]), math.log(config.zoom[1])))
    part = np.array(part_px, np.float64)
    room, slack = part - zoom * np.array(size_px), config.translate * part
    low, high = np.minimum(0, room) - slack, np.maximum(0, room) + slack
    if focus_px is None:
        shift = rng.uniform(low, high)
    else:
        shift = (rng.uniform(0.15, 0.85, 2) * part - zoom * focus_px).clip(low, high)
    A = np.diag((zoom, zoom, 1.0))
    A[:2, 2] = (zoom - 1) / 2 + shift  # a picture's upper left corner is at -0.5
    return A
