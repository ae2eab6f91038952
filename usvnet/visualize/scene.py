"""A camera's picture with everything that is known about it: boats, ranges, horizon, and the chart from above."""

import math
from collections.abc import Sequence

from usvnet.evaluation.record_json import interval_90_m
from usvnet.evaluation.records import BoatRecord
from usvnet.geometry.camera import scale_camera
from usvnet.tracking.tracker import Track, track_of
from usvnet.types import Camera, Reason
from usvnet.visualize.boats import enlarged, moved, paint_boats
from usvnet.visualize.canvas import GREY, INK, PLUS_MINUS, Picture, Rectangle, rounded, text, text_size, translucent
from usvnet.visualize.horizon import draw_horizon
from usvnet.visualize.records import draw_boat
from usvnet.visualize.topdown import TopDownChart
from usvnet.visualize.trails import draw_trail, seen_on_water

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

    def draw(
        self,
        picture: Picture,
        boats: Sequence[BoatRecord],
        camera: Camera,
        caption: str = "",
        tracks: Sequence[Track] = (),
    ) -> Picture:
        """Draw one picture.

        Args:
            picture: (H, W, 3) RGB.
            boats: in its pixels.
            camera: its camera (a batch of 1).
            caption: a line at the bottom, beside the estimator's name.
            tracks: of the boats; they bring numbers, smoothed ranges and trails.

        Returns:
            A new picture of the same size, or twice that where it is small.
        """
        canvas, scale = enlarged(picture)
        height, width = canvas.shape[:2]
        camera = scale_camera(camera, (width, height))
        unit = max(min(height, width) / 640, 0.9)
        labels = [
            self.label(boat, track_of(tracks, number), camera.height_m.item()) for number, boat in enumerate(boats)
        ]
        drawings = [moved(draw_boat(boat, label=label), scale) for boat, label in zip(boats, labels)][
            ::-1
        ]  # best on top
        draw_horizon(canvas, camera, unit)
        for track in tracks:
            draw_trail(canvas, seen_on_water(track.trail_m, camera), unit)
        places = [_caption(canvas, "   ".join(filter(None, [caption, f"range: {self.estimator}"])), unit)]
        if self.chart is not None:
            boxes = [tuple(drawing.box_px.tolist()) for drawing in drawings]
            places.append(self.chart.draw(canvas, boats, self.estimator, camera, unit, [*places, *boxes], tracks))
        paint_boats(canvas, drawings, places)
        return canvas

    def label(self, boat: BoatRecord, track: Track | None = None, height_m: float = 0.0) -> tuple[str, ...]:
        """Say a boat's range: ``("23.4 m +- 0.5", "90 %: 22.6 to 24.2 m")``.

        Args:
            boat: as it is seen.
            track: smoothed, said instead, with its number and how near it will come.
            height_m: of the camera that follows it.
        """
        if track is not None:
            return _track_label(track, height_m)
        estimate = boat.ranges[self.estimator]
        if not estimate.usable:
            return ("no range", WHY_NOT.get(estimate.reason, f"score {boat.score:.2f}"))
        return _range_lines(estimate.slant_m, estimate.slant_std_m, *interval_90_m(estimate))


def _range_lines(slant_m: float, std_m: float, low_m: float, high_m: float) -> tuple[str, str]:
    decimals = 1 if not 0 < std_m < math.inf else min(2, max(0, 1 - math.floor(math.log10(std_m))))
    return (
        f"{slant_m:.{decimals}f} m {PLUS_MINUS} {std_m:.{decimals}f}",
        f"90 %: {low_m:.{decimals}f} to {high_m:.{decimals}f} m",
    )


def _track_label(track: Track, height_m: float) -> tuple[str, ...]:
    slant_m, low_m, high_m = (math.hypot(m, height_m) for m in (track.range_m, track.low_90_m, track.high_90_m))
    first, second = _range_lines(slant_m, track.range_std_m, low_m, high_m)
    lines = (f"#{track.number}  {first}", second)
    if track.encounter is None or track.encounter.tcpa_s < 0:
        return lines
    cpa_m, cpa_std_m, tcpa_s, _ = track.encounter
    return (*lines, f"CPA {cpa_m:.0f} m {PLUS_MINUS} {cpa_std_m:.0f} in {tcpa_s:.0f} s")


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
