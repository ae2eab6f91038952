"""Radiance and geometry of a scene through a pinhole.

Two passes: light paths for the radiance, few over the whole view and more where the boats are, then one ray through
the middle of every sub-pixel for everything that must be exact (depth, what is seen where) and for the denoiser.
Nesting one in the other doubles the cost.
"""

from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.scene import Scene, View, Window, make_sensor

Floats = NDArray[np.float32]
MAX_DEPTH = 4
"""Light path: sky, water, hull and back to the camera is three bounces."""
MAX_SEED = 2**31
SMALL_WINDOW = 0.05
"""Share of the view that a small boat and the water around it fill."""


@dataclass(frozen=True)
class Quality:
    """How much work a picture is worth."""

    samples: int
    """Light paths for each pixel."""
    boat_samples: int
    """Further light paths for each pixel around a small boat, see :meth:`samples_in`."""
    subpixels: int
    """Exact rays along each side of a pixel."""
    denoise: Literal["no", "fast", "high"]
    """The fast filter takes half the time of the high one and costs 0.3 dB."""
    row_px: float
    column_px: float
    """Spacing of the water's rows and columns on the screen."""

    def samples_in(self, window: Window, view: View) -> int:
        """Further light paths for each pixel of a window; fewer in a large one, where details are large too."""
        share = SMALL_WINDOW * view.width * view.height / window.area
        return max(round(self.boat_samples * min(share, 1.0)), self.samples)


QUALITIES = {
    "preview": Quality(samples=2, boat_samples=4, subpixels=1, denoise="no", row_px=3.0, column_px=3.0),
    "standard": Quality(samples=4, boat_samples=12, subpixels=2, denoise="fast", row_px=1.2, column_px=1.6),
    "high": Quality(samples=24, boat_samples=40, subpixels=3, denoise="high", row_px=0.7, column_px=0.9),
}


class Geometry(NamedTuple):
    """What the exact rays met. H x W is the view, h x w is s times as large: s rays along each side of a pixel."""

    depth_m: Floats
    """(h, w) along the ray; inf for the sky."""
    boat: NDArray[np.int32]
    """(h, w) the boat that is seen, -1 for everything else."""
    albedo: Floats
    """(H, W, 3)"""
    normals: Floats
    """(H, W, 3) world frame."""


def render_radiance(scene: Scene, view: View, quality: Quality, seed: int, windows: list[Window]) -> Floats:
    """Radiance (H, W, 3) of a view, with more light paths in ``windows``, which may not overlap."""
    integrator = mi.load_dict({"type": "path", "max_depth": MAX_DEPTH, "rr_depth": MAX_DEPTH})

    def render(sensor: Any, samples: int, part: int) -> Floats:
        number = (seed * 16 + part) % MAX_SEED  # another seed for each part, or their noise would agree
        light = np.array(mi.render(scene.scene, sensor=sensor, integrator=integrator, spp=samples, seed=number))
        return np.nan_to_num(light, nan=0.0, posinf=0.0)  # one pixel that is no number would spoil the whole picture

    radiance = render(make_sensor(view), quality.samples, 0)
    for part, window in enumerate(windows, start=1):
        samples = quality.samples_in(window, view)
        more = render(make_sensor(view, window), samples, part)
        inside = radiance[window.top : window.bottom, window.left : window.right]
        share = samples / (quality.samples + samples)
        inside += share * (more - inside)
    return radiance


def trace_geometry(scene: Scene, view: View, quality: Quality) -> Geometry:
    """Send one ray through the middle of every sub-pixel."""
    s = quality.subpixels
    sensor = make_sensor(view, oversample=s, jitter=False)
    channels = {"type": "aov", "aovs": "albedo:albedo,normal:sh_normal,depth:depth,shape:shape_index"}
    film = np.array(mi.render(scene.scene, sensor=sensor, integrator=mi.load_dict(channels), spp=1, seed=0))
    albedo, normal, depth, shape = film[..., :3], film[..., 3:6], film[..., 6], film[..., 7]
    boat = np.full(shape.shape, -1, np.int32)
    for index, number in scene.boat_of_index.items():
        boat[shape == index] = number
    return Geometry(
        np.where(depth > 0, depth, np.inf).astype(np.float32),
        boat,
        _mean_of_blocks(albedo, s),
        _mean_of_blocks(normal, s),
    )


def free_memory() -> None:
    """Give back what the last frame held, so that a worker's memory stays flat.

    Hardly two scenes have the same number of shapes, so each compiles kernels of its own: 1 MB a frame if kept.
    """
    dr.flush_malloc_cache()
    dr.flush_kernel_cache()


def _mean_of_blocks(values: Floats, s: int) -> Floats:
    height, width, channels = values.shape
    blocks = values.reshape(height // s, s, width // s, s, channels)
    return blocks.mean((1, 3), dtype=np.float32)
