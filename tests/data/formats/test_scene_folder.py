from pathlib import Path

import numpy as np
import pytest

from usvnet.data.formats.scene_folder import read_scene_folder
from usvnet.data.records import Faults


def test_scenes_boats_and_ranges(scene_folder: Path):
    pictures, _ = read_scene_folder(scene_folder, Faults())
    assert [(picture.name, picture.scene, picture.split) for picture in pictures] == [
        ("I/0001.png", "I", None),
        ("I/0002.png", "I", None),
        ("VI/0001.png", "VI", None),
        ("VI/0002.png", "VI", None),
    ]
    assert [picture.range_m.tolist() for picture in pictures] == [[7.25], [], [12.5], [0.0]]
    np.testing.assert_allclose(pictures[0].boxes_px, [[63.5, 47.5, 95.5, 71.5]])
    assert pictures[0].visibility.tolist() == [[2] * 7]  # a line without visibility
    assert pictures[2].visibility.tolist() == [[2, 1, 0, 2, 2, 2, 2]]


def test_the_table_of_another_country(scene_folder: Path):
    (scene_folder / "laser.csv").write_bytes("\ufeffScene;Image;Distance (m)\nVI;0001;12,5\nI;0001.png;7,25\n".encode())
    ranges = [picture.range_m.tolist() for picture in read_scene_folder(scene_folder, Faults()).pictures]
    assert ranges == [[7.25], [], [12.5], [0.0]]


def test_pictures_and_labels_in_folders_of_their_own_and_splits(scene_folder: Path):
    for scene in ("I", "VI"):
        for suffix, kind in ((".png", "images"), (".txt", "labels")):
            for path in sorted((scene_folder / scene).glob(f"*{suffix}")):
                target = scene_folder / kind / "test" / scene / path.name
                target.parent.mkdir(parents=True, exist_ok=True)
                path.rename(target)
    pictures, _ = read_scene_folder(scene_folder, Faults())
    assert [(picture.name, picture.scene, picture.split) for picture in pictures[:1]] == [("I/0001.png", "I", "test")]
    assert [picture.range_m.tolist() for picture in pictures] == [[7.25], [], [12.5], [0.0]]


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("laser.csv", "image,height\nI/0001.png,3\n", r"laser\.csv:1: 0 columns of range, range_m"),
        ("laser.csv", "image,range,distance\nI/0001.png,3,3\n", r"laser\.csv:1: 2 columns of range"),
        ("laser.csv", "image,range\nI/0001.png,far\n", r"laser\.csv:2: range_m is far, expected a number"),
        ("laser.csv", "image,range\nI/0001.png,-3\n", r"laser\.csv:2: range -3 m"),
        ("laser.csv", "image,range\n0001.png,3\n", r"laser\.csv:2: image is 0001\.png, which 2 pictures could be"),
        ("laser.csv", "image,range\n0009.png,3\n", r"laser\.csv:2: image is 0009\.png, which 0 pictures could be"),
        ("laser.csv", "image,range\n,3\n", r"laser\.csv:2: a range without a picture"),
        ("laser.csv", "image,range\nI/0001,3\nI/0001.png,3\n", r"laser\.csv:3: a second range for boat 0"),
        ("laser.csv", "image,range\nI/0002.png,3\n", r"laser\.csv:2: a range for boat 0 of .*has 0 boats"),
        ("laser.csv", "image,range,boat\nI/0001.png,3,-1\n", r"laser\.csv:2: instance is -1"),
        ("laser.csv", "image,range,reference\nI/0001.png,3,mast\n", r"laser\.csv:2: reference is mast"),
        (
            "laser.csv",
            "image,range,scene\nI/0001,3,II\n",
            r"laser\.csv:2: scene is II, but I/0001\.png lies in .* scene I$",
        ),
        (
            "laser.csv",
            "image,range,scene\nI/0001,3,I\nI/0001,,II\n",
            r"laser\.csv:3: scene of .* is II, but .*:2 says I$",
        ),
        ("I/0001.txt", "0 0.5\n", r"0001\.txt:1: 2 values, expected 26"),
        ("I/0001.png", "", r"0001\.png: corrupt picture"),
    ],
)
def test_a_fault_is_named(scene_folder: Path, file: str, text: str, words: str):
    (scene_folder / file).write_text(text)
    with pytest.raises(ValueError, match=words):
        read_scene_folder(scene_folder, Faults())


def test_a_folder_without_labels_is_refused(scene_folder: Path):
    for path in scene_folder.rglob("*.txt"):
        path.unlink()
    with pytest.raises(FileNotFoundError, match="no labels, expected a text file such as"):
        read_scene_folder(scene_folder, Faults())


def test_a_table_says_the_scene_of_pictures_that_lie_together(scene_folder: Path):
    for scene in ("I", "VI"):
        for path in sorted((scene_folder / scene).iterdir()):
            path.rename(scene_folder / f"{scene}_{path.name}")
    (scene_folder / "laser.csv").write_text("image,range,scene\nI_0001,7.25,I\nVI_0001,12.5,VI\nVI_0002,,VI\nIX,,IX\n")
    pictures = read_scene_folder(scene_folder, Faults()).pictures
    assert [picture.scene for picture in pictures] == ["I", None, "VI", "VI"]
    assert [picture.range_m.tolist() for picture in pictures] == [[7.25], [], [12.5], [0.0]]
