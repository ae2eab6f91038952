"""Files of other runtimes: loops and sizes are the module's, not those of the picture that they were made with."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from usvnet.checkpoints import load_model
from usvnet.deploy import runtimes
from usvnet.deploy.deployed import ANSWERS, DeployedUSVNet
from usvnet.deploy.export import export_model
from usvnet.deploy.exported import ExportedModel
from usvnet.deploy.formats import OPSET, example_inputs, format_of
from usvnet.deploy.predictor import Predictor
from usvnet.deploy.runtimes import open_runtime
from usvnet.deploy.sidecar import sidecar_path
from usvnet.geometry.camera import make_camera
from usvnet.heatmap import decode
from usvnet.network.nms import suppress

SHIPPED = Path(__file__).parents[2] / "checkpoints" / "usvnet-n.pt"


class Suppression(nn.Module):
    def forward(self, boxes_px):
        return suppress(boxes_px, 0.5)


class Reading(nn.Module):
    def forward(self, logits, coarse_px):
        return decode(logits, coarse_px)


def chain_of_boxes(lengths):
    """Pictures with rows of 12 boxes, of which so many overlap their neighbours: each falls if the one before stays."""
    boxes = torch.zeros(len(lengths), 12, 4)
    for row, length in zip(boxes, lengths):
        left = torch.arange(12.0) * 30
        left[:length] = torch.arange(length) * 3.0
        row[:, 0], row[:, 2], row[:, 3] = left, left + 10, 10
    return boxes


def onnx_session(module, example, path, names, axes):
    pytest.importorskip("onnx", reason="ONNX files need pip install usvnet[export]")
    onnxruntime = pytest.importorskip("onnxruntime", reason="ONNX files need pip install usvnet[export]")
    torch.onnx.export(
        module, example, str(path), dynamo=False, opset_version=OPSET, input_names=names, dynamic_axes=axes
    )
    return onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])


@pytest.mark.filterwarnings("ignore")
def test_suppression_in_onnx_goes_as_many_rounds_as_a_picture_needs(tmp_path):
    one_round = chain_of_boxes([1])
    session = onnx_session(Suppression(), (one_round,), tmp_path / "m.onnx", ["boxes"], {"boxes": {0: "batch"}})
    boxes = chain_of_boxes([12, 5, 1])
    (kept,) = session.run(None, {"boxes": boxes.numpy()})
    np.testing.assert_array_equal(kept, suppress(boxes, 0.5).numpy())
    assert kept.sum(1).tolist() == [6, 10, 12]


def test_suppression_in_torch_export_goes_as_many_rounds_as_a_picture_needs():
    example = chain_of_boxes([1, 1])
    batch = torch.export.Dim("batch", min=1, max=8)
    program = torch.export.export(Suppression(), (example,), dynamic_shapes=({0: batch},), strict=False)
    boxes = chain_of_boxes([12, 5, 1])
    assert torch.equal(program.module()(boxes), suppress(boxes, 0.5))


@pytest.mark.filterwarnings("ignore")
def test_heatmaps_in_onnx_may_have_any_size(tmp_path):
    axes = {"logits": {0: "batch", 2: "height", 3: "width"}, "coarse": {0: "batch", 1: "boats"}}
    example = (torch.rand(1, 7, 16, 20), torch.full((1, 2, 7, 2), 30.0))
    session = onnx_session(Reading(), example, tmp_path / "m.onnx", ["logits", "coarse"], axes)
    generator = torch.Generator().manual_seed(0)
    logits = 5 * torch.rand(2, 7, 30, 40, generator=generator)
    coarse = torch.rand(2, 3, 7, 2, generator=generator) * torch.tensor([160.0, 120.0])
    found = session.run(None, {"logits": logits.numpy(), "coarse": coarse.numpy()})
    for got, expected in zip(found, decode(logits, coarse)):
        np.testing.assert_allclose(got, expected.numpy(), atol=1e-3, rtol=1e-4)
    inside = coarse[..., 0] > 80  # beyond the map of the example
    assert bool((decode(logits, coarse)[0][..., 0] > 80)[inside].any())


def test_example_inputs_are_what_the_module_takes():
    inputs = example_inputs(32)
    assert inputs[0].shape == (2, 3, 128, 160)
    assert [value.shape[0] for value in inputs] == [2] * 9


def test_what_cannot_be_opened_is_refused(tmp_path, monkeypatch):
    with pytest.raises(FileNotFoundError, match=r"no\.onnx: no such exported file"):
        open_runtime(tmp_path / "no.onnx")
    for suffix in (".ts", ".pt2", ".onnx", ".xml", ".tflite"):
        (tmp_path / f"m{suffix}").write_bytes(b"nonsense")
    with pytest.raises(ValueError, match=r"m\.tflite: got the suffix '\.tflite', expected one of \.ts"):
        open_runtime(tmp_path / "m.tflite")
    for suffix in (".ts", ".pt2"):
        with pytest.raises(ValueError, match=rf"m\{suffix}: cannot be read as an exported model"):
            open_runtime(tmp_path / f"m{suffix}")
    with pytest.raises(ValueError, match=r"computed on the processor, got the device cuda"):
        open_runtime(tmp_path / "m.onnx", "cuda")
    monkeypatch.setattr(runtimes.importlib, "import_module", _nothing_is_installed)
    for suffix, package in ((".onnx", "onnxruntime"), (".xml", "openvino")):
        with pytest.raises(ValueError, match=rf"{package} is not installed: needs pip install usvnet\[export\]"):
            open_runtime(tmp_path / f"m{suffix}")


def _nothing_is_installed(name):
    raise ImportError(name)


class Sums(nn.Module):
    """Takes and answers what a deployed model does, in a hundredth of the time that it takes to write one."""

    def __init__(self):
        super().__init__()
        self.model = nn.Module()
        self.model.network = nn.Module()
        self.model.network.largest_stride_px = 32
        self.names: list[str] = list(ANSWERS)

    def forward(
        self,
        image: torch.Tensor,
        K: torch.Tensor,
        distortion: torch.Tensor,
        height_m: torch.Tensor,
        pitch_rad: torch.Tensor,
        roll_rad: torch.Tensor,
        camera_std: torch.Tensor,
        hull_points_m: torch.Tensor,
        hull_std: torch.Tensor,
    ) -> dict[str, torch.Tensor]:
        total = image.sum([1, 2, 3]) + K.sum([1, 2]) + distortion.sum(1) + height_m + 2 * pitch_rad + 3 * roll_rad
        total = total + camera_std.sum(1) + hull_points_m.sum([1, 2]) + hull_std.sum(1)
        named: dict[str, torch.Tensor] = {}
        for number, name in enumerate(self.names):
            named[name] = total * number
        return named


@pytest.mark.parametrize(
    ("suffix", "packages"),
    [(".ts", []), (".pt2", []), (".onnx", ["onnx", "onnxruntime"]), (".xml", ["onnx", "openvino"])],
)
def test_every_format_takes_and_answers_by_name_at_any_batch_and_size(tmp_path, suffix, packages):
    for package in packages:
        pytest.importorskip(package, reason="needs pip install usvnet[export]")
    module = Sums().eval()
    path = tmp_path / f"model{suffix}"
    format_of(path).write(module, path, 96)
    assert {file.suffix for file in tmp_path.iterdir()} == {suffix, *format_of(path).companions}
    runtime = open_runtime(path)
    image, *rest = example_inputs(32)
    for picture in (image, image[..., :96].repeat(1, 1, 2, 1)):
        for batch in (1, 2):
            inputs = [value[:batch] for value in (picture, *rest)]
            got, expected = runtime(*inputs), module(*inputs)
            assert list(got) == list(expected)
            for name, value in expected.items():
                torch.testing.assert_close(got[name], value, rtol=1e-5, atol=0.1)


def test_the_network_that_comes_along_passes_parity(tmp_path):
    """Trained networks see boats anywhere in a random picture, on the horizon too, where a rounding error is metres."""
    for package in ("onnx", "onnxruntime"):
        pytest.importorskip(package, reason="needs pip install usvnet[export]")
    path = tmp_path / "model.onnx"
    assert export_model(load_model(SHIPPED), path, image_size=640).px < 0.01
    assert path.is_file()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("suffix", "packages"), [(".onnx", ["onnx", "onnxruntime"]), (".xml", ["onnx", "openvino"]), (".pt2", [])]
)
def test_the_whole_method_in_every_format(tmp_path, suffix, packages):
    """Exports pass parity at two sizes and two batches before they get their name; then they stand behind a camera.

    Of a trained network: the scores of an untrained one differ by less than rounding, and so do its choices.
    """
    for package in packages:
        pytest.importorskip(package, reason="needs pip install usvnet[export]")
    path = tmp_path / f"model{suffix}"
    parity = export_model(load_model(SHIPPED), path, score_threshold=0.0, image_size=96)
    assert parity.px < 0.01
    assert parity.m_at_10_m < 0.001
    about = json.loads(sidecar_path(path).read_text())
    assert about["format"] == format_of(path).title
    camera = make_camera([[210.0, 0, 99.5], [0, 205.0, 59.5], [0, 0, 1]], (200, 120), height_m=2.0, pitch_rad=0.12)
    picture = np.random.default_rng(0).integers(0, 255, (120, 200, 3), np.uint8)
    boats = Predictor(ExportedModel(path), camera, image_size=192, confidence=1e-6)(picture)
    assert boats
    assert set(open_runtime(path)(*example_inputs(32))) == set(ANSWERS)
    assert DeployedUSVNet(load_model(SHIPPED)).model.max_boats >= len(boats)
