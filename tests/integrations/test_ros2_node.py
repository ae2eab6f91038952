"""The node with stand-ins for rclpy and tf2: what it is told, and what it publishes."""

import importlib
import sys
from types import ModuleType, SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest
import yaml
from ros_messages import VISION_MSGS, Header, Quaternion, Strict, Time, camera_info
from scipy.spatial.transform import Rotation

from usvnet.deploy import predictor as predictor_room

PICTURE = np.random.default_rng(0).integers(0, 255, (64, 96, 3), np.uint8)
INFO = {"width": 96, "height": 64, "d": [], "k": [90.0, 0, 47.5, 0, 90, 31.5, 0, 0, 1]}
DOWN_DEG = 17.0


class Publisher:
    def __init__(self):
        self.messages = []
        self.listeners = 0

    def publish(self, message):
        assert isinstance(message, Strict)
        self.messages.append(message)

    def get_subscription_count(self):
        return self.listeners


class Node:
    """As much of rclpy's as the node uses."""

    given: ClassVar[dict] = {}

    def __init__(self, name):
        self.parameters, self.topics, self.said = {}, {}, []

    def declare_parameter(self, name, value):
        self.parameters[name] = SimpleNamespace(value=self.given.get(name, value))

    def get_parameter(self, name):
        return self.parameters[name]

    def create_publisher(self, kind, topic, qos):
        self.topics[topic] = Publisher()
        return self.topics[topic]

    def create_subscription(self, kind, topic, callback, qos, callback_group=None):
        self.topics[topic] = callback

    def get_logger(self):
        return SimpleNamespace(warning=lambda sentence, **_: self.said.append(sentence), info=self.said.append)


class Transforms:
    """The camera looks where the IMU's x points."""

    def lookup_transform(self, target, source, time):
        assert (target, source) == ("camera_optical", "imu")
        optical_from_body = Rotation.from_matrix([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
        return SimpleNamespace(transform=SimpleNamespace(rotation=Quaternion(*optical_from_body.as_quat().tolist())))


class Broadcaster:
    def __init__(self, node):
        node.sent = []
        self.sendTransform = node.sent.append


def transform_stamped():
    return SimpleNamespace(header=None, child_frame_id="", transform=SimpleNamespace(rotation=Quaternion()))


@pytest.fixture
def room(monkeypatch):
    """The module ``node`` among stand-ins."""

    def stand_in(name, **contents):
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)
        return module

    def nothing(*_, **__):
        return SimpleNamespace()

    logging = stand_in("rclpy.logging", get_logger=nothing)
    stand_in("rclpy", init=nothing, spin=nothing, try_shutdown=nothing, logging=logging)
    stand_in("rclpy.callback_groups", MutuallyExclusiveCallbackGroup=nothing)
    stand_in("rclpy.executors", ExternalShutdownException=InterruptedError, MultiThreadedExecutor=nothing)
    stand_in("rclpy.node", Node=Node)
    reliability = SimpleNamespace(BEST_EFFORT=1)
    profile = SimpleNamespace
    stand_in("rclpy.qos", QoSProfile=profile, ReliabilityPolicy=reliability, qos_profile_sensor_data=None)
    stand_in("rclpy.time", Time=nothing)
    stand_in("sensor_msgs.msg", CameraInfo=object, Image=object, Imu=object)
    stand_in("std_msgs.msg", Header=Header)
    stand_in("geometry_msgs.msg", TransformStamped=transform_stamped)
    messages = stand_in("vision_msgs.msg", **vars(VISION_MSGS))
    stand_in("vision_msgs", msg=messages)
    stand_in(
        "tf2_ros",
        Buffer=Transforms,
        TransformBroadcaster=Broadcaster,
        TransformException=LookupError,
        TransformListener=nothing,
    )
    monkeypatch.delitem(sys.modules, "usvnet_ros.node", raising=False)
    return importlib.import_module("usvnet_ros.node")


@pytest.fixture
def start(room, untrained, monkeypatch):
    """Start the node with parameters; its network is untrained, and sees boats everywhere."""

    def unhurried(model, confidence):
        model.score_threshold = confidence
        return model

    monkeypatch.setattr(predictor_room, "_made_fast", unhurried)

    def begin(**given):
        settings = {"checkpoint": str(untrained), "image_size": 64, "confidence": 0.0, "mount.height_m": 1.5}
        monkeypatch.setattr(Node, "given", settings | {"mount.pitch_deg": DOWN_DEG, "estimator": "box_bottom"} | given)
        return room.RangingNode()

    return begin


def image(**changes):
    fields = {"encoding": "rgb8", "height": 64, "width": 96, "step": 288, "data": PICTURE.tobytes()}
    return SimpleNamespace(**(fields | {"header": Header(Time(7, 0), "camera_optical")} | changes))


def test_images_become_detections_in_their_own_frame_and_time(start):
    node = start()
    node.topics["image"](image())
    assert node.said == ["images, but no camera_info yet"]
    node.topics["camera_info"](camera_info(**INFO))
    first = node.predictor
    node.topics["camera_info"](camera_info(**INFO))
    assert node.predictor is first  # the network is loaded once
    node.topics["detections_2d"].listeners = 1
    node.topics["image"](image())
    (boats,), (boxes,) = node.topics["detections_3d"].messages, node.topics["detections_2d"].messages
    assert (boats.header.frame_id, boats.header.stamp.sec) == ("camera_optical", 7)
    assert 0 < len(boats.detections) <= len(boxes.detections)
    position = boats.detections[0].results[0].pose.pose.position
    assert position.z > 0
    assert not node.sent


def test_the_level_frame_is_broadcast_and_used(start):
    node = start(axes="level")
    node.topics["camera_info"](camera_info(**INFO))
    node.topics["image"](image())
    (boats,), (transform,) = node.topics["detections_3d"].messages, node.sent
    assert boats.header.frame_id == transform.child_frame_id == "camera_optical_level"
    assert transform.header.frame_id == "camera_optical"
    heights = [detection.bbox.center.position.z for detection in boats.detections]
    assert heights == pytest.approx([-1.5] * len(heights), abs=1e-3)  # on the water


def test_the_imu_turns_the_camera(start):
    node = start(use_imu=True)
    node.topics["camera_info"](camera_info(**INFO))
    header = SimpleNamespace(stamp=SimpleNamespace(sec=7, nanosec=20_000_000), frame_id="imu")
    bow_down = Quaternion(*Rotation.from_euler("y", 10, degrees=True).as_quat().tolist())
    imu = SimpleNamespace(header=header, orientation=bow_down, orientation_covariance=[0.0] * 9)
    camera = node.predictor.native_camera(96, 64)
    assert np.degrees(node.attitude_of(image(), camera).pitch_rad.item()) == pytest.approx(DOWN_DEG)
    assert node.said[-1] == "no imu message near the image's time: the mount's attitude is taken"
    node.topics["imu"](imu)
    assert np.degrees(node.attitude_of(image(), camera).pitch_rad.item()) == pytest.approx(10, abs=1e-4)


def test_what_is_wrong_is_said_in_one_sentence(start):
    node = start()
    node.topics["camera_info"](camera_info(**INFO))
    node.topics["image"](image(encoding="16UC1"))
    assert "image skipped: Image: encoding is '16UC1'" in node.said[-1]
    node.topics["image"](image(width=64, step=192))
    assert "another shape" in node.said[-1]
    assert node.topics["detections_3d"].messages == []
    with pytest.raises(ValueError, match="axes: got 'map', expected optical or level"):
        start(axes="map")
    with pytest.raises(ValueError, match="estimator: got 'sonar'"):
        start(estimator="sonar")
    with pytest.raises(ValueError, match="height_m"):
        start(**{"mount.height_m": 0.0}).topics["camera_info"](camera_info(**INFO))


def test_the_parameter_file_and_the_readme_name_what_the_node_declares(start, root):
    folder = root / "integrations" / "ros2"
    written = yaml.safe_load((folder / "config" / "ranging.yaml").read_text())["/**"]["ros__parameters"]
    mount = {f"mount.{name}": value for name, value in written.pop("mount").items()}
    declared = {name: parameter.value for name, parameter in start().parameters.items()}
    for name, value in (written | mount).items():
        assert type(value) is type(declared[name]), name  # rclpy takes no whole number for a double
    readme = (folder / "README.md").read_text()
    assert [name for name in declared if f"`{name}`" not in readme] == []
