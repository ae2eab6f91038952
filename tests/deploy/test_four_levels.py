"""A network whose pictures are multiples of 64 leaves the house like the others."""

import pytest
import torch

from usvnet.deploy.deployed import DeployedUSVNet, fill_up
from usvnet.deploy.export import export_model
from usvnet.deploy.probes import probe_camera
from usvnet.model import USVNet


@pytest.fixture(scope="module")
def model():
    torch.manual_seed(0)
    return USVNet("v8n-p6", max_boats=4).eval()


def test_the_export_agrees_with_the_model(model, tmp_path):
    parity = export_model(model, tmp_path / "model.ts")
    assert parity.px <= 0.01


@pytest.mark.parametrize("size_px", [(64, 96), (96, 64), (100, 130)])
def test_pictures_are_filled_up_to_multiples_of_64(model, size_px):
    image = torch.rand(1, 3, *size_px, generator=torch.Generator().manual_seed(0))
    camera = probe_camera(1, *size_px)
    mount = (camera.K, camera.distortion, camera.height_m, camera.pitch_rad, camera.roll_rad)
    filled = fill_up(image, 64)
    assert all(side % 64 == 0 for side in filled.shape[2:])
    with torch.inference_mode():
        found, expected = DeployedUSVNet(model)(image, *mount), model(filled, camera)
    torch.testing.assert_close(found["boxes_px"], expected.boxes_px, atol=0.01, rtol=0)
