"""Eight bits: only the network is rounded, and a file stays only where ranges stay."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from small_sample import write_small_sample
from torch import nn

from usvnet.checkpoints import load_model
from usvnet.commands import export as command
from usvnet.data import BoatDataset, read_dataset
from usvnet.data.pictures import read_picture
from usvnet.deploy import export_int8 as room
from usvnet.deploy import runtimes
from usvnet.deploy.deployed import ANSWERS
from usvnet.deploy.export_int8 import Int8Data, export_int8, spread_out
from usvnet.deploy.exported import ExportedModel, as_prediction
from usvnet.deploy.formats import write_openvino
from usvnet.deploy.gate import Gate, Ranging, keypoint_median_px, measure
from usvnet.deploy.parity import Parity
from usvnet.deploy.predictor import Predictor, default_checkpoint
from usvnet.deploy.quantisation import quantise
from usvnet.deploy.runtimes import open_runtime
from usvnet.evaluation.range_metrics import ranged_boats
from usvnet.evaluation.records import TruthRecord, to_records
from usvnet.model import USVNet

SIZE_PX = 96
OF_CAMERA = ("heading_rad", "misfit")
"""What the little model says without looking at the picture."""


class LittleModel(nn.Module):
    """Sees one boat in every picture, about 8 m away, by two convolutions; built in no time."""

    def __init__(self, *_: object):
        super().__init__()
        torch.manual_seed(0)
        self.model = nn.Module()
        self.model.network = nn.Module()
        self.model.network.largest_stride_px = 32
        self.look = nn.Sequential(nn.Conv2d(3, 8, 3, 2), nn.SiLU(), nn.Conv2d(8, 7, 3))

    def forward(self, image, K, distortion, height_m, pitch_rad, roll_rad, camera_std, hull_points_m, hull_std):
        seen = self.look(image).mean([2, 3])[:, None]  # (B, 1, 7)
        camera = K.sum([1, 2]) + distortion.sum(1) + height_m + pitch_rad + roll_rad + camera_std.sum(1)
        camera = (camera + hull_points_m.sum([1, 2]) + hull_std.sum(1))[:, None]  # all of it, or the file leaves it out
        shapes = {"boxes_px": (4,), "keypoints_px": (7, 2), "keypoint_covariance_px2": (7, 2, 2), "visibility": (7,)}
        named = {}
        for name in ANSWERS:
            shape = (3,) if name.endswith("position_m") else shapes.get(name, ())
            named[name] = torch.ones(1, 1, *shape) * (8 + seen[..., 0]).reshape(-1, 1, *[1] * len(shape))
        named["scores"] = seen[..., 0].sigmoid()
        named["keypoints_px"] = 40 + torch.stack([seen, seen], -1)
        for name in OF_CAMERA:
            named[name] = camera
        for name in ("present", *(name for name in ANSWERS if name.endswith("_valid"))):
            named[name] = named["scores"] > 0.01
        for name in (name for name in ANSWERS if name.endswith("_reason")):
            named[name] = torch.zeros_like(camera, dtype=torch.int64)
        return named


@pytest.fixture(scope="module")
def data(root, tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    write_small_sample(root / "data" / "sample", folder, {"val": 5, "test": 3})
    return folder


@pytest.fixture
def little(monkeypatch):
    """The export of a little model in place of the network."""
    for package in ("onnx", "openvino", "nncf"):
        pytest.importorskip(package, reason="int8 needs pip install usvnet[int8]")
    monkeypatch.setattr(room, "DeployedUSVNet", LittleModel)
    monkeypatch.setattr(room, "check_parity", lambda *_: Parity(0.0, 0.0, 0.0))
    return USVNet("n")


def split(data, name):
    return BoatDataset(read_dataset(data, name), SIZE_PX)


def test_only_the_network_is_rounded(data, little, tmp_path):
    module = LittleModel().eval()
    write_openvino(module, tmp_path / "whole.xml", SIZE_PX)
    quantise(tmp_path / "whole.xml", tmp_path / "int8.xml", spread_out(split(data, "val"), 5))
    whole, rounded = open_runtime(tmp_path / "whole.xml"), open_runtime(tmp_path / "int8.xml")
    seen = []

    def compared(*inputs):
        expected, got = whole(*inputs), rounded(*inputs)
        for name in OF_CAMERA:
            assert torch.equal(got[name], expected[name])
        seen.append(float((got["fused_slant_m"] - expected["fused_slant_m"]).abs()))
        return got

    assert measure(compared, split(data, "test"), 0.01, "comparing").missed == 0
    assert 0 < max(seen) < 0.05
    for file, eaten in ((whole, {"Parameter", "Multiply"}), (rounded, {"FakeQuantize"})):
        convolutions = [node for node in file.model.get_ops() if node.get_type_name() == "Convolution"]
        assert {node.input_value(0).get_node().get_type_name() for node in convolutions} == eaten
        assert len(convolutions) == 2


def test_a_file_that_ranges_as_well_stays_and_predicts(data, little, tmp_path):
    path = tmp_path / "model.xml"
    gate = export_int8(little, path, Int8Data(data, tolerance_m=0.05), 0.01, SIZE_PX)
    assert {file.name for file in tmp_path.iterdir()} == {"model.xml", "model.bin", "model.xml.json"}
    about = json.loads((tmp_path / "model.xml.json").read_text())["int8"]
    assert about["calibration"] == {"split": "val", "pictures": 5}
    assert about["measured"]["split"] == "test"
    assert about["measured"]["tolerance_m"] == 0.05
    assert about["measured"]["int8"]["fused_mae_m"] == gate.int8.fused_mae_m != gate.float32.fused_mae_m
    assert about["measured"]["float32"]["boats"] == gate.float32.boats == 3
    frame = read_dataset(data, "test")[0]
    boats = Predictor(ExportedModel(path), frame.camera, confidence=0.01)(read_picture(frame.image_path))
    assert boats[0].ranges["fused"].slant_m == pytest.approx(8, abs=2)


@pytest.mark.parametrize(("worse_m", "more_missed"), [(0.05, 0), (-1.0, 1), (math.nan, 0)])
def test_a_file_that_ranges_worse_leaves_nothing(data, little, tmp_path, monkeypatch, worse_m, more_missed):
    def measured(answer, dataset, score_threshold, title):
        found = measure(answer, dataset, score_threshold, title)
        if title != "measuring int8":
            return found
        return found._replace(fused_mae_m=found.fused_mae_m + worse_m, missed=found.missed + more_missed)

    monkeypatch.setattr(room, "measure", measured)
    with pytest.raises(
        ValueError, match=r"in int8, fused ranges are .* m wrong in the mean, .*; allowed are 0.02 m more"
    ):
        export_int8(little, tmp_path / "model.xml", Int8Data(data), 0.01, SIZE_PX)
    assert list(tmp_path.iterdir()) == []


def ranging(mae_m, missed=1):
    return Ranging(73, missed, mae_m, 2 * mae_m, 1.5 * mae_m, 3.0)


def test_the_gate_allows_what_it_says():
    Gate(ranging(0.12), ranging(0.139), 0.02).check()
    Gate(ranging(0.12), ranging(0.1, missed=0), 0.0).check()
    with pytest.raises(
        ValueError, match=r"0\.150 m wrong in the mean, in float32 0\.120 m, and 1 of 73 boats are missed"
    ):
        Gate(ranging(0.12), ranging(0.15), 0.02).check()
    with pytest.raises(ValueError, match=r"2 of 73 boats are missed, in float32 1; .* no further boat missed"):
        Gate(ranging(0.12), ranging(0.12, missed=2), 0.02).check()
    assert json.dumps(Gate(ranging(math.nan), ranging(0.1), 0.02).to_json(), allow_nan=False)


def test_boats_are_measured_and_missed(data):
    module = LittleModel().eval()
    dataset = split(data, "test")
    found = measure(module, dataset, 0.01, "")
    ranges_m = np.concatenate([frame.range_m for frame in dataset.frames])
    assert (found.boats, found.missed) == (3, 0)
    assert found.fused_mae_m == pytest.approx(np.abs(ranges_m - 8).mean(), abs=1)
    assert found.waterline_mae_m == found.fused_mae_m
    missed = measure(module, dataset, 0.999, "")
    assert (missed.boats, missed.missed) == (3, 3)
    assert math.isnan(missed.fused_mae_m)
    assert math.isnan(missed.keypoint_median_px)


def test_keypoints_are_compared_where_they_are_labelled(data):
    inputs = [torch.zeros(1, 3, 32, 32), torch.eye(3)[None], torch.zeros(1, 5), *torch.zeros(3, 1)]
    named = LittleModel()(*inputs, torch.zeros(1, 5), torch.zeros(1, 7, 3), torch.zeros(1, 2))
    [boats] = to_records(as_prediction(named, 0.01))
    keypoints_px = boats[0].keypoints_px + np.array([3.0, 4.0])
    keypoints_px[6] += 1000
    truth = TruthRecord(boats[0].box_px, keypoints_px, np.array([2, 2, 1, 2, 1, 2, 0]), range_m=8.0)
    assert keypoint_median_px(ranged_boats([boats], [[truth]])) == pytest.approx(5)


def test_samples_are_spread_evenly(data):
    assert spread_out(split(data, "val"), 3).indices == [0, 2, 4]
    assert spread_out(split(data, "test"), 100).indices == [0, 1, 2]


def test_what_cannot_be_is_refused_before_anything_is_written(data, root, tmp_path, monkeypatch):
    model, out = SimpleNamespace(refiner=None), tmp_path / "out" / "model.xml"
    with pytest.raises(ValueError, match=r"model\.xml: a model with refine: native .* expected \.ts, \.pt"):
        export_int8(SimpleNamespace(refiner=nn.Identity()), out, Int8Data(data))
    with pytest.raises(ValueError, match=r"model\.onnx: got the suffix '\.onnx', expected \.xml: int8 is for OpenVINO"):
        export_int8(model, out.with_suffix(".onnx"), Int8Data(data))
    for tolerance_m in (-0.1, math.nan, math.inf):
        with pytest.raises(ValueError, match=r"int8_tolerance_m: got .*, expected metres from 0"):
            export_int8(model, out, Int8Data(data, tolerance_m=tolerance_m))
    with pytest.raises(ValueError, match="int8_gate_split: got val, which 8 bits are fitted to"):
        export_int8(model, out, Int8Data(data, gate_split="val"))
    (tmp_path / "data").mkdir()
    write_small_sample(root / "data" / "sample", tmp_path / "data", {"val": 1, "test": 1})
    (tmp_path / "data" / "ranges.csv").unlink()
    monkeypatch.setattr(room, "quantiser", lambda: torch)
    monkeypatch.setattr(room, "needed", lambda *_: torch)
    with pytest.raises(ValueError, match=r"no boat of test has a range in ranges\.csv to judge int8 by"):
        export_int8(model, out, Int8Data(tmp_path / "data"))
    with pytest.raises(ValueError, match="no split 'dev', expected one of train, val, test"):
        export_int8(model, out, Int8Data(data, calibration_split="dev"))
    assert not out.parent.exists()


def test_a_missing_library_is_named(data, tmp_path, monkeypatch):
    def nothing_is_installed(name):
        raise ImportError(name)

    monkeypatch.setattr(runtimes.importlib, "import_module", nothing_is_installed)
    with pytest.raises(ValueError, match=r"nncf is not installed: needs pip install usvnet\[int8\]"):
        export_int8(SimpleNamespace(refiner=None), tmp_path / "model.xml", Int8Data(data))


def test_the_command_says_what_was_measured(untrained, tmp_path, monkeypatch, capsys):
    asked = []

    def export(model, path, data, score_threshold, image_size):
        asked.append((data, model.max_boats))
        return Gate(ranging(0.12), ranging(0.13), data.tolerance_m)

    monkeypatch.setattr(command, "export_int8", export)
    options = {"int8_calibration_split": "train", "int8_gate_split": "val", "int8_tolerance_m": 0.5}
    command.export(checkpoint=untrained, output=tmp_path / "m.xml", max_boats=6, int8_data=tmp_path, **options)
    assert asked == [(Int8Data(tmp_path, "train", "val", 0.5), 6)]
    assert "on val, fused ranges are 0.130 m wrong in the mean, in float32 0.120 m" in capsys.readouterr().out


@pytest.mark.slow
def test_the_whole_network_in_int8(root, tmp_path):
    for package in ("onnx", "openvino", "nncf"):
        pytest.importorskip(package, reason="int8 needs pip install usvnet[int8]")
    path, data = tmp_path / "model.xml", root / "data" / "sample"
    gate = export_int8(load_model(default_checkpoint()), path, Int8Data(data, tolerance_m=1.0), image_size=320)
    assert gate.int8.boats == 24
    frame = read_dataset(data, "test")[0]
    boats = Predictor(ExportedModel(path), frame.camera, image_size=320)(read_picture(frame.image_path))
    assert boats[0].ranges["fused"].slant_m == pytest.approx(float(frame.range_m[0]), rel=0.1)
