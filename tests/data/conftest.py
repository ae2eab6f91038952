"""A tiny dataset with a tilted, distorted camera, and boats whose numbers the tests know."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from usvnet.data.formats.yolo import write_data_yaml, write_yolo
from usvnet.data.records import Frame
from usvnet.geometry.camera import make_camera
from usvnet.geometry.camera_files import save_camera
from usvnet.types import Camera

SIZE_PX = (160, 120)


def tilted_camera(size_px: tuple[int, int] = SIZE_PX) -> Camera:
    width, height = size_px
    K = [[1.1 * width, 0, 0.52 * width], [0, 1.1 * width, 0.47 * height], [0, 0, 1]]
    return make_camera(K, size_px, [-0.1, 0.02, 0.001, -0.002, 0.0], height_m=1.5, pitch_rad=0.12, roll_rad=0.04)


def boat_frame(path: Path, name: str, number: int, size_px: tuple[int, int] = SIZE_PX, boats: int = 1) -> Frame:
    """Boats at places drawn from ``number``, all below the horizon, the first with a laser range."""
    rng = np.random.default_rng(number)
    size = np.array(size_px)
    centre = rng.uniform((0.3, 0.6), (0.7, 0.7), (boats, 2)) * size
    keypoints = centre[:, None] + rng.uniform(-0.08, 0.08, (boats, 7, 2)) * size
    visibility = rng.integers(1, 3, (boats, 7))
    boxes = np.concatenate((keypoints.min(1) - 1, keypoints.max(1) + 1), -1)
    range_m = np.where(np.arange(boats) == 0, 5.0 + number, 0.0)
    return Frame(
        image_path=path / "images" / name,
        name=name,
        scene=("I", "VI")[number % 2],
        camera=tilted_camera(size_px),
        boxes_px=boxes,
        keypoints_px=keypoints,
        visibility=visibility,
        range_m=range_m,
        range_std_m=np.where(range_m > 0, 0.01, 0.0),
        reference=np.full(boats, -1),
    )


@pytest.fixture
def make_frame(tmp_path: Path) -> Callable[..., Frame]:
    def make(number: int = 0, **settings: int) -> Frame:
        return boat_frame(tmp_path, f"train/{number:04d}.png", number, **settings)

    return make


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    """A dataset folder: 4 train, 2 val and 1 test pictures, one camera, a range each."""
    rng = np.random.default_rng(0)
    frames = []
    for number, split in enumerate(("train",) * 4 + ("val",) * 2 + ("test",)):
        frame = boat_frame(tmp_path, f"{split}/{number:04d}.png", number)
        frame.image_path.parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(frame.image_path), rng.integers(0, 256, (SIZE_PX[1], SIZE_PX[0], 3), np.uint8))
        frames.append(frame)
    write_yolo(frames, tmp_path / "labels")
    write_data_yaml(tmp_path / "data.yaml", {split: f"images/{split}" for split in ("train", "val", "test")})
    save_camera(tilted_camera(), tmp_path / "cameras" / "front.yaml")
    rows = [f"{frame.name},{frame.range_m[0]},0.01,{frame.scene}" for frame in frames]
    (tmp_path / "ranges.csv").write_text("image,range_m,range_std_m,scene\n" + "\n".join(rows) + "\n")
    return tmp_path
