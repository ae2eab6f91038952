"""What training minimises: the assignment of anchors to boats, and every loss."""

from usvnet.losses.assigner import Assignment, assign
from usvnet.losses.criterion import Criterion

__all__ = ["Assignment", "Criterion", "assign"]
