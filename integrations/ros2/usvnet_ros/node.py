"""The node ``ranging``: images and their camera in, boats with ranges and covariance out. See README.md."""

import sys
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import rclpy
import rclpy.logging
import vision_msgs.msg
from geometry_msgs.msg import TransformStamped
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo, Image, Imu
from std_msgs.msg import Header
from tf2_ros import Buffer, TransformBroadcaster, TransformException, TransformListener

from usvnet.deploy.predictor import Predictor, best_estimator, check_estimator, default_checkpoint
from usvnet.geometry.camera import with_attitude
from usvnet.types import Camera
from usvnet_ros.attitudes import ImuMessages, camera_attitude
from usvnet_ros.cameras import Mount, camera_from_info
from usvnet_ros.images import picture_from_image
from usvnet_ros.messages import detections_2d, detections_3d
from usvnet_ros.poses import boat_poses, level_in_optical_xyzw

WARN_EVERY_S = 5.0
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
"""An image that came while another was looked at takes the place of one that waits."""


class RangingNode(Node):
    """Subscribes to ``image``, ``camera_info`` and ``imu``, publishes ``detections_3d`` and ``detections_2d``."""

    def __init__(self) -> None:
        super().__init__("ranging")
        texts = {"checkpoint": "", "hull": "", "estimator": best_estimator(), "axes": "optical", "device": ""}
        numbers = {"image_size": 0, "confidence": 0.25, "rectified": False, "use_imu": False, "imu_max_gap_s": 0.1}
        for name, value in (texts | numbers).items():
            self.declare_parameter(name, value)
        for name, value in asdict(Mount()).items():
            self.declare_parameter(f"mount.{name}", value)
        self.estimator, self.axes = self.value("estimator"), self.value("axes")
        check_estimator(self.estimator)
        if self.axes not in ("optical", "level"):
            raise ValueError(f"axes: got {self.axes!r}, expected optical or level")
        self.mount = Mount(**{field.name: self.value(f"mount.{field.name}") for field in fields(Mount)})
        self.predictor: Predictor | None = None
        self.info: CameraInfo | None = None
        self.imus = ImuMessages()
        self.transforms = Buffer()
        self.listener = TransformListener(self.transforms, self)
        self.broadcaster = TransformBroadcaster(self)
        self.boats_3d = self.create_publisher(vision_msgs.msg.Detection3DArray, "detections_3d", 10)
        self.boats_2d = self.create_publisher(vision_msgs.msg.Detection2DArray, "detections_2d", 10)
        alone = MutuallyExclusiveCallbackGroup()  # the IMU's messages and tf2's go on while an image is looked at
        self.create_subscription(
            CameraInfo, "camera_info", self.take_info, qos_profile_sensor_data, callback_group=alone
        )
        self.create_subscription(Image, "image", self.take_image, NEWEST, callback_group=alone)
        if self.value("use_imu"):
            self.create_subscription(Imu, "imu", self.imus.add, QoSProfile(depth=100, reliability=NEWEST.reliability))

    def value(self, name: str) -> Any:
        """The value of a parameter."""
        return self.get_parameter(name).value

    def warn(self, sentence: str) -> None:
        """Say what goes wrong, but not with every image."""
        self.get_logger().warning(sentence, throttle_duration_sec=WARN_EVERY_S)

    def take_info(self, info: CameraInfo) -> None:
        """Load the network for a camera that is new or has changed."""
        if self.info is not None and _calibration(self.info) == _calibration(info):
            return
        camera = camera_from_info(info, self.mount, self.value("rectified"))
        self.predictor = Predictor(
            self.value("checkpoint") or default_checkpoint(refine=True),
            camera,
            Path(self.value("hull")) if self.value("hull") else None,
            self.value("image_size") or None,
            self.value("confidence"),
            self.value("device") or None,
        )
        self.predictor.warm_up()
        self.info = info
        width, height = (int(side) for side in camera.size_px[0])
        self.get_logger().info(f"ranging in images of {width} x {height} on {self.predictor.device}")

    def take_image(self, image: Image) -> None:
        """Find the boats of an image and publish them."""
        if self.predictor is None:
            self.warn("images, but no camera_info yet")
            return
        try:
            picture = picture_from_image(image)
            camera = self.attitude_of(image, self.predictor.native_camera(image.width, image.height))
            (boats,) = self.predictor.predict([picture], [camera])
        except ValueError as error:
            self.warn(f"image skipped: {error}")
            return
        header = image.header
        if self.axes == "level":
            header = Header(stamp=image.header.stamp, frame_id=f"{image.header.frame_id}_level")
            self.broadcast_level(image.header, header, camera)
        self.boats_3d.publish(
            detections_3d(boat_poses(boats, self.estimator, camera, self.axes), header, vision_msgs.msg)
        )
        if self.boats_2d.get_subscription_count():
            self.boats_2d.publish(detections_2d(boats, image.header, vision_msgs.msg))

    def attitude_of(self, image: Image, camera: Camera) -> Camera:
        """The camera with the attitude that the IMU had at the image's time, or else its mount's."""
        if not self.value("use_imu"):
            return camera
        imu = self.imus.nearest(image.header.stamp, self.value("imu_max_gap_s"))
        if imu is None:
            self.warn("no imu message near the image's time: the mount's attitude is taken")
            return camera
        try:
            found = self.transforms.lookup_transform(image.header.frame_id, imu.header.frame_id, Time())
        except TransformException as error:
            self.warn(f"the mount's attitude is taken: {error}")
            return camera
        attitude = camera_attitude(imu, found.transform.rotation)
        if attitude is None:
            self.warn("the imu gives no orientation: the mount's attitude is taken")
            return camera
        return with_attitude(camera, *attitude)

    def broadcast_level(self, optical: Header, level: Header, camera: Camera) -> None:
        """Tell tf2 how the level frame lies in the optical one."""
        transform = TransformStamped()
        transform.header, transform.child_frame_id = optical, level.frame_id
        turn = transform.transform.rotation
        turn.x, turn.y, turn.z, turn.w = level_in_optical_xyzw(camera).tolist()
        self.broadcaster.sendTransform(transform)


def _calibration(info: CameraInfo) -> tuple[object, ...]:
    """All of a CameraInfo but its header."""
    roi = info.roi
    window = (info.binning_x, info.binning_y, roi.x_offset, roi.y_offset, roi.width, roi.height)
    return (info.width, info.height, info.distortion_model, *info.d, *info.k, *info.p, *window)


def main() -> None:
    """Run the node; what is wrong with its parameters or its camera ends it with one sentence."""
    rclpy.init()
    try:
        rclpy.spin(RangingNode(), MultiThreadedExecutor(num_threads=2))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except (ValueError, OSError) as error:
        rclpy.logging.get_logger("ranging").fatal(str(error))
        sys.exit(1)
    finally:
        rclpy.try_shutdown()
