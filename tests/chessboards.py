"""Chessboards with known corners, for the tests of the calibration: as points and as rendered pictures."""

import cv2
import numpy as np

from usvnet.geometry.calibration import View, board_points

COLUMNS, ROWS, SQUARE_MM = 9, 6, 25.0
BOARD_M = board_points(COLUMNS, ROWS, SQUARE_MM)
SIZE_PX = (480, 360)
K = np.array([[400.0, 0, 246.0], [0, 404.0, 173.0], [0, 0, 1]])
DISTORTION = np.array([-0.25, 0.08, 0.001, -0.0005, 0.0])


def poses(number, seed=0, tilt_rad=0.7, size_px=SIZE_PX):
    """Rotation vectors and translations (m) of boards that lie wholly inside the picture."""
    random = np.random.default_rng(seed)
    found = []
    while len(found) < number:
        rotation = random.uniform(-tilt_rad, tilt_rad, 3)
        translation = random.uniform((-0.2, -0.15, 0.3), (0.05, 0.05, 0.55))
        corners = project(rotation, translation)
        if (corners > 25).all() and (corners < np.array(size_px) - 25).all():
            found.append((rotation, translation))
    return found


def project(rotation, translation):
    """(P, 2) pixels of the board's corners through the known camera."""
    return cv2.projectPoints(BOARD_M, rotation, translation, K, DISTORTION)[0].reshape(-1, 2)


def views(number=12, seed=0, noise_px=0.1, tilt_rad=0.7):
    random = np.random.default_rng(seed + 1000)
    corners = [project(*pose) for pose in poses(number, seed, tilt_rad)]
    return [View(f"view{i}", c + random.normal(0, noise_px, c.shape)) for i, c in enumerate(corners)]


def _alternate(x):
    """+1 and -1 in turn from one integer to the next, with an edge one pixel wide: what a sensor integrates."""
    footprint = np.hypot(*np.gradient(x))
    to_edge = 0.5 - np.abs(x % 1 - 0.5)
    return np.where(np.floor(x) % 2 == 0, 1, -1) * np.minimum(1, 2 * to_edge / footprint)


def render(rotation, translation, seed=0):
    """A (360, 480) uint8 picture of the board through the known camera, by ray casting, with blur and noise."""
    random = np.random.default_rng(seed)
    width, height = SIZE_PX
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 1, 2).astype(float)
    rays = cv2.convertPointsToHomogeneous(cv2.undistortPoints(pixels, K, DISTORTION))[:, 0]
    axes = cv2.Rodrigues(rotation)[0]
    on_board = rays @ np.linalg.inv(np.column_stack([axes[:, 0], axes[:, 1], translation])).T
    x, y = np.moveaxis((on_board[:, :2] / on_board[:, 2:] / (SQUARE_MM / 1000)).reshape(height, width, 2), -1, 0)
    squares = (np.abs(x - (COLUMNS - 1) / 2) < (COLUMNS + 1) / 2) & (np.abs(y - (ROWS - 1) / 2) < (ROWS + 1) / 2)
    margin = (np.abs(x - (COLUMNS - 1) / 2) < (COLUMNS + 3) / 2) & (np.abs(y - (ROWS - 1) / 2) < (ROWS + 3) / 2)
    background = cv2.resize(random.uniform(60, 150, (6, 8)), SIZE_PX, interpolation=cv2.INTER_CUBIC)
    picture = np.where(squares, 127 - 100 * _alternate(x) * _alternate(y), np.where(margin, 227, background))
    picture = cv2.GaussianBlur(picture, (0, 0), 0.7) + random.normal(0, 2, picture.shape)
    return np.clip(picture, 0, 255).astype(np.uint8)
