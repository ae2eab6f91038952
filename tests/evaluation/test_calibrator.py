"""Calibrating a checkpoint on a split, with a model that knows the labels."""

import dataclasses
import json
import shutil

import numpy as np
import pytest
import torch

from usvnet.checkpoints import load_model, write_calibration
from usvnet.data.dataset import BoatDataset
from usvnet.evaluation import calibrator
from usvnet.evaluation.conformal import MIN_BOATS
from usvnet.evaluation.evaluator import evaluate, prediction_meta
from usvnet.intervals import ESTIMATORS, UNCALIBRATED, IntervalFactors

from .conftest import Oracle


@pytest.fixture
def checkpoint(untrained, tmp_path):
    return shutil.copy(untrained, tmp_path / "best.ckpt")


def ranged_pictures(dataset: BoatDataset, pictures: int) -> BoatDataset:
    """The dataset's pictures over and over, each with a laser reading that is 3 % off the waterline's range."""
    rng = np.random.default_rng(0)
    frames = [dataset.frames[n % len(dataset.frames)] for n in range(pictures)]
    wrong = [
        dataclasses.replace(f, range_m=f.range_m * (1 + 0.03 * rng.standard_normal()), name=f"{n}.png")
        for n, f in enumerate(frames)
    ]
    return BoatDataset(wrong, dataset.size_px[0])


def test_factors_are_found_told_and_written(dataset, checkpoint, monkeypatch, capsys):
    pictures = ranged_pictures(dataset, 48)
    oracle = Oracle(pictures)
    monkeypatch.setattr(calibrator, "load_model", lambda path: oracle)
    factors = calibrator.calibrate_checkpoint(checkpoint, pictures, "val")
    assert factors["waterline"].boats == 48
    assert factors["waterline"].factor_90 != 1.0
    assert load_model(checkpoint).intervals.factors() == {
        name: IntervalFactors(*torch.tensor(found[:2]).tolist(), found.boats) for name, found in factors.items()
    }
    assert load_model(checkpoint).noise.get_share() == 0.0  # the oracle's keypoints are the labels
    told = capsys.readouterr().out
    assert f"val: box_bottom x {factors['box_bottom'].factor_90:.2f} (48 boats)" in told


def test_an_evaluation_says_before_and_after(dataset, tmp_path):
    pictures = ranged_pictures(dataset, 48)
    oracle = Oracle(pictures)
    raw = evaluate(oracle, pictures, tmp_path / "raw", prediction_meta(oracle, pictures, "test"))
    assert raw.intervals.overall["waterline"].before == raw.intervals.overall["waterline"].after
    report = (tmp_path / "raw" / "report.md").read_text()
    assert f"Not calibrated, factor 1: {', '.join(ESTIMATORS)}." in report

    oracle = Oracle(pictures)
    oracle.intervals.set_factors({"waterline": IntervalFactors(2.0, 3.0, 77)})
    scores = evaluate(oracle, pictures, tmp_path / "calibrated", prediction_meta(oracle, pictures, "test"))
    before, after = scores.intervals.overall["waterline"].before, scores.intervals.overall["waterline"].after
    assert before.width_90_m == pytest.approx(raw.intervals.overall["waterline"].after.width_90_m, rel=1e-5)
    assert after.width_90_m == pytest.approx(3 * before.width_90_m, rel=1e-5)
    assert after.width_68_m == pytest.approx(2 * before.width_68_m, rel=1e-4)
    report = (tmp_path / "calibrated" / "report.md").read_text()
    assert "Calibrated on 77 boats (waterline)." in report
    assert "| **all** | **waterline** | **calibrated** | **48** |" in report
    assert "![reliability](reliability.png)" in report
    line = json.loads((tmp_path / "calibrated" / "predictions.jsonl").read_text().splitlines()[1])
    estimate = line["boats"][0]["waterline"]
    assert estimate["slant_std_m"] == pytest.approx(3 * estimate["raw_std_m"], rel=1e-5)


def test_too_few_readings_are_told_and_leave_the_factor_at_one(dataset, checkpoint, capsys):
    assert calibrator.calibrate_checkpoint(checkpoint, dataset, "val") == {}
    assert (
        f"intervals not calibrated: 4 laser readings in val, expected at least {MIN_BOATS}" in capsys.readouterr().out
    )
    assert set(load_model(checkpoint).intervals.factors().values()) == {UNCALIBRATED}


def test_keypoints_that_stray_are_told_and_widen_the_ranges(dataset, checkpoint, monkeypatch, capsys):
    pictures = ranged_pictures(dataset, 48)
    rng = np.random.default_rng(1)
    strayed = [
        dataclasses.replace(frame, keypoints_px=frame.keypoints_px + 3 * rng.standard_normal(frame.keypoints_px.shape))
        for frame in pictures.frames
    ]
    monkeypatch.setattr(calibrator, "load_model", lambda path: Oracle(pictures))
    found = calibrator.calibrate_checkpoint(checkpoint, BoatDataset(strayed, dataset.size_px[0]), "val")
    share = load_model(checkpoint).noise.get_share()
    width_px, height_px = dataset.frames[0].boxes_px[0, 2:] - dataset.frames[0].boxes_px[0, :2]
    assert share * np.sqrt(width_px * height_px) == pytest.approx(3, rel=0.2)
    assert f"keypoints of val stray by {100 * share:.1f} % of a boat's size" in capsys.readouterr().out

    monkeypatch.setattr(calibrator, "load_model", lambda path: Oracle(pictures))
    calibrator.calibrate_checkpoint(checkpoint, pictures, "val")
    believed = load_model(checkpoint).intervals.factors()
    assert found["waterline"].factor_90 < 0.8 * believed["waterline"].factor_90
    assert found["box_bottom"].factor_90 == pytest.approx(believed["box_bottom"].factor_90)


def test_where_nothing_can_be_fitted_an_earlier_calibration_stays(dataset, checkpoint, monkeypatch, capsys):
    write_calibration(checkpoint, 0.02, 0.03, {"waterline": IntervalFactors(2.0, 3.0, 77)})
    assert calibrator.calibrate_checkpoint(checkpoint, dataset, "val") == {}
    kept = load_model(checkpoint)
    assert (kept.noise.get_share(), kept.intervals.factors()["waterline"]) == (
        pytest.approx(0.02),
        IntervalFactors(2.0, 3.0, 77),
    )
    assert f"{checkpoint}: its calibration is left as it is" in capsys.readouterr().out

    pictures = ranged_pictures(dataset, 48)  # enough of everything, but the boats are not found
    monkeypatch.setattr(calibrator, "load_model", lambda path: Oracle(pictures, missed=tuple(range(48))))
    assert calibrator.calibrate_checkpoint(checkpoint, pictures, "val") == {}
    assert load_model(checkpoint).intervals.factors()["waterline"] == IntervalFactors(2.0, 3.0, 77)


def test_a_new_doubt_of_keypoints_alone_removes_factors_that_belong_to_another(
    dataset, checkpoint, monkeypatch, capsys
):
    write_calibration(checkpoint, 0.02, 0.03, {"waterline": IntervalFactors(2.0, 3.0, 77)})
    frames = [dataclasses.replace(f, range_m=np.zeros(1)) for f in ranged_pictures(dataset, 48).frames]
    pictures = BoatDataset(frames, dataset.size_px[0])
    monkeypatch.setattr(calibrator, "load_model", lambda path: Oracle(pictures))
    assert calibrator.calibrate_checkpoint(checkpoint, pictures, "val") == {}
    found = load_model(checkpoint)
    assert (found.noise.get_share(), set(found.intervals.factors().values())) == (0.0, {UNCALIBRATED})
    assert "its earlier interval factors are removed" in capsys.readouterr().out
