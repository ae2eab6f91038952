import math

import pytest
import torch

from usvnet.geometry.camera import make_camera
from usvnet.types import Camera

K = [[700.0, 0.0, 322.0], [0.0, 690.0, 236.5], [0.0, 0.0, 1.0]]
SIZE_PX = (640, 480)
DISTORTION = (-0.28, 0.09, 0.0012, -0.0007, 0.005)


@pytest.fixture
def camera() -> Camera:
    """A float64 camera with everything in it: distortion, roll and every standard deviation."""
    return make_camera(
        K,
        SIZE_PX,
        DISTORTION,
        height_m=1.5,
        pitch_rad=math.radians(6),
        roll_rad=math.radians(3),
        focal_std_px=4.0,
        height_std_m=0.02,
        pitch_std_rad=math.radians(0.3),
        roll_std_rad=math.radians(0.5),
        wave_std_m=0.03,
        dtype=torch.float64,
    )


@pytest.fixture
def water_px() -> torch.Tensor:
    """Pixels (1, 6, 2) of the water, from 4 m to 40 m away."""
    return torch.tensor(
        [[[322.0, 236.5], [100.0, 300.0], [600.0, 330.0], [320.0, 470.0], [30.0, 250.0], [400.0, 260.0]]],
        dtype=torch.float64,
    )


@pytest.fixture
def pixel_covariance() -> torch.Tensor:
    """A lopsided covariance (1, 6, 2, 2), pixels squared."""
    return torch.tensor([[1.2, 0.4], [0.4, 0.8]], dtype=torch.float64).expand(1, 6, 2, 2).contiguous()
