from pathlib import Path

import numpy as np
import pytest

from usvnet.data.formats.yolo import parse_line, read_data_yaml, read_label, write_data_yaml, write_yolo
from usvnet.data.records import Faults

GOOD = "0 0.5 0.5 0.2 0.1 " + " ".join(f"0.4{i} 0.5{i} {i % 3}" for i in range(7))


def changed(position: int, value: str) -> str:
    words = GOOD.split()
    words[position] = value
    return " ".join(words)


def test_the_pixel_rule_is_the_same_for_boxes_and_keypoints():
    boat = parse_line(GOOD, (200, 100))
    # pixel i covers [i, i + 1) in the file and has its centre at i here
    np.testing.assert_allclose(boat.boxes_px, [[0.4 * 200 - 0.5, 0.45 * 100 - 0.5, 0.6 * 200 - 0.5, 0.55 * 100 - 0.5]])
    np.testing.assert_allclose(boat.keypoints_px[0, 3], [0.43 * 200 - 0.5, 0.53 * 100 - 0.5])
    np.testing.assert_array_equal(boat.visibility[0], [0, 1, 2, 0, 1, 2, 0])


@pytest.mark.parametrize("boats", [0, 1, 3])
def test_reading_gives_back_what_was_written(make_frame, tmp_path: Path, boats: int):
    frame = make_frame(1, boats=boats)
    write_yolo([frame], tmp_path / "labels")
    labels = read_label(tmp_path / "labels" / "train" / "0001.txt", frame.size_px, Faults())
    for got, expected in zip(labels, frame.labels):
        assert got.shape == expected.shape
        np.testing.assert_allclose(got, expected, atol=1e-6)


def test_a_mark_at_the_beginning_is_no_part_of_a_line(tmp_path: Path):
    (tmp_path / "1.txt").write_text(GOOD, encoding="utf-8-sig")  # as Windows writes it
    assert len(read_label(tmp_path / "1.txt", (640, 640), Faults()).boxes_px) == 1


def test_no_file_is_a_picture_without_boats(tmp_path: Path):
    assert len(read_label(tmp_path / "none.txt", (10, 10), Faults()).boxes_px) == 0


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (GOOD.rsplit(" ", 3)[0], ("23 values", "6 keypoints", "expected 26")),
        ("0 0.5", ("2 values", "expected 26")),
        (changed(5, "nan"), ("nan", "finite")),
        (changed(5, "bow"), ("bow", "not a number")),
        (changed(8, "1.2"), ("bow_left", "1.2", "expected 0 to 1")),
        (changed(1, "-0.1"), ("box centre", "-0.1", "expected 0 to 1")),
        (changed(3, "0"), ("box", "above 0")),
        (changed(0, "1"), ("class 1", "expected 0")),
        (changed(10, "3"), ("bow_left", "visibility", "3", "0, 1 or 2")),
    ],
)
def test_a_faulty_line_is_named(tmp_path: Path, line: str, words: tuple[str, ...]):
    path = tmp_path / "0001.txt"
    path.write_text(f"{GOOD}\n\n{line}\n")
    with pytest.raises(ValueError, match=r"0001\.txt:3: ") as error:
        read_label(path, (640, 640), Faults())
    for word in words:
        assert word in str(error.value)


def test_a_point_outside_needs_no_sensible_place():
    assert parse_line(changed(5, "-3"), (100, 100)).visibility[0, 0] == 0


def test_collecting_goes_on_behind_a_fault(tmp_path: Path):
    path = tmp_path / "0001.txt"
    path.write_text(f"{changed(0, '1')}\n{GOOD}\n{changed(5, 'nan')}\n")
    faults = Faults(collect=True)
    assert len(read_label(path, (640, 640), faults).boxes_px) == 1
    assert len(faults.sentences) == 2


def test_data_yaml_round_trip(tmp_path: Path):
    splits = {"train": "images/train", "val": "annotations/val.json"}
    write_data_yaml(tmp_path / "data.yaml", splits)
    assert read_data_yaml(tmp_path / "data.yaml") == splits


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("kpt_shape: [7, 3]", "kpt_shape: [17, 3]", "kpt_shape is .17, 3., expected .7, 3."),
        ("kpt_shape: [7, 3]", "", "kpt_shape is None"),
        ("flip_idx: [0, 2, 1", "flip_idx: [0, 1, 2", "flip_idx is"),
        ("[bow, bow_left", "[bow_left, bow", "kpt_names is"),
        ("{0: usv}", "{0: usv, 1: buoy}", "names is .*expected one class"),
        ("images/train", "pictures/train", "train is pictures/train, expected a folder below images/"),
        ("names:", "names: [", "not valid YAML"),
    ],
)
def test_a_data_yaml_that_is_not_ours_is_refused(tmp_path: Path, old: str, new: str, words: str):
    path = tmp_path / "data.yaml"
    write_data_yaml(path, {"train": "images/train"})
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    with pytest.raises(ValueError, match=f"data.yaml: {words}"):
        read_data_yaml(path)
