"""From the truths of rendered frames to a dataset that can be read: labels, tables, cameras, hulls and data.yaml.

Everything here follows from the truths alone, so it is written anew after every run, ``data.yaml`` last: a folder
without it is not finished and no reader takes it for a dataset.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import torch

from usvnet.data.formats.coco import write_coco
from usvnet.data.formats.ranges import RANGE_COLUMNS
from usvnet.data.formats.yolo import write_data_yaml, write_yolo
from usvnet.data.records import SPLITS, Frame, Labels
from usvnet.geometry.camera_files import save_camera
from usvnet.geometry.hull_files import save_hull
from usvnet.simulator.dataset_writer import IMAGES, read_truths
from usvnet.simulator.tables import boat_rows, frame_row, range_rows, write_table
from usvnet.simulator.truth import Truth, numbers_or_nan
from usvnet.types import NEAREST_WATERLINE, NUM_KEYPOINTS, Camera, Hull

DATA_YAML = "data.yaml"
CORNER_PX = -0.5
"""Where a keypoint outside the picture is put: the picture's corner, which label files spell 0 0 0."""


def write_dataset_files(root: Path, cameras: dict[str, Camera]) -> int:
    """Write all files of a dataset but the pictures, of every whole frame in the folder, and return their number.

    Args:
        root: the folder of the dataset.
        cameras: by name, as they are mounted.

    Raises:
        ValueError: there is no whole frame, a truth is damaged, or one hull has two shapes.
    """
    (root / DATA_YAML).unlink(missing_ok=True)
    truths = list(read_truths(root))
    if not truths:
        raise ValueError(f"{root}: not one frame has been rendered")
    for name, camera in sorted(cameras.items()):
        save_camera(camera, root / "cameras" / f"{name}.yaml", name=name)
    for name, keypoints_m in sorted(_hulls(truths).items()):
        points_m, exact = torch.from_numpy(keypoints_m.astype(np.float32))[None], torch.zeros(1)
        save_hull(Hull(points_m, scale_std=exact, point_std_m=exact), root / "hulls" / f"{name}.yaml")
    first_with_boat = sorted(truths, key=lambda truth: not truth["boats"])[:1]
    columns = [key for truth in first_with_boat for key in frame_row(truth)]
    write_table(root / "frames.csv", [frame_row(truth) for truth in truths], columns)
    write_table(root / "boats.csv", [row for truth in truths for row in boat_rows(truth)], ("image", "instance"))
    write_table(root / "ranges.csv", [row for truth in truths for row in range_rows(truth)], RANGE_COLUMNS)
    splits = [split for split in SPLITS if any(truth["spec"]["split"] == split for truth in truths)]
    for split in splits:
        frames = [_frame(root, truth, cameras) for truth in truths if truth["spec"]["split"] == split]
        write_yolo(frames, root / "labels")
        write_coco(frames, root / "annotations" / f"{split}.json")
    write_data_yaml(root / DATA_YAML, {split: f"{IMAGES}/{split}" for split in splits})
    return len(truths)


def boat_labels(boat: dict[str, Any]) -> Labels:
    """The box and keypoints of one boat of a truth; keypoints outside the picture are put into its corner.

    Their true pixels stay in the truth. Label files hold fractions from 0 to 1, and Ultralytics drops a picture with
    others.
    """
    visibility = np.array(boat["visibility"], np.int64)
    keypoints_px = np.where(visibility[:, None] > 0, numbers_or_nan(boat["keypoints_px"]), CORNER_PX)
    return Labels(numbers_or_nan(boat["box_px"])[None], keypoints_px[None], visibility[None])


def _frame(root: Path, truth: Truth, cameras: dict[str, Camera]) -> Frame:
    labels = Labels.of([boat_labels(boat) for boat in truth["boats"]])
    boats, name = len(labels.boxes_px), truth["image"]
    return Frame(
        root / IMAGES / name,
        name,
        truth["spec"]["scene"],
        cameras[truth["spec"]["camera_name"]],
        *labels,
        range_m=np.zeros(boats),
        range_std_m=np.zeros(boats),
        reference=np.full(boats, NEAREST_WATERLINE, np.int64),
    )


def _hulls(truths: Iterable[Truth]) -> dict[str, np.ndarray]:
    """The keypoints (7, 3) of each hull that can be seen, by its name."""
    hulls: dict[str, np.ndarray] = {}
    for truth in truths:
        for boat in truth["boats"]:
            name, keypoints_m = boat["spec"]["hull"]["name"], numbers_or_nan(boat["hull_keypoints_m"])
            if keypoints_m.shape != (NUM_KEYPOINTS, 3) or not np.array_equal(
                hulls.setdefault(name, keypoints_m), keypoints_m
            ):
                raise ValueError(f"{truth['image']}: the keypoints of hull {name} are not those of other pictures")
    return hulls
