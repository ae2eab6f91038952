"""``usvnet sensitivity`` of a camera file and of predictions."""

import csv
import json

import numpy as np
import pytest
import torch

from usvnet import cli
from usvnet.data.reader import read_dataset
from usvnet.evaluation.evaluator import frame_truths, frames_sha256
from usvnet.evaluation.predictions import PicturePrediction, write_predictions
from usvnet.evaluation.range_metrics import score_range
from usvnet.evaluation.records import BoatRecord, RangeRecord
from usvnet.evaluation.reranging import native_cases, range_cases
from usvnet.geometry.camera_files import load_camera, save_camera
from usvnet.geometry.ranging import RangingLayer


@pytest.fixture
def config(tmp_path, root):
    path = tmp_path / "config.yaml"
    path.write_text(
        f"camera: {root}/data/sample/cameras/cam_a.yaml\n"
        "distances_m: [5, 10]\nheadings_deg: [30]\ndraws: 20\n"
        "disturbances: {focal_px: [0, 50], height_m: [0.03], keypoint_px: [1]}\n"
    )
    return path


def rows_of(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def test_a_camera_file_becomes_tables_and_plots(config, tmp_path, capsys):
    out = tmp_path / "out"
    cli.run(["sensitivity", "--config", str(config), "--output", str(out)])
    for picture in ("budget", "curves_waterline", "curves_box_bottom"):
        assert (out / f"{picture}.png").stat().st_size > 10_000
    text = (out / "sensitivity.md").read_text()
    assert "| focal length | 50 px | waterline |" in text
    assert "| 1.246 | 1.111 |" in text
    assert "waterline at 10 m: keypoints 1 px costs 1.5 %" in text
    assert "waterline at 10 m: keypoints 1 px costs 1.5 %" in capsys.readouterr().out
    curves = {(row["source"], row["distance_m"], row["estimator"]): row for row in rows_of(out / "curves.csv")}
    assert float(curves["height_m", "10", "waterline"]["exact"]) == pytest.approx(0.02, rel=1e-5)
    assert {row["source"] for row in rows_of(out / "errors.csv")} == {"focal_px", "height_m", "keypoint_px"}


def test_standard_deviations_of_a_calibration_are_told_in_three_digits(config, tmp_path, root, capsys):
    camera = load_camera(root / "data" / "sample" / "cameras" / "cam_a.yaml")
    found = camera._replace(pitch_std_rad=torch.deg2rad(torch.tensor([0.0837432])), focal_std_px=torch.tensor([1234.5]))
    save_camera(found, tmp_path / "camera.yaml")
    options = ["--camera", str(tmp_path / "camera.yaml"), "--output", str(tmp_path / "out")]
    cli.run(["sensitivity", "--config", str(config), *options])
    said = capsys.readouterr().out
    assert "pitch 0.0837 deg costs" in said
    assert "focal length 1230 px costs" in said


def boat_of(frame, ranges):
    return BoatRecord(
        box_px=frame.boxes_px[0],
        score=0.9,
        keypoints_px=frame.keypoints_px[0] + 1.0,
        keypoint_covariance_px2=np.tile(np.eye(2), (7, 1, 1)),
        visibility=np.ones(7),
        ranges=ranges,
    )


@pytest.mark.parametrize("size_std", [0.0, 0.05])
def test_predictions_are_ranged_anew_without_a_network(config, tmp_path, root, capsys, size_std):
    frames = read_dataset(root / "data" / "sample", "test")
    cases = native_cases([(boat_of(frame, {}), frame) for frame in frames]).with_noise(0.0, size_std)
    found = range_cases(cases, RangingLayer())
    boats = [
        boat_of(
            frame,
            {
                name: RangeRecord(float(e.slant_m[n]), float(e.slant_std_m[n]), 0.0, 0.0, np.zeros(3), True)
                for name, e in found.items()
            },
        )
        for n, frame in enumerate(frames)
    ]
    path = tmp_path / "predictions.jsonl"
    meta = {"curved_water": False, "frames_sha256": frames_sha256(frames), "size_std": size_std}
    write_predictions(path, meta, [PicturePrediction(f.name, [boat]) for f, boat in zip(frames, boats)])
    scores = score_range([[boat] for boat in boats], [frame_truths(frame) for frame in frames])
    arguments = ["sensitivity", "--config", str(config), "--predictions", str(path), "--output", str(tmp_path / "out")]
    cli.run([*arguments, "--data", str(root / "data" / "sample")])
    rows = {
        (row["source"], float(row["amount"]), row["estimator"]): row for row in rows_of(tmp_path / "out/errors.csv")
    }
    for name, errors in scores.overall.items():
        undisturbed = rows["focal_px", 0.0, name]
        assert int(undisturbed["n"]) == errors.n == 24
        assert float(undisturbed["rmse_m"]) == pytest.approx(errors.rmse_m, rel=1e-4)
        assert float(undisturbed["first_order_mae_m"]) == pytest.approx(errors.mae_m, rel=1e-4)
        assert float(rows["focal_px", 50.0, name]["rmse_m"]) > errors.rmse_m

    path.write_text(path.read_text().replace(meta["frames_sha256"], "0"))
    with pytest.raises(ValueError, match="made of other pictures, cameras or hulls"):
        cli.run([*arguments, "--data", str(root / "data" / "sample")])
    assert json.loads(path.read_text().splitlines()[0])["meta"]["curved_water"] is False


def test_half_a_question_is_answered_in_one_sentence(config, tmp_path):
    with pytest.raises(ValueError, match="--predictions and --data are only of use together"):
        cli.run(["sensitivity", "--config", str(config), "--data", str(tmp_path)])
    config.write_text("disturbances: {}")
    with pytest.raises(ValueError, match="disturbances: expected at least one of focal_px"):
        cli.run(["sensitivity", "--config", str(config)])
    config.write_text("disturbances: {focal_px: [1]}")
    with pytest.raises(ValueError, match="camera is missing"):
        cli.run(["sensitivity", "--config", str(config)])
