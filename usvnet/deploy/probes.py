"""Cameras and native pictures that no two numbers of are alike: what exported files are traced and compared with."""

import torch
from torch import Tensor
from torch.nn import functional

from usvnet.types import Camera, Native


def probe_camera(batch: int, height: int, width: int) -> Camera:
    """B slightly different cameras with every number other than 0."""
    one = torch.ones(batch)
    focal = 1.2 * width
    K = torch.tensor([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    return Camera(
        K=K.expand(batch, 3, 3),
        distortion=torch.tensor([-0.1, 0.02, 0.001, -0.001, 0.0]).expand(batch, 5),
        size_px=torch.tensor([float(width), float(height)]).expand(batch, 2),
        height_m=1.5 * one,
        pitch_rad=0.1 + 0.02 * torch.arange(batch),
        roll_rad=0.03 * one,
        focal_std_px=0.5 * one,
        height_std_m=0.02 * one,
        pitch_std_rad=0.002 * one,
        roll_std_rad=0.002 * one,
        wave_std_m=0.01 * one,
    )


def probe_native(image: Tensor) -> Native:
    """Pictures of which the images (B, 3, H, W) are copies at half the size."""
    picture = functional.interpolate(image, scale_factor=2, mode="bicubic").clamp(0, 1)
    to_image = torch.tensor([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
    return Native((255 * picture).round().to(torch.uint8), to_image.expand(len(image), 3, 3))
