"""What an error costs: against the geometry's own error bars, finite differences, figures known by hand."""

import math
from dataclasses import replace

import pytest
import torch

from usvnet.evaluation.disturbances import DISTURBANCES, amount_shape, disturb, slopes
from usvnet.evaluation.reranging import range_cases, slants_m
from usvnet.evaluation.scenario_boats import scenario_cases
from usvnet.evaluation.sensitivity import ALL, Study
from usvnet.evaluation.sensitivity_settings import SensitivitySettings, load_sensitivity
from usvnet.geometry.camera import make_camera
from usvnet.geometry.hull_model import generic_hull
from usvnet.geometry.ranging import RangingLayer

WATERLINE = "waterline"


def camera(pitch_std_deg=0.3, wave_std_m=0.02, pitch_deg=4.0, distortion=(-0.1, 0.02, 0.0, 0.0, 0.0)):
    return make_camera(
        [[700.0, 0, 480.0], [0, 700.0, 300.0], [0, 0, 1]],
        (960, 600),
        distortion,
        height_m=1.5,
        pitch_rad=math.radians(pitch_deg),
        focal_std_px=3.0,
        height_std_m=0.02,
        pitch_std_rad=math.radians(pitch_std_deg),
        roll_std_rad=math.radians(0.5),
        wave_std_m=wave_std_m,
    )


def study(**settings):
    defaults = {"disturbances": {"height_m": (0.03,)}, "distances_m": (10.0, 50.0), "headings_deg": (20.0, 160.0)}
    return Study(SensitivitySettings(**defaults | settings), camera(), generic_hull())


@pytest.mark.parametrize("curved", [False, True])
def test_boats_stand_where_they_were_asked_for(curved):
    cases = scenario_cases(camera(), generic_hull(), [5.0, 40.0], [0.0, 70.0, 200.0], 8.0, curved_water=curved)
    estimate = range_cases(cases, RangingLayer(curved))[WATERLINE]
    expected = torch.tensor([5.0] * 3 + [40.0] * 3, dtype=torch.float64)
    torch.testing.assert_close(estimate.slant_m, expected, rtol=1e-6, atol=0)  # the camera's numbers are float32
    torch.testing.assert_close(estimate.bearing_rad, torch.full_like(expected, math.radians(8.0)), rtol=1e-6, atol=0)


def test_a_boat_beside_the_picture_is_refused():
    with pytest.raises(ValueError, match=r"distances_m: a boat at 2 m, 0 degrees to the right, lies outside"):
        scenario_cases(camera(), generic_hull(), [2.0], [0.0])
    with pytest.raises(ValueError, match=r"distances_m: expected more than the camera's 1.5 m of height, got 1"):
        scenario_cases(camera(), generic_hull(), [1.0], [0.0])


@pytest.mark.parametrize("name", DISTURBANCES)
def test_slopes_are_those_of_the_real_geometry(name):
    torch.manual_seed(0)
    hull = generic_hull()
    hull = hull._replace(point_std_m=0.3 * hull.point_std_m)  # the fit of one less well known ends short of its optimum
    cases = scenario_cases(camera(), hull, [8.0, 20.0], [20.0, 130.0], 5.0)
    ranging = RangingLayer()
    way = torch.randn(amount_shape(name, cases.count), dtype=torch.float64)
    step = 1e-5
    ahead, behind = (slants_m(disturb(cases, name, sign * step * way), ranging) for sign in (1, -1))
    for estimator, slope in slopes(cases, name, ranging).items():
        expected = (ahead[estimator] - behind[estimator]) / (2 * step)
        torch.testing.assert_close((slope * way).reshape(cases.count, -1).sum(1), expected, rtol=1e-5, atol=1e-5)


def test_the_budget_of_the_waterline_adds_up_to_the_error_bar_of_the_geometry():
    at = study(keypoint_std_px=1.3)
    errors = range_cases(at.cases, at.ranging)[WATERLINE]
    relative = (errors.slant_std_m / errors.slant_m).reshape(2, -1).square().mean(1).sqrt()
    told = [cost.first_order for cost in at.budget() if cost.source == ALL and cost.estimator == WATERLINE]
    assert told == pytest.approx(relative.tolist(), rel=1e-9)


def test_the_figures_of_the_textbook_camera():
    """D = h / sin(gamma), so dD / D = cot(gamma) dgamma, and a pixel at the depression gamma is cos(gamma)^2 / f."""
    textbook = make_camera(
        [[700.0, 0, 480.0], [0, 700.0, 300.0], [0, 0, 1]], (960, 600), height_m=1.5, pitch_std_rad=math.radians(0.3)
    )
    settings = SensitivitySettings({}, distances_m=(10.0,), headings_deg=(0.0,), bearing_deg=0.0)
    costs = Study(settings, textbook, generic_hull()).budget()
    told = {cost.source: cost.first_order for cost in costs if cost.estimator == WATERLINE}
    gamma = math.asin(0.15)
    assert told["keypoint_px"] == pytest.approx(math.cos(gamma) ** 2 / math.tan(gamma) / 700, rel=1e-6)  # 0.92 %
    assert told["pitch_deg"] == pytest.approx(math.radians(0.3) / math.tan(gamma), rel=1e-6)
    assert told[ALL] == pytest.approx(0.0357, abs=0.0001)
    assert set(told) == {"keypoint_px", "pitch_deg", ALL}


def test_a_height_that_is_wrong_is_a_range_that_is_wrong_by_the_same_share():
    one_point = [cost for cost in study().curves() if cost.estimator in ("box_bottom", WATERLINE)]
    assert len(one_point) == 4
    for cost in one_point:
        assert cost.exact == pytest.approx(0.03 / 1.5, rel=1e-6)
        assert cost.first_order == pytest.approx(0.03 / 1.5, rel=1e-6)


def test_monte_carlo_agrees_where_errors_are_small_and_tells_where_they_are_not():
    costs = study(draws=100, distances_m=(10.0,)).budget()
    near = {cost.source: cost for cost in costs if cost.distance_m == 10 and cost.estimator == WATERLINE}
    for cost in near.values():
        assert cost.exact == pytest.approx(cost.first_order, rel=0.2)
        assert cost.no_range == 0
    settings = SensitivitySettings({}, distances_m=(60.0,), headings_deg=(0.0,), draws=200)
    unsteady = Study(settings, camera(pitch_std_deg=2.0), generic_hull())
    pitch = next(cost for cost in unsteady.budget() if cost.source == "pitch_deg" and cost.estimator == WATERLINE)
    assert pitch.no_range == pytest.approx(0.24, abs=0.1)  # P(z > 1.43 degrees / 2)
    assert pitch.exact == math.inf  # more than 15.9 % are above the horizon


def test_the_set_of_boats_has_the_errors_it_was_given():
    noise = {"keypoint_std_px": 0.0, "bearing_deg": 0.0}
    settings = SensitivitySettings(
        {"height_m": (0.0, 0.03), "wave_m": (0.03,)}, distances_m=(10.0, 20.0), headings_deg=(0.0,), draws=300, **noise
    )
    perfect = camera()._replace(**{f"{name}": torch.zeros(1) for name in camera()._fields if "_std_" in name})
    table = Study(settings, perfect, generic_hull()).table()
    rows = {(row.source, row.amount): row for row in table if row.estimator == WATERLINE}
    expected_m = 0.02 * math.sqrt((10**2 + 20**2) / 2)
    assert rows["height_m", 0.0].rmse_m == pytest.approx(0, abs=1e-9)
    assert rows["height_m", 0.03].rmse_m == pytest.approx(expected_m, rel=1e-5)
    assert rows["height_m", 0.03].mae_m == pytest.approx(0.3, rel=1e-5)
    assert rows["wave_m", 0.03].rmse_m == pytest.approx(expected_m, rel=0.15)
    assert rows["wave_m", 0.03].first_order_rmse_m == pytest.approx(expected_m, rel=0.15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("disturbances: {pitch_dg: [1]}", "disturbances: unknown key 'pitch_dg'; expected one of focal_px"),
        ("disturbances: {pitch_deg: [1]}\nhight: 3", "unknown key 'hight'"),
        ("camera: a.yaml", "disturbances is missing"),
        ("disturbances: {wave_m: [-1]}", "wave_m: expected standard deviations of at least 0"),
        ("disturbances: {pitch_deg: []}", "pitch_deg: expected at least one number"),
        ("disturbances: {}\ndistances_m: [0, 10]", "distances_m: expected metres above 0, got 0"),
        ("disturbances: {}\ndraws: 1", "draws: expected a number between 10 and"),
    ],
)
def test_wrong_settings_are_named(text, message, tmp_path):
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    with pytest.raises(ValueError, match=message) as error:
        load_sensitivity(path)
    assert str(error.value).startswith(str(path))


def test_every_configuration_can_be_studied(root):
    from usvnet.geometry.camera_files import load_camera
    from usvnet.geometry.hull_files import load_hull

    paths = [path for path in (root / "configs" / "sensitivity").glob("*.yaml") if not path.stem.endswith("camera")]
    assert paths
    for path in paths:
        settings = load_sensitivity(path)
        Study(replace(settings, draws=10), load_camera(settings.camera), load_hull(settings.hull))
