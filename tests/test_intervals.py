"""The factors reach every standard deviation that a model gives, scripted or not, and nothing else."""

import pytest
import torch

from usvnet.deploy.probes import probe_camera
from usvnet.intervals import ESTIMATORS, UNCALIBRATED, IntervalFactors, IntervalScale
from usvnet.model import USVNet
from usvnet.types import RangeEstimate

FACTORS = {name: IntervalFactors(1.0 + n, 1.5 + n, 40) for n, name in enumerate(ESTIMATORS)}


def test_each_estimator_of_the_model_gets_its_own_factor():
    torch.manual_seed(0)
    model = USVNet("n").eval()
    image, camera = torch.rand(2, 3, 96, 128), probe_camera(2, 96, 128)
    with torch.inference_mode():
        raw = model(image, camera)
        model.intervals.set_factors(FACTORS)
        calibrated = model(image, camera)
        for name in ESTIMATORS:
            before, after = getattr(raw, name), getattr(calibrated, name)
            finite = before.slant_std_m.isfinite()
            assert finite.any(), name
            ratio = after.slant_std_m[finite] / before.slant_std_m[finite]
            torch.testing.assert_close(ratio, torch.full_like(ratio, FACTORS[name].factor_90))
            for field in ("slant_m", "horizontal_m", "bearing_rad", "position_m", "valid"):
                torch.testing.assert_close(getattr(after, field), getattr(before, field), rtol=0, atol=0)


def test_scripted_equals_eager_and_no_factor_is_a_weight():
    scale = IntervalScale()
    scale.set_factors(FACTORS)
    assert scale.state_dict() == {}
    assert not list(scale.parameters())
    scripted = torch.jit.script(scale)
    estimate = RangeEstimate(*[torch.rand(2, 3) for _ in RangeEstimate._fields])
    for n in range(len(ESTIMATORS)):
        assert torch.equal(scripted(estimate, n).slant_std_m, scale(estimate, n).slant_std_m)


def test_factors_come_back_and_are_checked():
    scale = IntervalScale()
    assert set(scale.factors().values()) == {UNCALIBRATED}
    scale.set_factors(FACTORS)
    assert scale.factors() == FACTORS
    scale.set_factors({})
    assert set(scale.factors().values()) == {UNCALIBRATED}
    with pytest.raises(ValueError, match="unknown estimator 'radar'"):
        scale.set_factors({"radar": UNCALIBRATED})
