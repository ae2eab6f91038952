"""The whole chain: differentiable from range to the first convolution, and the same when scripted."""

import pytest
import torch

from usvnet.geometry.camera import make_camera, stack_cameras
from usvnet.model import USVNet
from usvnet.types import Camera


def camera(count: int, size: int) -> Camera:
    K = torch.tensor([[1.4 * size, 0, (size - 1) / 2], [0, 1.4 * size, (size - 1) / 2], [0, 0, 1]])
    return stack_cameras([make_camera(K, (size, size), height_m=1.5, pitch_rad=0.5)] * count)


@pytest.fixture(scope="module")
def model() -> USVNet:
    torch.manual_seed(0)
    return USVNet("n", max_boats=5).eval()


def test_range_alone_reaches_the_first_convolution(model: USVNet) -> None:
    model.zero_grad()
    prediction = model(torch.rand(1, 3, 96, 96), camera(1, 96))
    assert prediction.waterline.valid.any()
    prediction.waterline.slant_m[prediction.waterline.valid].sum().backward()
    gradient = model.network.backbone.stem.conv.weight.grad
    assert gradient is not None
    assert gradient.isfinite().all()
    assert gradient.abs().sum() > 0


@pytest.mark.parametrize(("count", "size"), [(1, 64), (3, 96)])
def test_scripted_equals_eager(model: USVNet, count: int, size: int) -> None:
    image = torch.rand(count, 3, size, size)
    scripted = torch.jit.script(model)
    with torch.no_grad():
        ours, theirs = model(image, camera(count, size)), scripted(image, camera(count, size))
    torch.testing.assert_close(theirs.keypoints_px, ours.keypoints_px, rtol=0, atol=0.01)
    torch.testing.assert_close(theirs.waterline.slant_m, ours.waterline.slant_m, rtol=1e-4, atol=1e-3)
    torch.testing.assert_close(theirs.box_bottom.slant_std_m, ours.box_bottom.slant_std_m, rtol=1e-3, atol=1e-3)


def test_the_camera_moves_the_range_and_not_the_keypoints(model: USVNet) -> None:
    image, low = torch.rand(1, 3, 64, 64), camera(1, 64)
    with torch.no_grad():
        near, far = model(image, low), model(image, low._replace(height_m=2 * low.height_m))
    torch.testing.assert_close(near.keypoints_px, far.keypoints_px)
    valid = near.waterline.valid
    torch.testing.assert_close(2 * near.waterline.slant_m[valid], far.waterline.slant_m[valid])
