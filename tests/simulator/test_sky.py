"""The sky's map: where things are in it, how bright they are, and that it repeats."""

import dataclasses

import numpy as np
import pytest

from usvnet.simulator.clouds import cloud_layer
from usvnet.simulator.daylight import clear_sky, luminance, sun_colour
from usvnet.simulator.frame_spec import SkySpec
from usvnet.simulator.sky import HEIGHT, build_sky, texel_directions, texel_solid_angles

HALF = HEIGHT // 2
DAY = SkySpec("clear", 0.7, np.radians(35), 6.0, 2.5, 0.0, 3)


def spec(**changes: object) -> SkySpec:
    return dataclasses.replace(DAY, **changes)  # type: ignore[arg-type]


def flux(radiance: np.ndarray, facing: np.ndarray) -> float:
    """Irradiance (luminance) of a surface that faces ``facing``, from the whole map."""
    cosine = np.maximum(texel_directions() @ facing, 0)
    return float((luminance(radiance) * cosine * texel_solid_angles()).sum())


@pytest.mark.parametrize("azimuth", [-2.5, -0.7, 0.0, 0.7, 1.6, 3.1])
def test_sun_is_where_it_should_be(azimuth: float) -> None:
    sky = build_sky(spec(sun_azimuth_rad=azimuth))
    bright = luminance(sky.radiance)
    heavy = np.where(bright > 0.2 * bright.max(), bright, 0) * texel_solid_angles()
    centre = (texel_directions() * heavy[..., None]).sum((0, 1))
    centre /= np.linalg.norm(centre)
    level = np.cos(np.radians(35))
    expected = [level * np.sin(azimuth), level * np.cos(azimuth), np.sin(np.radians(35))]
    np.testing.assert_allclose(sky.sun_direction, expected, atol=1e-12)
    assert np.degrees(np.arccos(centre @ expected)) < 0.1


def test_texels_follow_the_stated_rule() -> None:
    directions = texel_directions()
    rows, columns = directions.shape[:2]
    u = np.arctan2(directions[..., 0], directions[..., 1]) / (2 * np.pi) % 1
    np.testing.assert_allclose(u, np.broadcast_to((np.arange(columns) + 0.5) / columns, u.shape), atol=1e-4)
    v = np.arccos(directions[..., 2]) / np.pi
    np.testing.assert_allclose(v[:, 5], (np.arange(rows) + 0.5) / rows, atol=1e-4)
    assert directions[HALF, columns // 4] @ [1, 0, 0] > 0.999
    assert texel_solid_angles().sum() * columns == pytest.approx(4 * np.pi, rel=1e-5)


@pytest.mark.parametrize("elevation_deg", [6, 30, 70])
@pytest.mark.parametrize("strength", [0.5, 4, 9])
def test_sun_is_as_strong_as_asked(elevation_deg: float, strength: float) -> None:
    sunny = spec(sun_elevation_rad=np.radians(elevation_deg), sun_strength=strength)
    sky, shade = build_sky(sunny), build_sky(dataclasses.replace(sunny, sun_strength=0.0))
    assert flux(shade.radiance, np.array([0, 0, 1.0])) == pytest.approx(np.pi, rel=0.02)
    added = sky.radiance - shade.radiance
    disc = np.where((texel_directions() @ sky.sun_direction > np.cos(np.radians(1.6)))[..., None], added, 0)
    assert flux(disc, sky.sun_direction) / np.pi == pytest.approx(strength, rel=0.15)


def test_disc_covers_several_texels() -> None:
    bright = luminance(build_sky(spec(sun_strength=9.0)).radiance)
    assert (bright > 0.5 * bright.max()).sum() >= 10
    assert bright.max() < 5e4


def test_low_sun_is_warm_and_a_high_one_nearly_white() -> None:
    low, high = sun_colour(np.radians(4), 3.0), sun_colour(np.radians(60), 3.0)
    assert low[0] / low[2] > 2
    assert high[0] / high[2] < 1.5
    assert luminance(low) == pytest.approx(1, rel=1e-5)


def test_clear_zenith_is_darker_and_bluer_than_the_horizon() -> None:
    sky = build_sky(spec(sun_strength=0.0)).radiance
    away = sky.shape[1] * 5 // 8  # the sun stands at azimuth 0.7 rad, an eighth of a turn
    zenith, horizon = sky[2, away], sky[HALF - 8, away]
    assert luminance(zenith) < 0.7 * luminance(horizon)
    assert zenith[2] / zenith[0] > 1.5 * horizon[2] / horizon[0]


def test_preetham_zenith_luminance_is_the_published_one() -> None:
    theta = np.radians(50)
    chi = (4 / 9 - 3.0 / 120) * (np.pi - 2 * theta)
    expected = (4.0453 * 3 - 4.9710) * np.tan(chi) - 0.2155 * 3 + 2.4192
    rgb = clear_sky(np.ones(1), np.array([np.cos(theta)]), np.pi / 2 - theta, 3.0)
    assert luminance(rgb)[0] == pytest.approx(expected, rel=0.01)


def test_overcast_zenith_is_about_three_times_the_horizon() -> None:
    bright = luminance(build_sky(spec(kind="overcast", sun_strength=0.0)).radiance)
    assert 2.0 < bright[:10].mean() / bright[HALF - 3 : HALF].mean() < 4.0


def test_dusk_glows_where_the_sun_went_down() -> None:
    sky = build_sky(spec(kind="dusk", sun_elevation_rad=0.0, sun_strength=0.0)).radiance
    width = sky.shape[1]
    at_sun, behind = int(0.7 / (2 * np.pi) * width), int((0.7 + np.pi) / (2 * np.pi) * width)
    row = HALF - 5
    assert luminance(sky[row, at_sun]) > 1.2 * luminance(sky[row, behind])
    assert sky[row, at_sun, 0] / sky[row, at_sun, 2] > sky[row, behind, 0] / sky[row, behind, 2]


def test_fog_is_even() -> None:
    bright = luminance(build_sky(spec(kind="fog", sun_strength=0.0)).radiance)[:HALF]
    assert bright.max() / bright.min() < 2


@pytest.mark.parametrize("kind", ["clear", "overcast", "dusk", "fog"])
@pytest.mark.parametrize("seed", [0, 1])
def test_every_sky_is_finite_and_has_no_dark_band(kind: str, seed: int) -> None:
    for elevation in (-0.1, 0.03, 1.5):
        sky = build_sky(
            spec(kind=kind, seed=seed, sun_elevation_rad=elevation, cloud_cover=0.5, turbidity=1.7 + 8 * seed)
        )
        assert np.isfinite(sky.radiance).all()
        assert sky.radiance.dtype == np.float32
        assert (sky.radiance > 0).all()
        bright = luminance(
            build_sky(spec(kind=kind, seed=seed, sun_elevation_rad=elevation, sun_strength=0.0)).radiance
        )
        horizon = bright[HALF - 1].mean()
        assert bright[HALF:].mean(1).min() > 0.5 * horizon
        assert bright[HALF : HALF + 6].mean() == pytest.approx(horizon, rel=0.15)


@pytest.mark.parametrize("cover", [0.2, 0.5, 0.8])
def test_clouds_cover_what_they_should(cover: float) -> None:
    upper = texel_directions()[:HALF]
    opacity, brightness = cloud_layer(upper, np.array([0.6, 0.0, 0.8]), cover, 0.7, np.random.default_rng(4))
    share = (opacity * texel_solid_angles()[:HALF]).sum() / (texel_solid_angles()[:HALF].sum() * upper.shape[1])
    assert share == pytest.approx(cover, abs=0.08)
    assert 0 <= opacity.min() <= opacity.max() <= 1
    assert brightness.min() > 0.3


def test_clouds_have_no_seam_ahead() -> None:
    opacity, _ = cloud_layer(texel_directions()[:HALF], np.array([0.6, 0, 0.8]), 0.5, 0.7, np.random.default_rng(4))
    step = np.abs(np.diff(opacity, axis=1, append=opacity[:, :1])).mean(0)
    assert step[-1] < 2.5 * step.mean()


def test_clouds_dim_the_sun_behind_them() -> None:
    peaks = [luminance(build_sky(spec(cloud_cover=0.6, seed=seed)).radiance).max() for seed in range(8)]
    free = luminance(build_sky(DAY).radiance).max()
    assert min(peaks) < 0.2 * free
    assert max(peaks) > 0.5 * free


def test_airlight_is_the_horizon_below_it_and_smooth_ahead() -> None:
    sky = build_sky(spec(kind="fog", sun_strength=0.0))
    down, level = sky.airlight([[0.3, 1.0, -0.8], [0.3, 1.0, 0.0]])
    np.testing.assert_allclose(down, level, rtol=1e-4)
    bright = luminance(sky.radiance)[HALF - 20 : HALF].mean()
    assert luminance(level) == pytest.approx(bright, rel=0.15)
    left, right = build_sky(DAY).airlight([[-1e-4, 1, 0.1], [1e-4, 1, 0.1]])
    np.testing.assert_allclose(left, right, rtol=1e-3)
    assert sky.airlight(np.ones((3, 4, 3))).shape == (3, 4, 3)


def test_airlight_is_brighter_towards_the_sun_but_has_no_disc() -> None:
    sky = build_sky(DAY)
    towards = luminance(sky.airlight(sky.sun_direction[None]))[0]
    away = luminance(sky.airlight(sky.sun_direction[None] * [-1, -1, 1]))[0]
    assert away < towards < 10


def test_seed_decides_the_clouds_and_nothing_else_does() -> None:
    first, again, other = (build_sky(spec(cloud_cover=0.5, seed=seed)).radiance for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).mean() > 0.05


@pytest.mark.parametrize("wrong", [{"kind": "blue"}, {"cloud_cover": 1.2}, {"sun_strength": -1.0}])
def test_nonsense_is_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match="expected"):
        build_sky(spec(**wrong))
