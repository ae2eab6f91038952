"""Ranges to 20 km on the curved water, against 50-digit arithmetic and, in float32, against float64.

The reference is the plain, cancelling root of the ray-sphere quadratic,
D = (R + h) s - sqrt((R + h)^2 s^2 - h (2 R + h)), with
the sine rule for the arc, R asin(D cos(d) / R): neither is the formula of :mod:`usvnet.geometry.water`.
"""

import math
from decimal import Decimal, localcontext

import pytest
import torch

from usvnet.geometry.camera import camera_to, make_camera, project
from usvnet.geometry.ranging import RangingLayer
from usvnet.geometry.rays import level_rotation
from usvnet.geometry.water import effective_radius_m, horizon_dip_rad, meet_water
from usvnet.types import Camera

RADIUS_M = effective_radius_m()
HEIGHTS_M = (1.5, 10.0, 30.0, 100.0)
DECADES_M = ((1, 10), (10, 100), (100, 1000), (1000, 10_000), (10_000, 20_000))

CASES = [
    (height_m, low_m, high_m)
    for height_m in HEIGHTS_M
    for low_m, high_m in DECADES_M
    if low_m < RADIUS_M * math.acos(RADIUS_M / (RADIUS_M + height_m))
]
"""Nothing is to be seen beyond the horizon."""


def reference(depression_rad: float, height_m: float) -> tuple[float, float]:
    """Slant range and arc along the water of a ray, from the sine of its depression as float64 has it."""
    with localcontext() as context:
        context.prec = 50
        sine, height, radius = Decimal(math.sin(depression_rad)), Decimal(height_m), Decimal(RADIUS_M)
        across = (radius + height) * sine
        slant = across - (across * across - height * (2 * radius + height)).sqrt()
        chord = slant * (1 - sine * sine).sqrt()
    return float(slant), RADIUS_M * math.asin(float(chord) / RADIUS_M)


def depressions(height_m: float, low_m: float, high_m: float, count: int = 12) -> list[float]:
    """Depressions (rad) of points ``low_m`` to ``high_m`` away that stand clear of the horizon by one part in 10^4."""
    horizon_m = RADIUS_M * math.acos(RADIUS_M / (RADIUS_M + height_m))
    arcs = torch.logspace(math.log10(low_m), math.log10(high_m), count, dtype=torch.float64).tolist()
    angles = [arc / RADIUS_M for arc in arcs if arc < 0.9999 * horizon_m]
    return [math.atan2(height_m + 2 * RADIUS_M * math.sin(a / 2) ** 2, RADIUS_M * math.sin(a)) for a in angles]


def rays(depression_rad: list[float], azimuth_rad: float = 0.1) -> torch.Tensor:
    depression = torch.tensor(depression_rad, dtype=torch.float64)
    across = torch.cos(depression)
    sin, cos = math.sin(azimuth_rad), math.cos(azimuth_rad)
    return torch.stack([across * sin, torch.sin(depression), across * cos], -1)


def long_camera(height_m: float) -> Camera:
    """A telephoto camera with a lens, a pitch and a roll that show everything from 200 m on."""
    return make_camera(
        [[2000.0, 0, 960], [0, 2000, 540], [0, 0, 1]],
        (1920, 1080),
        (-0.1, 0.02, 0.0005, 0.0003),
        height_m=height_m,
        pitch_rad=0.05,
        roll_rad=0.02,
        dtype=torch.float64,
    )


@pytest.mark.parametrize(("height_m", "low_m", "high_m"), CASES)
def test_float64_is_right_to_eleven_digits(height_m, low_m, high_m):
    angles = depressions(height_m, low_m, high_m)
    hit = meet_water(rays(angles), torch.full((len(angles),), height_m, dtype=torch.float64), curved=True)
    expected = torch.tensor([reference(angle, height_m) for angle in angles], dtype=torch.float64)
    assert hit.valid.all()
    torch.testing.assert_close(hit.slant_m, expected[:, 0], rtol=1e-11, atol=0)
    torch.testing.assert_close(hit.horizontal_m, expected[:, 1], rtol=1e-11, atol=0)


@pytest.mark.parametrize("height_m", [30.0, 100.0])
def test_pixels_to_metres_at_20_km(height_m):
    camera = long_camera(height_m)
    angles = depressions(height_m, 19_000, 20_000)
    pixels = project((rays(angles) @ level_rotation(camera.pitch_rad, camera.roll_rad)[0])[None], camera)
    found = RangingLayer(curved_water=True).range_points(pixels, torch.zeros(1, len(angles), 2, 2).double(), camera)
    expected = torch.tensor([reference(angle, height_m)[0] for angle in angles], dtype=torch.float64)
    assert found.valid.all()
    torch.testing.assert_close(found.slant_m[0], expected, rtol=1e-9, atol=0)


@pytest.mark.parametrize(("height_m", "low_m", "high_m"), [case for case in CASES if case[1] >= 100])
def test_float32_costs_less_than_a_thousandth_of_a_pixel(height_m, low_m, high_m):
    """From pixels to metres, pixels and camera rounded to float32, against the range's change by one pixel."""
    camera = long_camera(height_m)
    angles = depressions(height_m, low_m, high_m)
    pixels = project((rays(angles) @ level_rotation(camera.pitch_rad, camera.roll_rad)[0])[None], camera)
    one_px = torch.eye(2, dtype=torch.float64).expand(1, len(angles), 2, 2)
    layer = RangingLayer(curved_water=True)
    exact = layer.range_points(pixels, one_px, camera)
    rounded = layer.range_points(pixels.float(), one_px.float(), camera_to(camera, dtype=torch.float32))
    seen = torch.isfinite(pixels).all(-1) & (pixels[..., 1] < 1080)
    assert seen.any()
    assert rounded.valid[seen].all()
    off = (rounded.slant_m.double() - exact.slant_m).abs()[seen]
    assert (off < 1e-3 * exact.slant_std_m[seen]).all()


@pytest.mark.parametrize("height_m", HEIGHTS_M)
def test_the_dip_is_arccos_in_float32_too(height_m):
    with localcontext() as context:
        context.prec = 50
        ratio = Decimal(RADIUS_M) / (Decimal(RADIUS_M) + Decimal(height_m))
        sine = float((1 - ratio * ratio).sqrt())
    exact = math.asin(sine)
    assert horizon_dip_rad(torch.tensor(height_m, dtype=torch.float64)).item() == pytest.approx(exact, rel=1e-13)
    assert horizon_dip_rad(torch.tensor(height_m)).item() == pytest.approx(exact, rel=3e-7)
