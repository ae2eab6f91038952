import cv2
import numpy as np
import pytest
import torch

from usvnet.geometry.lens_models import MOST_ERROR_PX, plumb_bob

K = torch.tensor([[600.0, 0, 322], [0, 610, 236], [0, 0, 1]], dtype=torch.float64)
SIZE_PX = (640, 480)
RATIONAL = [0.35, -0.02, 0.0007, -0.0004, 0.003, 0.62, 0.05, 0.004]


def test_five_coefficients_stay_as_they_are():
    lens = [-0.28, 0.09, 0.001, -0.0007, 0.005]
    assert plumb_bob(lens, K, SIZE_PX, "lens") == lens
    assert plumb_bob([*lens, 0, 0, 0], K, SIZE_PX, "lens") == lens
    assert plumb_bob(lens[:4], K, SIZE_PX, "lens") == lens[:4]


def test_a_rational_lens_becomes_the_plumb_bob_that_shows_the_same_picture():
    """cv2.projectPoints knows both models."""
    lens = plumb_bob(RATIONAL, K, SIZE_PX, "lens")
    x, y = np.meshgrid(np.linspace(-0.6, 0.6, 41), np.linspace(-0.45, 0.45, 31))
    points = np.stack([x, y, np.ones_like(x)], -1).reshape(-1, 3)
    views = [cv2.projectPoints(points, np.zeros(3), np.zeros(3), K.numpy(), np.array(c))[0] for c in (RATIONAL, lens)]
    rational, bob = (view.reshape(-1, 2) for view in views)
    inside = ((rational >= -0.5) & (rational <= np.array(SIZE_PX) - 0.5)).all(1)
    assert inside.sum() > 500
    assert np.abs(rational - bob)[inside].max() < MOST_ERROR_PX
    plain = np.array([*RATIONAL[:5]])
    wrong = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K.numpy(), plain)[0].reshape(-1, 2)
    assert np.abs(rational - wrong)[inside].max() > 10  # leaving k4, k5 and k6 out is no way


@pytest.mark.parametrize(
    ("lens", "sentence"),
    [
        ([0.1] * 6, r"lens: expected 4 or 5 numbers .* got 6"),
        ([0.1, 0, 0, 0, 0, 0.2, 0, 0, 0.01, 0, 0, 0], r"lens: .* \(thin prism, tilted sensor\), got 0.01, 0, 0, 0"),
        ([0, 0, 0, 0, 0, 3.0, 0, 0], r"lens: .* folds over inside it"),
        ([40.0, 0, 0, 0, 0, 42, 0, 0], r"lens: .* miss this rational one by \d+\.\d px; calibrate again"),
    ],
)
def test_what_no_plumb_bob_resembles_is_refused(lens, sentence):
    with pytest.raises(ValueError, match=sentence):
        plumb_bob(lens, K, SIZE_PX, "lens")


def test_whatever_the_coefficients_five_finite_ones_come_out_or_one_sentence():
    rng = np.random.default_rng(0)
    answered = 0
    for _ in range(300):
        lens = (rng.normal(size=8) * 10.0 ** rng.uniform(-6, 2 if rng.random() < 0.5 else 38, 8)).tolist()
        try:
            found = plumb_bob(lens, K, SIZE_PX, "camera.yaml")
        except ValueError as error:
            found = [0.0] * 5
            answered += str(error).startswith("camera.yaml: expected a lens that ")
        else:
            answered += 1
        assert len(found) == 5
        assert np.isfinite(found).all()
    assert answered == 300
