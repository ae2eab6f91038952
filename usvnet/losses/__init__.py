"""What training minimises: the assignment of anchors to boats, and every loss."""

from usvnet.losses.assigner import Assignment, assign, best_keypoints
from usvnet.losses.criterion import Criterion
from usvnet.losses.curriculum import RangeCurriculum, keypoint_error

__all__ = ["Assignment", "Criterion", "RangeCurriculum", "assign", "best_keypoints", "keypoint_error"]
