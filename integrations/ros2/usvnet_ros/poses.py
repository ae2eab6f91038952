"""Where boats are and how they lie, in a frame of ROS, with the covariance of both."""

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from usvnet.deploy.tracking import sight
from usvnet.evaluation.records import BoatRecord
from usvnet.geometry.rays import level_rotation
from usvnet.types import Camera

FloatArray = NDArray[np.float64]
Axes = Literal["optical", "level"]
"""Whose axes to use, both at the camera: "optical" is the image's own frame (REP-103: x right, y down, z forward);
"level" is x forward, y left and z up, levelled by gravity (REP-103's axes of a body)."""
LEVEL_FROM_USVNET = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
"""From usvnet's level frame, X right, Y down and Z forward, to "level"."""
TILT_STD_RAD = 0.05
"""Boats lie upright with this standard deviation, as the ranging takes it."""
UNKNOWN_HEADING_VARIANCE = math.pi**2 / 3
"""That of an angle of which nothing is known."""


class BoatPose(NamedTuple):
    """One ranged boat."""

    score: float
    position_m: FloatArray
    """(3,) the point that the range belongs to: the nearer waterline keypoint."""
    orientation_xyzw: FloatArray
    """(4,) quaternion that turns the boat's axes, x to the bow, y to port and z up, into the frame's."""
    covariance: FloatArray
    """(6, 6) of x, y, z and of turns about the frame's x, y, z: metres and radians."""


def usvnet_to(axes: Axes, camera: Camera) -> FloatArray:
    """Rotation (3, 3) from usvnet's level frame to the axes at a camera (a batch of 1)."""
    if axes == "level":
        return LEVEL_FROM_USVNET
    return level_rotation(camera.pitch_rad.double(), camera.roll_rad.double())[0].T.numpy()


def level_in_optical_xyzw(camera: Camera) -> FloatArray:
    """Quaternion (4,) of the transform from the "level" frame to the "optical" one."""
    return Rotation.from_matrix(usvnet_to("optical", camera) @ LEVEL_FROM_USVNET.T).as_quat()


def boat_poses(boats: Sequence[BoatRecord], estimator: str, camera: Camera, axes: Axes = "optical") -> list[BoatPose]:
    """The poses of those boats that have a range, in the order of ``boats``.

    Along the ray to the boat the covariance is the range's, r r^T std^2, which already holds the errors of camera and
    waves; across the ray it is (I - r r^T) (range x std of the bearing)^2, with the bearing's from the keypoints. The
    heading is the fitted hull's; without a fit it points ahead of the camera with the variance of any angle.

    Args:
        boats: in the camera's pixels.
        estimator: whose ranges to take.
        camera: theirs (a batch of 1), with the attitude that it had.
        axes: of the result.
    """
    turn = usvnet_to(axes, camera)
    poses = []
    for boat, sighting in zip(boats, sight(boats, estimator, camera)):
        estimate = boat.ranges[estimator]
        if not (estimate.usable and math.isfinite(estimate.slant_std_m)):
            continue
        position = turn @ estimate.position_m
        ray = position / np.linalg.norm(position)
        along = np.outer(ray, ray)
        across_m = estimate.slant_m * sighting.bearing_std_rad
        heading, heading_variance = 0.0, UNKNOWN_HEADING_VARIANCE
        if boat.ranges["hull"].valid and math.isfinite(boat.heading_rad):
            heading, heading_variance = boat.heading_rad, min(boat.heading_std_rad**2, UNKNOWN_HEADING_VARIANCE)
        sine, cosine = math.sin(heading), math.cos(heading)
        boat_axes = np.array([[sine, -cosine, 0], [0, 0, -1], [cosine, sine, 0]])  # columns: to the bow, to port, up
        covariance = np.zeros((6, 6))
        covariance[:3, :3] = along * estimate.slant_std_m**2 + (np.eye(3) - along) * across_m**2
        covariance[3:, 3:] = turn @ np.diag([TILT_STD_RAD**2, heading_variance, TILT_STD_RAD**2]) @ turn.T
        orientation = Rotation.from_matrix(turn @ boat_axes).as_quat()
        poses.append(BoatPose(boat.score, position, orientation, covariance))
    return poses
