"""From arrays to vision_msgs 4: the message classes are handed in, so that this runs and is tested without ROS."""

from collections.abc import Sequence
from typing import Any

from usvnet.evaluation.records import BoatRecord
from usvnet_ros.poses import BoatPose

CLASS_ID = "boat"


def detections_3d(poses: Sequence[BoatPose], header: Any, types: Any) -> Any:
    """A Detection3DArray of ranged boats.

    The box has the pose's centre and no size, which is not measured; ``id`` stays empty, as nothing is tracked.

    Args:
        poses: of the boats.
        header: std_msgs/Header, with the time of the image and the frame of the poses.
        types: ``vision_msgs.msg``, or what stands in for it.
    """
    array = types.Detection3DArray()
    array.header = header
    for pose in poses:
        result = _hypothesis(pose.score, types)
        place, turn = result.pose.pose.position, result.pose.pose.orientation
        place.x, place.y, place.z = pose.position_m.tolist()
        turn.x, turn.y, turn.z, turn.w = pose.orientation_xyzw.tolist()
        result.pose.covariance = pose.covariance.ravel().tolist()
        detection = types.Detection3D()
        detection.header = header
        detection.results = [result]
        detection.bbox.center = result.pose.pose
        array.detections.append(detection)
    return array


def detections_2d(boats: Sequence[BoatRecord], header: Any, types: Any) -> Any:
    """A Detection2DArray of all boats, also of those without a range; arguments as above.

    Pixel centres are integers in usvnet and in ROS, so boxes are the same in both.
    """
    array = types.Detection2DArray()
    array.header = header
    for boat in boats:
        left, top, right, bottom = boat.box_px.tolist()
        detection = types.Detection2D()
        detection.header = header
        detection.results = [_hypothesis(boat.score, types)]
        detection.bbox.center.position.x, detection.bbox.center.position.y = (left + right) / 2, (top + bottom) / 2
        detection.bbox.size_x, detection.bbox.size_y = right - left, bottom - top
        array.detections.append(detection)
    return array


def _hypothesis(score: float, types: Any) -> Any:
    result = types.ObjectHypothesisWithPose()
    result.hypothesis.class_id = CLASS_ID
    result.hypothesis.score = float(score)
    return result
