"""A dataset of four made-up pictures and a model that knows its labels."""

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from usvnet.data.dataset import BoatDataset
from usvnet.data.records import Frame
from usvnet.geometry.camera import make_camera
from usvnet.intervals import ESTIMATORS
from usvnet.model import USVNet
from usvnet.types import Camera, Hull, Native, Prediction

from .boats import BOX_PX, KEYPOINTS_PX

SIZE_PX = (320, 280)
SCENES = ("I", "I", "IV", None)


class Oracle(USVNet):
    """Predicts the labels of a dataset; ``missed`` pictures get a score of 0.1."""

    def __init__(self, dataset: BoatDataset, missed: tuple[int, ...] = ()):
        super().__init__("n")
        self.dataset = dataset
        self.missed = missed
        self.predicted = 0

    def forward(
        self, image: Tensor, camera: Camera, hull: Hull | None = None, native: Native | None = None
    ) -> Prediction:
        indices = range(self.predicted, self.predicted + len(image))
        self.predicted += len(image)
        frames = [self.dataset[index].frame for index in indices]
        keypoints_px = torch.tensor(np.array([frame.keypoints_px for frame in frames]), dtype=torch.float32)
        boxes_px = torch.tensor(np.array([frame.boxes_px for frame in frames]), dtype=torch.float32)
        covariance_px2 = 0.25 * torch.eye(2).expand(len(frames), 1, 7, 2, 2)
        ranges = self.ranging(keypoints_px, covariance_px2, boxes_px, camera, hull)
        calibrated = {name: self.intervals(getattr(ranges, name), n) for n, name in enumerate(ESTIMATORS)}
        return Prediction(
            boxes_px=boxes_px,
            scores=torch.tensor([[0.1 if index in self.missed else 0.9] for index in indices]),
            keypoints_px=keypoints_px,
            keypoint_covariance_px2=covariance_px2,
            visibility=torch.full((len(frames), 1, 7), 0.9),
            present=torch.ones(len(frames), 1, dtype=torch.bool),
            **(ranges._asdict() | calibrated),
        )


@pytest.fixture
def dataset(tmp_path) -> BoatDataset:
    """Four pictures of one boat each; the laser agrees with the waterline estimate of the labels."""
    generator = np.random.default_rng(0)
    camera = make_camera(
        [[400.0, 0, 159.5], [0, 400.0, 139.5], [0, 0, 1]], SIZE_PX, height_m=1.5, pitch_rad=0.1, pitch_std_rad=0.001
    )
    ranging = USVNet("n").ranging
    frames = []
    for n, scene in enumerate(SCENES):
        path = tmp_path / f"{n}.png"
        cv2.imwrite(str(path), generator.integers(60, 120, (*SIZE_PX[::-1], 3), dtype=np.uint8))
        shift = np.array([20.0 * n, -5.0 * n])
        keypoints = torch.tensor(KEYPOINTS_PX + shift, dtype=torch.float32)[None, None]
        box = torch.tensor(BOX_PX + np.tile(shift, 2), dtype=torch.float32)[None, None]
        waterline = ranging(keypoints, torch.zeros(1, 1, 7, 2, 2), box, camera).waterline
        frames.append(
            Frame(
                image_path=path,
                name=f"test/{n}.png",
                scene=scene,
                camera=camera,
                boxes_px=box[0].double().numpy(),
                keypoints_px=keypoints[0].double().numpy(),
                visibility=np.full((1, 7), 2),
                range_m=waterline.slant_m[0].double().numpy(),
                range_std_m=np.array([0.01]),
                reference=np.array([-1]),
            )
        )
    return BoatDataset(frames, 128)
