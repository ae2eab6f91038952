"""COCO keypoints JSON: all pictures and boats of a split in one file.

COCO leaves half a pixel open. We read it as labelling tools write it, the number that they divide by the picture's
width for YOLO: u = x - 0.5 (:mod:`usvnet.data.formats.fractions`), so that the two formats of one tool agree. (The
people of the original COCO set were marked in whole pixel numbers instead.)
"""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from usvnet.data.formats.fractions import from_boat, to_boat
from usvnet.data.formats.json_files import read_json
from usvnet.data.records import Faults, Frame, Labels
from usvnet.files import atomic_write
from usvnet.geometry.yaml_files import as_mapping, short
from usvnet.types import KEYPOINT_NAMES, NUM_KEYPOINTS


def read_coco(path: Path, faults: Faults) -> dict[str, tuple[Labels, tuple[int, int]]]:
    """Read the boats and the size (width, height) of every picture, by its ``file_name`` below images/.

    Boats stand in the order of the file: ``instance`` in ranges.csv counts them. Annotations of crowds are refused.

    Raises:
        FileNotFoundError: no such file.
        ValueError: naming the file and the annotation (or noted in ``faults``).
    """
    content = read_json(path)
    found = content if isinstance(content, dict) else {}
    images, annotations, categories = found.get("images"), found.get("annotations"), found.get("categories", [])
    if not (isinstance(images, list) and isinstance(annotations, list) and isinstance(categories, list)):
        raise ValueError(f"{path}: expected the keys 'images', 'annotations' and 'categories' of COCO, a list each")
    for category in categories:
        names = category.get("keypoints", list(KEYPOINT_NAMES)) if isinstance(category, dict) else category
        if names != list(KEYPOINT_NAMES):
            raise ValueError(f"{path}: keypoints are {short(names)}, expected {list(KEYPOINT_NAMES)}")
    if len(categories) > 1:
        raise ValueError(f"{path}: {len(categories)} categories, expected one")
    pictures: dict[Any, tuple[str, tuple[int, int]]] = {}
    boats: dict[str, list[Labels]] = {}
    for number, image in enumerate(images):
        with faults.catch():
            try:
                name, size_px = str(image["file_name"]), (int(image["width"]), int(image["height"]))
                if min(size_px) < 1:
                    raise ValueError("a picture without pixels")
                image_id = image["id"]
            except (KeyError, TypeError, ValueError, OverflowError):
                expected = "id, file_name, width and height"
                raise ValueError(f"{path}: images[{number}] is {short(image)}, expected {expected}") from None
            if name in boats:
                raise ValueError(f"{path}: images[{number}] is a second {name}")
            boats[name], pictures[image_id] = [], (name, size_px)
    for number, annotation in enumerate(annotations):
        with faults.catch():
            try:
                missing = {"image_id", "bbox", "keypoints"} - set(as_mapping(annotation, "annotation"))
                if missing:
                    raise ValueError(f"no {' and no '.join(sorted(missing))}")
                if annotation["image_id"] not in pictures:
                    image_id = short(annotation["image_id"])
                    raise ValueError(f"image_id is {image_id}, expected the id of one of 'images'")
                name, size_px = pictures[annotation["image_id"]]
                boats[name].append(_parse(annotation, size_px))
            except (TypeError, ValueError, OverflowError) as error:
                raise ValueError(f"{path}: annotations[{number}]: {error}") from None
    return {name: (Labels.of(boats[name]), size_px) for name, size_px in pictures.values()}


def _parse(annotation: dict[str, Any], size_px: tuple[int, int]) -> Labels:
    """Turn one annotation into the labels of one boat."""
    if annotation.get("iscrowd"):
        raise ValueError("iscrowd is set, expected single boats")
    box, values = np.array(annotation["bbox"], float), np.array(annotation["keypoints"], float)
    if box.shape != (4,):
        raise ValueError(f"bbox of {box.size} numbers, expected x, y, width, height")
    if values.shape != (3 * NUM_KEYPOINTS,):
        raise ValueError(f"{values.size} keypoint values ({values.size / 3:g} keypoints), expected {3 * NUM_KEYPOINTS}")
    box[:2] += box[2:] / 2
    return to_boat(box / np.tile(size_px, 2), values.reshape(NUM_KEYPOINTS, 3) / (*size_px, 1), size_px)


def write_coco(frames: Iterable[Frame], path: Path) -> None:
    """Write the labels of frames as one COCO file: the inverse of :func:`read_coco`.

    Raises:
        ValueError: a coordinate is not finite.
    """
    category = {"id": 1, "name": "usv", "supercategory": "boat", "keypoints": list(KEYPOINT_NAMES), "skeleton": []}
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for frame in frames:
        width, height = frame.size_px
        images.append({"id": len(images) + 1, "file_name": frame.name, "width": width, "height": height})
        for i in range(len(frame.boxes_px)):
            box, points = from_boat(frame.labels.boat(i), frame.size_px)
            centre_x, centre_y, wide, high = (box * np.tile(frame.size_px, 2)).tolist()
            keypoints = [[x, y, int(visibility)] for x, y, visibility in (points * (*frame.size_px, 1)).tolist()]
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": len(images),
                    "category_id": 1,
                    "iscrowd": 0,
                    "bbox": [centre_x - wide / 2, centre_y - high / 2, wide, high],
                    "area": wide * high,
                    "keypoints": [number for keypoint in keypoints for number in keypoint],
                    "num_keypoints": int((points[:, 2] > 0).sum()),
                }
            )
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps({"images": images, "annotations": annotations, "categories": [category]}))
