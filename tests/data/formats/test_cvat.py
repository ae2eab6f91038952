"""The layout is documented at https://docs.cvat.ai/docs/dataset_management/formats/format-yolo-ultralytics (Pose)."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from usvnet.data.formats.cvat import read_cvat, unpacked
from usvnet.data.formats.exports import parse_text_label
from usvnet.data.records import Faults

SIZE_PX = (160, 120)


def read(source: Path, faults: Faults | None = None):
    faults = faults or Faults()
    with unpacked(source, faults) as folder:
        return read_cvat(folder, faults)


def test_a_zip_that_a_mac_has_packed_again_is_read(cvat: Path, tmp_path: Path):
    packed = tmp_path / "packed"
    shutil.copytree(cvat, packed / "export")
    for file in ("__MACOSX/._export", ".DS_Store"):
        (packed / file).parent.mkdir(exist_ok=True)
        (packed / file).write_bytes(b"")
    assert len(read(Path(shutil.make_archive(str(packed), "zip", packed)))[0]) == 3


@pytest.mark.parametrize("packed", [False, True])
def test_pictures_splits_and_boats(cvat: Path, packed: bool):
    source = Path(shutil.make_archive(str(cvat), "zip", cvat)) if packed else cvat
    pictures, notes = read(source)
    assert [(picture.name, picture.split, picture.size_px) for picture in pictures] == [
        ("a.png", "train", SIZE_PX),
        ("b.png", "train", SIZE_PX),
        ("c.png", "val", SIZE_PX),
    ]
    assert [len(picture.boxes_px) for picture in pictures] == [1, 0, 1]
    # cx 0.5 of 160 px and rw 0.25 give the edges 60 and 100, which lie half a pixel before the centres 60 and 100
    np.testing.assert_allclose(pictures[0].boxes_px, [[59.5, 47.5, 99.5, 71.5]])
    np.testing.assert_allclose(pictures[0].labels.keypoints_px[0, 0], [0.4 * 160 - 0.5, 0.5 * 120 - 0.5])
    assert pictures[0].visibility.tolist() == [[2, 1, 0, 2, 2, 2, 2]]
    assert "bow, bow_left" in notes[0]


def test_what_hangs_out_of_the_picture_is_cut(cvat: Path):
    boat = read(cvat).pictures[2].labels
    np.testing.assert_allclose(boat.boxes_px, [[-0.5, 47.5, 15.5, 71.5]])  # cx 0, rw 0.2: half of it outside
    assert boat.visibility.tolist() == [[0, 2, 2, 2, 2, 2, 2]]


def test_without_visibility_a_point_at_the_corner_is_missing():
    kind, boat = parse_text_label("3 0.5 0.5 0.2 0.2 0.0 0.0 " + "0.5 0.5 " * 6, SIZE_PX)
    assert kind == 3
    assert boat.visibility.tolist() == [[0, 2, 2, 2, 2, 2, 2]]


def test_a_track_number_is_left_alone():
    line = "0 0.5 0.5 0.2 0.2 " + "0.5 0.5 2 " * 7
    for got, expected in zip(parse_text_label(line + " 12", SIZE_PX)[1], parse_text_label(line, SIZE_PX)[1]):
        np.testing.assert_array_equal(got, expected)


def test_other_places_that_tools_use(cvat: Path):
    """An older list begins with data/; some tools write train/images instead of images/train."""
    (cvat / "train.txt").write_text("data/images/train/a.png\n")
    (cvat / "val" / "images").mkdir(parents=True)
    (cvat / "images" / "val" / "c.png").rename(cvat / "val" / "images" / "c.png")
    (cvat / "labels" / "val").rename(cvat / "val" / "labels")
    (cvat / "val.txt").write_text("val/images/c.png\n")
    assert [(picture.name, len(picture.boxes_px)) for picture in read(cvat).pictures] == [("a.png", 1), ("c.png", 1)]


@pytest.mark.parametrize(
    ("file", "old", "new", "words"),
    [
        ("data.yaml", "[7, 3]", "[17, 3]", r"data\.yaml: kpt_shape is \[17, 3\], expected \[7, 3\]"),
        ("data.yaml", "train.txt", "images/train", r"data\.yaml: train is 'images/train', expected a list"),
        ("data.yaml", "train.txt", "other.txt", r"other\.txt: no such file, but .*data\.yaml names it"),
        ("data.yaml", "names", "labels", r"data\.yaml: names is None"),
        ("train.txt", "images/train/a.png", "images/train/z.png", r"train\.txt:1: no picture .*Save images"),
        ("train.txt", "images/train/a.png", "../a.png", r"train\.txt:1: '\.\./a\.png', expected a picture inside"),
        ("labels/train/a.txt", " 0.4 0.5 2", "", r"a\.txt:1: 23 values, expected 26"),
        ("labels/train/a.txt", "0.4", "nan", r"a\.txt:1: .*not finite"),
        ("labels/train/a.txt", "0.4", "bow", r"a\.txt:1: .*not a number"),
        ("labels/train/a.txt", "1 0.5 0.5", "0 0.5 0.5", r"classes buoy, usv, expected one class"),
    ],
)
def test_a_fault_is_named(cvat: Path, file: str, old: str, new: str, words: str):
    text = (cvat / file).read_text()
    assert old in text
    (cvat / file).write_text(text.replace(old, new, 1))
    with pytest.raises((ValueError, FileNotFoundError), match=words):
        read(cvat)


def test_faults_in_a_zip_are_named_below_it_and_all_of_them(cvat: Path):
    for name in ("train/a", "val/c"):
        (cvat / "labels" / f"{name}.txt").write_text("1 2 3\n")
    source = Path(shutil.make_archive(str(cvat), "zip", cvat))
    faults = Faults(collect=True)
    assert [picture.name for picture in read(source, faults).pictures] == ["b.png"]
    assert [sentence.split(":1: ")[0] for sentence in faults.sentences] == [
        f"{source}/labels/train/a.txt",
        f"{source}/labels/val/c.txt",
    ]


def test_another_export_of_cvat_has_no_labels_here(cvat: Path):
    shutil.rmtree(cvat / "labels")
    with pytest.raises(ValueError, match=r"no labels/.*Ultralytics YOLO Pose"):
        read(cvat)


def test_a_broken_zip_is_refused(tmp_path: Path):
    (tmp_path / "export.zip").write_bytes(b"PK\3\4 and no more")
    with pytest.raises(ValueError, match=r"export\.zip: not a zip that can be unpacked"):
        read(tmp_path / "export.zip")
