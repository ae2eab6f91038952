"""Boats to poses and to vision_msgs, without ROS."""

import dataclasses
import math

import numpy as np
import pytest
import torch
from ros_messages import VISION_MSGS, Header
from scipy.spatial.transform import Rotation

from usvnet.evaluation.records import ESTIMATORS, BoatRecord, RangeRecord
from usvnet.geometry.camera import make_camera, project
from usvnet.geometry.rays import level_rotation
from usvnet_ros.messages import detections_2d, detections_3d
from usvnet_ros.poses import UNKNOWN_HEADING_VARIANCE, boat_poses, level_in_optical_xyzw

CAMERA = make_camera(
    [[700.0, 0, 319.5], [0, 700, 239.5], [0, 0, 1]], (640, 480), height_m=1.5, pitch_rad=0.1, roll_rad=-0.2
)
LEVEL_M = np.array([3.0, 1.5, 20.0])
"""X right, Y down, Z forward: on the water."""
STD_M, HEADING, HEADING_STD = 0.8, 0.7, 0.1


def boat(position_m=LEVEL_M, valid=True, **changes):
    """A boat whose waterline keypoints are seen where the camera shows the position."""
    angles = (angle.double() for angle in (CAMERA.pitch_rad, CAMERA.roll_rad))
    in_camera = level_rotation(*angles)[0].T @ torch.from_numpy(position_m)
    pixel = project(in_camera[None, None].float(), CAMERA)[0, 0].numpy()
    slant = float(np.linalg.norm(position_m))
    horizontal, bearing = math.hypot(*position_m[[0, 2]]), math.atan2(position_m[0], position_m[2])
    estimate = RangeRecord(slant, STD_M, horizontal, bearing, position_m, valid)
    record = BoatRecord(
        box_px=np.array([300.0, 200, 340, 231]),
        score=0.75,
        keypoints_px=np.tile(pixel, (7, 1)),
        keypoint_covariance_px2=np.tile(np.eye(2), (7, 1, 1)),
        visibility=np.ones(7),
        ranges=dict.fromkeys(ESTIMATORS, estimate),
        heading_rad=HEADING,
        heading_std_rad=HEADING_STD,
    )
    return dataclasses.replace(record, **changes)


def optical_to_level(vector):
    """By tf2's rule: the broadcast transform takes the level frame's vectors to the optical frame."""
    return Rotation.from_quat(level_in_optical_xyzw(CAMERA)).inv().apply(vector)


def test_the_optical_frame_is_the_cameras_own():
    (pose,) = boat_poses([boat()], "fused", CAMERA)
    pixel = project(torch.from_numpy(pose.position_m)[None, None].float(), CAMERA)[0, 0]
    np.testing.assert_allclose(pixel.numpy(), boat().keypoints_px[3], atol=1e-3)


def test_the_level_frame_is_forward_left_up():
    (pose,) = boat_poses([boat()], "fused", CAMERA, "level")
    np.testing.assert_allclose(pose.position_m, [20, -3, -1.5], atol=1e-9)
    forward, up = (Rotation.from_quat(pose.orientation_xyzw).apply(axis) for axis in ([1, 0, 0], [0, 0, 1]))
    np.testing.assert_allclose(forward, [math.cos(HEADING), -math.sin(HEADING), 0], atol=1e-9)  # clockwise from above
    np.testing.assert_allclose(up, [0, 0, 1], atol=1e-9)


def test_the_broadcast_transform_takes_one_frame_to_the_other():
    (optical,), (level,) = (boat_poses([boat()], "fused", CAMERA, axes) for axes in ("optical", "level"))
    np.testing.assert_allclose(optical_to_level(optical.position_m), level.position_m, atol=1e-9)
    for axis in np.eye(3):
        turned = Rotation.from_quat(optical.orientation_xyzw).apply(axis)
        np.testing.assert_allclose(
            optical_to_level(turned), Rotation.from_quat(level.orientation_xyzw).apply(axis), atol=1e-9
        )
    M = Rotation.from_quat(level_in_optical_xyzw(CAMERA)).inv().as_matrix()
    for block in (slice(0, 3), slice(3, 6)):
        turned = M @ optical.covariance[block, block] @ M.T
        np.testing.assert_allclose(turned, level.covariance[block, block], atol=1e-9)


@pytest.mark.parametrize("axes", ["optical", "level"])
def test_the_covariance_is_the_ranges_along_the_ray_and_the_bearings_across(axes):
    (pose,) = boat_poses([boat()], "fused", CAMERA, axes)
    slant_m = np.linalg.norm(LEVEL_M)
    variances, vectors = np.linalg.eigh(pose.covariance[:3, :3])
    assert variances[2] == pytest.approx(STD_M**2)
    assert abs(vectors[:, 2] @ pose.position_m) == pytest.approx(slant_m)
    # both ends are seen with 1 px each way: their middle with 0.71 px
    assert np.sqrt(variances[:2]) == pytest.approx(slant_m * math.sqrt(0.5) / 700, rel=0.05)
    turns = np.sort(np.linalg.eigvalsh(pose.covariance[3:, 3:]))
    assert turns == pytest.approx([0.05**2, 0.05**2, HEADING_STD**2])
    assert not pose.covariance[:3, 3:].any()
    np.testing.assert_allclose(pose.covariance, pose.covariance.T, atol=1e-15)


def test_a_heading_that_no_hull_gives_may_be_any():
    unfitted = boat(heading_rad=math.nan, heading_std_rad=math.nan)
    (pose,) = boat_poses([unfitted], "fused", CAMERA, "level")
    assert np.isfinite(pose.orientation_xyzw).all()
    assert pose.covariance[5, 5] == pytest.approx(UNKNOWN_HEADING_VARIANCE)


def test_messages():
    boats = [boat(), boat(valid=False), boat(np.array([-2.0, 1.5, 9.0]), score=0.5)]
    header = Header(frame_id="camera_optical_frame")
    array = detections_3d(boat_poses(boats, "fused", CAMERA), header, VISION_MSGS)
    assert array.header is header
    assert [detection.results[0].hypothesis.score for detection in array.detections] == [0.75, 0.5]  # ranged ones only
    (first, _), (pose, _) = array.detections, boat_poses(boats, "fused", CAMERA)
    (result,) = first.results
    place, turn = result.pose.pose.position, result.pose.pose.orientation
    np.testing.assert_array_equal([place.x, place.y, place.z], pose.position_m)
    np.testing.assert_array_equal([turn.x, turn.y, turn.z, turn.w], pose.orientation_xyzw)
    np.testing.assert_array_equal(np.reshape(result.pose.covariance, (6, 6)), pose.covariance)
    assert first.header is header
    assert first.bbox.center == result.pose.pose
    assert (result.hypothesis.class_id, first.id) == ("boat", "")

    flat = detections_2d(boats, header, VISION_MSGS)
    assert [detection.results[0].hypothesis.score for detection in flat.detections] == [0.75, 0.75, 0.5]
    box = flat.detections[1].bbox
    assert (box.center.position.x, box.center.position.y, box.size_x, box.size_y) == (320, 215.5, 40, 31)


def test_no_boats_are_an_empty_message():
    header = Header()
    assert detections_3d(boat_poses([], "fused", CAMERA), header, VISION_MSGS).detections == []
    assert detections_2d([], header, VISION_MSGS).detections == []
