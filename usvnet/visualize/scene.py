"""A camera's picture with everything that is known about it: boats, ranges, horizon, and the chart from above."""

import math
from collections.abc import Sequence

from usvnet.evaluation.record_json import interval_90_m
from usvnet.evaluation.records import BoatRecord
from usvnet.geometry.camera import scale_camera
from usvnet.types import Camera, Reason
from usvnet.visualize.boats import enlarged, moved, paint_boats
from usvnet.visualize.canvas import GREY, INK, PLUS_MINUS, Picture, Rectangle, rounded, text, text_size, translucent
from usvnet.visualize.horizon import draw_horizon
from usvnet.visualize.records import draw_boat
from usvnet.visualize.topdown import TopDownChart

WHY_NOT = {
    Reason.HORIZON: "at the horizon or above",
    Reason.MISFIT: "does not fit the hull",
    Reason.NO_RAY: "beyond the lens",
}


class SceneDrawer:
    """Draws the pictures of one camera, one after another.

    Args:
        estimator: whose ranges are shown.
        topdown: draw the chart too.
    """

    def __init__(self, estimator: str, topdown: bool = True) -> None:
        self.estimator = estimator
        self.chart = TopDownChart() if topdown else None

    def draw(self, picture: Picture, boats: Sequence[BoatRecord], camera: Camera, caption: str = "") -> Picture:
        """Draw one picture.

        Args:
            picture: (H, W, 3) RGB.
            boats: in its pixels.
            camera: its camera (a batch of 1).
            caption: a line at the bottom, beside the estimator's name.

        Returns:
            A new picture of the same size, or twice that where it is small.
        """
        canvas, scale = enlarged(picture)
        height, width = canvas.shape[:2]
        camera = scale_camera(camera, (width, height))
        unit = max(min(height, width) / 640, 0.9)
        drawings = [moved(draw_boat(boat, label=self.label(boat)), scale) for boat in reversed(boats)]  # best on top
        draw_horizon(canvas, camera, unit)
        places = [_caption(canvas, "   ".join(filter(None, [caption, f"range: {self.estimator}"])), unit)]
        if self.chart is not None:
            boxes = [tuple(drawing.box_px.tolist()) for drawing in drawings]
            places.append(self.chart.draw(canvas, boats, self.estimator, camera, unit, [*places, *boxes]))
        paint_boats(canvas, drawings, places)
        return canvas

    def label(self, boat: BoatRecord) -> tuple[str, ...]:
        """Say a boat's range: ``("23.4 m +- 0.5", "90 %: 22.6 to 24.2 m")``."""
        estimate = boat.ranges[self.estimator]
        if not estimate.usable:
            return ("no range", WHY_NOT.get(estimate.reason, f"score {boat.score:.2f}"))
        std_m = estimate.slant_std_m
        decimals = 1 if not 0 < std_m < math.inf else min(2, max(0, 1 - math.floor(math.log10(std_m))))
        low_m, high_m = interval_90_m(estimate)
        return (
            f"{estimate.slant_m:.{decimals}f} m {PLUS_MINUS} {std_m:.{decimals}f}",
            f"90 %: {low_m:.{decimals}f} to {high_m:.{decimals}f} m",
        )


def _caption(canvas: Picture, words: str, unit: float) -> Rectangle:
    """Write a line into the lower left corner; return its place."""
    scale, pad = 0.4 * unit, 6 * unit
    wide, high = text_size(words, scale)
    left, bottom = 14 * unit, canvas.shape[0] - 14 * unit
    place = (left, bottom - high - 2 * pad, left + wide + 2 * pad, bottom)
    with translucent(canvas, 0.7, place):
        rounded(canvas, place, 4 * unit, INK)
    text(canvas, words, (round(left + pad), round(bottom - pad)), scale, GREY)
    return place
