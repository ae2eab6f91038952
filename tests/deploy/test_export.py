import copy
import json

import pytest
import torch
from torch import nn
from torch.nn import functional

from usvnet.commands.export import export as command
from usvnet.deploy import export
from usvnet.deploy.deployed import INPUTS, NATIVE_INPUTS, OUTPUTS, DeployedUSVNet, camera_std
from usvnet.deploy.exported import ExportedModel
from usvnet.deploy.parity import check_parity, compare_chains
from usvnet.deploy.predictor import Predictor
from usvnet.deploy.probes import probe_camera
from usvnet.deploy.sidecar import read_sidecar, sidecar_path
from usvnet.intervals import ESTIMATORS, UNCALIBRATED, IntervalFactors
from usvnet.model import USVNet


@pytest.fixture(scope="module")
def model():
    """A network whose normalisation has seen a picture, so that its answers depend on what they are asked."""
    torch.manual_seed(0)
    model = USVNet("n", max_boats=6).train()
    for module in model.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.momentum = 0.9  # 1.0 makes an untrained network so lively that it multiplies rounding errors
    with torch.no_grad():
        model.network(inputs(2, 128, 160)[0])
        for level in model.network.pose_head.levels:
            level.score[-1].weight.mul_(20)  # scores far apart: the order of the boats is no accident
            level.score[-1].bias.fill_(-1.0)
        model.network.heatmap_head.heatmap[-1].weight.mul_(50)
    return model.eval()


@pytest.fixture(scope="module")
def exported(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("export") / "model.ts"
    return path, export.export_model(model, path, score_threshold=0.6, image_size=320)


def inputs(batch, height, width):
    camera = probe_camera(batch, height, width)
    blobs = torch.rand((batch, 3, 8, 10), generator=torch.Generator().manual_seed(1))
    image = functional.interpolate(blobs, (height, width), mode="bicubic").clamp(0, 1)
    return image, camera, camera_std(camera)


def answer(module, batch, height, width, with_std=True):
    image, camera, std = inputs(batch, height, width)
    mount = (camera.K, camera.distortion, camera.height_m, camera.pitch_rad, camera.roll_rad)
    with torch.inference_mode():
        return module(image, *mount, std) if with_std else module(image, *mount)


def test_the_file_says_what_the_model_says(model, exported):
    path, found = exported
    assert found.px <= 0.01
    assert found.m_at_10_m <= 0.001
    got = answer(torch.jit.load(path), 2, 128, 160)
    image, camera, _ = inputs(2, 128, 160)
    with torch.inference_mode():
        expected = model(image, camera)
    assert expected.present.any(1).all()
    torch.testing.assert_close(got["scores"], expected.scores, atol=1e-5, rtol=0)
    torch.testing.assert_close(got["boxes_px"], expected.boxes_px, atol=0.01, rtol=0)
    torch.testing.assert_close(got["keypoints_px"], expected.keypoints_px, atol=0.01, rtol=0)
    for name in ("box_bottom", "waterline"):
        estimate = getattr(expected, name)
        near = estimate.slant_m < 10
        assert near.sum() >= 2
        torch.testing.assert_close(got[f"{name}_slant_m"][near], estimate.slant_m[near], atol=0.001, rtol=0)
        assert torch.equal(got[f"{name}_valid"], estimate.valid)
    assert torch.equal(got["present"], expected.scores >= 0.6)
    assert got["present"].any()
    assert not got["present"].all()


def test_the_file_applies_the_interval_factors_of_the_model(model, tmp_path):
    calibrated = copy.deepcopy(model)
    factors = {"box_bottom": IntervalFactors(1.5, 2.5, 60), "waterline": IntervalFactors(0.5, 0.7, 60)}
    calibrated.intervals.set_factors(factors)
    export.export_model(calibrated, tmp_path / "model.ts")
    got = answer(torch.jit.load(tmp_path / "model.ts"), 2, 128, 160)
    image, camera, _ = inputs(2, 128, 160)
    with torch.inference_mode():
        raw, expected = model(image, camera), calibrated(image, camera)
    for name in ESTIMATORS:
        before, after = getattr(raw, name).slant_std_m, getattr(expected, name).slant_std_m
        near = getattr(expected, name).slant_m < 10
        assert near.any()
        torch.testing.assert_close(got[f"{name}_slant_std_m"][near], after[near], atol=1e-3, rtol=1e-3)
        torch.testing.assert_close(after[near], before[near] * factors.get(name, UNCALIBRATED).factor_90)
    sidecar = json.loads((tmp_path / "model.ts.json").read_text())
    assert sidecar["model"]["interval_factors"]["box_bottom"] == {"factor_68": 1.5, "factor_90": 2.5, "boats": 60}


def test_a_picture_of_any_size_is_taken_and_its_camera_stays(exported):
    reloaded = torch.jit.load(exported[0])
    image, camera, std = inputs(1, 128, 160)
    image[..., 100:, :] = 114 / 255
    image[..., 150:] = 114 / 255
    mount = (camera.K, camera.distortion, camera.height_m, camera.pitch_rad, camera.roll_rad, std)
    whole, cut = reloaded(image, *mount), reloaded(image[..., :100, :150], *mount)
    for name in OUTPUTS:
        torch.testing.assert_close(cut[name], whole[name])


def test_camera_sigmas_widen_the_ranges_only(exported):
    reloaded = torch.jit.load(exported[0])
    sure, unsure = answer(reloaded, 1, 128, 160, with_std=False), answer(reloaded, 1, 128, 160)
    valid = sure["waterline_valid"]
    assert valid.any()
    assert (unsure["waterline_slant_std_m"] > sure["waterline_slant_std_m"])[valid].all()
    torch.testing.assert_close(unsure["waterline_slant_m"], sure["waterline_slant_m"])


def test_the_sidecar_explains_every_input_and_output(model, exported):
    path, _ = exported
    sidecar = json.loads(sidecar_path(path).read_text())
    reloaded = torch.jit.load(path)
    assert sidecar["outputs"].keys() == answer(reloaded, 1, 64, 64).keys()
    names = [argument.name for argument in reloaded.forward.schema.arguments][1:]
    assert list(sidecar["inputs"]) == list(INPUTS)
    assert names == [*INPUTS, *NATIVE_INPUTS]
    assert sidecar["model"]["trained_image_size_px"] == 320
    assert sidecar["model"]["score_threshold"] == 0.6
    assert len(sidecar["keypoint_names"]) == 7
    assert len(sidecar["sha256"]["weights"]) == len(sidecar["sha256"]["ts"]) == 64


def test_a_file_that_differs_is_removed(model, tmp_path, monkeypatch):
    def differ(*modules):
        raise ValueError("differs")

    monkeypatch.setattr(export, "check_parity", differ)
    monkeypatch.setattr(export, "DeployedUSVNet", lambda model, score_threshold: nn.ReLU())  # scripts in no time
    monkeypatch.setattr(export, "describe", lambda *whole: {})
    with pytest.raises(ValueError, match="differs"):
        export.export_model(model, tmp_path / "model.ts")
    assert list(tmp_path.iterdir()) == []


def test_a_difference_is_noticed(model):
    deployed, other = DeployedUSVNet(model).eval(), DeployedUSVNet(model).eval()
    with torch.no_grad():
        other.model.network.heatmap_head.heatmap[-1].weight.mul_(1.1)
    for first, second in ((deployed, other), (other, other)):
        with pytest.raises(ValueError, match=r"differs.* px, .* mm at 10 m"):
            check_parity(model, first, second)


def far_boat(slant_m, std_m):
    """What a chain answers of one boat whose box ends near the horizon, and of nothing else."""
    fields = {"boxes_px": 4, "keypoints_px": 2, "scores": 1, "heading_rad": 1, "misfit": 1}
    answers = {name: torch.zeros(1, 1, size).squeeze(-1) for name, size in fields.items()}
    answers["misfit"] += 1
    for who in ESTIMATORS:
        one = torch.ones(1, 1)
        place = torch.tensor([0.0, 1.5, slant_m]).view(1, 1, 3)
        answers |= {f"{who}_slant_m": slant_m * one, f"{who}_horizontal_m": slant_m * one, f"{who}_position_m": place}
        answers |= {f"{who}_slant_std_m": std_m * one}
    return answers


@pytest.mark.parametrize(("field", "factor", "fits"), [("", 1.0, True), ("slant_m", 1.01, False), ("std", 1.1, False)])
def test_a_rounding_error_near_the_horizon_is_no_difference(field, factor, fits):
    """At 1.5 m above the water and a focal length of 700 px, 1e-4 px are 0.4 m of range at 2 km, and twice as much,
    in proportion, of its sigma."""
    off = 2000.0 * 1e-4 / 700 / 1.5
    slant_m, std_m = 2000 * (1 + off), 1000 * (1 + 2 * off)
    got = far_boat(slant_m * factor if field == "slant_m" else slant_m, std_m * factor if field == "std" else std_m)
    image, camera, _ = inputs(1, 64, 64)
    found = compare_chains(lambda *_: far_boat(2000, 1000), lambda *_: got, image, camera)
    assert (found.m_at_10_m <= 0.001 and found.rest <= 1e-4) == fits


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ({"max_boats": -1}, "max_boats: got -1, expected 1 to 128"),
        ({"max_boats": 500}, "max_boats: got 500, expected 1 to 128"),
        ({"score_threshold": 50.0}, "score_threshold: got 50, expected a score from 0 to 1"),
    ],
)
def test_an_option_out_of_range_is_named(untrained, tmp_path, option, message):
    with pytest.raises(ValueError, match=message):
        command(checkpoint=untrained, output=tmp_path / "model.ts", **option)
    assert list(tmp_path.glob("model*")) == []


def test_other_suffixes_are_refused(model, tmp_path):
    with pytest.raises(ValueError, match=r"model\.tflite.*\.ts, .*\.onnx, \.xml"):
        export.export_model(model, tmp_path / "model.tflite")


def test_predictions_by_a_file_are_those_of_its_model(model, exported):
    camera = probe_camera(1, 128, 160)
    picture = (inputs(1, 128, 160)[0][0].permute(1, 2, 0) * 255).round().to(torch.uint8).numpy()
    opened = ExportedModel(exported[0])
    assert opened.score_threshold == 0.6
    assert opened.sidecar.image_size == 320
    of_file = Predictor(opened, camera, image_size=160, confidence=0.3)
    of_model = Predictor(model, camera, image_size=160, confidence=0.3)
    boats, expected = of_file(picture), of_model(picture)
    assert Predictor(opened, camera, confidence=0.3).image_size == 320
    assert of_file.stride_px == of_model.stride_px
    assert of_file.factors == of_model.factors
    assert len(boats) == len(expected) >= 2
    for boat, same in zip(boats, expected):
        assert boat.score == pytest.approx(same.score, abs=1e-5)
        assert boat.keypoints_px == pytest.approx(same.keypoints_px, abs=0.01)
        assert boat.ranges["waterline"].valid == same.ranges["waterline"].valid
        if same.ranges["waterline"].slant_m < 10:
            assert boat.ranges["waterline"].slant_m == pytest.approx(same.ranges["waterline"].slant_m, abs=0.001)


def test_a_description_of_another_file_is_refused(exported, tmp_path):
    path = tmp_path / "model.ts"
    path.write_bytes(exported[0].read_bytes())
    with pytest.raises(FileNotFoundError, match=r"model\.ts\.json: no such file"):
        read_sidecar(path)
    about = json.loads(sidecar_path(exported[0]).read_text())
    sidecar_path(path).write_text(json.dumps(about))
    assert read_sidecar(path).score_threshold == 0.6
    for spoilt, reason in (
        ({**about, "keypoint_names": ["bow"]}, "keypoint_names are bow, expected bow, bow_left"),
        ({**about, "model": {}}, "got something else"),
        ({**about, "sha256": {"ts": "0"}}, "describes another model.ts"),
        ([], "got something else"),
    ):
        sidecar_path(path).write_text(json.dumps(spoilt))
        with pytest.raises(ValueError, match=reason):
            read_sidecar(path)
