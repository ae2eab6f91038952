"""Small exports of other tools, written by hand in the layouts that those tools document."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from usvnet.types import KEYPOINT_NAMES

SIZE_PX = (160, 120)


def write_picture(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.full((SIZE_PX[1], SIZE_PX[0], 3), 90, np.uint8))


def write_text(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def write_cvat(folder: Path) -> Path:
    """Two classes in the task, one of them in use; train and val; a boat that hangs out of its picture."""
    write_text(
        folder / "data.yaml",
        "names:\n  0: buoy\n  1: usv\npath: .\ntrain: train.txt\nval: val.txt\nkpt_shape: [7, 3]\n",
    )
    write_text(folder / "train.txt", "images/train/a.png\nimages/train/b.png\n")
    write_text(folder / "val.txt", "images/val/c.png\n")
    seen = " 0.45 0.5 2" * 4
    write_text(folder / "labels/train/a.txt", f"1 0.5 0.5 0.25 0.2 0.4 0.5 2 0.42 0.5 1 0.0 0.0 0{seen}\n")
    write_text(folder / "labels/val/c.txt", f"1 0.0 0.5 0.2 0.2 -0.1 0.5 2 0.05 0.5 2 0.02 0.5 2{seen}\n")
    write_text(folder / "labels/train/b.txt", "")
    for name in ("train/a", "train/b", "val/c"):
        write_picture(folder / "images" / f"{name}.png")
    return folder


def region(kind: str, key: str, value: dict[str, Any], **more: Any) -> dict[str, Any]:
    """What Label Studio writes for one region."""
    return {
        "original_width": SIZE_PX[0],
        "original_height": SIZE_PX[1],
        "image_rotation": 0,
        "value": value,
        "id": key,
        "from_name": "label",
        "to_name": "image",
        "type": kind,
        "origin": "manual",
        **more,
    }


def write_label_studio(folder: Path) -> Path:
    """An uploaded picture with a boat, one from local files without, and one that nobody has labelled yet."""
    boat = {"x": 25, "y": 25, "width": 50, "height": 50, "rotation": 0, "rectanglelabels": ["usv"]}
    result = [region("rectanglelabels", "boat", boat)]
    for number, name in enumerate(KEYPOINT_NAMES):
        label = name.replace("_", " ").title() if number % 2 else name
        value = {"x": 30 + 5 * number, "y": 40 + number, "width": 0.5, "keypointlabels": [label]}
        result.append(region("keypointlabels", name, value, parentID="boat"))
    result[2]["meta"] = {"text": ["hidden"]}
    result.append(region("choices", "bow_right", {"x": 40, "y": 42, "width": 0.5, "choices": ["Hidden"]}))
    tasks = [
        {
            "id": 1,
            "annotations": [
                {"id": 11, "completed_by": 1, "result": result, "was_cancelled": False, "ground_truth": False}
            ],
            "file_upload": "0123abcd-a.png",
            "data": {"image": "/data/upload/1/0123abcd-a.png"},
            "predictions": [],
        },
        {
            "id": 2,
            "annotations": [{"id": 12, "result": [], "was_cancelled": False, "ground_truth": False}],
            "data": {"image": "/data/local-files/?d=boats/I/b.png"},
        },
        {"id": 3, "annotations": [], "data": {"image": "https://example.org/boats/c.png"}},
    ]
    for name in ("a", "I/b", "c"):
        write_picture(folder / f"{name}.png")
    write_text(folder / "export.json", json.dumps(tasks, indent=2))
    return folder / "export.json"


def write_scene_folder(folder: Path) -> Path:
    """Two scenes of two pictures, one boat without and two with visibility, and two laser ranges."""
    write_text(folder / "I/0001.txt", "0 0.5 0.5 0.2 0.2" + " 0.45 0.5" * 7 + "\n")
    with_visibility = "0 0.5 0.5 0.2 0.2 0.45 0.5 2 0.42 0.5 1 0.0 0.0 0" + " 0.45 0.5 2" * 4 + "\n"
    write_text(folder / "VI/0001.txt", with_visibility)
    write_text(folder / "VI/0002.txt", with_visibility)
    for name in ("I/0001", "I/0002", "VI/0001", "VI/0002"):
        write_picture(folder / f"{name}.png")
    write_text(folder / "laser.csv", "Image,Range (m),note\nI/0001.png,7.25,calm\nVI/0001,12.5,\nVI/0002.png,,\n")
    return folder
