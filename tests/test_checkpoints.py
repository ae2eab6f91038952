"""Checkpoints load strictly, safely, and say what is wrong in one sentence."""

import hashlib
import math

import pytest
import torch

from usvnet.checkpoints import load_model, pack_checkpoint, sha256, write_calibration
from usvnet.intervals import ESTIMATORS, UNCALIBRATED, IntervalFactors
from usvnet.model import USVNet


@pytest.fixture(scope="module")
def model():
    torch.manual_seed(0)
    return USVNet("n", curved_water=True)


@pytest.fixture
def checkpoint(model):
    """What training writes, without the optimiser."""
    weights = {f"model.{name}": value for name, value in model.state_dict().items()}
    return {"usvnet": {"variant": "n", "curved_water": True}, "state_dict": weights}


def save(checkpoint, folder):
    path = folder / "best.ckpt"
    torch.save(checkpoint, path)
    return path


def test_the_same_model_comes_back_ready_to_predict(model, checkpoint, tmp_path):
    loaded = load_model(save(checkpoint, tmp_path), variant="n")
    assert not loaded.training
    assert loaded.ranging.curved_water
    for name, value in model.state_dict().items():
        torch.testing.assert_close(loaded.state_dict()[name], value, rtol=0, atol=0)


def test_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"none\.ckpt: no such checkpoint"):
        load_model(tmp_path / "none.ckpt")


@pytest.mark.parametrize("content", [b"", b"boats", b"PK\x03\x04 half a zip"])
def test_a_file_of_something_else_is_refused(content, tmp_path):
    path = tmp_path / "photo.ckpt"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"photo\.ckpt: got a file that is not a checkpoint"):
        load_model(path)


def test_a_checkpoint_of_another_program_is_refused(checkpoint, tmp_path):
    del checkpoint["usvnet"]
    with pytest.raises(ValueError, match=r"best\.ckpt: got a checkpoint of something else"):
        load_model(save(checkpoint, tmp_path))


def test_another_size_is_refused(checkpoint, tmp_path):
    with pytest.raises(ValueError, match=r"best\.ckpt: got a checkpoint of size 'n', expected size 's'"):
        load_model(save(checkpoint, tmp_path), variant="s")


def test_a_missing_weight_is_named(checkpoint, tmp_path):
    name = next(iter(checkpoint["state_dict"]))
    del checkpoint["state_dict"][name]
    with pytest.raises(ValueError, match=rf"do not fit.*{name.removeprefix('model.')}"):
        load_model(save(checkpoint, tmp_path))


def test_a_superfluous_weight_is_refused(checkpoint, tmp_path):
    checkpoint["state_dict"]["model.rudder"] = torch.zeros(1)
    with pytest.raises(ValueError, match="rudder"):
        load_model(save(checkpoint, tmp_path))


class Trap:
    """Runs code when it is unpickled."""

    def __reduce__(self):
        return (pytest.fail, ("the checkpoint ran code",))


def test_a_checkpoint_never_runs_code(checkpoint, tmp_path):
    with pytest.raises(ValueError, match="not a checkpoint"):
        load_model(save(checkpoint | {"trap": Trap()}, tmp_path))


def test_sha256_of_a_file(tmp_path):
    path = tmp_path / "weights"
    path.write_bytes(b"bow, stern")
    assert sha256(path) == hashlib.sha256(b"bow, stern").hexdigest()


def test_a_calibration_travels_in_the_checkpoint(model, checkpoint, tmp_path):
    path = save(checkpoint, tmp_path)
    assert set(load_model(path).intervals.factors().values()) == {UNCALIBRATED}
    factors = {"waterline": IntervalFactors(1.25, 1.5, 60)}
    write_calibration(path, 0.03, 0.02, factors)
    loaded = load_model(path)
    assert loaded.intervals.factors() == dict.fromkeys(ESTIMATORS, UNCALIBRATED) | factors
    assert loaded.noise.get_share() == pytest.approx(0.03)
    assert loaded.noise.get_size_std() == pytest.approx(0.02)
    assert loaded.state_dict().keys() == model.state_dict().keys()
    for name, value in model.state_dict().items():
        torch.testing.assert_close(loaded.state_dict()[name], value, rtol=0, atol=0)
    write_calibration(path, 0.0, 0.0, {})
    assert set(load_model(path).intervals.factors().values()) == {UNCALIBRATED}
    assert load_model(path).noise.get_share() == 0.0


@pytest.mark.parametrize("share", [-0.1, math.nan, 1.5, "much", True])
def test_wrong_keypoint_noise_is_refused(checkpoint, share, tmp_path):
    checkpoint["usvnet"]["keypoint_share"] = share
    with pytest.raises(ValueError, match=r"best\.ckpt: keypoint noise: expected a share"):
        load_model(save(checkpoint, tmp_path))
    checkpoint["usvnet"] |= {"keypoint_share": 0.0, "size_std": share}
    with pytest.raises(ValueError, match=r"best\.ckpt: drawn size: expected a standard deviation"):
        load_model(save(checkpoint, tmp_path))


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ({"sonar": [1.0, 1.0, 40]}, r"best\.ckpt: interval factors: unknown estimator 'sonar'"),
        ({"waterline": [1.0, 0.0, 40]}, r"best\.ckpt: interval factors: waterline: expected numbers above 0"),
        ({"waterline": [1.0, math.nan, 40]}, r"best\.ckpt: interval factors: waterline: expected numbers above 0"),
    ],
)
def test_wrong_interval_factors_are_refused(checkpoint, factors, message, tmp_path):
    checkpoint["usvnet"]["intervals"] = factors
    with pytest.raises(ValueError, match=message):
        load_model(save(checkpoint, tmp_path))


def test_packed_it_is_half_as_large_and_predicts_the_same_to_float16(model, checkpoint, tmp_path):
    checkpoint["usvnet"]["intervals"] = {"fused": [1.5, 1.25, 40]}
    whole, packed = save({**checkpoint, "optimizer_states": [torch.ones(1000)]}, tmp_path), tmp_path / "small.pt"
    pack_checkpoint(whole, packed)
    assert packed.stat().st_size < 0.6 * whole.stat().st_size
    loaded = load_model(packed)
    assert loaded.intervals.factors() == load_model(whole).intervals.factors()
    for name, value in model.state_dict().items():
        assert loaded.state_dict()[name].dtype == value.dtype
        torch.testing.assert_close(loaded.state_dict()[name], value, rtol=2**-10, atol=2**-24)


def test_a_weight_that_float16_cannot_hold_is_refused(checkpoint, tmp_path):
    checkpoint["state_dict"]["model.network.backbone.stem.conv.weight"] += 1e6
    with pytest.raises(ValueError, match=r"backbone\.stem\.conv\.weight is too large for float16"):
        pack_checkpoint(save(checkpoint, tmp_path), tmp_path / "small.pt")
    assert not (tmp_path / "small.pt").exists()


@pytest.mark.parametrize("name", ["usvnet-n", "usvnet-n-refine"])
def test_what_comes_along_is_what_its_card_says(root, name):
    path = root / "checkpoints" / f"{name}.pt"
    assert f"`{sha256(path)}`" in path.with_suffix(".md").read_text(encoding="utf-8")
    assert path.stat().st_size <= 8e6
    model = load_model(path)
    assert (model.refiner is not None) == name.endswith("refine")
    assert 0 < float(model.noise.share) < 0.1
