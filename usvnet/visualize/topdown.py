"""The boats seen from above: a small chart with rings of distance and each boat's 90 % interval."""

import math
from collections.abc import Sequence

import numpy as np
import torch

from usvnet.evaluation.range_metrics import Z_90
from usvnet.evaluation.records import BoatRecord, RangeRecord
from usvnet.geometry.rays import level_rays
from usvnet.tracking.tracker import Track
from usvnet.types import Camera
from usvnet.visualize.canvas import (
    GREY,
    INK,
    WHITE,
    YELLOW,
    FloatArray,
    Picture,
    Rectangle,
    disc,
    ellipse,
    fill,
    rounded,
    stroke,
    text,
    text_size,
    translucent,
)
from usvnet.visualize.trails import draw_trail

WEDGE, RING = (38, 58, 84), (96, 116, 140)
STEPS_M = tuple(step * 10**power for power in range(4) for step in (1, 2, 5))
RINGS = 4
"""Rings at least."""
LABEL_SCALE = 0.36
GAP = 14.0
HULL = np.array([[0.0, 8.0], [2.8, 3.0], [3.0, -6.0], [-3.0, -6.0], [-2.8, 3.0]])
"""A small boat seen from above: to starboard and ahead."""
KNOWN_HEADING_RAD = 0.35
"""A heading of a larger standard deviation is not shown."""
CORNERS = ((1, 1), (0, 1), (1, 0), (0, 0))
"""Right and bottom first: boats are seldom there."""


class TopDownChart:
    """A chart whose reach follows the boats: it grows at once and shrinks late, so that a video does not flicker."""

    def __init__(self) -> None:
        self.reach_m = 0.0
        self.corner = CORNERS[0]

    def draw(
        self,
        canvas: Picture,
        boats: Sequence[BoatRecord],
        estimator: str,
        camera: Camera,
        unit: float,
        taken: Sequence[Rectangle],
        tracks: Sequence[Track] = (),
    ) -> Rectangle:
        """Draw the chart into the corner of the canvas where it covers least.

        Args:
            canvas: (H, W, 3) RGB.
            boats: of the picture.
            estimator: whose ranges are shown.
            camera: one (a batch of 1) of the canvas.
            unit: size of what is small.
            taken: places of the canvas that should stay free.
            tracks: whose trails are shown.

        Returns:
            The chart's place.
        """
        ranges = [(boat.ranges[estimator], boat) for boat in boats if boat.ranges[estimator].usable]
        step_m = self._fit([estimate for estimate, _ in ranges])
        left_rad, right_rad = field_of_view_rad(camera)
        half = max(abs(left_rad), abs(right_rad), 0.15)
        spread = math.sin(min(half, math.pi / 2))
        high, margin = 0.3 * min(canvas.shape[:2]), GAP * unit
        label_px = text_size(f"{self.reach_m:g} m", LABEL_SCALE * unit)[0]
        reach_px = min(high - 2 * margin, 0.8 * high / spread)
        wide = 2 * reach_px * spread + 2 * margin + label_px
        place = self._settle(canvas, wide, high, unit, taken)
        eye = np.array([place[0] + margin + reach_px * spread, place[3] - margin])
        px_per_m = reach_px / self.reach_m

        with translucent(canvas, 0.78, place):
            rounded(canvas, place, 7 * unit, INK)
            fill(canvas, np.concatenate([[eye], _arc(eye, reach_px, left_rad, right_rad)]), WEDGE)
        thin = max(1, round(unit))
        rings_m = [step_m * ring for ring in range(1, round(self.reach_m / step_m) + 1)]
        for distance_m in rings_m:
            stroke(canvas, _arc(eye, distance_m * px_per_m, left_rad, right_rad), RING, thin, closed=False)
        for distance_m in rings_m:
            words = f"{distance_m:g} m" if distance_m == rings_m[-1] else f"{distance_m:g}"
            end = _arc(eye, distance_m * px_per_m, left_rad, right_rad)[-1] + np.array([4.0, 4.0]) * unit
            text(canvas, words, (round(end[0]), round(end[1])), LABEL_SCALE * unit, GREY)
        for track in tracks:
            inside = np.hypot(*track.trail_m.T)[:, None] < self.reach_m
            draw_trail(canvas, eye + np.where(inside, track.trail_m * (px_per_m, -px_per_m), np.nan), 0.7 * unit)
        for estimate, boat in sorted(ranges, key=lambda pair: -pair[0].horizontal_m):
            self._draw_boat(canvas, estimate, boat, camera, eye, px_per_m, unit)
        nose, side = np.array([0, -7.0]) * unit, np.array([4.5, 4.0]) * unit
        fill(canvas, np.array([eye + nose, eye + side, eye + side * (-1, 1)]), WHITE)
        return place

    def _settle(self, canvas: Picture, wide: float, high: float, unit: float, taken: Sequence[Rectangle]) -> Rectangle:
        """Stay in the corner, or move to the one that covers least where that is less."""
        gap = GAP * unit
        height, width = canvas.shape[:2]

        def place(corner: tuple[int, int]) -> Rectangle:
            x, y = (width - gap - wide if corner[0] else gap), (height - gap - high if corner[1] else gap)
            return x, y, x + wide, y + high

        def covered(corner: tuple[int, int]) -> float:
            x1, y1, x2, y2 = place(corner)
            return sum(max(0.0, min(x2, t[2]) - max(x1, t[0])) * max(0.0, min(y2, t[3]) - max(y1, t[1])) for t in taken)

        self.corner = min((self.corner, *CORNERS), key=covered)  # the first of those that cover least
        return place(self.corner)

    def _fit(self, estimates: Sequence[RangeRecord]) -> float:
        """Choose the reach; return the distance between rings."""
        farthest_m = max(
            (1.05 * e.horizontal_m + Z_90 * min(e.slant_std_m, e.slant_m / 2) for e in estimates), default=0
        )
        levels = [level for level in STEPS_M if level >= 5]
        wanted = next((level for level in levels if level >= farthest_m), levels[-1])
        if estimates and (wanted > self.reach_m or farthest_m < 0.35 * self.reach_m):
            self.reach_m = float(wanted)
        self.reach_m = self.reach_m or 50.0
        return max(step for step in STEPS_M if step * RINGS <= self.reach_m)

    def _draw_boat(
        self,
        canvas: Picture,
        estimate: RangeRecord,
        boat: BoatRecord,
        camera: Camera,
        eye: FloatArray,
        px_per_m: float,
        unit: float,
    ) -> None:
        """A dot, or a hull where its heading is known, and the ellipse that spans the range's 90 % interval."""
        away = np.array([math.sin(estimate.bearing_rad), -math.cos(estimate.bearing_rad)])
        across = np.array([-away[1], away[0]])
        length_px = max(Z_90 * min(estimate.slant_std_m, self.reach_m) * px_per_m, 3.0 * unit)
        width_px = max(Z_90 * _lateral_std_rad(boat, camera) * estimate.horizontal_m * px_per_m, 3.0 * unit)
        covariance = length_px**2 * np.outer(away, away) + width_px**2 * np.outer(across, across)
        place = eye + min(estimate.horizontal_m, self.reach_m) * px_per_m * away
        ellipse(canvas, place, covariance, YELLOW, max(1, round(unit)))
        if boat.heading_std_rad < KNOWN_HEADING_RAD:
            for colour, size in ((INK, 1.3), (YELLOW, 1.0)):
                fill(canvas, place + size * unit * _turned(HULL, boat.heading_rad), colour)
        else:
            disc(canvas, place, 3.8 * unit, INK)
            disc(canvas, place, 2.8 * unit, YELLOW)


def field_of_view_rad(camera: Camera) -> tuple[float, float]:
    """Azimuths of the left and the right end of the picture's middle row, clockwise from the optical axis."""
    width, height = camera.size_px[0].tolist()
    ends = torch.tensor([[[0.0, (height - 1) / 2], [width - 1, (height - 1) / 2]]], dtype=camera.K.dtype)
    rays = level_rays(ends, camera)[0]
    left, right = torch.atan2(rays[:, 0], rays[:, 2]).tolist()
    return left, right


def _lateral_std_rad(boat: BoatRecord, camera: Camera) -> float:
    std_px = math.sqrt(max(0.0, float(np.median(boat.keypoint_covariance_px2[:, 0, 0]))))
    return std_px / float(camera.K[0, 0, 0])


def _arc(eye: FloatArray, radius_px: float, left_rad: float, right_rad: float) -> FloatArray:
    angle = np.linspace(left_rad, right_rad, 33)
    return eye + radius_px * np.stack([np.sin(angle), -np.cos(angle)], axis=1)


def _turned(outline: FloatArray, heading_rad: float) -> FloatArray:
    """Points (N, 2), to starboard and ahead, as they lie on the chart of a boat with that heading."""
    ahead = np.array([math.sin(heading_rad), -math.cos(heading_rad)])
    starboard = np.array([-ahead[1], ahead[0]])
    return outline @ np.stack([starboard, ahead])
