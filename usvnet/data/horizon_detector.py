"""The horizon in a photograph: a straight, sharp, wide edge between sky and water near where the camera points it.

The picture is unrolled along the curve where the horizon is expected, so that a lens that bends it and a camera that
is rolled make no difference: in this strip the horizon is nearly level. It is searched in the band that the camera's
own sigmas leave, measured to a fraction of a pixel in blocks of columns, and fitted robustly.

A shore is not the horizon: its foot lies lower, by about height / distance. What lies around the line decides: sky is
smooth and brighter than water, and water does not brighten towards the camera; land does otherwise.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from usvnet.data.pictures import Picture
from usvnet.geometry.attitude import Attitude
from usvnet.geometry.camera import camera_to, with_attitude
from usvnet.geometry.horizon import WaterEdge, attitude_from_edge, edge_px, sea_horizon
from usvnet.types import Camera

Floats = NDArray[np.float64]

BLOCK_PX = 8
"""Columns that are averaged before an edge is looked for in them."""
BAND_STDS = 4.0
"""The search reaches this many sigmas of the attitude to either side,"""
LEAST_BAND_PX = 3.0
"""but at least so far,"""
MOST_BAND = 0.4
"""and at most this share of the picture's height."""
REACH_PX = 6
"""Rows to either side of the line in which a block looks for its edge."""
AROUND_PX = 46
"""Rows to either side of the line that must look like sky and like water."""
EDGE_STD_PX, TILT_STD_PX, SOFT_STD_PX = 0.3, 0.2, 4.0
"""What blur, compression and waves do to the line as a whole and to its ends, and how much an edge that is spread over
more rows than SHARP may be off: haze hides the far water."""
SHARP, LEAST_SHARP = 0.8, 0.4
"""Share of the step within two rows: of a clear horizon, and the least that is still an edge."""


class Sight(NamedTuple):
    """What was found in one picture."""

    attitude: Attitude | None
    """Pitch and roll with their sigmas (B = 1), float64; None where no horizon is to be seen."""
    reason: str
    """Why not: ``outside``, ``faint``, ``hazy``, ``crooked``, ``shore``; empty where it was found."""
    points_px: Floats | None
    """(2, 2) leftmost and rightmost point of the line that was looked at, in pixels of the picture."""


class _Strip(NamedTuple):
    """A picture unrolled along a curve; the middle row lies on it."""

    colours: Floats
    """(rows, blocks, 3) mean of each block of columns; NaN outside the picture."""
    u_px: Floats
    """(blocks,) middle column of each block."""
    v_px: Floats
    """(blocks,) row of the picture where the strip's middle row lies."""
    x: Floats
    """(blocks,) -0.5 at the left end to 0.5 at the right end."""
    noise: float
    """Standard deviation of a block's colour from row to row, in grey levels."""


class _Line(NamedTuple):
    """A line in a strip and what speaks for and against it. Steps are shares of the line's own."""

    middle_px: float
    """Rows below the strip's middle row, at x = 0."""
    tilt_px: float
    """Rows from the left to the right end."""
    covariance_px2: Floats
    """(2, 2) of the rows of its left and right end."""
    snr: float
    """Step across the line over the noise of a block."""
    seen: float
    """Share of the blocks whose edge lies within a pixel of it."""
    span: float
    """Share of the width from the first to the last of these."""
    rms_px: float
    """Their scatter about it."""
    sharpness: float
    """Share of the step that happens within two rows."""
    brighter: float
    """Share of the blocks that are brighter above than below."""
    second: float
    """Largest other step that goes along with the whole line, above or below it."""
    busy: float
    """Largest other step in the middling block above it."""
    rebrightening: float
    """How much the colour turns back to that above the line, farther below it."""
    rough: float
    """Change from block to block just above it."""


def find_horizon(picture: Picture, camera: Camera, edge: WaterEdge | None = None) -> Sight:
    """Find the water's far edge and what it says about the camera's attitude.

    The result is independent of the camera's own pitch and roll, which only say where to search, as far as their
    standard deviations are honest.

    Args:
        picture: (H, W, 3) RGB.
        camera: its camera (B = 1), with an attitude and sigmas.
        edge: how far below the horizontal the open water ends; by default at the sea's horizon.
    """
    camera = camera_to(camera, dtype=torch.float64)
    edge = sea_horizon(camera) if edge is None else WaterEdge(*(field.double() for field in edge))
    shift_px, tilt_px = _band(picture.shape, camera, edge)
    strip = _unroll(picture, camera, edge, math.ceil(shift_px + tilt_px / 2) + REACH_PX)
    if strip is None:
        return Sight(None, "outside", None)
    points = _ends(strip, *_search(strip, shift_px, tilt_px))
    line = None
    for _ in range(2):  # the second time along the line itself
        camera = _turned(camera, points, edge)
        strip = _unroll(picture, camera, edge, AROUND_PX)
        if strip is None:
            return Sight(None, "outside", points)
        line = _measure(strip)
        if line is None:
            return Sight(None, "faint", points)
        points = _ends(strip, line.middle_px, line.tilt_px)
    assert line is not None
    if reason := _fault(line):
        return Sight(None, reason, points)
    covariance = torch.from_numpy(line.covariance_px2)[None]
    return Sight(attitude_from_edge(torch.from_numpy(points)[None], covariance, camera, edge), "", points)


def _band(shape: tuple[int, ...], camera: Camera, edge: WaterEdge) -> tuple[float, float]:
    """How far the line may be shifted (px) and tilted (px over the width) from where the camera expects it."""
    height, width = shape[:2]
    pitch_std = math.hypot(camera.pitch_std_rad.item(), edge.std_rad.item())
    stds_px = (camera.K[0, 1, 1].item() * pitch_std, width * camera.roll_std_rad.item())
    shift_px, tilt_px = (min(max(BAND_STDS * std, LEAST_BAND_PX), MOST_BAND * height) for std in stds_px)
    return shift_px, tilt_px


def _unroll(picture: Picture, camera: Camera, edge: WaterEdge, reach_px: int) -> _Strip | None:
    """Unroll the picture along the edge of the water as the camera stands; None where that is not in it."""
    height, width = picture.shape[:2]
    azimuth = torch.linspace(-1.4, 1.4, 561, dtype=torch.float64)[None]
    curve = edge_px(camera, edge.depression_rad, azimuth)[0].numpy()
    curve = curve[np.isfinite(curve).all(1)]
    curve = curve[np.argsort(curve[:, 0])]
    columns = np.arange(width // BLOCK_PX * BLOCK_PX, dtype=float)
    if not len(curve) or curve[0, 0] > 0 or curve[-1, 0] < columns[-1]:
        return None
    v = np.interp(columns, curve[:, 0], curve[:, 1])
    rows = (v + np.arange(-reach_px, reach_px + 1)[:, None]).astype(np.float32)
    colours = cv2.remap(picture, np.broadcast_to(columns.astype(np.float32), rows.shape).copy(), rows, cv2.INTER_LINEAR)
    colours = colours.astype(float)
    noise = 1.05 * float(np.median(np.abs(np.diff(colours, axis=1)).mean(-1))) / math.sqrt(2 * BLOCK_PX)
    colours[(rows < 0) | (rows > height - 1)] = np.nan

    def middle(of: Floats) -> Floats:
        return of.reshape(-1, BLOCK_PX).mean(1)

    u = middle(columns)
    blocks = colours.reshape(len(rows), -1, BLOCK_PX, 3).mean(2)
    return _Strip(blocks, u, middle(v), (u - u.mean()) / (u[-1] - u[0]), max(noise, 0.05))


def _steps(colours: Floats) -> Floats:
    """Step (rows, blocks, 3) of colour across each row: two rows above it minus two rows below, halved; 0 for none."""
    steps = np.zeros_like(colours)
    steps[2:-2] = np.nan_to_num(colours[:-4] + colours[1:-3] - colours[3:-1] - colours[4:]) / 2
    return steps


def _search(strip: _Strip, shift_px: float, tilt_px: float) -> tuple[float, float]:
    """Shift and tilt of the line across which the middling colours change most: half of it may be hidden."""
    steps = _steps(strip.colours)
    shifts = np.arange(-math.ceil(shift_px), math.ceil(shift_px) + 1)
    blocks = np.arange(len(strip.x))
    best, found = -1.0, (0.0, 0.0)
    for tilt in np.arange(-math.ceil(tilt_px), math.ceil(tilt_px) + 1):
        rows = len(steps) // 2 + shifts[:, None] + np.rint(tilt * strip.x).astype(int)
        step = np.linalg.norm(np.median(steps[rows, blocks], 1), axis=-1)
        if step.max() > best:
            best, found = step.max(), (float(shifts[step.argmax()]), float(tilt))
    return found


def _ends(strip: _Strip, middle_px: float, tilt_px: float) -> Floats:
    return np.stack([strip.u_px, strip.v_px + middle_px + tilt_px * strip.x], -1)[[0, -1]]


def _turned(camera: Camera, points_px: Floats, edge: WaterEdge) -> Camera:
    exactly = torch.zeros(1, 2, 2, dtype=torch.float64)
    found = attitude_from_edge(torch.from_numpy(points_px)[None], exactly, camera, edge)
    return with_attitude(camera, found.pitch_rad, found.roll_rad)


def _measure(strip: _Strip) -> _Line | None:
    """Fit a line to the edges near the strip's middle row, and look around it; None without enough of an edge."""
    middle = len(strip.colours) // 2
    inside = np.isfinite(strip.colours[middle - REACH_PX - 2 : middle + REACH_PX + 3]).all((0, 2))
    if inside.mean() < 0.5:
        return None
    colours = strip.colours[:, inside]
    x, steps = strip.x[inside], _steps(colours)
    above, below = colours[middle - 6 : middle - 1].mean(0), colours[middle + 2 : middle + 7].mean(0)
    difference = np.median(above - below, 0)
    contrast = max(float(np.linalg.norm(difference)), 1e-6)
    across = difference / contrast

    row, step = _edges(steps[middle - REACH_PX : middle + REACH_PX + 1] @ across)
    usual = float(np.median(step))
    sharp = step > max(0.3 * usual, 4 * strip.noise)
    if sharp.sum() < 8:
        return None
    line = _fit_line(x[sharp], row[sharp])
    miss = row - line[0] - line[1] * x
    on = sharp & (np.abs(miss) < 1)
    if on.sum() < 8:
        return None
    rms = float(np.sqrt(np.mean(miss[on] ** 2)))

    # the line's own step against all others; a little wider than a block, for noise
    main = max(float(np.linalg.norm(np.median(steps[middle], 0))), 1e-6)
    along = np.linalg.norm(np.median(steps, 1), axis=-1) / main
    single = np.linalg.norm(cv2.blur(steps, (5, 1)), axis=-1)
    own = max(float(np.median(single[middle])), 1e-6)
    wide = (colours[middle - 12 : middle - 8].mean(0) - colours[middle + 9 : middle + 13].mean(0)) @ across
    whole = max(float(np.linalg.norm(above - below, axis=-1).mean()), float(np.nan_to_num(np.abs(np.median(wide)))))
    farther = np.nan_to_num(np.nanmedian((colours[middle + 10 : middle + 26].mean(0) - below) @ across))
    texture = np.linalg.norm(np.diff(colours[middle - 8 : middle - 3].mean(0), axis=0), axis=-1)
    sharpness = usual / whole

    ends = np.stack([np.ones(2), strip.x[[0, -1]]], -1)
    A = np.stack([np.ones(on.sum()), x[on]], -1)
    scatter = ends @ np.linalg.inv(A.T @ A) @ ends.T * max(rms, 0.1) ** 2
    softness = SOFT_STD_PX * max(0.0, SHARP - sharpness)
    return _Line(
        middle_px=line[0],
        tilt_px=line[1],
        covariance_px2=scatter + (EDGE_STD_PX**2 + softness**2) + TILT_STD_PX**2 * np.eye(2),
        snr=usual / strip.noise,
        seen=float(on.sum() / len(strip.x)),
        span=float(np.ptp(x[on])),
        rms_px=rms,
        sharpness=sharpness,
        brighter=float((above.mean(-1) > below.mean(-1)).mean()),
        second=float(max(along[: middle - 3].max(), along[middle + 5 :].max())),
        busy=float(np.median(single[: middle - 4].max(0)) / own),
        rebrightening=float(farther) / contrast,
        rough=float(np.median(texture)) / usual,
    )


def _edges(step: Floats) -> tuple[Floats, Floats]:
    """Row (blocks,) of the largest step of each column (rows, blocks), from the middle row, by a parabola; the step."""
    peak = step[1:-1].argmax(0) + 1
    blocks = np.arange(step.shape[1])
    before, top, after = step[peak - 1, blocks], step[peak, blocks], step[peak + 1, blocks]
    bend = np.maximum(2 * top - before - after, 1e-9)
    return peak - len(step) // 2 + ((after - before) / (2 * bend)).clip(-1, 1), top


def _fit_line(x: Floats, row: Floats) -> tuple[float, float]:
    """Offset and slope by Tukey's iteratively reweighted least squares."""
    A = np.stack([np.ones_like(x), x], -1)
    line = np.array([np.median(row), 0.0])
    for _ in range(15):
        miss = row - A @ line
        reach = 4 * max(1.4826 * float(np.median(np.abs(miss))), 0.15)
        weight = np.where(np.abs(miss) < reach, (1 - (miss / reach) ** 2) ** 2, 0)
        line = np.linalg.solve(A.T @ (weight[:, None] * A) + 1e-9 * np.eye(2), A.T @ (weight * row))
    return float(line[0]), float(line[1])


def _fault(line: _Line) -> str:
    """Why the line is not the horizon; limits chosen on half of a rendered set with and without shores."""
    if line.seen < 0.6 or line.span < 0.6:
        return "faint"
    if line.sharpness < LEAST_SHARP:
        return "hazy"
    if line.rms_px > 0.2 + 8 / line.snr:  # noise alone scatters the edges by about 6 / snr
        return "crooked"
    land = (
        line.brighter < 0.6
        or line.second > 0.4
        or line.busy > 0.9
        or line.rebrightening > 0.05
        or line.rough > 0.15 + 6 / line.snr
    )
    return "shore" if land else ""
