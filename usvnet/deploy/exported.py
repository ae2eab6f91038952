"""An exported file in the place of the network that it was made from."""

from pathlib import Path

import torch
from torch import Tensor

from usvnet.deploy.deployed import ESTIMATES, plain_inputs
from usvnet.deploy.runtimes import open_runtime, usable_device
from usvnet.deploy.sidecar import read_sidecar
from usvnet.geometry.hull_model import generic_hull, hull_to
from usvnet.types import Camera, Hull, Native, Prediction, RangeEstimate


class ExportedModel:
    """Called like :class:`usvnet.model.USVNet`.

    Args:
        path: written by ``usvnet export``, its description beside it.
        device: where to compute, which only TorchScript can choose; None is the processor.

    Raises:
        FileNotFoundError: no such file, or no description of it.
        ValueError: a file that is not what it should be, or whose library is not installed.
    """

    def __init__(self, path: Path | str, device: torch.device | str | None = None) -> None:
        self.path = Path(path)
        self.device = usable_device(device or "cpu")
        self.sidecar = read_sidecar(self.path)
        self.score_threshold = self.sidecar.score_threshold
        """Lowest score of a boat; may be set."""
        self.runtime = open_runtime(self.path, self.device)

    def __call__(
        self, image: Tensor, camera: Camera, hull: Hull | None = None, native: Native | None = None
    ) -> Prediction:
        """Find and range the boats, as :meth:`usvnet.model.USVNet.forward`."""
        hull = hull or hull_to(generic_hull(len(image)), self.device)
        again = native if self.sidecar.refines and native is not None else ()
        return as_prediction(self.runtime(*plain_inputs(image, camera, hull), *again), self.score_threshold)


def as_prediction(named: dict[str, Tensor], score_threshold: float) -> Prediction:
    """The named outputs of a file as what :class:`usvnet.model.USVNet` answers; boats score at least so much."""
    scores = named["scores"]
    return Prediction(
        boxes_px=named["boxes_px"],
        scores=scores,
        keypoints_px=named["keypoints_px"],
        keypoint_covariance_px2=named["keypoint_covariance_px2"],
        visibility=named["visibility"],
        present=(scores >= score_threshold) & (scores > 0),  # 0 is padding
        box_bottom=_estimate(named, "box_bottom"),
        waterline=_estimate(named, "waterline"),
        hull=_estimate(named, "hull"),
        fused=_estimate(named, "fused"),
        heading_rad=named["heading_rad"],
        heading_std_rad=named["heading_std_rad"],
        misfit=named["misfit"],
    )


def _estimate(named: dict[str, Tensor], estimator: str) -> RangeEstimate:
    return RangeEstimate(*(named[f"{estimator}_{what}"] for what in ESTIMATES))
