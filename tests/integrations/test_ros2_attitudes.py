"""sensor_msgs/Imu to pitch and roll, without ROS."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch
from ros_messages import Quaternion
from scipy.spatial.transform import Rotation

from usvnet.geometry.rays import level_rotation
from usvnet_ros.attitudes import ImuMessages, camera_attitude

PITCH, ROLL = 0.12, -0.3
USVNET_FROM_WORLD = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""The level frame (X right, Y down, Z forward) of a camera that looks along the world's x; the world is x, y, z up."""
CAMERA_FROM_IMU = Rotation.from_euler("xyz", [100, -20, 75], degrees=True)
"""However the IMU is screwed on."""


def quaternion(rotation):
    return Quaternion(*rotation.as_quat().tolist())


def imu_of(pitch, roll, yaw=0.0, covariance=(0.0,) * 9, stamp=(0, 0)):
    """What an IMU says on a camera of this attitude."""
    angles = (torch.tensor([angle], dtype=torch.float64) for angle in (pitch, roll))
    level_from_camera = Rotation.from_matrix(level_rotation(*angles)[0].numpy())
    world_from_level = Rotation.from_euler("z", yaw) * Rotation.from_matrix(USVNET_FROM_WORLD.T)
    orientation = world_from_level * level_from_camera * CAMERA_FROM_IMU
    header = SimpleNamespace(stamp=SimpleNamespace(sec=stamp[0], nanosec=stamp[1]))
    return SimpleNamespace(header=header, orientation=quaternion(orientation), orientation_covariance=list(covariance))


@pytest.mark.parametrize("yaw", [0.0, 2.0, -3.0])
def test_pitch_and_roll_are_those_of_the_level_frame_whatever_the_yaw(yaw):
    attitude = camera_attitude(imu_of(PITCH, ROLL, yaw), quaternion(CAMERA_FROM_IMU))
    assert attitude == pytest.approx((PITCH, ROLL, None, None), abs=1e-9)


def test_a_camera_on_an_imu_of_rep_103_looks_down_when_the_bow_does():
    """x forward, y left, z up: a positive turn about y lowers the bow; a positive one about x lowers starboard."""
    optical_from_body = Rotation.from_matrix(USVNET_FROM_WORLD)
    header = SimpleNamespace(stamp=None)
    for turn, expected in ((("y", 0.2), (0.2, 0.0)), (("x", 0.1), (0.0, 0.1))):
        orientation = quaternion(Rotation.from_euler(*turn))
        imu = SimpleNamespace(header=header, orientation=orientation, orientation_covariance=[0.0] * 9)
        assert camera_attitude(imu, quaternion(optical_from_body))[:2] == pytest.approx(expected, abs=1e-9)


def test_standard_deviations_are_those_of_turned_imus():
    """Monte Carlo: the IMU is turned about its own axes as its covariance says."""
    A = np.array([[4e-3, 0, 0], [1e-3, 3e-3, 0], [-2e-3, 1e-3, 6e-3]])
    imu = imu_of(PITCH, ROLL, 0.5, (A @ A.T).ravel())
    found = camera_attitude(imu, quaternion(CAMERA_FROM_IMU))
    rng = np.random.default_rng(0)
    truth = Rotation.from_quat([getattr(imu.orientation, axis) for axis in "xyzw"])
    angles = []
    for error in rng.normal(size=(2000, 3)) @ A.T:
        imu.orientation = quaternion(truth * Rotation.from_rotvec(error))
        angles.append(camera_attitude(imu, quaternion(CAMERA_FROM_IMU))[:2])
    assert found[2:] == pytest.approx(np.std(angles, axis=0), rel=0.06)


@pytest.mark.parametrize("fault", ["no estimate", "no quaternion"])
def test_an_imu_without_orientation_says_nothing(fault):
    imu = imu_of(PITCH, ROLL, covariance=(-1.0,) + (0.0,) * 8 if fault == "no estimate" else (0.0,) * 9)
    if fault == "no quaternion":
        imu.orientation = Quaternion(0.0, 0.0, 0.0, 0.0)
    assert camera_attitude(imu, quaternion(CAMERA_FROM_IMU)) is None


def test_the_message_nearest_to_the_image_is_found():
    imus = ImuMessages()
    stamp = SimpleNamespace(sec=10, nanosec=250_000_000)
    assert imus.nearest(stamp, 1.0) is None
    for tenth in range(6):
        imus.add(imu_of(0.1 * tenth, 0.0, stamp=(10, tenth * 100_000_000 + 1)))
    assert imus.nearest(stamp, 0.1) is imus.messages[2]
    assert imus.nearest(SimpleNamespace(sec=11, nanosec=0), 0.1) is None
