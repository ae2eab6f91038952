"""From a camera's picture to its boats, in the picture's own pixels."""

import copy
import math
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from usvnet.checkpoints import STAMP, load_model, read_checkpoint
from usvnet.data.transforms import warp
from usvnet.deploy.deployed import fold_norms
from usvnet.deploy.exported import ExportedModel
from usvnet.deploy.runtimes import usable_device
from usvnet.evaluation.records import ESTIMATORS, RANGE_CONFIDENCE, BoatRecord, to_records
from usvnet.geometry.camera import camera_to, letterbox_camera, letterbox_matrix, scale_camera, stack_cameras
from usvnet.geometry.camera_files import load_camera
from usvnet.geometry.hull_files import load_hull
from usvnet.geometry.hull_model import hull_to, stack_hulls
from usvnet.model import USVNet
from usvnet.types import Camera, Hull, Native, Prediction

Picture = NDArray[np.uint8]
"""(H, W, 3) RGB."""
DEFAULT_IMAGE_SIZE_PX = 640
PREFERRED_ESTIMATORS = ("fused", "hull", "waterline", "box_bottom")
"""Best first; those that :class:`usvnet.types.Prediction` does not have are passed over."""
SHIPPED = {False: "usvnet-n.pt", True: "usvnet-n-refine.pt"}
"""The trained networks that come with usvnet: without and with a second look at the boats in the native picture."""


class Predictor:
    """A trained network behind one camera: ``Predictor("best.ckpt", "camera.yaml")(picture)`` lists the boats.

    Pictures may be of any size that has the shape of the camera's: the camera is scaled along. Inside they are
    letterboxed to the network's size; boxes, keypoints and covariances come back in the picture's own pixels. A network
    trained with ``model.refine`` looks at the boats again in the pictures as they are.

    Args:
        checkpoint: written by train.py, a model in memory, or an exported file that was opened.
        camera: camera file with its mount, or a camera in memory (a batch of 1).
        hull: hull file of the boats to expect, or a hull in memory (a batch of 1); None is a generic one.
        image_size: longer side of what the network sees, pixels; None is the size that it was trained on.
        confidence: lowest score of a boat.
        device: where to compute; None is the first GPU, or the processor where there is none. An exported file that was
            opened has its own.

    Raises:
        FileNotFoundError: no such file.
        ValueError: a file that is not what it should be, or a number out of range.
    """

    def __init__(
        self,
        checkpoint: Path | str | USVNet | ExportedModel,
        camera: Path | str | Camera,
        hull: Path | str | Hull | None = None,
        image_size: int | None = None,
        confidence: float = RANGE_CONFIDENCE,
        device: torch.device | str | None = None,
    ) -> None:
        if not 0 <= confidence <= 1:
            raise ValueError(f"confidence: got {confidence:g}, expected a score from 0 to 1")
        if isinstance(checkpoint, ExportedModel):
            trained_size = checkpoint.sidecar.image_size
        else:
            trained_size = (
                None if isinstance(checkpoint, USVNet) else read_checkpoint(checkpoint)[STAMP].get("image_size")
            )
        self.image_size = image_size or trained_size or DEFAULT_IMAGE_SIZE_PX
        if self.image_size < 32:
            raise ValueError(f"image_size: got {self.image_size}, expected at least 32")
        self.camera_name = "camera" if isinstance(camera, Camera) else str(camera)
        self.camera = camera if isinstance(camera, Camera) else load_camera(camera)
        self.hull = load_hull(hull) if isinstance(hull, Path | str) else hull
        self.model: Callable[..., Prediction]
        if isinstance(checkpoint, ExportedModel):
            self.device, self.refines, self.model = checkpoint.device, checkpoint.sidecar.refines, checkpoint
            self.stride_px, self.factors = checkpoint.sidecar.largest_stride_px, checkpoint.sidecar.factors
            checkpoint.score_threshold = confidence
        else:
            self.device = usable_device(device or ("cuda" if torch.cuda.is_available() else "cpu"))
            model = copy.deepcopy(checkpoint) if isinstance(checkpoint, USVNet) else load_model(checkpoint)
            self.stride_px = model.network.largest_stride_px
            self.refines = model.refiner is not None
            self.factors = model.intervals.factors()
            self.model = _made_fast(model, confidence).to(self.device)
        self._cameras: dict[tuple[int, int], Camera] = {}

    @property
    def sizes_px(self) -> list[tuple[int, int]]:
        """Widths and heights of the pictures so far."""
        return list(self._cameras)

    def __call__(self, picture: Picture) -> list[BoatRecord]:
        """Find and range the boats in one picture (H, W, 3), RGB; best first.

        Raises:
            ValueError: the picture has another shape than the camera's.
        """
        return self.predict([picture])[0]

    def predict(self, pictures: Sequence[Picture], cameras: Sequence[Camera] | None = None) -> list[list[BoatRecord]]:
        """Find and range the boats in pictures of one size, at once; best first in each.

        Args:
            pictures: (H, W, 3) RGB.
            cameras: one for each, as :meth:`native_camera` gives it but for its attitude; None is the mount's.

        Raises:
            ValueError: pictures of several sizes, or of another shape than the camera's.
        """
        sizes = {picture.shape[1::-1] for picture in pictures}
        if len(sizes) != 1:
            raise ValueError(f"got pictures of {len(sizes)} sizes, expected at least one picture and one size")
        camera = self.native_camera(*sizes.pop())
        cameras = cameras or [camera] * len(pictures)
        input_px = self.input_size_px(camera)
        letterbox = letterbox_matrix(camera.size_px[0].double(), input_px)
        seen = np.stack([warp(picture, letterbox.numpy(), input_px) for picture in pictures])
        image = torch.from_numpy(seen).to(self.device).permute(0, 3, 1, 2).float().div_(255)  # channels_last already
        seeing = camera_to(letterbox_camera(stack_cameras(cameras), input_px), self.device)
        hulls = None if self.hull is None else hull_to(stack_hulls([self.hull] * len(pictures)), self.device)
        native = None
        if self.refines:
            taken = torch.from_numpy(np.stack(pictures)).to(self.device).permute(0, 3, 1, 2)
            native = Native(taken, letterbox.to(image).expand(len(pictures), 3, 3))
        with torch.inference_mode():
            prediction = self.model(image, seeing, hulls, native)
        return to_records(prediction, letterbox.expand(len(pictures), 3, 3), self.factors)

    def warm_up(self) -> None:
        """Compute twice for nothing: the first two answers take seconds, while the graph is fitted to its input."""
        width, height = (int(side) for side in self.camera.size_px[0])
        for _ in range(2):
            self(np.zeros((height, width, 3), np.uint8))

    def native_camera(self, width: int, height: int) -> Camera:
        """The camera of pictures of this size.

        Raises:
            ValueError: they have another shape than the camera's.
        """
        size_px = (width, height)
        if size_px not in self._cameras:
            self._cameras[size_px] = fit_camera(self.camera, width, height, self.camera_name)
        return self._cameras[size_px]

    def input_size_px(self, camera: Camera) -> tuple[int, int]:
        """Width and height of what the network sees of this camera's pictures: no more margin than its strides ask."""
        width, height = camera.size_px[0].tolist()
        scale = self.image_size / max(width, height)
        rows, columns = (math.ceil(round(scale * side, 3) / self.stride_px) for side in (height, width))
        return columns * self.stride_px, rows * self.stride_px


def fit_camera(camera: Camera, width: int, height: int, name: str = "camera") -> Camera:
    """Scale a camera to pictures of another size but the same shape.

    Raises:
        ValueError: pictures of another shape, with the sizes.
    """
    camera_width, camera_height = (int(side) for side in camera.size_px[0])
    if (camera_width, camera_height) == (width, height):
        return camera
    scale = width / camera_width
    if abs(scale * camera_height - height) > max(1.0, scale):  # sizes are rounded to whole pixels
        raise ValueError(
            f"{name} was calibrated for pictures of {camera_width} x {camera_height}, but these are "
            f"{width} x {height}, which is another shape: calibrate with pictures as they come from this source"
        )
    return scale_camera(camera, (width, height))


def default_checkpoint(refine: bool = False) -> Path:
    """The weights to use where a person names none, from ``checkpoints`` of the repository or the package.

    Args:
        refine: those with a second look, where pictures come as the camera took them.

    Raises:
        FileNotFoundError: none came along.
    """
    package = Path(__file__).resolve().parents[1]
    for folder in (package.parent, package):
        if (path := folder / "checkpoints" / SHIPPED[refine]).is_file():
            return path
    raise FileNotFoundError("no trained weights came with this usvnet: name some with --checkpoint, e.g. a best.ckpt")


def best_estimator() -> str:
    """The range estimator to show where none is named."""
    return next(name for name in PREFERRED_ESTIMATORS if name in ESTIMATORS)


def check_estimator(name: str) -> None:
    """Insist on a range estimator that there is.

    Raises:
        ValueError: what was got and which there are.
    """
    if name not in ESTIMATORS:
        raise ValueError(f"estimator: got {name!r}, expected one of {', '.join(ESTIMATORS)}")


def _made_fast(model: USVNet, confidence: float) -> torch.nn.Module:
    """Fold norms, turn weights channels_last and freeze the graph: the same answers sooner."""
    model = model.eval().requires_grad_(False)
    fold_norms(model)
    model.score_threshold = confidence
    model = model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=DeprecationWarning)  # TorchScript is deprecated, and still works
        return torch.jit.freeze(torch.jit.script(model))
