"""Stand-ins for ROS messages with the fields that are used, as strict about types as the generated classes.

Definitions: vision_msgs 4 (Detection2D, Detection3D, BoundingBox2D with a Pose2D of a Point2D), geometry_msgs,
sensor_msgs.
"""

from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any


class Strict:
    """Refuses a field that is unknown or of another type, as rclpy's messages do."""

    def __setattr__(self, name: str, value: Any) -> None:
        kind = self.__dataclass_fields__[name].type  # a KeyError for an unknown field
        assert isinstance(value, kind), f"{type(self).__name__}.{name}: got {type(value)}, expected {kind}"
        if name == "covariance":
            assert len(value) == 36
            assert all(type(number) is float for number in value)
        object.__setattr__(self, name, value)


@dataclass
class Time(Strict):
    sec: int = 0
    nanosec: int = 0


@dataclass
class Header(Strict):
    stamp: Time = field(default_factory=Time)
    frame_id: str = ""


@dataclass
class Point(Strict):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class Quaternion(Strict):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


@dataclass
class Pose(Strict):
    position: Point = field(default_factory=Point)
    orientation: Quaternion = field(default_factory=Quaternion)


@dataclass
class PoseWithCovariance(Strict):
    pose: Pose = field(default_factory=Pose)
    covariance: list = field(default_factory=lambda: [0.0] * 36)


@dataclass
class ObjectHypothesis(Strict):
    class_id: str = ""
    score: float = 0.0


@dataclass
class ObjectHypothesisWithPose(Strict):
    hypothesis: ObjectHypothesis = field(default_factory=ObjectHypothesis)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


@dataclass
class Vector3(Strict):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


@dataclass
class BoundingBox3D(Strict):
    center: Pose = field(default_factory=Pose)
    size: Vector3 = field(default_factory=Vector3)


@dataclass
class Point2D(Strict):
    x: float = 0.0
    y: float = 0.0


@dataclass
class Pose2D(Strict):
    position: Point2D = field(default_factory=Point2D)
    theta: float = 0.0


@dataclass
class BoundingBox2D(Strict):
    center: Pose2D = field(default_factory=Pose2D)
    size_x: float = 0.0
    size_y: float = 0.0


@dataclass
class Detection3D(Strict):
    header: Header = field(default_factory=Header)
    results: list = field(default_factory=list)
    bbox: BoundingBox3D = field(default_factory=BoundingBox3D)
    id: str = ""


@dataclass
class Detection2D(Strict):
    header: Header = field(default_factory=Header)
    results: list = field(default_factory=list)
    bbox: BoundingBox2D = field(default_factory=BoundingBox2D)
    id: str = ""


@dataclass
class Detection3DArray(Strict):
    header: Header = field(default_factory=Header)
    detections: list = field(default_factory=list)


@dataclass
class Detection2DArray(Strict):
    header: Header = field(default_factory=Header)
    detections: list = field(default_factory=list)


VISION_MSGS = SimpleNamespace(
    Detection3DArray=Detection3DArray,
    Detection3D=Detection3D,
    Detection2DArray=Detection2DArray,
    Detection2D=Detection2D,
    ObjectHypothesisWithPose=ObjectHypothesisWithPose,
)


def camera_info(**fields: Any) -> SimpleNamespace:
    """sensor_msgs/CameraInfo of a 640 x 480 camera."""
    k = [600.0, 0, 322, 0, 610, 236, 0, 0, 1]
    p = [580.0, 0, 320, 0, 0, 580, 240, 0, 0, 0, 1, 0]
    roi = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0)
    plain = {"width": 640, "height": 480, "distortion_model": "plumb_bob", "d": [-0.2, 0.05, 1e-3, -5e-4, 0.01]}
    return SimpleNamespace(**(plain | {"k": k, "p": p, "roi": roi, "binning_x": 0, "binning_y": 0} | fields))
