import json
from pathlib import Path

import numpy as np
import pytest

from usvnet.data.formats.coco import read_coco, write_coco
from usvnet.data.formats.yolo import read_label, write_yolo
from usvnet.data.records import Faults


@pytest.fixture
def written(make_frame, tmp_path: Path) -> Path:
    write_coco([make_frame(number, boats=number) for number in range(3)], tmp_path / "train.json")
    return tmp_path / "train.json"


def test_reading_gives_back_what_was_written(make_frame, written: Path):
    read = read_coco(written, Faults())
    assert list(read) == ["train/0000.png", "train/0001.png", "train/0002.png"]
    for number, (labels, size_px) in enumerate(read.values()):
        frame = make_frame(number, boats=number)
        assert size_px == frame.size_px
        for got, expected in zip(labels, frame.labels):
            np.testing.assert_allclose(got, expected, atol=1e-9)
            assert got.shape == expected.shape


def test_both_formats_say_the_same(make_frame, written: Path, tmp_path: Path):
    """A tool writes x to COCO and x / width to YOLO: the half pixel must be treated alike."""
    frame = make_frame(1, boats=1)
    write_yolo([frame], tmp_path)
    words = [float(word) for word in (tmp_path / "train/0001.txt").read_text().split()]
    annotation = json.loads(written.read_text())["annotations"][0]
    assert annotation["keypoints"][0] / frame.size_px[0] == pytest.approx(words[5], abs=1e-8)
    assert annotation["bbox"][2] / frame.size_px[0] == pytest.approx(words[3], abs=1e-8)
    yolo = read_label(tmp_path / "train/0001.txt", frame.size_px, Faults())
    np.testing.assert_allclose(yolo.boxes_px, read_coco(written, Faults())["train/0001.png"][0].boxes_px, atol=1e-6)


def test_pycocotools_reads_it(written: Path, capsys):
    from pycocotools.coco import COCO

    coco = COCO(str(written))
    assert len(coco.getAnnIds()) == 3
    assert len(coco.anns[1]["keypoints"]) == 21


def test_a_picture_without_pixels_is_named_and_its_boats_with_it(written: Path):
    content = json.loads(written.read_text())
    content["images"][1]["width"] = 0
    written.write_text(json.dumps(content))
    faults = Faults(collect=True)
    assert list(read_coco(written, faults)) == ["train/0000.png", "train/0002.png"]
    assert "images[1]" in faults.sentences[0]
    assert "image_id is 2, expected the id of one of 'images'" in faults.sentences[1]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("keypoints", [1.0] * 18, "6 keypoints"),
        ("keypoints", [float("nan"), 1, 2] * 7, "bow is .nan, .*expected finite"),
        ("keypoints", [1, 1, 3] * 7, "expected 0, 1 or 2"),
        ("keypoints", [900, 1, 2] * 7, "bow is .*expected 0 to 1"),
        ("bbox", [1, 1, 0, 5], "above 0"),
        ("bbox", [500, 1, 5, 5], "box centre is .*expected 0 to 1"),
        ("bbox", [1, 1], "bbox of 2 numbers"),
        ("image_id", 77, "image_id is 77"),
        ("iscrowd", 1, "iscrowd"),
    ],
)
def test_a_faulty_annotation_is_named(written: Path, key: str, value: object, words: str):
    content = json.loads(written.read_text())
    content["annotations"][1][key] = value
    written.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=rf"train\.json: annotations\[1\]: .*{words}"):
        read_coco(written, Faults())


@pytest.mark.parametrize("key", ["image_id", "bbox", "keypoints"])
def test_a_missing_key_is_named(written: Path, key: str):
    content = json.loads(written.read_text())
    del content["annotations"][2][key]
    written.write_text(json.dumps(content))
    with pytest.raises(ValueError, match=rf"annotations\[2\]: no {key}"):
        read_coco(written, Faults())


def test_other_keypoints_are_refused(written: Path):
    content = json.loads(written.read_text())
    content["categories"][0]["keypoints"][0] = "nose"
    written.write_text(json.dumps(content))
    with pytest.raises(ValueError, match="nose"):
        read_coco(written, Faults())
