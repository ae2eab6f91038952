"""Pictures side by side."""

from collections.abc import Sequence

import numpy as np

from usvnet.visualize.canvas import GREY, INK, WHITE, Picture, text


def contact_sheet(
    pictures: Sequence[Picture], columns: int, captions: Sequence[str] = (), title: str = "", gap_px: int = 12
) -> Picture:
    """Lay out pictures in rows on a dark ground.

    Args:
        pictures: RGB, all of one size.
        columns: pictures a row.
        captions: a line of text over each picture, or none.
        title: a line over all.
        gap_px: space between pictures.

    Raises:
        ValueError: no picture, or pictures of different sizes.
    """
    sizes = sorted({picture.shape[:2] for picture in pictures})
    if len(sizes) != 1:
        raise ValueError(f"contact sheet: got pictures of {len(sizes)} sizes {sizes}, expected one size")
    height, width = sizes[0]
    columns = min(columns, len(pictures))
    rows = -(-len(pictures) // columns)
    caption_px, title_px = (30 if captions else 0), (52 if title else 0)
    step = (height + gap_px + caption_px, width + gap_px)
    sheet = np.full((rows * step[0] + gap_px + title_px, columns * step[1] + gap_px, 3), INK, np.uint8)
    if title:
        text(sheet, title, (gap_px + 2, 40), 1.0, WHITE, strong=True)
    for n, picture in enumerate(pictures):
        top = title_px + gap_px + caption_px + n // columns * step[0]
        left = gap_px + n % columns * step[1]
        sheet[top : top + height, left : left + width] = picture
        if captions:
            text(sheet, captions[n], (left + 2, top - 9), 0.55, GREY)
    return sheet
