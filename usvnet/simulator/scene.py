"""The scene as Mitsuba sees it: meshes, three kinds of surface, a sky and a pinhole.

Every frame has the same number of shapes and surfaces, whatever it shows: Dr.Jit compiles its kernels for that
structure once and takes them from its cache for every frame after. Call :func:`usvnet.simulator.engine.start_engine`
first.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np
from numpy.typing import NDArray

from usvnet.simulator.frame_spec import MAX_BOATS
from usvnet.simulator.meshes import Mesh

FAR_M = 2e4
WATER_REFRACTIVE_INDEX = 1.333
NOTHING = Mesh(
    np.array([[0, 0, -900], [1, 0, -900], [0, 1, -900]], np.float32),
    np.array([[0, 1, 2]], np.uint32),
    np.zeros((3, 3), np.float32),
    np.ones(3, np.float32),
)
"""A triangle that nobody sees, in place of a boat that is not there."""


@dataclass(frozen=True)
class View:
    """A pinhole with square pixels and its principal point in the middle."""

    width: int
    height: int
    focal_px: float
    eye_m: NDArray[np.float64]
    """(3,) in the world frame."""
    rotation: NDArray[np.float64]
    """(3, 3) from the world frame to the camera frame."""


@dataclass(frozen=True)
class Window:
    """A part of a view, in pixels: columns left to right and rows top to bottom, the ends excluded."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def area(self) -> int:
        """Pixels in it."""
        return (self.right - self.left) * (self.bottom - self.top)


class Scene:
    """Meshes and light, ready to be rendered and asked for what a ray meets."""

    def __init__(self, water: Mesh, floor: Mesh, backdrop: Mesh, boats: Sequence[Mesh], sky: NDArray[np.float32]):
        """Build the scene.

        Args:
            water: the waves, with smooth normals.
            floor: what shows below and beyond them.
            backdrop: shore and clutter.
            boats: at most :data:`usvnet.simulator.frame_spec.MAX_BOATS`, in the world frame.
            sky: (H, W, 3) radiance; column u looks at azimuth 2 pi u / W, row v at 180 v / H degrees from the zenith.
        """
        if len(boats) > MAX_BOATS:
            raise ValueError(f"{len(boats)} boats in one frame, expected at most {MAX_BOATS}")
        wet, paint, matt = _water_surface(), _paint_surface(), _matt_surface()
        shapes = {
            **{f"boat_{i}": _shape(f"boat_{i}", mesh, paint) for i, mesh in enumerate(_padded(boats))},
            "backdrop": _shape("backdrop", backdrop, matt),
            "water": _shape("water", water, wet),
            "floor": _shape("floor", floor, wet),
        }
        light = {
            "type": "envmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(sky, np.float32)),
            "to_world": mi.ScalarTransform4f().rotate([1, 0, 0], 90),
        }
        self.scene: Any = mi.load_dict({"type": "scene", **shapes, "sky": light})
        self.boat_of_index = _boats_by_index(self.scene.shapes())
        """Which boat a number in Mitsuba's ``shape_index`` channel means; others are no boats."""

    def distance(self, eye_m: NDArray, directions: NDArray) -> NDArray[np.float64]:
        """How far unit ``directions`` (N, 3) go from ``eye_m`` (3,) until they meet something; inf for the sky."""
        if mi.variant() == "scalar_rgb":
            hits = [self.scene.ray_intersect_preliminary(mi.Ray3f(eye_m, ray)).t for ray in directions]
            return np.array(hits, np.float64)
        ray = mi.Ray3f(mi.Point3f(*(float(x) for x in eye_m)), mi.Vector3f(np.asarray(directions, np.float32).T))
        return np.array(self.scene.ray_intersect_preliminary(ray).t, np.float64)


def make_sensor(view: View, window: Window | None = None, oversample: int = 1, jitter: bool = True) -> Any:
    """Mitsuba's camera for a view or for a part of it.

    Args:
        view: what to look through.
        window: the part of it to render.
        oversample: pixels of the film along each side of a pixel of the view.
        jitter: spread samples over a pixel, or put its one sample exactly at its centre.
    """
    film: dict[str, Any] = {
        "type": "hdrfilm",
        "width": view.width * oversample,
        "height": view.height * oversample,
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
        "component_format": "float32",
    }
    if window is not None:
        film |= {"crop_offset_x": window.left * oversample, "crop_offset_y": window.top * oversample}
        film |= {"crop_width": (window.right - window.left) * oversample}
        film |= {"crop_height": (window.bottom - window.top) * oversample}
    forward, up = view.rotation[2], -view.rotation[1]
    return mi.load_dict(
        {
            "type": "perspective",
            "fov": float(np.degrees(2 * np.arctan(view.width / 2 / view.focal_px))),
            "fov_axis": "x",
            "near_clip": 0.05,
            "far_clip": FAR_M,
            "to_world": mi.ScalarTransform4f().look_at(
                origin=view.eye_m.tolist(), target=(view.eye_m + forward).tolist(), up=up.tolist()
            ),
            "film": film,
            "sampler": {"type": "independent"} if jitter else {"type": "stratified", "jitter": False},
        }
    )


def _padded(boats: Sequence[Mesh]) -> list[Mesh]:
    return [*boats, *[NOTHING] * (MAX_BOATS - len(boats))]


def _shape(name: str, mesh: Mesh, surface: Any) -> Any:
    properties = mi.Properties()
    properties["bsdf"] = surface
    properties["face_normals"] = mesh.normals is None
    shape = mi.Mesh(
        name, len(mesh.vertices_m), len(mesh.faces), has_vertex_normals=mesh.normals is not None, props=properties
    )
    parameters = mi.traverse(shape)
    parameters["vertex_positions"] = mesh.vertices_m.ravel()
    parameters["faces"] = mesh.faces.ravel()
    if mesh.normals is not None:
        parameters["vertex_normals"] = mesh.normals.ravel()
    parameters.update()
    shape.add_attribute("vertex_color", 3, mesh.colours.ravel())
    shape.add_attribute("vertex_rough", 1, mesh.roughness.ravel())
    return shape


def _boats_by_index(shapes: Sequence[Any]) -> dict[int, int]:
    found = {}
    for place, shape in enumerate(shapes, start=1):
        if shape.id().startswith("boat_"):
            index = place  # the scalar engine counts a scene's shapes, the others every shape of the process
            if mi.variant() != "scalar_rgb":
                index = int(dr.reinterpret_array(mi.UInt32, mi.ShapePtr(shape))[0])
            found[index] = int(shape.id().removeprefix("boat_"))
    return found


def _attributes() -> dict[str, Any]:
    return {
        "type": "principled",
        "base_color": {"type": "mesh_attribute", "name": "vertex_color"},
        "roughness": {"type": "mesh_attribute", "name": "vertex_rough"},
    }


def _water_surface() -> Any:
    sampling = {"diffuse_reflectance_sampling_rate": 0.25, "main_specular_sampling_rate": 1.0}
    return mi.load_dict({**_attributes(), "eta": WATER_REFRACTIVE_INDEX, **sampling})


def _paint_surface() -> Any:
    gelcoat = {"specular": 0.5, "clearcoat": 0.5, "clearcoat_gloss": 0.9}
    return mi.load_dict({"type": "twosided", "surface": {**_attributes(), **gelcoat}})


def _matt_surface() -> Any:
    colour = {"type": "mesh_attribute", "name": "vertex_color"}
    return mi.load_dict({"type": "twosided", "surface": {"type": "diffuse", "reflectance": colour}})
