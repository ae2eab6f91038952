"""The layout is documented at https://labelstud.io/guide/task_format, https://labelstud.io/tags/keypointlabels and
https://labelstud.io/tags/rectanglelabels; ``parentID`` groups regions (HumanSignal/label-studio, issue 6502)."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from usvnet.data.formats.label_studio import read_label_studio
from usvnet.data.records import Faults
from usvnet.types import KEYPOINT_NAMES

Task = dict[str, Any]
Edit = Callable[[list[Task]], object]


def regions(tasks: list[Task], task: int = 0) -> list[dict[str, Any]]:
    return tasks[task]["annotations"][0]["result"]


def read(path: Path, edit: Edit = lambda tasks: None, faults: Faults | None = None):
    tasks = json.loads(path.read_text())
    edit(tasks)
    path.write_text(json.dumps(tasks))
    return read_label_studio(path, path.parent, faults or Faults())


def test_pictures_boats_and_their_pixels(label_studio: Path):
    pictures, notes = read(label_studio)
    assert [(picture.name, len(picture.boxes_px)) for picture in pictures] == [("a.png", 1), ("I/b.png", 0)]
    assert notes == ["1 task without an annotation left out"]
    # 25 % of 160 px is the edge of a pixel: half a pixel before its centre
    np.testing.assert_allclose(pictures[0].boxes_px, [[39.5, 29.5, 119.5, 89.5]])
    np.testing.assert_allclose(pictures[0].labels.keypoints_px[0, 0], [0.3 * 160 - 0.5, 0.4 * 120 - 0.5])
    assert pictures[0].visibility.tolist() == [[2, 1, 1, 2, 2, 2, 2]]  # one said so in a note, one by a choice


def test_a_turned_rectangle_is_enclosed(label_studio: Path):
    """By 90 degrees clockwise about its top left corner: what was 80 px wide to the right now hangs down from it."""

    def edit(tasks: list[Task]) -> None:
        regions(tasks)[0]["value"] |= {"x": 60, "y": 10, "width": 50, "height": 20, "rotation": 90}

    box = read(label_studio, edit).pictures[0].boxes_px
    np.testing.assert_allclose(box, [[96 - 24 - 0.5, 11.5, 95.5, 12 + 80 - 0.5]])


def test_without_a_parent_a_keypoint_belongs_to_the_rectangle_around_it(label_studio: Path):
    before = read(label_studio).pictures[0].labels

    def edit(tasks: list[Task]) -> None:
        for region in regions(tasks):
            region.pop("parentID", None)

    for got, expected in zip(read(label_studio, edit).pictures[0].labels, before):
        np.testing.assert_array_equal(got, expected)


def test_two_boats_that_overlap_are_told_apart_by_parent_or_relation(label_studio: Path):
    def edit(tasks: list[Task]) -> None:
        second = json.loads(json.dumps(regions(tasks)[0])) | {"id": "second"}
        bow = json.loads(json.dumps(regions(tasks)[1])) | {"id": "second-bow"}
        bow.pop("parentID")
        relation = {"type": "relation", "from_id": "second-bow", "to_id": "second", "direction": "right"}
        regions(tasks).extend([second, bow, relation])

    visibility = read(label_studio, edit).pictures[0].visibility
    assert visibility.tolist() == [[2, 1, 1, 2, 2, 2, 2], [2, 0, 0, 0, 0, 0, 0]]


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (
            lambda tasks: regions(tasks)[0].update(original_width=320),
            r"original size is \(320, 120\), but .* 160 x 120",
        ),
        (lambda tasks: regions(tasks)[0].update(image_rotation=90), "image_rotation is 90, expected 0"),
        (
            lambda tasks: regions(tasks)[1]["value"].update(keypointlabels=["mast"]),
            "keypoint 'mast', expected one of bow",
        ),
        (lambda tasks: regions(tasks)[1]["value"].update(keypointlabels=["stern_left"]), "a second stern_left"),
        (lambda tasks: regions(tasks)[1]["value"].update(x="left"), "x: expected a finite number, got 'left'"),
        (lambda tasks: regions(tasks)[1].update(parentID="gone"), "bow belongs to 'gone', expected a rectangle"),
        (lambda tasks: regions(tasks)[0]["value"].update(width=0), "expected a width and a height above 0"),
        (lambda tasks: regions(tasks)[0]["value"].pop("height"), "height is missing"),
        (lambda tasks: tasks[0].pop("annotations"), "JSON-MIN"),
        (lambda tasks: tasks[0]["annotations"].append(tasks[0]["annotations"][0]), "2 annotations, expected one"),
        (lambda tasks: tasks[0]["data"].update(image="/data/upload/1/z.png"), r"no picture 'z\.png' below"),
        (lambda tasks: tasks[0]["data"].update(image="a.mp3"), "data names no picture"),
        (lambda tasks: tasks.append(tasks[0]), "a second task of"),
    ],
)
def test_a_fault_is_named_with_its_task(label_studio: Path, edit: Edit, words: str):
    with pytest.raises((ValueError, FileNotFoundError), match=rf"export\.json: tasks\[\d\]: .*{words}"):
        read(label_studio, edit)


def test_a_keypoint_in_no_or_two_rectangles_is_refused(label_studio: Path):
    def lonely(tasks: list[Task]) -> None:
        regions(tasks)[1].pop("parentID")
        regions(tasks)[1]["value"]["x"] = 1

    with pytest.raises(ValueError, match="bow lies in 0 rectangles, expected one"):
        read(label_studio, lonely)


def test_every_fault_is_gathered(label_studio: Path):
    def edit(tasks: list[Task]) -> None:
        regions(tasks)[0]["image_rotation"] = 90
        tasks[1]["data"]["image"] = "z.png"

    faults = Faults(collect=True)
    assert read(label_studio, edit, faults).pictures == []
    assert len(faults.sentences) == 2


def test_ground_truth_counts_where_several_people_labelled(label_studio: Path):
    def edit(tasks: list[Task]) -> None:
        tasks[1]["annotations"].append(tasks[0]["annotations"][0] | {"ground_truth": True})

    assert [len(picture.boxes_px) for picture in read(label_studio, edit).pictures] == [1, 1]


def test_the_fixture_holds_every_keypoint(label_studio: Path):
    names = [region["value"]["keypointlabels"][0] for region in regions(json.loads(label_studio.read_text()))[1:8]]
    assert [name.lower().replace(" ", "_") for name in names] == list(KEYPOINT_NAMES)
