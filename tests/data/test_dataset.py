import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from turned_jpegs import write_turned

from usvnet.data import AugmentationConfig, BoatDataset, Frame, collate, read_dataset
from usvnet.data.sampling import Draw
from usvnet.types import NEAREST_WATERLINE


def with_picture(frame: Frame, picture: np.ndarray) -> Frame:
    frame.image_path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(frame.image_path), picture)
    return frame


def white_dot_frame(make_frame, size_px: tuple[int, int]) -> Frame:
    """A dot at bow_bottom."""
    frame = make_frame(1, size_px=size_px)
    u, v = np.meshgrid(np.arange(size_px[0]), np.arange(size_px[1]))
    point = frame.keypoints_px[0, 3]
    dot = np.exp(-((u - point[0]) ** 2 + (v - point[1]) ** 2) / (2 * (size_px[0] / 80) ** 2))
    return with_picture(frame, (114 + 140 * dot).round().astype(np.uint8)[..., None].repeat(3, -1))


def dot_centre(picture: np.ndarray) -> np.ndarray:
    weight = (picture[..., 0].astype(float) - 114).clip(0)
    v, u = np.indices(weight.shape)
    return np.array([(weight * u).sum(), (weight * v).sum()]) / weight.sum()


@pytest.mark.parametrize("size_px", [(1281, 720), (640, 640), (200, 150), (101, 333)])
def test_letterboxing_moves_picture_and_labels_alike(make_frame, size_px: tuple[int, int]):
    """Also through the cache, which keeps the first of them at half its size."""
    frame = white_dot_frame(make_frame, size_px)
    dataset = BoatDataset([frame], 320)
    sample = dataset[0]
    assert sample.picture.shape == (320, 320, 3)
    assert sample.frame.size_px == (320, 320)
    np.testing.assert_allclose(dot_centre(sample.picture), sample.frame.keypoints_px[0, 3], atol=0.1)
    A = dataset.letterbox_matrix(0).numpy()
    native = np.linalg.inv(A) @ (*sample.frame.keypoints_px[0, 3], 1)
    np.testing.assert_allclose(native[:2], frame.keypoints_px[0, 3], atol=1e-9)


def test_labels_belong_to_the_picture_as_it_stands_upright(make_frame):
    """A phone's portrait: its pixels lie, and its EXIF orientation says so."""
    frame = white_dot_frame(make_frame, (240, 320))
    phone = dataclasses.replace(frame, image_path=frame.image_path.with_suffix(".jpg"))
    write_turned(phone.image_path, cv2.imread(str(frame.image_path)))
    sample = BoatDataset([phone], 320)[0]
    np.testing.assert_allclose(dot_centre(sample.picture), sample.frame.keypoints_px[0, 3], atol=0.3)


def test_augmenting_moves_picture_and_labels_alike(make_frame):
    frame = white_dot_frame(make_frame, (640, 480))
    off = ("mosaic", "paste", "hue", "saturation", "value", "glare", "fog", "dim", "noise", "blur")
    still = dict.fromkeys(off, 0)
    dataset = BoatDataset([frame], 320, AugmentationConfig(zoom=(0.5, 1.5), **still))
    torch.manual_seed(0)
    seen = 0
    for _ in range(20):
        sample = dataset[0]
        keypoint = sample.frame.keypoints_px[0, 3]
        if (keypoint > 20).all() and (keypoint < 300).all():
            seen += 1
            np.testing.assert_allclose(dot_centre(sample.picture), keypoint, atol=0.15)
    assert seen > 10


def test_a_boat_always_stays_in_the_frame(make_frame):
    frame = with_picture(make_frame(1), np.zeros((120, 160, 3), np.uint8))
    corner = np.array([[0.0, 100.0, 6.0, 104.0]])
    frame = dataclasses.replace(frame, boxes_px=corner, keypoints_px=np.zeros((1, 7, 2)))
    dataset = BoatDataset(
        [frame], 64, AugmentationConfig(zoom=(3.0, 3.0), translate=0.5, roll_deg=0, mosaic=0, paste=0)
    )
    torch.manual_seed(0)
    assert all(len(dataset[0].frame.boxes_px) == 1 for _ in range(20))


def test_the_end_of_a_run_has_no_mosaics(make_frame):
    frame = with_picture(make_frame(1), np.zeros((120, 160, 3), np.uint8))
    dataset = BoatDataset([frame], 64, AugmentationConfig(mosaic=1))
    dataset.closing_epoch = 3
    boats = [len(dataset[Draw(0, (seed, epoch, 0))].frame.boxes_px) for epoch in range(6) for seed in (0, 1)]
    assert min(boats[:6]) > 1
    assert max(boats[6:]) == 1


def test_seeds_decide_everything(tiny: Path):
    dataset = BoatDataset(read_dataset(tiny, "train"), 64, AugmentationConfig())

    def draw(seed: int) -> np.ndarray:
        torch.manual_seed(seed)
        return np.stack([dataset[0].picture for _ in range(3)])

    first = draw(1)
    np.testing.assert_array_equal(first, draw(1))
    assert (first != draw(2)).any()
    assert (first[0] != first[1]).any()


def test_a_batch_has_the_shapes_and_types_it_promises(make_frame):
    black = np.zeros((120, 160, 3), np.uint8)
    frames = [with_picture(make_frame(i, boats=i), black) for i in (0, 1, 3)]
    batch = collate([BoatDataset(frames, 96)[i] for i in (2, 0, 1)])
    assert batch.image.shape == (3, 3, 96, 96)
    assert batch.image.dtype == torch.float32
    assert batch.image.is_contiguous(memory_format=torch.channels_last)
    assert batch.image.min() == 0
    assert batch.image.max() == pytest.approx(114 / 255)
    assert batch.frame_index.tolist() == [2, 0, 1]
    assert batch.camera.K.shape == (3, 3, 3)
    assert batch.camera.size_px.tolist() == [[96, 96]] * 3
    boats = batch.boats
    assert boats.present.tolist() == [[True] * 3, [False] * 3, [True, False, False]]
    shapes = {name: tuple(value.shape) for name, value in boats._asdict().items()}
    assert shapes == {
        "boxes_px": (3, 3, 4),
        "keypoints_px": (3, 3, 7, 2),
        "visibility": (3, 3, 7),
        "present": (3, 3),
        "range_m": (3, 3),
        "range_std_m": (3, 3),
        "reference": (3, 3),
    }
    assert boats.visibility.dtype == boats.reference.dtype == torch.int64
    assert boats.boxes_px.dtype == boats.range_m.dtype == torch.float32
    assert boats.range_m[2].tolist() == [6.0, 0, 0]
    assert (boats.reference[~boats.present] == NEAREST_WATERLINE).all()


@pytest.mark.parametrize("count", [1, 2])
def test_a_batch_of_empty_pictures_is_padded_to_one_boat(make_frame, count: int):
    frames = [with_picture(make_frame(i, boats=0), np.zeros((120, 160, 3), np.uint8)) for i in range(count)]
    dataset = BoatDataset(frames, 64, AugmentationConfig())
    batch = collate([dataset[i] for i in range(count)])
    assert batch.boats.boxes_px.shape == (count, 1, 4)
    assert not batch.boats.present.any()


def test_colours_are_rgb_from_0_to_1(make_frame):
    red = np.zeros((120, 160, 3), np.uint8)
    red[..., 2] = 255  # OpenCV writes BGR
    batch = collate([BoatDataset([with_picture(make_frame(1), red)], 64)[0]])
    assert batch.image[0, :, 32, 32].tolist() == [1.0, 0.0, 0.0]
