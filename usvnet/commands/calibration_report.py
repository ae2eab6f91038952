"""What a calibration looks like to people: two tables for the terminal and the coverage picture."""

from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon
from rich.table import Table

from usvnet.geometry.calibration import CalibrationResult
from usvnet.geometry.calibration_quality import coverage, field_of_view_deg, undistort

COLOURS = "viridis"
INK = "0.25"


def result_table(result: CalibrationResult) -> Table:
    """The camera with one sigma on everything, and what the picture spans."""
    table = Table("", "value", "+- 1 sigma", "unit", title="Camera")
    for column in table.columns[1:3]:
        column.justify = "right"
    for name, (i, j) in {"fx": (0, 0), "fy": (1, 1), "cx": (0, 2), "cy": (1, 2)}.items():
        table.add_row(name, f"{result.K[i, j]:.2f}", f"{result.K_std[i, j]:.2f}", "px")
    for name, value, std in zip(("k1", "k2", "p1", "p2", "k3"), result.distortion, result.distortion_std):
        table.add_row(name, f"{value:.5f}", f"{std:.5f}" if std else "held", "")
    horizontal, vertical = field_of_view_deg(result)
    table.add_section()
    table.add_row("RMS error", f"{result.rms_px:.3f}", "", "px")
    table.add_row("field of view", f"{horizontal:.1f} x {vertical:.1f}", "", "deg")
    table.add_row("picture covered", f"{coverage(result):.0%}", "", "")
    return table


def view_table(result: CalibrationResult) -> Table:
    """Each view: its error, where the board was, and the views left out."""
    table = Table("view", "RMS px", "worst px", "distance m", "tilt deg", title="Views")
    for column in table.columns[1:]:
        column.justify = "right"
    distance = np.linalg.norm(result.translation_m + result.rotation @ result.board_m.mean(0), axis=-1)
    tilt = np.degrees(np.arccos(np.clip(np.abs(result.rotation[:, 2, 2]), 0, 1)))
    worst = np.linalg.norm(result.residual_px, axis=-1).max(-1)
    for i, view in enumerate(result.views):
        error = result.view_error_px[i]
        table.add_row(view.name, f"{error:.3f}", f"{worst[i]:.2f}", f"{distance[i]:.2f}", f"{tilt[i]:.0f}")
    for bad in result.rejected:
        table.add_row(bad.view.name, f"{bad.error_px:.3f}", "left out", "", "", style="red")
    return table


def draw_coverage(result: CalibrationResult, path: Path) -> None:
    """Write a PNG: corners over the frame with enlarged residuals, each view's error, and the residuals' spread.

    One colour scale, a view's RMS error, runs through all three panels.
    """
    figure = Figure(figsize=(13, 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(2, 2, width_ratios=(2.4, 1))
    frame, top, bottom = (figure.add_subplot(place) for place in (grid[:, 0], grid[0, 1], grid[1, 1]))
    errors = result.view_error_px
    scale = ScalarMappable(Normalize(0.9 * errors.min(), 1.05 * errors.max()), COLOURS)
    _draw_frame(frame, result, scale)
    _draw_views(top, result, scale)
    _draw_residuals(bottom, result, scale)
    horizontal, vertical = field_of_view_deg(result)
    figure.suptitle(
        f"f = {result.focal_px:.1f} ± {result.focal_std_px:.1f} px   field of view {horizontal:.1f}° x {vertical:.1f}°"
        f"   RMS {result.rms_px:.2f} px   {len(result.views)} views, {len(result.rejected)} left out"
        f"   {coverage(result):.0%} of the picture covered",
        fontsize=12,
        fontweight="bold",
    )
    figure.savefig(path, dpi=120)


def _draw_frame(axes: Axes, result: CalibrationResult, scale: ScalarMappable) -> None:
    """Every corner where it was seen, its residual enlarged, over the lines of equal distortion."""
    width, height = result.size_px
    _draw_distortion(axes, result)
    enlarged = _round_number(0.02 * width / max(result.rms_px, 1e-9))
    for i in np.argsort(result.view_error_px):
        corners, colour = result.views[i].corners_px, scale.to_rgba(result.view_error_px[i])
        hull = cv2.convexHull(corners.astype(np.float32)).reshape(-1, 2)
        axes.add_patch(Polygon(hull, facecolor=(*colour[:3], 0.06), edgecolor=(*colour[:3], 0.35), linewidth=0.5))
        tips = np.stack([corners, corners + enlarged * result.residual_px[i]])
        axes.plot(*tips.transpose(2, 0, 1), color=colour, linewidth=0.8)
        axes.plot(*corners.T, ".", color=colour, markersize=3)
    for bad in result.rejected:
        axes.plot(*bad.view.corners_px.T, "x", color="tab:red", markersize=4, linewidth=0.8)
    axes.plot(*result.K[:2, 2], "+", color=INK, markersize=14, markeredgewidth=1.5)
    axes.annotate(
        "principal point",
        (result.K[0, 2], result.K[1, 2]),
        (8, 8),
        textcoords="offset points",
        fontsize=8,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.5},
    )
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal", xlabel="u (px)", ylabel="v (px)")
    left_out = ", red crosses: views left out" if result.rejected else ""
    axes.set_title(
        f"Corners and their residuals x {enlarged:g}; dotted: pixels moved by the lens{left_out}", fontsize=10
    )


def _draw_distortion(axes: Axes, result: CalibrationResult) -> None:
    """Dotted lines of equal distance between a pixel and where a perfect lens would have put it."""
    width, height = result.size_px
    u, v = np.meshgrid(np.linspace(0, width - 1, 97), np.linspace(0, height - 1, 73))
    pixels = np.stack([u, v], -1).reshape(-1, 2)
    ideal = undistort(pixels, result) * result.K[[0, 1], [0, 1]] + result.K[:2, 2]
    moved = np.linalg.norm(ideal - pixels, axis=-1).reshape(u.shape)
    step = _round_number(np.percentile(moved, 98) / 5)
    levels = step * np.array([0.5, 1, 2, 3, 4, 5, 6, 8, 10])
    lines = axes.contour(u, v, moved, levels=levels, colors="0.6", linestyles="dotted", linewidths=1)
    axes.clabel(lines, fmt=lambda level: f"{level:g} px", fontsize=7)


def _draw_views(axes: Axes, result: CalibrationResult, scale: ScalarMappable) -> None:
    """Bars of each view's error, those left out in red."""
    names = [view.name for view in result.views] + [bad.view.name for bad in result.rejected]
    errors = [*result.view_error_px, *(bad.error_px for bad in result.rejected)]
    colours = [scale.to_rgba(error) for error in result.view_error_px] + ["tab:red"] * len(result.rejected)
    bars = axes.bar(range(len(names)), errors, color=colours)
    shown = 1.4 * float(result.view_error_px.max())
    for bar, error in zip(bars, errors):
        if error > shown:  # a view left out may be tens of pixels off: its figure instead of its height
            middle = bar.get_x() + bar.get_width() / 2
            axes.text(middle, 0.97 * shown, f"{error:.1f}", color="white", fontsize=7, ha="center", va="top")
    axes.axhline(result.rms_px, color=INK, linewidth=1, linestyle="dashed")
    axes.set(ylim=(0, shown), ylabel="RMS error (px)", title="Error of each view (dashed: all views)")
    every = max(1, len(names) // 20)
    axes.set_xticks(range(0, len(names), every), [name[-18:] for name in names[::every]], rotation=90, fontsize=7)
    axes.title.set_fontsize(10)


def _draw_residuals(axes: Axes, result: CalibrationResult, scale: ScalarMappable) -> None:
    """All residuals around zero: a round cloud is noise, a lopsided one is not."""
    for residual, error in zip(result.residual_px, result.view_error_px):
        axes.plot(*residual.T, ".", color=scale.to_rgba(error), markersize=3, alpha=0.7)
    axes.add_patch(Circle((0, 0), result.rms_px, fill=False, color=INK, linewidth=1, linestyle="dashed"))
    reach = max(1.05 * float(np.abs(result.residual_px).max()), 1e-9)
    axes.set(xlim=(-reach, reach), ylim=(reach, -reach), aspect="equal", xlabel="du (px)", ylabel="dv (px)")
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    axes.set_title("Residuals (dashed: RMS)", fontsize=10)


def _round_number(value: float) -> float:
    """The nearest of 1, 2, 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(max(value, 1e-9)))
    return float(min((1, 2, 5, 10), key=lambda digit: abs(digit * power - value)) * power)
