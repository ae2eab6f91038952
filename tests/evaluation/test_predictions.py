import json
import math
from dataclasses import replace

import numpy as np
import pytest

from usvnet.evaluation.predictions import PicturePrediction, predict_dataset, read_predictions, write_predictions
from usvnet.evaluation.records import ESTIMATORS

from .boats import boat, truth
from .conftest import Oracle

META = {"checkpoint_sha256": "abc", "image_size": [128, 128]}


def above_horizon():
    found = boat(truth(range_m=9.0))
    lost = replace(
        found.ranges["waterline"], slant_m=math.inf, slant_std_m=math.inf, horizontal_m=math.inf, valid=False
    )
    return replace(found, ranges=found.ranges | {"waterline": lost})


def test_what_is_written_is_read_back(tmp_path):
    boats = [boat(truth(range_m=12.345678), score=0.75, std_m=0.2), above_horizon()]
    path = tmp_path / "new" / "predictions.jsonl"
    write_predictions(path, META, [PicturePrediction("test/1.jpg", boats), PicturePrediction("test/2.jpg", [])])
    first, second = read_predictions(path, META)
    assert (first.image, second.image, second.boats) == ("test/1.jpg", "test/2.jpg", [])
    for read, written in zip(first.boats, boats):
        assert read.score == written.score
        np.testing.assert_allclose(read.box_px, written.box_px)
        np.testing.assert_allclose(read.keypoints_px, written.keypoints_px)
        np.testing.assert_allclose(read.keypoint_covariance_px2, written.keypoint_covariance_px2)
        np.testing.assert_allclose(read.visibility, written.visibility)
        for name in ESTIMATORS:
            one, other = read.ranges[name], written.ranges[name]
            assert one.valid == other.valid
            assert (one.slant_m, one.slant_std_m, one.horizontal_m, one.bearing_rad) == pytest.approx(
                (other.slant_m, other.slant_std_m, other.horizontal_m, other.bearing_rad), rel=1e-6
            )


def test_lines_are_strict_json_with_a_90_percent_interval(tmp_path):
    path = tmp_path / "predictions.jsonl"
    found = boat(truth(range_m=10.0), std_m=1.0)
    write_predictions(path, META, [PicturePrediction("a.jpg", [found, above_horizon()])])

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    meta, picture = [json.loads(line, parse_constant=refuse) for line in path.read_text().splitlines()]
    assert meta == {"meta": META}
    first, second = picture["boats"]
    assert first["waterline"]["interval_90_m"] == pytest.approx([10 - 1.644854, 10 + 1.644854])
    assert len(first["keypoint_covariance_px2"]) == 7
    assert first["keypoint_covariance_px2"][0] == [2.0, 0.5, 1.0]
    assert second["waterline"]["slant_m"] is None
    assert second["waterline"]["interval_90_m"] == [None, None]


def test_predictions_of_something_else_are_refused(tmp_path):
    path = tmp_path / "predictions.jsonl"
    write_predictions(path, META, [])
    with pytest.raises(ValueError, match="made of other weights: add --overwrite to replace it"):
        read_predictions(path, META | {"checkpoint_sha256": "def"})
    with pytest.raises(ValueError, match="made with split None, not 'val'"):
        read_predictions(path, META | {"split": "val"})
    assert read_predictions(path) == []


@pytest.mark.parametrize("line", ["{", '{"image": "a.jpg"}', '{"image": "a.jpg", "boats": [{"score": 1}]}', "3"])
def test_a_damaged_file_is_named_with_its_line(tmp_path, line):
    path = tmp_path / "predictions.jsonl"
    write_predictions(path, META, [])
    with path.open("a") as file:
        file.write(line + "\n")
    with pytest.raises(ValueError, match=r"predictions\.jsonl:2: not a line of a predictions file"):
        read_predictions(path)


def test_a_failure_while_predicting_leaves_no_file(tmp_path):
    def broken():
        yield PicturePrediction("a.jpg", [])
        raise RuntimeError("out of memory")

    with pytest.raises(RuntimeError):
        write_predictions(tmp_path / "predictions.jsonl", META, broken())
    assert list(tmp_path.iterdir()) == []


def test_a_dataset_is_predicted_in_native_pixels(tmp_path, dataset, capsys):
    path = tmp_path / "predictions.jsonl"
    predict_dataset(Oracle(dataset), dataset, path, META, batch_size=3)
    pictures = read_predictions(path)
    assert capsys.readouterr().out == ""
    assert [picture.image for picture in pictures] == [frame.name for frame in dataset.frames]
    for picture, frame in zip(pictures, dataset.frames):
        (found,) = picture.boats
        np.testing.assert_allclose(found.keypoints_px, frame.keypoints_px[0], atol=1e-3)
        np.testing.assert_allclose(found.box_px, frame.boxes_px[0], atol=1e-3)
        # 320 px letterboxed to 128: a standard deviation of 0.5 px there is 1.25 px here
        np.testing.assert_allclose(found.keypoint_covariance_px2[0], 1.25**2 * np.eye(2), atol=1e-5)
        assert found.ranges["waterline"].slant_m == pytest.approx(frame.range_m[0], rel=1e-5)
