"""The data that flows from a photograph to a range, and THE conventions of the whole package.

Conventions
-----------
Pixel
    u to the right, v down, the **centre of a pixel is an integer** (as in OpenCV and Kornia): a W x H picture
    spans [-0.5, W - 0.5] x [-0.5, H - 0.5]. Boxes are (x1, y1, x2, y2) in the same coordinates.
    Cell i of a map at stride s sits at s * i + (s - 1) / 2 (see :mod:`usvnet.heatmap`).
Camera frame
    x right, y down, z forward.
Level frame
    At the camera: X right, Y down (gravity), Z horizontal and forward.
    p_level = Rx(pitch) Rz(roll) p_camera with Rz = [[c, -s, 0], [s, c, 0], [0, 0, 1]] and
    Rx = [[1, 0, 0], [0, c, s], [0, -s, c]].
    ``pitch_rad`` > 0: the optical axis points below the horizontal.
    ``roll_rad`` > 0: the camera is turned clockwise as seen from behind it.
Water
    The plane Y = ``height_m``: the optical centre's height above mean water.
Range
    ``slant_m`` is the straight line from the optical centre to the point (what a laser reads);
    ``horizontal_m`` is measured along the water. They are never mixed.
Keypoints
    In the order of :data:`KEYPOINT_NAMES`; left and right are the boat's port and starboard.
    Visibility: 0 outside the picture or unlabelled, 1 hidden by the hull or an object, 2 seen.
Units
    Stand in the names: ``_px``, ``_px2``, ``_m``, ``_rad``. Files for people use degrees (``_deg``).

Pitfalls: a label tool that says "pixel i covers [i, i + 1)" is half a pixel off (readers subtract it); resizing,
cropping or flipping a picture without its camera changes every range (:mod:`usvnet.geometry.camera` moves both).

Everything here is a NamedTuple of tensors, so that the whole chain scripts and exports. B is the number of
pictures, N the number of boats (padded), A the number of anchors.
"""

from enum import IntEnum
from typing import NamedTuple

from torch import Tensor

KEYPOINT_NAMES = ("bow", "bow_left", "bow_right", "bow_bottom", "stern_left", "stern_right", "stern_bottom")
NUM_KEYPOINTS = len(KEYPOINT_NAMES)
FLIP_INDEX = (0, 2, 1, 3, 5, 4, 6)
"""Where each keypoint comes from when a picture is mirrored."""
WATERLINE_KEYPOINTS = (3, 6)
"""bow_bottom and stern_bottom, the two keypoints that lie on the water."""
NEAREST_WATERLINE = -1
"""The default ``reference`` of a laser range: whichever waterline keypoint is nearer to the camera."""


class Camera(NamedTuple):
    """B calibrated and mounted cameras."""

    K: Tensor
    """(B, 3, 3) pinhole matrix, pixels."""
    distortion: Tensor
    """(B, 5) plumb-bob coefficients k1, k2, p1, p2, k3."""
    size_px: Tensor
    """(B, 2) width and height of the picture that K belongs to."""
    height_m: Tensor
    """(B,) optical centre above mean water."""
    pitch_rad: Tensor
    """(B,) optical axis below the horizontal."""
    roll_rad: Tensor
    """(B,) clockwise seen from behind."""
    focal_std_px: Tensor
    """(B,) standard deviation of the focal length (fx and fy together)."""
    height_std_m: Tensor
    """(B,)"""
    pitch_std_rad: Tensor
    """(B,)"""
    roll_std_rad: Tensor
    """(B,)"""
    wave_std_m: Tensor
    """(B,) standard deviation of the water at a boat about mean water, the same for every point of that boat."""


class Hull(NamedTuple):
    """The shape of the boats in B pictures: one a picture.

    Hull frame: x forward, y to port, z up, the origin amidships on the resting waterline.
    """

    points_m: Tensor
    """(B, 7, 3) the keypoints, in the order of :data:`KEYPOINT_NAMES`."""
    scale_std: Tensor
    """(B,) standard deviation of the logarithm of the true size over this one; 0 where the size is known."""
    point_std_m: Tensor
    """(B,) standard deviation of every coordinate of every keypoint: how well the shape is known."""


class Boats(NamedTuple):
    """The labelled boats of B pictures, padded to N."""

    boxes_px: Tensor
    """(B, N, 4)"""
    keypoints_px: Tensor
    """(B, N, 7, 2)"""
    visibility: Tensor
    """(B, N, 7) int64: 0, 1 or 2."""
    present: Tensor
    """(B, N) bool, False on padding."""
    range_m: Tensor
    """(B, N) slant range read by the laser, 0 where there is none."""
    range_std_m: Tensor
    """(B, N) standard deviation of that reading, 0 where there is none."""
    reference: Tensor
    """(B, N) int64: the keypoint that the range belongs to, or NEAREST_WATERLINE."""


class Native(NamedTuple):
    """B pictures as the camera took them, of which the images that the detector sees are shrunk and shifted copies."""

    picture: Tensor
    """(B, 3, H, W) uint8 RGB, of one size."""
    to_image: Tensor
    """(B, 3, 3) map from its pixels to those of the image: positive scales and a shift."""


class Batch(NamedTuple):
    """What the data loader hands to training and evaluation."""

    image: Tensor
    """(B, 3, H, W) float32 RGB in [0, 1]."""
    camera: Camera
    """The camera of each picture *as it is in the batch* (letterboxed, augmented)."""
    boats: Boats
    frame_index: Tensor
    """(B,) int64 position in the dataset."""
    hull: Hull
    """The hull that each picture shows, mirrored where the picture is; a generic one where none is known."""
    native: Native | None = None
    """The same pictures before they were shrunk, where keypoints are refined on them."""


class NetworkOutput(NamedTuple):
    """The pose network's dense answer, before any choice of boats."""

    boxes_px: Tensor
    """(B, A, 4) decoded boxes."""
    box_logits: Tensor
    """(B, A, 4, R) distribution over R bins of each side's distance in strides (left, top, right, bottom)."""
    class_logits: Tensor
    """(B, A, C)"""
    keypoints_px: Tensor
    """(B, A, 7, 2) decoded coarse keypoints."""
    visibility_logits: Tensor
    """(B, A, 7)"""
    heatmap_logits: Tensor
    """(B, 7, H / 4, W / 4)"""
    anchors_px: Tensor
    """(A, 2) centre of each anchor's cell."""
    strides_px: Tensor
    """(A,) stride of each anchor."""


class Detections(NamedTuple):
    """The boats chosen by non-maximum suppression, best first, padded to N."""

    boxes_px: Tensor
    """(B, N, 4)"""
    scores: Tensor
    """(B, N), 0 on padding."""
    keypoints_px: Tensor
    """(B, N, 7, 2) coarse keypoints."""
    visibility: Tensor
    """(B, N, 7) probability that the keypoint is seen."""
    present: Tensor
    """(B, N) bool, False on padding."""


class Reason(IntEnum):
    """Why a range is given, or why not."""

    OK = 0
    """It is."""
    HORIZON = 1
    """The ray is at or above the horizon."""
    MISFIT = 2
    """The keypoints do not fit the hull: a reflection, ends mistaken for each other, another boat."""
    NO_RAY = 3
    """The lens gives the pixel no ray (or fewer than three keypoints one)."""


class RangeEstimate(NamedTuple):
    """How far, which way and how sure, by one estimator. The leading shape ``...`` is (B, N) in a prediction."""

    slant_m: Tensor
    """(...) straight line to the point; inf where not valid."""
    slant_std_m: Tensor
    """(...) one standard deviation; inf where not valid. The geometry's is first order; a calibrated model scales it so
    that ``slant_m`` +- 1.645 of it holds 90 % of the readings (:mod:`usvnet.intervals` has the rule and the raw)."""
    horizontal_m: Tensor
    """(...) along the water; inf where not valid."""
    bearing_rad: Tensor
    """(...) clockwise from the optical axis seen from above."""
    position_m: Tensor
    """(..., 3) in the level frame; 0 where not valid."""
    valid: Tensor
    """(...) bool, whether there is a range."""
    reason: Tensor
    """(...) int64, a :class:`Reason`: 0 where valid."""


class Ranges(NamedTuple):
    """What the geometry says of N boats in B pictures."""

    box_bottom: RangeEstimate
    """The paper's baseline: the bottom centre of the box."""
    waterline: RangeEstimate
    """The paper's method: the waterline keypoint nearest to the camera."""
    hull: RangeEstimate
    """All keypoints on one rigid hull: the nearer waterline point of the hull that fits them best."""
    fused: RangeEstimate
    """Waterline and hull together, with what their errors have in common; of a boat whose hull is refused, waterline
    and bottom of the box."""
    heading_rad: Tensor
    """(B, N) the fitted hull's bow, clockwise from the optical axis seen from above."""
    heading_std_rad: Tensor
    """(B, N)"""
    misfit: Tensor
    """(B, N) chi-squared of the hull's fit over its 99 % quantile; about 1 good boat in 100 is above 0.9."""


class Prediction(NamedTuple):
    """Everything usvnet says about B pictures: N boats each, best first, padded."""

    boxes_px: Tensor
    """(B, N, 4)"""
    scores: Tensor
    """(B, N), 0 on padding."""
    keypoints_px: Tensor
    """(B, N, 7, 2)"""
    keypoint_covariance_px2: Tensor
    """(B, N, 7, 2, 2)"""
    visibility: Tensor
    """(B, N, 7) probability that the keypoint is seen."""
    present: Tensor
    """(B, N) bool, False on padding."""
    box_bottom: RangeEstimate
    """This and all that follows as in :class:`Ranges`."""
    waterline: RangeEstimate
    hull: RangeEstimate
    fused: RangeEstimate
    heading_rad: Tensor
    """(B, N)"""
    heading_std_rad: Tensor
    """(B, N)"""
    misfit: Tensor
    """(B, N)"""
