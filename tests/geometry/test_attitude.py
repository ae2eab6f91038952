import math

import pytest
import torch
from torch.autograd import gradcheck

from usvnet.geometry.attitude import Attitude, camera_attitude, combine
from usvnet.geometry.camera import with_attitude

INF = float("inf")


def source(pitch: float, roll: float, pitch_std: float, roll_std: float) -> Attitude:
    return Attitude(*(torch.tensor([value], dtype=torch.float64) for value in (pitch, roll, pitch_std, roll_std)))


def numbers(attitude: Attitude) -> list[float]:
    return [field.item() for field in attitude]


def test_two_sources_are_weighted_by_their_inverse_variance():
    both = combine([source(0.10, 0.02, 0.003, 0.004), source(0.11, 0.01, 0.004, 0.003)])
    assert both.consistent.all()
    expected = [
        (0.10 / 9 + 0.11 / 16) / (1 / 9 + 1 / 16),
        (0.02 / 16 + 0.01 / 9) / (1 / 9 + 1 / 16),
        0.003 * 0.004 / 0.005,
        0.003 * 0.004 / 0.005,
    ]
    assert numbers(both.attitude) == pytest.approx(expected)


def test_the_combined_sigma_is_what_the_combined_error_scatters_by():
    torch.manual_seed(0)
    stds = torch.tensor([0.3, 0.1, 0.2], dtype=torch.float64)
    errors = torch.randn(3, 20000, dtype=torch.float64) * stds[:, None]
    like = torch.ones(20000, dtype=torch.float64)
    both = combine([Attitude(e, e, s * like, s * like) for e, s in zip(errors, stds)], gate=20.0)
    assert both.consistent.all()
    assert both.attitude.pitch_rad.std().item() == pytest.approx(both.attitude.pitch_std_rad[0].item(), rel=0.02)


def test_a_source_that_says_nothing_changes_nothing():
    known, silent = source(0.1, 0.02, 0.003, 0.004), source(0.0, 0.0, INF, INF)
    assert numbers(combine([known, silent]).attitude) == pytest.approx(numbers(known))
    nothing = combine([silent, silent])
    assert nothing.consistent.all()
    assert numbers(nothing.attitude) == [0.0, 0.0, INF, INF]


@pytest.mark.parametrize("which", [0, 1])
def test_sources_that_contradict_each_other_leave_the_widest(which):
    narrow, wide, silent = source(0.1, 0.0, 0.001, 0.001), source(0.12, 0.0, 0.004, 0.004), source(0, 0, INF, INF)
    if which:  # in roll alone
        narrow, wide = (a._replace(pitch_rad=a.roll_rad, roll_rad=a.pitch_rad) for a in (narrow, wide))
    both = combine([narrow, wide, silent])
    assert not both.consistent.any()
    assert numbers(both.attitude) == numbers(wide)
    assert combine([narrow, wide], gate=5.0).consistent.all()  # 0.02 over hypot(0.001, 0.004) is 4.85


def test_each_picture_is_judged_on_its_own():
    a = Attitude(*(torch.tensor(v) for v in ([0.1, 0.1], [0.0, 0.0], [0.001, 0.001], [0.001, 0.001])))
    b = a._replace(pitch_rad=torch.tensor([0.1, 0.2]))
    assert combine([a, b]).consistent.tolist() == [True, False]


def test_a_sigma_of_zero_is_certain_and_not_nan():
    both = combine([source(0.1, 0.02, 0.0, 0.0), source(0.1, 0.02, 0.01, 0.01)])
    assert numbers(both.attitude) == pytest.approx([0.1, 0.02, 0.0, 0.0], abs=1e-8)


def test_gradients_are_right_and_finite():
    values = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in ([0.1, 0.1], [0.1001, 0.3])]
    stds = [torch.tensor(v, dtype=torch.float64, requires_grad=True) for v in ([0.01, 0.02], [0.02, 0.03])]

    def joined(a, b, sa, sb):
        return combine([Attitude(a, a, sa, sa), Attitude(b, b, sb, sb)]).attitude

    assert gradcheck(joined, (*values, *stds))
    silent = torch.tensor([INF, INF], dtype=torch.float64, requires_grad=True)
    sum(field.sum() for field in joined(values[0], values[1], stds[0], silent)).backward()
    assert all(bool(torch.isfinite(t.grad).all()) for t in (*values, stds[0], silent))


def test_it_scripts(camera):
    sources = [camera_attitude(camera), camera_attitude(camera)._replace(pitch_rad=camera.pitch_rad + 0.001)]
    scripted, eager = torch.jit.script(combine)(sources), combine(sources)
    for a, b in zip(scripted.attitude, eager.attitude):
        torch.testing.assert_close(a, b)


def test_a_camera_takes_the_result(camera):
    imu = Attitude(*(torch.full_like(camera.pitch_rad, math.radians(v)) for v in (6.2, 3.1, 0.1, 0.1)))
    better = with_attitude(camera, *combine([camera_attitude(camera), imu]).attitude)
    assert math.radians(6.0) < better.pitch_rad.item() < math.radians(6.2)
    assert better.pitch_std_rad.item() < math.radians(0.1)
