"""Label files, COCO, data.yaml and the tables of a dataset: read, or refused in one sentence, whatever is in them."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from usvnet.data.formats.coco import read_coco
from usvnet.data.formats.imu import read_imu
from usvnet.data.formats.ranges import read_tables
from usvnet.data.formats.yolo import read_data_yaml, read_label
from usvnet.data.records import Faults, Labels
from usvnet.types import KEYPOINT_NAMES

from .mutations import EXAMPLES, quick, read_or_refused, spoilt_json, spoilt_text

SIZE_PX = (160, 120)
LABELS = ("0 0.5 0.5 0.2 0.1" + " 0.45 0.5 2" * 7 + "\n") * 2
DATA_YAML = "train: images/train\nval: val.json\nnames: {0: usv}\nkpt_shape: [7, 3]\nflip_idx: [0, 2, 1, 3, 5, 4, 6]\n"
RANGES = "image,range_m,range_std_m,instance,reference,scene,pitch_deg\na.png,5.5,0.1,0,bow_bottom,I,6\nb.png,7,,,,,\n"
FRAMES = "image,camera,hull,scene,pitch_deg,roll_deg,pitch_std_deg,time_s\na.png,front,mine,I,6,-1,0.1,12.5\n"
IMU = "time_s,pitch_deg,roll_deg,pitch_std_deg,roll_std_deg\n0,6,-1,0.1,0.1\n0.1,6.5,-1.5,0.1,0.1\n0.2,6,-1,0.1,0.1\n"
COCO = {
    "images": [{"id": 1, "file_name": "a.png", "width": 160, "height": 120}],
    "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "bbox": [40, 30, 80, 60], "keypoints": [60, 50, 2] * 7}],
    "categories": [{"id": 1, "name": "usv", "keypoints": list(KEYPOINT_NAMES)}],
}


def check_labels(labels: Labels) -> None:
    """What is read can be trained on: float32 numbers, and boxes that have an area."""
    for numbers in labels:
        assert np.isfinite(np.asarray(numbers, np.float32)).all()
    assert (labels.boxes_px[:, 2:] > labels.boxes_px[:, :2]).all()
    assert np.isin(labels.visibility, (0, 1, 2)).all()


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("collect", [False, True])
def test_yolo_labels(tmp_path: Path, examples: int, collect: bool):
    path = tmp_path / "a.txt"

    @quick(examples)
    @given(spoilt_text(LABELS))
    def read(data: bytes) -> None:
        path.write_bytes(data)
        faults = Faults(collect)
        labels = read_or_refused(lambda: read_label(path, SIZE_PX, faults), path)
        assert all(str(path) in sentence for sentence in faults.sentences)
        assert labels is not None or not collect
        if labels is not None:
            check_labels(labels)

    read()


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("collect", [False, True])
def test_coco(tmp_path: Path, examples: int, collect: bool):
    path = tmp_path / "a.json"

    @quick(examples)
    @given(spoilt_json(COCO))
    def read(data: bytes) -> None:
        path.write_bytes(data)
        faults = Faults(collect)
        for labels, size_px in (read_or_refused(lambda: read_coco(path, faults), path) or {}).values():
            check_labels(labels)
            assert min(size_px) > 0
        assert all(str(path) in sentence for sentence in faults.sentences)

    read()


@pytest.mark.parametrize("examples", EXAMPLES)
def test_data_yaml(tmp_path: Path, examples: int):
    path = tmp_path / "data.yaml"

    @quick(examples)
    @given(spoilt_text(DATA_YAML))
    def read(data: bytes) -> None:
        path.write_bytes(data)
        splits = read_or_refused(lambda: read_data_yaml(path), path)
        assert splits is None or all(isinstance(place, str) for place in splits.values())

    read()


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize(("name", "sound"), [("ranges.csv", RANGES), ("frames.csv", FRAMES)], ids=["ranges", "frames"])
def test_tables(tmp_path: Path, name: str, sound: str, examples: int):
    path = tmp_path / name

    @quick(examples)
    @given(spoilt_text(sound), st.booleans())
    def read(data: bytes, collect: bool) -> None:
        path.write_bytes(data)
        faults = Faults(collect)
        for note in (read_or_refused(lambda: read_tables(tmp_path, faults), path) or {}).values():
            assert note.pitch_deg is None or abs(note.pitch_deg) <= 90
            assert all(0 < reading.range_m < np.inf for reading in note.readings.values())
        assert all(str(path) in sentence for sentence in faults.sentences)

    read()


@pytest.mark.parametrize("examples", EXAMPLES)
def test_imu(tmp_path: Path, examples: int):
    path = tmp_path / "imu.csv"

    @quick(examples)
    @given(spoilt_text(IMU))
    def read(data: bytes) -> None:
        path.write_bytes(data)
        log = read_or_refused(lambda: read_imu(path), path)
        if log is not None:
            assert np.isfinite(log.time_s).all()
            assert (np.diff(log.time_s) > 0).all()
            assert (np.abs(log.angles_deg) <= 90).all()

    read()
