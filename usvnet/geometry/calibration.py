"""Zhang's calibration: the corners of a flat board in several pictures in, a camera matrix with its sigmas out.

Z. Zhang, "A flexible new technique for camera calibration", PAMI 22(11), 2000. OpenCV solves it; this room says what
was solved for, throws out the views that do not belong, and says when an answer is not to be trusted. Finding the
corners in pictures is :mod:`usvnet.geometry.chessboard`'s work.
"""

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MIN_VIEWS = 3
"""Two views determine K in theory; with three, one bad view can at least be noticed."""
OUTLIER_SIGMAS = 4.0
"""A view stands out when its error is this many robust sigmas above the median view's ..."""
OUTLIER_RATIO = 3.0
"""... and this many times the median view's, because the robust sigma of a handful of views is itself a guess."""


class View(NamedTuple):
    """One picture of the board."""

    name: str
    corners_px: Array
    """(P, 2) in the order of the board's points."""


class RejectedView(NamedTuple):
    """A view that was left out, and its error in the fit that it was thrown out of."""

    view: View
    error_px: float


class CalibrationResult(NamedTuple):
    """A calibrated camera, how sure it is, and how each of the V views fits."""

    size_px: tuple[int, int]
    """Width and height of the pictures."""
    K: Array
    """(3, 3) pinhole matrix, pixels."""
    K_std: Array
    """(3, 3) standard deviations of its elements, pixels; 0 where an element is a constant."""
    distortion: Array
    """(5,) plumb-bob coefficients k1, k2, p1, p2, k3."""
    distortion_std: Array
    """(5,) their standard deviations; 0 where held at zero."""
    views: tuple[View, ...]
    """The V views used."""
    residual_px: Array
    """(V, P, 2) corner seen minus corner predicted."""
    rotation: Array
    """(V, 3, 3) from the board's frame to the camera's."""
    translation_m: Array
    """(V, 3) of the board's origin in the camera frame."""
    board_m: Array
    """(P, 3) the board's points, z = 0."""
    rejected: tuple[RejectedView, ...] = ()

    @property
    def rms_px(self) -> float:
        """Root mean square distance between a corner seen and predicted (OpenCV's definition)."""
        return float(np.sqrt((self.residual_px**2).sum(-1).mean()))

    @property
    def view_error_px(self) -> Array:
        """(V,) the same for each view."""
        return np.sqrt((self.residual_px**2).sum(-1).mean(-1))

    @property
    def focal_px(self) -> float:
        """Mean of fx and fy."""
        return float(self.K[0, 0] + self.K[1, 1]) / 2

    @property
    def focal_std_px(self) -> float:
        """Standard deviation of the focal length; fx and fy err together, so it does not shrink by averaging them."""
        return float(np.hypot(self.K_std[0, 0], self.K_std[1, 1]) / np.sqrt(2))


def board_points(columns: int, rows: int, square_mm: float) -> Array:
    """Inner corners of a chessboard, row by row, as (rows * columns, 3) metres in the board's own frame."""
    y, x = np.mgrid[:rows, :columns]
    return np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3) * (square_mm / 1000)


def calibrate(
    board_m: Array,
    views: Sequence[View],
    size_px: tuple[int, int],
    fixed_aspect: bool = False,
    radial_terms: int = 3,
) -> CalibrationResult:
    """Fit K, distortion and the pose of every view by least squares on all corners.

    Args:
        board_m: (P, 3) points of the board, z = 0. Their unit changes the poses only, never K.
        views: at least MIN_VIEWS views with P corners each.
        size_px: width and height of the pictures.
        fixed_aspect: square pixels, fx = fy.
        radial_terms: 2 holds k3 at zero, as in Zhang's paper; 3 is OpenCV's and ROS's plumb-bob model.

    Raises:
        ValueError: too few views, or views that do not determine a camera.
    """
    if radial_terms not in (2, 3):
        raise ValueError(f"radial_terms must be 2 or 3, got {radial_terms}")
    if len(views) < MIN_VIEWS:
        raise ValueError(f"a calibration needs at least {MIN_VIEWS} views of the board, got {len(views)}")
    flags = (cv2.CALIB_FIX_ASPECT_RATIO if fixed_aspect else 0) | (cv2.CALIB_FIX_K3 if radial_terms == 2 else 0)
    points = [np.asarray(board_m, np.float32)] * len(views)
    corners = [np.asarray(view.corners_px, np.float32) for view in views]
    try:
        _, K, distortion, rotations, translations, std, _, _ = cv2.calibrateCameraExtended(
            points, corners, size_px, np.eye(3), np.zeros(5), flags=flags
        )
    except cv2.error as error:
        raise ValueError("the views do not determine a camera: tilt the board differently in each picture") from error
    fx_std, fy_std, cx_std, cy_std, *distortion_std = std.ravel()[:9]
    if fixed_aspect:
        fx_std = fy_std  # OpenCV gives the tied fx no deviation of its own
    residuals = [
        seen - cv2.projectPoints(board_m, r, t, K, distortion)[0].reshape(-1, 2)
        for seen, r, t in zip((view.corners_px for view in views), rotations, translations)
    ]
    result = CalibrationResult(
        size_px=size_px,
        K=K,
        K_std=np.array([[fx_std, 0, cx_std], [0, fy_std, cy_std], [0, 0, 0]]),
        distortion=distortion.ravel()[:5],
        distortion_std=np.array(distortion_std),
        views=tuple(views),
        residual_px=np.stack(residuals),
        rotation=np.stack([cv2.Rodrigues(r)[0] for r in rotations]),
        translation_m=np.stack([t.ravel() for t in translations]),
        board_m=board_m,
    )
    if not all(np.isfinite(part).all() for part in (result.K, result.K_std, result.distortion, result.residual_px)):
        raise ValueError("the views do not determine a camera: tilt the board differently in each picture")
    return result


def calibrate_robustly(
    board_m: Array,
    views: Sequence[View],
    size_px: tuple[int, int],
    fixed_aspect: bool = False,
    radial_terms: int = 3,
    outlier_error_px: float = 0.5,
) -> CalibrationResult:
    """:func:`calibrate`, then leave out the worst view and fit again for as long as the worst view stands out.

    One at a time, because a bad view bends the fit and so spoils the errors of the good ones. A view stands out when
    its error is above ``outlier_error_px``, above OUTLIER_RATIO times the median *and* OUTLIER_SIGMAS robust sigmas
    (1.4826 median absolute deviations) above the median. MIN_VIEWS views always stay: with fewer nobody can tell which
    one is wrong.
    """
    kept, rejected = list(views), list[RejectedView]()
    while True:
        result = calibrate(board_m, kept, size_px, fixed_aspect, radial_terms)
        error = result.view_error_px
        median = np.median(error)
        sigma = 1.4826 * np.median(np.abs(error - median))
        limit = max(outlier_error_px, OUTLIER_RATIO * median, median + OUTLIER_SIGMAS * sigma)
        worst = int(error.argmax())
        if error[worst] <= limit or len(kept) <= MIN_VIEWS:
            return result._replace(rejected=tuple(rejected))
        rejected.append(RejectedView(kept.pop(worst), float(error[worst])))
