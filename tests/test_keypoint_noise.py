"""Doubt added to keypoints: in the boat's own size, whatever the pixels, and only to covariances."""

import pytest
import torch

from usvnet.deploy.probes import probe_camera
from usvnet.keypoint_noise import KeypointNoise
from usvnet.model import USVNet
from usvnet.types import Hull

COVARIANCE_PX2 = torch.tensor([[4.0, 1.0], [1.0, 9.0]]).expand(1, 2, 7, 2, 2)
BOXES_PX = torch.tensor([[[10.0, 20.0, 110.0, 45.0], [0.0, 0.0, 40.0, 10.0]]])


@pytest.fixture
def noise() -> KeypointNoise:
    noise = KeypointNoise()
    noise.set_share(0.1)
    return noise


def test_a_boat_of_100_by_25_px_gets_a_tenth_of_50_px(noise):
    added = noise(COVARIANCE_PX2, BOXES_PX) - COVARIANCE_PX2
    expected = torch.tensor([25.0, 4.0])[:, None, None, None] * torch.eye(2)
    torch.testing.assert_close(added[0], expected.expand(2, 7, 2, 2))


def test_it_does_not_depend_on_the_size_of_the_picture(noise):
    small, large = noise(COVARIANCE_PX2, BOXES_PX), noise(9 * COVARIANCE_PX2, 3 * BOXES_PX)
    torch.testing.assert_close(large, 9 * small)


def test_without_a_share_or_a_box_the_heatmaps_are_believed(noise):
    assert torch.equal(KeypointNoise()(COVARIANCE_PX2, BOXES_PX), COVARIANCE_PX2)
    assert torch.equal(noise(COVARIANCE_PX2, BOXES_PX.flip(-1)), COVARIANCE_PX2)  # a box turned inside out


def test_scripted_equals_eager_and_it_is_no_weight(noise):
    scripted = torch.jit.script(noise)
    assert torch.equal(scripted(COVARIANCE_PX2, BOXES_PX), noise(COVARIANCE_PX2, BOXES_PX))
    assert noise.state_dict() == {}
    assert not list(noise.parameters())


def test_gradients_are_right(noise):
    covariance_px2 = COVARIANCE_PX2.double().contiguous().requires_grad_()
    assert torch.autograd.gradcheck(noise, (covariance_px2, BOXES_PX.double().requires_grad_()))


def test_a_hull_is_no_better_known_in_size_than_the_network_draws_it(noise):
    hull = Hull(torch.rand(2, 7, 3), scale_std=torch.tensor([0.0, 0.04]), point_std_m=torch.tensor([0.01, 0.02]))
    noise.set_size_std(0.03)
    resized = torch.jit.script(noise).resized(hull)
    torch.testing.assert_close(resized.scale_std, torch.tensor([0.03, 0.05]))
    assert torch.equal(resized.points_m, hull.points_m)
    assert torch.equal(resized.point_std_m, hull.point_std_m)
    with pytest.raises(ValueError, match=r"drawn size: expected a standard deviation in \[0, 1\], got -0.1"):
        noise.set_size_std(-0.1)


@pytest.mark.parametrize("share", [-0.01, 1.01, float("nan"), None])
def test_wrong_shares_are_refused(noise, share):
    with pytest.raises(ValueError, match=r"expected a share of the boat's size in \[0, 1\]"):
        noise.set_share(share)


def test_the_model_ranges_with_it():
    torch.manual_seed(0)
    model = USVNet("n").eval()
    image, camera = torch.rand(1, 3, 96, 128), probe_camera(1, 96, 128)
    with torch.inference_mode():
        before = model(image, camera)
        model.noise.set_share(0.5)
        after = model(image, camera)
    assert torch.equal(after.keypoints_px, before.keypoints_px)
    expected = model.noise(before.keypoint_covariance_px2, before.boxes_px)
    torch.testing.assert_close(after.keypoint_covariance_px2, expected)
    both = before.waterline.valid & after.waterline.valid
    assert both.any()
    assert torch.equal(after.waterline.slant_m[both], before.waterline.slant_m[both])
    assert (after.waterline.slant_std_m > before.waterline.slant_std_m)[both].all()
