"""Which cameras look and which boats are seen. Degrees, metres and pixels, as in files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from usvnet.simulator.frame_spec import HullFamily
from usvnet.simulator.typed_yaml import Bounded, Bounds, Range

ZERO = Range(0, 0)
GOOD_LENS_PX = Range(0.4, 0.7)
GOOD_JPEG = Range(90, 90)


@dataclass(frozen=True)
class LensSettings(Bounded):
    """Plumb-bob distortion, drawn once a camera."""

    k1: Annotated[Range, Bounds(-1, 1)] = ZERO
    k2: Annotated[Range, Bounds(-1, 1)] = ZERO
    p1: Annotated[Range, Bounds(-0.1, 0.1)] = ZERO
    p2: Annotated[Range, Bounds(-0.1, 0.1)] = ZERO
    k3: Annotated[Range, Bounds(-1, 1)] = ZERO


@dataclass(frozen=True)
class MountSettings(Bounded):
    """How a camera stands, drawn once a camera, and how each frame strays from it."""

    height_m: Annotated[Range, Bounds(0.1, 100)]
    pitch_deg: Annotated[Range, Bounds(-45, 80)]
    roll_deg: Annotated[Range, Bounds(-45, 45)] = ZERO
    height_std_m: Annotated[float, Bounds(0, 5)] = 0.0
    pitch_std_deg: Annotated[float, Bounds(0, 15)] = 0.0
    roll_std_deg: Annotated[float, Bounds(0, 15)] = 0.0


@dataclass(frozen=True)
class CameraSettings(Bounded):
    """One camera, or ``count`` of a kind. Either ``file``, or ``size_px``, ``mount`` and the focal length."""

    file: Path | None = None
    """A camera file (ROS or OpenCV); its standard deviations are how far the truth strays from it."""
    size_px: tuple[int, int] | None = None
    """Width and height."""
    focal_px: Annotated[Range | None, Bounds(10, 100_000)] = None
    hfov_deg: Annotated[Range | None, Bounds(5, 130)] = None
    """Horizontal field of view of the pinhole, instead of ``focal_px``."""
    principal_offset_px: Range | None = None
    """How far the principal point lies off the middle, across and down."""
    distortion: LensSettings | None = None
    mount: MountSettings | None = None
    focal_std_px: Annotated[float | None, Bounds(0)] = None
    """How far the true focal length strays from the camera file, once a camera."""
    count: Annotated[int, Bounds(1, 100)] = 1
    share: Annotated[float, Bounds(0)] = 1.0
    """How often, relative to the other cameras that see the water where the boat is; together for all ``count``."""
    seed: Annotated[int, Bounds(0)] = 0
    """Another dataset with the same entry has the same cameras."""
    imu_std_deg: Annotated[float | None, Bounds(0, 15)] = None
    """Error of a measured pitch and roll; where it is left out, nothing is measured but the mount."""
    readout_s: Annotated[float, Bounds(0, 0.1)] = 0.0
    """From the first row to the last of a rolling shutter; 0 is a global one."""
    turn_rate_std_deg_s: Annotated[float, Bounds(0, 90)] = 0.0
    """How fast the camera turns about each axis while it takes a picture."""
    blur_px: Annotated[Range, Bounds(0, 5)] = GOOD_LENS_PX
    """Standard deviation of the lens blur."""
    jpeg_quality: Annotated[Range, Bounds(10, 100)] = GOOD_JPEG

    def __post_init__(self) -> None:
        super().__post_init__()
        inline = ("size_px", "focal_px", "hfov_deg", "principal_offset_px", "distortion", "mount", "focal_std_px")
        given = [name for name in inline if getattr(self, name) is not None]
        if self.file is not None:
            if given:
                raise ValueError(f"{given[0]}: the camera file says that, expected it not beside file")
            if self.count != 1:
                raise ValueError("count: expected 1 beside file")
            if not self.file.is_file():
                raise ValueError(f"file: no such file: {self.file}")
            return
        for name in ("size_px", "mount"):
            if name not in given:
                raise ValueError(f"{name} is missing (or a camera file under file)")
        if ("focal_px" in given) == ("hfov_deg" in given):
            raise ValueError("expected either focal_px or hfov_deg")
        if self.size_px is not None and min(self.size_px) < 64:
            raise ValueError(f"size_px: expected at least 64 pixels, got {list(self.size_px)}")


@dataclass(frozen=True)
class HullSettings(Bounded):
    """One boat, or ``count`` of a family: ``length_m``, or ``mesh_file`` and ``keypoints_file`` for the family mesh."""

    family: HullFamily
    length_m: Annotated[Range | None, Bounds(0.3, 60)] = None
    """The lengths of the different hulls, spread evenly."""
    count: Annotated[int, Bounds(1, 1000)] = 1
    share: Annotated[float, Bounds(0)] = 1.0
    """How often, relative to the other entries whose hulls have a fitting size; together for all ``count``."""
    seed: Annotated[int, Bounds(0)] = 0
    """Another dataset with the same entry has the same hulls."""
    paint: Literal["varied", "fixed"] = "varied"
    """Another coat of paint in every frame, or one a hull."""
    mesh_file: Path | None = None
    """OBJ or PLY in the hull frame, metres."""
    keypoints_file: Path | None = None
    """The seven keypoints, as in :mod:`usvnet.geometry.hull_files`."""

    def __post_init__(self) -> None:
        super().__post_init__()
        files = {"mesh_file": self.mesh_file, "keypoints_file": self.keypoints_file}
        for name, path in files.items():
            if (path is not None) != (self.family == "mesh"):
                raise ValueError(f"{name}: expected for the family mesh and for no other")
            if path is not None and not path.is_file():
                raise ValueError(f"{name}: no such file: {path}")
        if self.mesh_file is not None and self.mesh_file.suffix.lower() not in (".obj", ".ply"):
            raise ValueError(f"mesh_file: expected .obj or .ply, got {self.mesh_file.name}")
        if (self.length_m is None) != (self.family == "mesh"):
            raise ValueError("length_m: expected for every family but mesh, whose keypoints say it")
        if self.family == "mesh" and self.count != 1:
            raise ValueError("count: expected 1 for the family mesh")
