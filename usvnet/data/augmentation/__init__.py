"""Training pictures as they might also have been: :func:`augment` is the whole of it."""

from collections.abc import Callable

import numpy as np

from usvnet.data.augmentation.config import AugmentationConfig
from usvnet.data.augmentation.geometric import Source, View, plain_view, random_view, shrink_view
from usvnet.data.augmentation.mosaic import mosaic
from usvnet.data.augmentation.paste import paste_boat
from usvnet.data.augmentation.photometric import change_light

__all__ = ["AugmentationConfig", "Source", "View", "augment", "plain_view", "shrink_view"]


def augment(
    source: Source,
    another: Callable[[int], Source],
    count: int,
    size_px: tuple[int, int],
    config: AugmentationConfig,
    rng: np.random.Generator,
    closing: bool = False,
) -> View:
    """Draw a changed picture: another view of it, or a mosaic; perhaps with one more boat; in another light.

    Args:
        source: the picture.
        another: gives picture number i of ``count``, to take further boats from.
        count: how many pictures there are.
        size_px: width and height of the frame.
        config: how far and how often.
        rng: what decides.
        closing: without mosaics and pasted boats, as at the end of a run.
    """
    composed = rng.random() < config.mosaic and not closing
    if composed:
        view = mosaic([source, *(another(int(i)) for i in rng.integers(count, size=3))], size_px, config, rng)
    else:
        view = random_view(source, size_px, config, rng)
        if rng.random() < config.paste and not closing:
            view = paste_boat(view, random_view(another(int(rng.integers(count))), size_px, config, rng), rng)
    return view._replace(picture=change_light(view.picture, view.frame, config, rng, one_camera=not composed))
