import math

import pytest
import torch
from torch.autograd import gradcheck

from usvnet.geometry.water import effective_radius_m, horizon_dip_rad, meet_water

RADIUS_M = effective_radius_m()


def rays(depression_rad: torch.Tensor, azimuth_rad: float = 0.3) -> torch.Tensor:
    across = torch.cos(depression_rad)
    sin, cos = math.sin(azimuth_rad), math.cos(azimuth_rad)
    return torch.stack([across * sin, torch.sin(depression_rad), across * cos], -1)


def around_the_earth(arc_m: torch.Tensor, height_m: float) -> tuple[torch.Tensor, torch.Tensor]:
    """Slant range and depression of a point ``arc_m`` along the curved water, from the triangle at its centre."""
    angle = arc_m / RADIUS_M
    forward = RADIUS_M * torch.sin(angle)
    down = height_m + 2 * RADIUS_M * torch.sin(angle / 2) ** 2
    return torch.hypot(forward, down), torch.atan2(down, forward)


def test_flat_water_is_height_over_sine():
    depression = torch.tensor([0.01, 0.15, 1.2], dtype=torch.float64)
    hit = meet_water(rays(depression), torch.tensor(1.5, dtype=torch.float64))
    torch.testing.assert_close(hit.slant_m, 1.5 / torch.sin(depression))
    torch.testing.assert_close(hit.horizontal_m, 1.5 / torch.tan(depression))
    assert hit.valid.all()


def test_curved_water_gives_back_points_of_the_sphere():
    arc = torch.tensor([1.0, 10.0, 100.0, 1000.0, 4000.0, 4600.0], dtype=torch.float64)
    slant, depression = around_the_earth(arc, 1.5)
    hit = meet_water(rays(depression), torch.full_like(arc, 1.5), curved=True)
    assert hit.valid.all()
    torch.testing.assert_close(hit.slant_m, slant, rtol=1e-7, atol=0)
    torch.testing.assert_close(hit.horizontal_m, arc, rtol=1e-7, atol=0)


def test_float32_is_as_good_as_its_ray():
    arc = torch.logspace(1, math.log10(4000), 60, dtype=torch.float64)
    _, depression = around_the_earth(arc, 1.5)
    single = rays(depression).float()  # the ray as float32 knows it; what the formula adds to that is tested here
    height = torch.full_like(arc, 1.5)
    exact = meet_water(single.double(), height, curved=True)
    rounded = meet_water(single, height.float(), curved=True)
    assert exact.valid.all()
    torch.testing.assert_close(rounded.slant_m.double(), exact.slant_m, rtol=2e-6, atol=0)
    torch.testing.assert_close(rounded.horizontal_m.double(), exact.horizontal_m, rtol=2e-6, atol=0)


def test_curvature_is_worth_one_percent_at_500_m_from_a_tripod():
    slant, depression = around_the_earth(torch.tensor([500.0], dtype=torch.float64), 1.5)
    flat = meet_water(rays(depression), torch.tensor([1.5], dtype=torch.float64))
    assert 0.011 < slant.item() / flat.slant_m.item() - 1 < 0.012


def test_dip_of_the_horizon():
    # Nautical tables: 1.76' sqrt(h) with k = 0.17; geometric 1.93' sqrt(h). In between for k = 0.13.
    height = torch.tensor([1.5, 10.0, 100.0], dtype=torch.float64)
    for k, minutes in ((0.0, 1.926), (0.17, 1.755)):
        dip_minutes = torch.rad2deg(horizon_dip_rad(height, k)) * 60
        torch.testing.assert_close(dip_minutes, minutes * height.sqrt(), rtol=1e-3, atol=0)


def test_a_ray_above_the_dipped_horizon_has_no_range():
    height = torch.tensor([1.5], dtype=torch.float64)
    dip = horizon_dip_rad(height)
    below = meet_water(rays(dip * 1.001), height, curved=True)
    above = meet_water(rays(dip * 0.999), height, curved=True)
    assert below.valid.all()
    assert not above.valid.any()
    assert meet_water(rays(dip * 0.999), height, curved=False).valid.all()
    horizon_m = math.sqrt(1.5 * (1.5 + 2 * RADIUS_M))
    assert 0.9 * horizon_m < below.slant_m.item() < horizon_m


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_rays_that_graze_the_horizon_have_finite_gradients(dtype):
    height = torch.tensor([1.5], dtype=dtype, requires_grad=True)
    close = torch.tensor([-1e-3, -1e-7, 0.0, 1e-15, 1e-9, 1e-7, 1e-6, 1e-5, 1e-3], dtype=dtype)
    depression = (horizon_dip_rad(height.detach()) * (1 + close)).requires_grad_()
    hit = meet_water(rays(depression), height.expand_as(close), curved=True)
    (hit.slant_m + hit.horizontal_m + hit.slant_by_sine_m + hit.slant_by_height).sum().backward()
    assert torch.isfinite(depression.grad).all()
    assert torch.isfinite(height.grad).all()


@pytest.mark.parametrize("curved", [False, True])
def test_stated_derivatives_are_autograds(curved):
    depression = torch.tensor([0.002, 0.15, 1.0], dtype=torch.float64, requires_grad=True)
    height = torch.tensor([1.5, 1.5, 2.0], dtype=torch.float64, requires_grad=True)
    hit = meet_water(rays(depression), height, curved)
    by_depression, by_height = torch.autograd.grad(hit.slant_m.sum(), (depression, height))
    torch.testing.assert_close(hit.slant_by_sine_m * torch.cos(depression), by_depression)
    torch.testing.assert_close(hit.slant_by_height, by_height)


@pytest.mark.parametrize("curved", [False, True])
def test_gradcheck(curved):
    depression = torch.tensor([0.02, 0.15, 1.0], dtype=torch.float64, requires_grad=True)
    height = torch.tensor([1.5, 1.5, 2.0], dtype=torch.float64, requires_grad=True)
    assert gradcheck(lambda d, h: meet_water(rays(d), h, curved)[:4], (depression, height))
    assert gradcheck(horizon_dip_rad, (height,))
