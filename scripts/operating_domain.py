"""Draw docs/pictures/operating-domain.png and print the tables of docs/operating-domain.md.

    python scripts/operating_domain.py

The waterline keypoint's range, to first order as in ``usvnet sensitivity``, for the camera of
configs/sensitivity/domain.yaml with one thing changed at a time.
"""

import math
from pathlib import Path

import torch
from jsonargparse import auto_cli
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from usvnet.evaluation.disturbances import first_order_std_m, known_stds, slopes
from usvnet.evaluation.scenario_boats import scenario_cases
from usvnet.evaluation.sensitivity_settings import SensitivitySettings, load_sensitivity
from usvnet.evaluation.tables import Column, Table
from usvnet.files import atomic_write, run_program
from usvnet.geometry.camera import scale_camera
from usvnet.geometry.camera_files import load_camera
from usvnet.geometry.hull_files import load_hull
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import Camera, Hull

ESTIMATOR = "waterline"
HEIGHTS_M = (0.75, 1.5, 3.0, 6.0, 12.0)
PITCHES_DEG = (0.03, 0.1, 0.3, 1.0)
FOCALS_PX = (350.0, 700.0, 1400.0, 2800.0)
WAVES_M = (0.02, 0.05, 0.1, 0.2)
DISTANCES_M = (5.0, 7.0, 10.0, 15.0, 20.0, 30.0, 50.0, 70.0, 100.0, 150.0, 200.0)
SHOWN_M = (5.0, 10.0, 20.0, 50.0, 100.0, 200.0)
SHOWN_PERCENT = (0.1, 0.3, 1.0, 3.0, 10.0, 30.0)
STEEPEST_RAD = math.radians(30)
"""Boats farther below the horizon are under the picture's edge."""

Curve = dict[float, float]
"""Standard deviation of the range as a share of it, by distance in metres."""


def main(config: Path = Path("configs/sensitivity/domain.yaml"), output: Path = Path("docs/pictures")) -> None:
    """Draw the figure and print the tables.

    Args:
        config: settings of the sensitivity study; its camera is the one that is changed.
        output: folder of the figure.
    """
    settings = load_sensitivity(config)
    if settings.camera is None or settings.hull is None:
        raise ValueError(f"{config}: expected a camera and a hull")
    camera, hull = load_camera(settings.camera), load_hull(settings.hull)

    def curve(camera: Camera, stds: dict[str, float]) -> Curve:
        return range_std(camera, hull, settings, stds)

    known = known_stds(camera, settings.keypoint_std_px)
    families = {
        "Camera height": {f"{h:g} m": curve(_at_height(camera, h), known) for h in HEIGHTS_M},
        "Pitch error": {f"{p:g} deg": curve(camera, {"pitch_deg": p}) for p in PITCHES_DEG},
        "Focal length": {f"{f:g} px": curve(_of_focal(camera, f), {"keypoint_px": 1.0}) for f in FOCALS_PX},
        "Waves": {f"{w:g} m": curve(camera, {"wave_m": w}) for w in WAVES_M},
    }
    titles = ("everything together", "pitch alone", "one pixel of the keypoint alone", "waves alone")
    figure = Figure(figsize=(11, 8.2), layout="constrained")
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for panel, title, (what, curves) in zip(panels.flatten(), titles, families.items()):
        draw(panel, title, what, curves)
    for panel in panels[1]:
        panel.set_xlabel("slant range, m")
    for panel in panels[:, 0]:
        panel.set_ylabel("standard deviation, % of the range")
    with atomic_write(output / "operating-domain.png") as temporary:
        figure.savefig(temporary, dpi=110)
    for what, curves in families.items():
        print(table(what, curves).to_markdown())


def range_std(camera: Camera, hull: Hull, settings: SensitivitySettings, stds: dict[str, float]) -> Curve:
    """What errors of these standard deviations cost together, at every distance that the picture shows."""
    distances = [d for d in DISTANCES_M if float(camera.height_m[0]) < d * math.sin(STEEPEST_RAD)]
    cases = scenario_cases(camera, hull, distances, settings.headings_deg[:1], settings.bearing_deg)
    ranging = RangingLayer(settings.curved_water)
    parts = [first_order_std_m(slopes(cases, name, ranging)[ESTIMATOR], std) for name, std in stds.items()]
    total_m = torch.stack(parts).square().sum(0).sqrt()
    return {distance: float(std_m) / distance for distance, std_m in zip(distances, total_m)}


def draw(panel: Axes, title: str, legend: str, curves: dict[str, Curve]) -> None:
    """One line for each curve, by distance."""
    for n, (label, curve) in enumerate(curves.items()):
        colour = colormaps["viridis"](0.9 * n / (len(curves) - 1))
        panel.plot(list(curve), [100 * share for share in curve.values()], color=colour, linewidth=2, label=label)
    panel.set(title=title, xscale="log", yscale="log", ylim=(SHOWN_PERCENT[0], SHOWN_PERCENT[-1]))
    panel.set_xticks(SHOWN_M, [f"{distance:g}" for distance in SHOWN_M])
    panel.set_yticks(SHOWN_PERCENT, [f"{percent:g}" for percent in SHOWN_PERCENT])
    panel.minorticks_off()
    panel.grid(alpha=0.3)
    panel.legend(title=legend.lower(), fontsize="small", title_fontsize="small")


def table(what: str, curves: dict[str, Curve]) -> Table:
    """Shares of the range at a few distances."""
    columns = [Column(what), *(Column(f"{distance:g} m", digits=1, percent=True) for distance in SHOWN_M)]
    return Table(what, columns, [[label, *(curve.get(d) for d in SHOWN_M)] for label, curve in curves.items()])


def _at_height(camera: Camera, height_m: float) -> Camera:
    return camera._replace(height_m=camera.height_m.new_tensor([height_m]))


def _of_focal(camera: Camera, focal_px: float) -> Camera:
    """The same view in more or fewer pixels."""
    scale = focal_px / float(camera.K[0, 0, 0])
    width, height = (round(scale * float(side)) for side in camera.size_px[0])
    return scale_camera(camera, (width, height))


if __name__ == "__main__":
    run_program(lambda: auto_cli(main, as_positional=False))
