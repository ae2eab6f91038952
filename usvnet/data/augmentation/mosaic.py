"""Four pictures in one frame: four times the boats for one forward pass."""

import dataclasses

import numpy as np

from usvnet.data.augmentation.config import AugmentationConfig
from usvnet.data.augmentation.geometric import Source, View, random_view
from usvnet.types import NEAREST_WATERLINE

MIDDLE = (0.35, 0.65)
"""Where the four meet, as a fraction of width and height."""


def mosaic(
    sources: list[Source], size_px: tuple[int, int], config: AugmentationConfig, rng: np.random.Generator
) -> View:
    """Fill the quarters of a frame of ``size_px`` (width, height) with parts of four pictures, each around a boat.

    The parts have the scale that the whole pictures would have, so boats look as large as elsewhere in training.

    **A mosaic teaches no ranges.** Each part is seen by a camera of its own, and a frame has one; so every range is
    taken away, and the frame's camera (the first part's) means nothing.
    """
    width, height = size_px
    across, down = np.round(rng.uniform(*MIDDLE, 2) * size_px).astype(int).tolist()
    columns, rows = ((0, across), (across, width)), ((0, down), (down, height))
    parts = [(left, top, right, bottom) for top, bottom in rows for left, right in columns]
    picture = np.empty((height, width, 3), np.uint8)
    frames = []
    for source, (left, top, right, bottom) in zip(sources, parts, strict=True):
        view = random_view(source, size_px, config, rng, (right - left, bottom - top))
        picture[top:bottom, left:right] = view.picture
        corner = np.array([left, top])
        frames.append(
            dataclasses.replace(
                view.frame,
                boxes_px=view.frame.boxes_px + np.tile(corner, 2),
                keypoints_px=view.frame.keypoints_px + corner,
            )
        )
    boats = sum(len(frame.boxes_px) for frame in frames)
    size = frames[0].camera.size_px.new_tensor([size_px])
    return View(
        picture,
        dataclasses.replace(
            frames[0],
            camera=frames[0].camera._replace(size_px=size),
            boxes_px=np.concatenate([frame.boxes_px for frame in frames]),
            keypoints_px=np.concatenate([frame.keypoints_px for frame in frames]),
            visibility=np.concatenate([frame.visibility for frame in frames]),
            range_m=np.zeros(boats),
            range_std_m=np.zeros(boats),
            reference=np.full(boats, NEAREST_WATERLINE),
        ),
    )
