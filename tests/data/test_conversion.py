import shutil
from pathlib import Path

import numpy as np
import pytest

from usvnet.data.conversion import detect_format, keep_splits, open_export, share_out, write_dataset
from usvnet.data.formats.exports import LabelledPicture
from usvnet.data.reader import read_dataset
from usvnet.data.records import Faults, Labels
from usvnet.geometry.camera import make_camera
from usvnet.geometry.camera_files import save_camera


def picture(name: str, scene: str | None = None, split: str | None = None) -> LabelledPicture:
    return LabelledPicture(Path("somewhere") / name, name, split, scene, (160, 120), Labels.of([]))


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    K = [[170, 0, 80], [0, 170, 60], [0, 0, 1]]
    save_camera(make_camera(K, (160, 120), [0.0] * 5, height_m=1.5, pitch_rad=0.1), tmp_path / "front.yml")
    return tmp_path / "front.yml"


def test_formats_are_told_apart(cvat: Path, label_studio: Path, scene_folder: Path, root: Path, tmp_path: Path):
    assert detect_format(cvat) == "cvat"
    assert detect_format(Path(shutil.make_archive(str(tmp_path / "x"), "zip", cvat))) == "cvat"
    assert detect_format(label_studio) == "labelstudio"
    assert detect_format(scene_folder) == "folder"
    assert detect_format(root / "data" / "sample") is None
    assert detect_format(tmp_path / "nothing") is None


def test_sharing_out_keeps_every_picture_once_and_scenes_in_proportion():
    pictures = [picture(f"{scene}/{number:03d}.png", scene) for scene in ("I", "VI") for number in range(50)]
    splits = share_out(pictures, (0.7, 0.2, 0.1), seed=0)
    assert sorted(each.name for members in splits.values() for each in members) == [each.name for each in pictures]
    for split, share in (("train", 35), ("val", 10), ("test", 5)):
        assert [sum(each.scene == scene for each in splits[split]) for scene in ("I", "VI")] == [share, share]
    assert share_out(pictures[::-1], (0.7, 0.2, 0.1), seed=0) == splits  # whatever order the disk gives them in
    assert share_out(pictures, (0.7, 0.2, 0.1), seed=1) != splits


def test_splits_are_kept_only_where_there_are_several():
    assert keep_splits([picture("a", split="train"), picture("b", split="train")]) is None
    assert keep_splits([picture("a", split="train"), picture("b")]) is None
    assert list(map(len, keep_splits([picture("a", split="train"), picture("b", split="test")]).values())) == [1, 0, 1]


def test_what_is_written_reads_back_to_the_last_digit(scene_folder: Path, camera: Path, tmp_path: Path):
    with open_export(scene_folder, "folder", Faults()) as export:
        write_dataset({"train": export.pictures[:3], "val": export.pictures[3:], "test": []}, tmp_path / "out", camera)
        frames = read_dataset(tmp_path / "out", "train") + read_dataset(tmp_path / "out", "val")
        assert [frame.name for frame in frames] == [
            "train/I/0001.png", "train/I/0002.png", "train/VI/0001.png", "val/VI/0002.png",
        ]  # fmt: skip
        for frame, original in zip(frames, export.pictures):
            assert frame.image_path.read_bytes() == original.path.read_bytes()
            assert frame.scene == original.scene
            assert frame.range_m.tolist() == original.range_m.tolist()
            for got, expected in zip(frame.labels, original.labels):
                np.testing.assert_allclose(got, expected, atol=1e-6)
    assert (tmp_path / "out" / "cameras" / "front.yaml").read_bytes() == camera.read_bytes()


def test_a_picture_of_another_size_writes_nothing(scene_folder: Path, camera: Path, tmp_path: Path):
    camera.write_text(camera.read_text().replace("image_width: 160", "image_width: 161"))
    before = sorted(tmp_path.iterdir())
    with (
        open_export(scene_folder, "folder", Faults()) as export,
        pytest.raises(ValueError, match=r"0001\.png: picture of 160 x 120, expected 161 x 120"),
    ):
        write_dataset({"train": export.pictures}, tmp_path / "out", camera)
    assert sorted(tmp_path.iterdir()) == before


def test_stopped_while_copying_leaves_nothing(scene_folder: Path, tmp_path: Path):
    def follow(named: list) -> list:
        yield named[0]
        raise KeyboardInterrupt

    before = sorted(tmp_path.iterdir())
    with open_export(scene_folder, "folder", Faults()) as export, pytest.raises(KeyboardInterrupt):
        write_dataset({"train": export.pictures}, tmp_path / "out", follow=follow)
    assert sorted(tmp_path.iterdir()) == before


def test_two_pictures_of_one_label_file_are_refused(tmp_path: Path):
    with pytest.raises(ValueError, match=r"a\.jpg: would share the label file of .*a\.png"):
        write_dataset({"train": [picture("a.png"), picture("a.jpg")]}, tmp_path / "out")


@pytest.mark.parametrize(
    ("scenes", "members", "expected"),
    [(1, 5, [3, 1, 1]), (40, 1, [28, 8, 4]), (7, 3, [15, 4, 2]), (1, 3, [1, 1, 1]), (1, 2, [2, 0, 0])],
)
def test_small_scenes_leave_no_split_without_its_share(scenes: int, members: int, expected: list[int]):
    pictures = [picture(f"{scene}/{n}.png", str(scene)) for scene in range(scenes) for n in range(members)]
    splits = share_out(pictures, (0.7, 0.2, 0.1), seed=0)
    assert list(map(len, splits.values())) == expected
    assert sorted(each.name for dealt in splits.values() for each in dealt) == sorted(each.name for each in pictures)
    assert share_out(pictures[::-1], (0.7, 0.2, 0.1), seed=0) == splits


def test_a_split_without_a_share_gets_nothing():
    assert share_out([picture(f"{n}.png") for n in range(11)], (0.5, 0.5, 0.0), seed=0)["test"] == []


def test_a_picture_of_no_split_among_splits_is_named():
    pictures = [picture("a", split="train"), picture("b", split="val"), picture("I/stray.png")]
    with pytest.raises(ValueError, match=r"stray\.png: in no split, while .* in train and val: .* --split"):
        keep_splits(pictures)
