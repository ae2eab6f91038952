import json
from dataclasses import replace

import cv2
import pytest

from usvnet.evaluation.evaluator import default_output, evaluate, prediction_meta

from .conftest import SIZE_PX, Oracle

FILES = {
    "floor.csv",
    "intervals_by_distance.csv",
    "intervals_by_scene.csv",
    "keypoints.csv",
    "metrics.json",
    "overlays",
    "pose.csv",
    "predictions.jsonl",
    "range_by_distance.csv",
    "range_by_scene.csv",
    "reliability.png",
    "report.md",
}


def test_an_oracle_scores_one_everywhere_and_its_ranges_have_no_error(tmp_path, dataset):
    model = Oracle(dataset)
    scores = evaluate(model, dataset, tmp_path / "out", prediction_meta(model, dataset, "test"))
    for pose in (scores.pose, scores.pose_strict):
        assert (pose.precision, pose.recall, pose.map50, pose.map50_95) == pytest.approx((1, 1, 1, 1))
    assert scores.keypoints.overall.p95_px < 1e-3
    waterline = scores.ranges.overall["waterline"]
    assert (waterline.n, waterline.missed) == (4, 0)
    assert waterline.mae_m < 1e-4
    assert scores.ranges.overall["box_bottom"].mae_m > 0.05
    assert {path.name for path in (tmp_path / "out").iterdir()} == FILES
    sheets = sorted((tmp_path / "out" / "overlays").iterdir())
    assert [sheet.name for sheet in sheets] == ["all.png", "scene_I.png", "scene_IV.png"]
    assert all(cv2.imread(str(sheet)) is not None for sheet in sheets)


def test_predictions_are_made_once_and_scored_often(tmp_path, dataset):
    model = Oracle(dataset, missed=(2,))
    meta = prediction_meta(model, dataset, "test")
    first = evaluate(model, dataset, tmp_path, meta)
    again = evaluate(model, dataset, tmp_path, meta, range_confidence=0.05)
    assert model.predicted == len(dataset)
    assert first.ranges.by_scene["IV"]["waterline"].missed == 1
    assert again.ranges.by_scene["IV"]["waterline"].missed == 0
    assert json.loads((tmp_path / "metrics.json").read_text())["range_confidence"] == 0.05


def test_other_weights_are_refused_unless_asked_to_overwrite(tmp_path, dataset):
    model = Oracle(dataset)
    meta = prediction_meta(model, dataset, "test")
    evaluate(model, dataset, tmp_path, meta | {"checkpoint_sha256": "abc"})
    with pytest.raises(ValueError, match="made of other weights: add --overwrite"):
        evaluate(model, dataset, tmp_path, meta | {"checkpoint_sha256": "def"})
    model.predicted = 0
    scores = evaluate(model, dataset, tmp_path, meta | {"checkpoint_sha256": "def"}, overwrite=True)
    assert scores.pose.map50 == pytest.approx(1.0)


def test_labels_may_change_without_a_new_prediction_but_cameras_and_pictures_may_not(dataset):
    model = Oracle(dataset)
    meta = prediction_meta(model, dataset, "test")
    frame = dataset.frames[0]
    dataset.frames[0] = replace(frame, range_m=frame.range_m + 1, scene="VI")
    assert prediction_meta(model, dataset, "test") == meta
    dataset.frames[0] = replace(frame, camera=frame.camera._replace(pitch_rad=frame.camera.pitch_rad + 0.01))
    assert prediction_meta(model, dataset, "test") != meta
    dataset.frames[0] = frame
    frame.image_path.write_bytes(dataset.frames[1].image_path.read_bytes())
    assert prediction_meta(model, dataset, "test") != meta


def test_a_confidence_that_is_no_score_is_refused(tmp_path, dataset):
    with pytest.raises(ValueError, match=r"range_confidence: got 25, expected a score in \[0, 1\]"):
        evaluate(Oracle(dataset), dataset, tmp_path, {}, range_confidence=25)


def test_results_go_beside_the_checkpoints():
    assert default_output("runs/x/checkpoints/best.ckpt", "test").as_posix() == "runs/x/evaluation/best_test"


def test_pictures_are_not_what_the_dataset_says(tmp_path, dataset):
    model = Oracle(dataset)
    meta = prediction_meta(model, dataset, "test")
    evaluate(model, dataset, tmp_path, meta)
    lines = (tmp_path / "predictions.jsonl").read_text().splitlines(keepends=True)
    (tmp_path / "predictions.jsonl").write_text("".join(lines[:-1]))
    with pytest.raises(ValueError, match="got other pictures than the 4 of the dataset"):
        evaluate(model, dataset, tmp_path, meta)


def test_native_pictures_are_larger_than_the_network_sees(dataset):
    assert dataset.frames[0].size_px == SIZE_PX
    assert dataset.size_px == (128, 128)
