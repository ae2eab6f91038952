import math

import pytest
import torch
from torch.autograd import gradcheck

from usvnet.geometry.camera import with_attitude
from usvnet.geometry.horizon import WaterEdge, attitude_from_edge, edge_px, flat_edge, sea_horizon
from usvnet.geometry.rays import level_rays
from usvnet.geometry.water import horizon_dip_rad, meet_water

AZIMUTHS = torch.tensor([[-0.35, 0.35]], dtype=torch.float64)
NO_NOISE = torch.zeros(1, 2, 2, dtype=torch.float64)


def turned(camera, pitch_deg, roll_deg):
    return with_attitude(camera, math.radians(pitch_deg), math.radians(roll_deg))


@pytest.mark.parametrize("dip_deg", [0.03, 1.0, 8.0])
@pytest.mark.parametrize(("pitch_deg", "roll_deg"), [(6, 3), (0, 0), (-4, 12), (15, -30), (2, 80)])
def test_two_points_of_the_edge_give_back_the_attitude(camera, pitch_deg, roll_deg, dip_deg):
    edge = WaterEdge(torch.tensor([math.radians(dip_deg)], dtype=torch.float64), torch.zeros(1, dtype=torch.float64))
    true = turned(camera, pitch_deg, roll_deg)
    found = attitude_from_edge(edge_px(true, edge.depression_rad, AZIMUTHS / 2), NO_NOISE, camera, edge)
    assert math.degrees(found.pitch_rad.item()) == pytest.approx(pitch_deg, abs=1e-4)  # the lens is undone to 1e-5
    assert math.degrees(found.roll_rad.item()) == pytest.approx(roll_deg, abs=1e-4)


def test_edge_px_lies_at_the_dip_below_the_horizontal(camera):
    dip = horizon_dip_rad(camera.height_m)
    rays = level_rays(edge_px(camera, dip, torch.linspace(-0.4, 0.4, 9, dtype=torch.float64)[None]), camera)
    torch.testing.assert_close(torch.asin(rays[..., 1]), dip.expand(1, 9), rtol=0, atol=1e-7)
    torch.testing.assert_close(
        torch.atan2(rays[0, :, 0], rays[0, :, 2]), torch.linspace(-0.4, 0.4, 9).double(), rtol=0, atol=1e-6
    )


def test_a_row_of_flat_water_at_its_end_ranges_to_there(camera):
    edge = flat_edge(camera, 400.0)
    rays = level_rays(edge_px(camera, edge.depression_rad, AZIMUTHS), camera)
    hit = meet_water(rays, camera.height_m[:, None], curved=False)
    torch.testing.assert_close(
        hit.slant_m, torch.hypot(camera.height_m, torch.tensor(400.0)).expand(1, 2), rtol=1e-4, atol=0
    )
    assert edge.std_rad.tolist() == [0.0]


def test_leaving_out_the_dip_costs_the_dip(camera):
    edge = sea_horizon(camera)
    points = edge_px(camera, edge.depression_rad, AZIMUTHS)
    flat = attitude_from_edge(points, NO_NOISE, camera, WaterEdge(0 * edge.depression_rad, edge.std_rad))
    lost = camera.pitch_rad - flat.pitch_rad
    torch.testing.assert_close(lost, edge.depression_rad / math.cos(math.radians(3)), rtol=0.1, atol=0)


def test_sigma_of_the_horizon_is_that_of_height_and_refraction(camera):
    edge = sea_horizon(camera, refraction_std=0.0)
    higher = horizon_dip_rad(camera.height_m + 0.02)
    torch.testing.assert_close(edge.std_rad, higher - edge.depression_rad, rtol=0.02, atol=0)
    edge = sea_horizon(camera._replace(height_std_m=0 * camera.height_m), refraction_std=0.01)
    less = horizon_dip_rad(camera.height_m, 0.14)
    torch.testing.assert_close(edge.std_rad, edge.depression_rad - less, rtol=0.02, atol=0)


@pytest.mark.parametrize("what", ["rows", "dip", "focal"])
def test_sigmas_are_autograds(camera, what):
    """Each source of error alone, against the derivative of the attitude found."""
    camera = turned(camera, 15, -20)._replace(focal_std_px=torch.zeros(1, dtype=torch.float64))
    edge = WaterEdge(torch.tensor([0.02], dtype=torch.float64), torch.zeros(1, dtype=torch.float64))
    points = edge_px(camera, edge.depression_rad, AZIMUTHS)
    covariance = torch.tensor([[[0.3, 0.1], [0.1, 0.2]]], dtype=torch.float64)

    def angles(rows, dip, scale):
        lens = camera._replace(K=camera.K * torch.stack([scale, scale, scale.new_ones(())])[:, None] ** SCALED)
        at = torch.stack([points[..., 0], rows], -1)
        return torch.stack(attitude_from_edge(at, NO_NOISE, lens, edge._replace(depression_rad=dip))[:2]).squeeze(-1)

    one = torch.ones((), dtype=torch.float64)
    by_rows, by_dip, by_scale = torch.autograd.functional.jacobian(angles, (points[..., 1], edge.depression_rad, one))
    if what == "rows":
        J = by_rows[:, 0]
        expected = torch.diagonal(J @ covariance[0] @ J.T).sqrt()
        found = attitude_from_edge(points, covariance, camera, edge)
    elif what == "dip":
        expected = 0.001 * by_dip[:, 0].abs()
        found = attitude_from_edge(points, NO_NOISE, camera, edge._replace(std_rad=0 * edge.std_rad + 0.001))
    else:
        expected = by_scale.abs() * 4.0 / camera.K[0, 1, 1]
        found = attitude_from_edge(points, NO_NOISE, camera._replace(focal_std_px=0 * edge.std_rad + 4.0), edge)
    torch.testing.assert_close(torch.cat(found[2:]), expected, rtol=1e-6, atol=1e-9)


SCALED = torch.tensor([[1.0, 0, 0], [0, 1, 0], [0, 0, 0]], dtype=torch.float64)
"""Exponents that scale fx and fy and leave the rest."""


def test_gradcheck(camera):
    edge = sea_horizon(camera)
    points = edge_px(camera, edge.depression_rad, AZIMUTHS).requires_grad_()
    covariance = torch.tensor([[[0.3, 0.1], [0.1, 0.2]]], dtype=torch.float64, requires_grad=True)
    dip = edge.depression_rad.clone().requires_grad_()

    def attitude(points, covariance, dip):
        return attitude_from_edge(points, covariance, camera, edge._replace(depression_rad=dip))

    assert gradcheck(attitude, (points, covariance, dip))
    pitch, roll = (angle.clone().requires_grad_() for angle in (camera.pitch_rad, camera.roll_rad))
    assert gradcheck(lambda p, r, d: edge_px(camera._replace(pitch_rad=p, roll_rad=r), d, AZIMUTHS), (pitch, roll, dip))


def test_points_that_say_nothing_have_infinite_sigmas_and_finite_gradients(camera):
    same = torch.tensor([[[300.0, 200.0], [300.0, 200.0]]], dtype=torch.float64)
    lost = torch.tensor([[[300.0, float("nan")], [500.0, 200.0]]], dtype=torch.float64)
    for bad in (same, lost):
        points = bad.clone().requires_grad_()
        found = attitude_from_edge(points, NO_NOISE, camera, sea_horizon(camera))
        assert found.pitch_std_rad.isinf().all()
        assert found.roll_std_rad.isinf().all()
        (found.pitch_rad + found.roll_rad).sum().backward()
        assert torch.isfinite(points.grad).all()
