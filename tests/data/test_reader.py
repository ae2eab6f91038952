import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from usvnet.data import Faults, read_dataset
from usvnet.data.check import check_dataset
from usvnet.data.formats.coco import write_coco
from usvnet.data.formats.yolo import write_data_yaml
from usvnet.geometry.camera_files import load_camera, save_camera
from usvnet.geometry.hull_files import save_hull
from usvnet.geometry.hull_model import generic_hull
from usvnet.types import Hull


def read_hulls(root: Path, split: str) -> list[Hull]:
    return [frame.hull for frame in read_dataset(root, split)]


def append(path: Path, text: str) -> None:
    with path.open("a") as stream:
        stream.write(text)


def test_a_dataset_is_put_together(tiny: Path, make_frame):
    frames = read_dataset(tiny, "train")
    assert [frame.name for frame in frames] == [f"train/{i:04d}.png" for i in range(4)]
    for number, frame in enumerate(frames):
        expected = make_frame(number)
        np.testing.assert_allclose(frame.keypoints_px, expected.keypoints_px, atol=1e-6)
        np.testing.assert_allclose(frame.range_m, expected.range_m)
        assert (frame.scene, frame.size_px, frame.range_std_m[0]) == (expected.scene, expected.size_px, 0.01)


def test_coco_and_yolo_give_the_same_frames(tiny: Path):
    yolo = read_dataset(tiny, "train")
    write_coco(yolo, tiny / "annotations" / "train.json")
    write_data_yaml(tiny / "data.yaml", {"train": "annotations/train.json"})
    for ours, theirs in zip(yolo, read_dataset(tiny, "train"), strict=True):
        assert ours.name == theirs.name
        np.testing.assert_allclose(ours.boxes_px, theirs.boxes_px, atol=1e-9)
        np.testing.assert_array_equal(ours.range_m, theirs.range_m)


def test_a_measured_attitude_replaces_the_mounts(tiny: Path):
    (tiny / "frames.csv").write_text("image,pitch_deg,roll_std_deg,true_roll_deg\ntrain/0001.png,9.5,0.2,77\n")
    mount, measured = (frame.camera for frame in read_dataset(tiny, "train")[:2])
    assert math.degrees(mount.pitch_rad.item()) == pytest.approx(math.degrees(0.12), abs=1e-5)
    assert math.degrees(measured.pitch_rad.item()) == pytest.approx(9.5, abs=1e-5)
    assert math.degrees(measured.roll_std_rad.item()) == pytest.approx(0.2, abs=1e-5)
    assert measured.roll_rad == mount.roll_rad
    assert measured.pitch_std_rad == mount.pitch_std_rad


def test_several_cameras_are_told_apart(tiny: Path):
    other = load_camera(tiny / "cameras" / "front.yaml")._replace(height_m=torch.tensor([3.0]))
    save_camera(other, tiny / "cameras" / "mast.yaml")
    (tiny / "frames.csv").write_text("image,camera\ntrain/0001.png,front\n")
    with pytest.raises(ValueError, match=r"frames\.csv: no camera for train/0000\.png, expected one of front, mast"):
        read_dataset(tiny, "train")
    rows = "".join(f"train/{i:04d}.png,{'mast' if i == 2 else 'front'}\n" for i in range(4))
    (tiny / "frames.csv").write_text("image,camera\n" + rows)
    assert [frame.camera.height_m.item() for frame in read_dataset(tiny, "train")] == [1.5, 1.5, 3.0, 1.5]
    (tiny / "frames.csv").write_text("image,camera\n" + rows.replace("mast", "stern"))
    with pytest.raises(ValueError, match=r"camera stern is named, expected one of front, mast"):
        read_dataset(tiny, "train")


def test_the_hull_is_the_one_named_else_the_only_one_else_a_generic_one(tiny: Path):
    known = Hull(1.3 * generic_hull().points_m, scale_std=torch.tensor([0.1]), point_std_m=torch.tensor([0.01]))
    for hull in read_hulls(tiny, "train"):
        torch.testing.assert_close(hull.points_m, generic_hull().points_m)
    save_hull(known, tiny / "hulls" / "skiff.yaml")
    assert all(torch.equal(hull.points_m, known.points_m) for hull in read_hulls(tiny, "train"))
    save_hull(known._replace(points_m=2 * known.points_m), tiny / "hulls" / "barge.yaml")
    (tiny / "frames.csv").write_text("image,hull\ntrain/0001.png,barge\ntrain/0002.png,skiff\ntrain/0003.png,\n")
    unnamed, barge, skiff, empty = read_hulls(tiny, "train")
    for hull in (unnamed, empty):
        torch.testing.assert_close(hull.points_m, generic_hull().points_m)
    assert torch.equal(barge.points_m, 2 * skiff.points_m)
    assert skiff.scale_std == known.scale_std
    (tiny / "frames.csv").write_text("image,hull\ntrain/0001.png,yacht\n")
    with pytest.raises(ValueError, match=r"hull yacht is named, expected one of barge, skiff"):
        read_dataset(tiny, "train")


def test_an_empty_label_is_an_empty_frame(tiny: Path):
    (tiny / "labels" / "val" / "0004.txt").write_text("")
    (tiny / "labels" / "val" / "0005.txt").unlink()
    (tiny / "ranges.csv").unlink()
    assert [len(frame.boxes_px) for frame in read_dataset(tiny, "val")] == [0, 0]


FAULTS: dict[str, tuple[Callable[[Path], object], str]] = {
    "label without picture": (
        lambda root: [(root / "ranges.csv").unlink(), (root / "images/train/0002.png").unlink()],
        r"labels.train.0002\.txt: a label without its picture",
    ),
    "range without picture": (
        lambda root: append(root / "ranges.csv", "train/7777.png,4,0.01,I\n"),
        r"ranges\.csv:9: no picture .*7777\.png",
    ),
    "range without boat": (
        lambda root: (root / "labels/train/0001.txt").write_text(""),
        r"ranges\.csv:3: a range for instance 0, but .*0001\.txt has 0 boats",
    ),
    "no pictures": (
        lambda root: (
            [path.unlink() for path in (*root.glob("images/train/*"), *root.glob("labels/train/*"))]
            and (root / "ranges.csv").unlink()
        ),
        r"images.train: no pictures",
    ),
    "no folder": (
        lambda root: write_data_yaml(root / "data.yaml", {"train": "images/trian"}),
        r"images.trian: no such folder, named in .*data\.yaml",
    ),
    "no split": (
        lambda root: write_data_yaml(root / "data.yaml", {"val": "images/val"}),
        r"data\.yaml: no split 'train', expected one of val",
    ),
    "no data.yaml": (lambda root: (root / "data.yaml").unlink(), r"data\.yaml: no such file"),
    "no camera": (lambda root: (root / "cameras/front.yaml").unlink(), r"cameras: no camera file"),
    "no COCO file": (
        lambda root: write_data_yaml(root / "data.yaml", {"train": "annotations/train.json"}),
        r"train\.json",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_one_sentence_with_its_place(tiny: Path, fault: str):
    spoil, words = FAULTS[fault]
    spoil(tiny)
    with pytest.raises((ValueError, OSError), match=words):
        read_dataset(tiny, "train")


def test_collecting_finds_every_fault_and_keeps_the_sound_frames(tiny: Path):
    append(tiny / "ranges.csv", "train/7777.png,4,0.01,I\ntrain/0003.png,-4,0.01,II\n")
    label = tiny / "labels/train/0002.txt"
    label.write_text(label.read_text().rsplit(" ", 3)[0])
    faults = Faults(collect=True)
    frames = read_dataset(tiny, "train", faults)
    assert [frame.name for frame in frames] == ["train/0000.png", "train/0001.png", "train/0003.png"]
    assert len(faults.sentences) == 3


def test_a_camera_that_is_missing_is_one_fault_however_many_pictures_name_it(tiny: Path):
    rows = [f"train/{number:04d}.png,stern" for number in range(3)]
    (tiny / "frames.csv").write_text("\n".join(["image,camera", *rows]) + "\n")
    frames, faults = check_dataset(tiny)
    assert [len(members) for members in frames.values()] == [1, 2, 1]
    (fault,) = faults
    assert "frames.csv: camera stern is named, expected one of front (the files in" in fault


def test_several_cameras_and_no_table_that_tells_them_apart_is_one_fault(tiny: Path):
    save_camera(load_camera(tiny / "cameras" / "front.yaml"), tiny / "cameras" / "aft.yaml")
    (tiny / "frames.csv").unlink(missing_ok=True)
    _, (fault,) = check_dataset(tiny)
    assert "frames.csv: no such file, which names the camera of every picture, expected one of aft, front" in fault


def test_hidden_files_are_no_pictures(tiny: Path):
    """macOS leaves ``._photo.jpg`` beside photographs on a card."""
    names = [frame.image_path.name for frame in read_dataset(tiny, "train")]
    (tiny / f"images/train/._{names[0]}").write_bytes(b"a resource fork")
    assert [frame.image_path.name for frame in read_dataset(tiny, "train")] == names
