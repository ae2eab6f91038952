"""What a calibration sees and what it does not: field of view, coverage, tilt, and the cautions that follow."""

import cv2
import numpy as np

from usvnet.geometry.calibration import Array, CalibrationResult


def field_of_view_deg(result: CalibrationResult) -> tuple[float, float]:
    """Horizontal and vertical angle that the picture spans through its principal point, distortion included."""
    width, height = result.size_px
    cx, cy = result.K[0, 2], result.K[1, 2]
    edges = np.array([[-0.5, cy], [width - 0.5, cy], [cx, -0.5], [cx, height - 0.5]])
    rays = undistort(edges, result)
    angle = np.degrees(np.arctan(rays))
    return float(angle[1, 0] - angle[0, 0]), float(angle[3, 1] - angle[2, 1])


def undistort(points_px: Array, result: CalibrationResult) -> Array:
    """(P, 2) pixels to (P, 2) points of the plane z = 1."""
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-12)
    return cv2.undistortPoints(points_px[:, None], result.K, result.distortion, criteria=criteria).reshape(-1, 2)


def coverage(result: CalibrationResult) -> float:
    """Share of the picture that lies inside the hull of the corners of at least one view."""
    mask = np.zeros(result.size_px[::-1], np.uint8)
    for view in result.views:
        cv2.fillConvexPoly(mask, cv2.convexHull(view.corners_px.astype(np.float32)).round().astype(np.int32), 1)
    return float(mask.mean())


WEAK_TILT_DEG = 20.0
"""Boards that differ by less leave the focal length rather free."""
LEAST_TILT_DEG = 10.0
"""Boards that differ by less say nothing of it, whatever its sigma claims."""


def tilt_spread_deg(result: CalibrationResult) -> float:
    """Largest angle between the boards of any two views.

    Boards parallel to one another, whichever way they face, say the same about K (Zhang, section 3.3).
    """
    normals = result.rotation[:, :, 2]
    return float(np.degrees(np.arccos(np.clip(normals @ normals.T, -1, 1).min())))


def distortion_folds(result: CalibrationResult) -> bool:
    """Whether the radial polynomial turns back inside the picture, so that two rays share a pixel."""
    k1, k2, _, _, k3 = result.distortion
    radius = np.linspace(0, 10, 20001)
    distorted = radius * (1 + k1 * radius**2 + k2 * radius**4 + k3 * radius**6)
    falling = np.flatnonzero(np.diff(distorted) <= 0)
    width, height = result.size_px
    corners = np.array([[x, y, 1] for x in (-0.5, width - 0.5) for y in (-0.5, height - 0.5)])
    reach = np.linalg.norm((corners @ np.linalg.inv(result.K).T)[:, :2], axis=-1).max()
    return bool(len(falling) and distorted[falling[0]] < reach)


def cautions(result: CalibrationResult) -> list[str]:
    """Plain sentences on what weakens this calibration and what would help; none when all is well."""
    sentences = []
    if len(result.views) < 8:
        sentences.append(f"only {len(result.views)} views: ten or more make the sigmas themselves trustworthy")
    if (spread := tilt_spread_deg(result)) < WEAK_TILT_DEG:
        sentences.append(
            f"the boards are nearly parallel to one another (within {spread:.0f} deg), which leaves the focal length "
            "free: tilt the board by 30 to 45 deg in different directions"
        )
    if (share := coverage(result)) < 0.5:
        sentences.append(
            f"the boards cover only {share:.0%} of the picture: distortion is a guess elsewhere; "
            "show the board near the edges and corners too"
        )
    if (rms := result.rms_px) > max(1.0, 0.001 * result.size_px[0]):
        sentences.append(f"corners miss by {rms:.1f} px (RMS): is the board flat, rigid and sharp in the pictures?")
    if (relative := result.focal_std_px / result.focal_px) > 0.005:
        sentences.append(f"the focal length is known to {relative:.1%} only (1 sigma): add tilted, closer views")
    if result.distortion_std[4] > 0 and abs(result.distortion[4]) < 2 * result.distortion_std[4]:
        sentences.append(
            f"k3 = {result.distortion[4]:.2g} +- {result.distortion_std[4]:.2g} is not seen by these pictures: "
            "--radial-terms 2 leaves it out"
        )
    if distortion_folds(result):
        sentences.append(
            "the distortion polynomial folds back inside the picture: far from the boards it is not to be used; "
            "cover the corners or try --radial-terms 2"
        )
    return sentences
