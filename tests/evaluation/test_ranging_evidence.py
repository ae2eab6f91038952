"""The benchmarks about ranging run from a checkpoint to their pages, with a model that knows the labels."""

import dataclasses
import importlib.util
import math
import sys
from types import ModuleType

import numpy as np
import pytest
import torch

from usvnet.checkpoints import load_model
from usvnet.data.dataset import BoatDataset
from usvnet.data.horizon_detector import Sight
from usvnet.evaluation.evaluator import frame_truths
from usvnet.evaluation.predictions import PicturePrediction
from usvnet.evaluation.range_metrics import RangedBoat, range_errors
from usvnet.geometry.attitude import Attitude
from usvnet.geometry.ranging import RangingLayer

from .boats import boat
from .conftest import Oracle


def benchmark(root, name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, root / "benchmarks" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def evidence(root):
    return benchmark(root, "ranging_evidence")


@pytest.fixture
def many(dataset):
    """The dataset's pictures ten times over."""
    frames = [dataclasses.replace(dataset.frames[n % 4], name=f"test/{n:02d}.png") for n in range(40)]
    return BoatDataset(frames, dataset.size_px[0])


def test_a_checkpoint_becomes_a_page(evidence, many, untrained, tmp_path, monkeypatch):
    both_splits = BoatDataset(2 * many.frames, many.size_px[0])
    monkeypatch.setattr(evidence, "load_model", lambda path: Oracle(both_splits))
    monkeypatch.setattr(evidence, "read_dataset", lambda root, split: many.frames)
    evidence.main(untrained, tmp_path, tmp_path, image_size=128, attitude_std_deg=0.05, wave_std_m=0.01, draws=2)
    page = (tmp_path / "ranging.md").read_text()
    assert page.count("## Slant range by distance, metres") == page.count("## Intervals by distance, metres") == 2
    assert (
        "| **all** | **waterline** | **40** | **0** | **0.000** |" in page
    )  # the laser of the fixture is the waterline
    assert "| **all** | **waterline** | **80** | **0** | **0." in page  # disturbed, two draws
    crossed = [
        row
        for section in page.split("## 90 % intervals cross-calibrated in 10 folds over val and test")[1:]
        for row in section.split("## ")[0].splitlines()
        if row.startswith("| **all** | **waterline** |")
    ]
    assert len(crossed) == 2
    assert all(row.startswith("| **all** | **waterline** | **80** |") for row in crossed)  # both splits, each boat once
    assert "Boats made wrong, share refused at 1 % false alarms" in page


def test_disturbing_widens_and_scatters_and_sigmas_are_those_that_are_told(evidence, many):
    truths = [frame_truths(frame)[0] for frame in many.frames]
    ranged = [RangedBoat(n, truth, boat(truth)) for n, truth in enumerate(truths)]
    frames = [evidence.with_sigmas(frame, 0.05, 0.02) for frame in many.frames]
    camera = frames[0].camera
    assert math.degrees(float(camera.pitch_std_rad)) == pytest.approx(0.05)
    assert math.degrees(float(camera.roll_std_rad)) == pytest.approx(0.05)
    assert float(camera.wave_std_m) == pytest.approx(0.02)
    told = evidence.with_sigmas(frames[0], None, None, 0.3).camera
    assert math.degrees(float(told.pitch_std_rad)) == pytest.approx(math.hypot(0.3, 0.05), rel=1e-5)

    still = evidence.disturbed(ranged, frames, evidence.Doubts(), 0.0, 1, RangingLayer())
    moved = evidence.disturbed(ranged, frames, evidence.Doubts(), 0.3, 3, RangingLayer())
    assert len(moved) == 3 * len(still)
    assert range_errors(still, "waterline").rmse_m < 1e-3
    quiet, loud = (range_errors(boats, "waterline") for boats in (still, moved))
    assert loud.width_90_m > 1.3 * quiet.width_90_m
    assert 0.8 < loud.coverage_90 <= 1.0
    assert np.ptp([item.boat.ranges["waterline"].slant_m for item in moved[::40]]) > 0.1  # one boat, three draws


def test_a_horizon_that_tells_the_truth_undoes_the_disturbance(root, many, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(root / "benchmarks")  # as where a script is run
    horizon_ranges = benchmark(root, "horizon_ranges")
    sure = torch.full((1,), 1e-6, dtype=torch.float64)

    def find_horizon(path, camera, edge):
        true = next(frame.camera for frame in many.frames if frame.image_path == path)
        if path == many.frames[0].image_path:
            return Sight(None, "faint", None)
        return Sight(Attitude(true.pitch_rad.double(), true.roll_rad.double(), sure, sure), "", None)

    predicted = [PicturePrediction(f.name, [boat(truth) for truth in frame_truths(f)]) for f in many.frames]
    monkeypatch.setattr(horizon_ranges, "read_picture", lambda path: path)
    monkeypatch.setattr(horizon_ranges, "find_horizon", find_horizon)
    monkeypatch.setattr(horizon_ranges, "read_dataset", lambda root, split: many.frames)
    monkeypatch.setattr(horizon_ranges, "read_predictions", lambda path: predicted)
    horizon_ranges.main(tmp_path, tmp_path, tmp_path, draws=2)
    rows = [line.strip("| ").split(" | ") for line in (tmp_path / "horizon_ranges.md").read_text().splitlines()[4:10]]
    unseen = sum(frame.image_path == many.frames[0].image_path for frame in many.frames)
    assert [row[2] for row in rows] == 6 * [str(2 * (40 - unseen))]
    disturbed_m, joined_m = float(rows[0][4]), float(rows[3][4])
    assert disturbed_m > 0.05
    assert joined_m < 0.02 * disturbed_m

    monkeypatch.setattr(horizon_ranges, "find_horizon", lambda picture, camera, edge: Sight(None, "faint", None))
    with pytest.raises(ValueError, match="no horizon was seen in 40 pictures"):
        horizon_ranges.main(tmp_path, tmp_path, tmp_path)


def test_learning_from_lasers_moves_the_network_and_writes_its_curve(root, untrained, many, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(root / "benchmarks")  # as where a script is run
    laser_only = benchmark(root, "laser_only")
    model = load_model(untrained)
    before = {name: value.clone() for name, value in model.state_dict().items()}
    monkeypatch.setattr(laser_only, "RANGE_CONFIDENCE", 0.0)  # it has found no boat yet
    monkeypatch.setattr(laser_only, "load_model", lambda path: model)
    monkeypatch.setattr(laser_only, "read_dataset", lambda root, split: many.frames[:8])
    laser_only.main(untrained, tmp_path, tmp_path, image_size=64, steps=2, every=1, batch_size=2, keypoint_share=0.1)
    rows = [line for line in (tmp_path / "laser_only.md").read_text().splitlines() if line.startswith("| ")]
    assert [row.split(" | ")[0] for row in rows[2:]] == ["| 0", "| 1", "| 2"]
    assert (tmp_path / "laser_only.png").stat().st_size > 1000
    after = model.state_dict()
    changed = {name for name, value in before.items() if not torch.equal(value, after[name])}
    assert {name.split(".")[1] for name in changed} == {"heatmap_head"}
    assert not any("running_" in name for name in changed)
