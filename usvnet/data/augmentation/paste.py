"""A boat of another picture pasted onto the water of this one."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from usvnet.data.augmentation.geometric import TRIES, View
from usvnet.data.augmentation.water import horizon_row
from usvnet.types import NEAREST_WATERLINE, WATERLINE_KEYPOINTS

MARGIN = 0.2
"""Width of the soft border around the pasted box, as a fraction of the box's shorter side."""
MAX_HIDDEN = 0.5
"""No boat that is there already loses more of its box than this."""
MIN_SIDE_PX = 6
"""Smaller boats are not worth pasting."""


def paste_boat(view: View, other: View, rng: np.random.Generator) -> View:
    """Paste one boat of ``other``, with a soft border of its water, where this picture's camera sees water.

    The patch is brightened or darkened until its water has the colour of the water around it.

    The boat keeps its size, which need not suit its new place, and the new camera looks at it from another height: it
    has a pose but **no range**. Keypoints that it covers become hidden. Where it finds no place, nothing changes.
    """
    whole = np.flatnonzero((other.frame.visibility > 0).all(-1))
    if not len(whole):
        return view
    boat = int(rng.choice(whole))
    height, width = view.picture.shape[:2]
    box = other.frame.boxes_px[boat]
    border = MARGIN * (box[2:] - box[:2]).min()
    low, high = np.floor(box[:2] - border).astype(int), np.ceil(box[2:] + border).astype(int) + 1
    low, high = low.clip(0, (width, height)), high.clip(0, (width, height))  # of the part that is cut out
    if (box[2:] - box[:2]).min() < MIN_SIDE_PX:
        return view
    shift = _find_place(view, box, other.frame.keypoints_px[boat], low, high, rng)
    if shift is None:
        return view

    alpha = _soft_box(box, border, low, high)[..., None]
    picture = view.picture.copy()
    part = picture[low[1] + shift[1] : high[1] + shift[1], low[0] + shift[0] : high[0] + shift[0]]
    patch = other.picture[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    around = alpha[..., 0] < 1
    patch = (patch + (part[around].mean(0) - patch[around].mean(0))).clip(0, 255) if around.any() else patch
    part[:] = np.round(part + alpha * (patch - part)).astype(np.uint8)

    frame = view.frame
    pasted = box + np.tile(shift, 2)
    covered = ((frame.keypoints_px >= pasted[:2]) & (frame.keypoints_px <= pasted[2:])).all(-1)
    return View(
        picture,
        dataclasses.replace(
            frame,
            boxes_px=np.concatenate((frame.boxes_px, pasted[None])),
            keypoints_px=np.concatenate((frame.keypoints_px, other.frame.keypoints_px[boat : boat + 1] + shift)),
            visibility=np.concatenate(
                (np.where(covered, np.minimum(frame.visibility, 1), frame.visibility), other.frame.visibility[[boat]])
            ),
            range_m=np.append(frame.range_m, 0.0),
            range_std_m=np.append(frame.range_std_m, 0.0),
            reference=np.append(frame.reference, NEAREST_WATERLINE),
        ),
    )


def _find_place(
    view: View,
    box: NDArray[np.float64],
    keypoints_px: NDArray[np.float64],
    low: NDArray[np.int_],
    high: NDArray[np.int_],
    rng: np.random.Generator,
) -> NDArray[np.int_] | None:
    """Draw a shift (2,) that keeps the cut-out in the frame and its waterline on water, and covers no boat too far."""
    height, width = view.picture.shape[:2]
    waterline = keypoints_px[list(WATERLINE_KEYPOINTS)]
    for _ in range(TRIES):
        shift = np.array([rng.integers(-low[0], width - high[0] + 1), rng.integers(-low[1], height - high[1] + 1)])
        on_water = all(v > horizon_row(view.frame.camera, u) for u, v in waterline + shift)
        if on_water and (_hidden(view.frame.boxes_px, box + np.tile(shift, 2)) <= MAX_HIDDEN).all():
            return shift
    return None


def _hidden(boxes_px: NDArray[np.float64], cover_px: NDArray[np.float64]) -> NDArray[np.float64]:
    """Share (n,) of boxes (n, 4) that lies under ``cover_px`` (4,)."""
    shared = np.minimum(boxes_px[:, 2:], cover_px[2:]) - np.maximum(boxes_px[:, :2], cover_px[:2])
    return shared.clip(0).prod(-1) / (boxes_px[:, 2:] - boxes_px[:, :2]).prod(-1).clip(1e-9)


def _soft_box(
    box: NDArray[np.float64], border: float, low: NDArray[np.int_], high: NDArray[np.int_]
) -> NDArray[np.float32]:
    """Opacity of the cut-out's pixels: 1 in the box, falling to 0 across the border."""
    ramps = []
    for axis in (0, 1):
        p = np.arange(low[axis], high[axis])
        outside = np.maximum(box[axis] - p, p - box[axis + 2])
        ramps.append((1 - outside / border).clip(0, 1).astype(np.float32))
    return ramps[1][:, None] * ramps[0]
