"""The form in which a model leaves the house: plain tensors in, named tensors out, nothing left to train."""

import copy

import torch
from torch import Tensor, nn
from torch.nn import functional
from torch.nn.utils.fusion import fuse_conv_bn_eval

from usvnet.data.transforms import FILL
from usvnet.model import USVNet
from usvnet.network.blocks import Conv
from usvnet.types import Camera, Hull, Native, RangeEstimate

INPUTS = {
    "image": "(B, 3, H, W) float32, RGB in [0, 1], no mean subtracted; any H and W",
    "K": "(B, 3, 3) pinhole matrix of this very picture, pixels; a pixel's centre is an integer",
    "distortion": "(B, 5) plumb-bob coefficients k1, k2, p1, p2, k3",
    "height_m": "(B,) optical centre above mean water",
    "pitch_rad": "(B,) optical axis below the horizontal",
    "roll_rad": "(B,) camera turned clockwise, seen from behind it",
    "camera_std": "(B, 5) standard deviations of focal length (px), height (m), pitch (rad), roll (rad) and of the "
    "water at a boat about mean water (m); may be left out, and the ranges' standard deviations then count the "
    "keypoints' alone",
    "hull_points_m": "(B, 7, 3) the keypoints on the boats of each picture: x forward, y port, z up, origin amidships "
    "on the resting waterline; may be left out, and a small boat of uncertain size is taken",
    "hull_std": "(B, 2) standard deviations of the hull's relative size and of each of its coordinates (m); may be "
    "left out, and the hull is then taken as exact",
}
NATIVE_INPUTS = {
    "native_picture": "(B, 3, h, w) uint8, RGB: the pictures as the camera took them, of which image is a shrunk and "
    "shifted copy; may be left out, and the keypoints are then those seen in image",
    "native_to_image": "(B, 3, 3) map from their pixels to those of image: positive scales and a shift",
}
"""What a model with ``refine: native`` takes beside :data:`INPUTS`, in TorchScript; other models pass them over."""
OUTPUTS = {
    "boxes_px": "(B, N, 4) x1, y1, x2, y2",
    "scores": "(B, N) in [0, 1], best first",
    "present": "(B, N) bool, True where the score reaches the exported threshold: the others are not to be used",
    "keypoints_px": "(B, N, 7, 2) u, v",
    "keypoint_covariance_px2": "(B, N, 7, 2, 2)",
    "visibility": "(B, N, 7) probability that the keypoint is seen",
    "heading_rad": "(B, N) the boat's bow, clockwise from the optical axis, seen from above",
    "heading_std_rad": "(B, N) one standard deviation of it",
    "misfit": "(B, N) how badly the keypoints fit the hull: about 1 good boat in 100 is above 0.9, and refused",
}
ESTIMATORS = {
    "box_bottom": "the bottom centre of the box",
    "waterline": "the waterline keypoint nearest to the camera",
    "hull": "all keypoints fitted by a rigid hull, its nearer waterline point",
    "fused": "waterline and hull together",
}
ESTIMATES = {
    "slant_m": "(B, N) straight line from the camera, inf where not valid",
    "slant_std_m": "(B, N) one standard deviation of it",
    "horizontal_m": "(B, N) along the water",
    "bearing_rad": "(B, N) clockwise from the optical axis, seen from above",
    "position_m": "(B, N, 3) right, down and forward in the level frame",
    "valid": "(B, N) bool, whether there is a range",
    "reason": "(B, N) int64: 0 valid, 1 at or above the horizon, 2 the keypoints do not fit the hull, 3 no ray",
}
"""What there is for each estimator, named ``<estimator>_<estimate>``."""
ANSWERS = OUTPUTS | {
    f"{who}_{what}": f"{text}: {by}" for who, by in ESTIMATORS.items() for what, text in ESTIMATES.items()
}
"""All outputs in their order."""

GREY = FILL / 255
"""What training fills margins with, on the scale of the input."""


class DeployedUSVNet(nn.Module):
    """A trained :class:`USVNet` for inference, behind an interface of plain tensors.

    Batch normalisation is folded into the convolutions, weights are channels_last and pictures of any size are filled
    up at the right and at the bottom, where it moves neither pixels nor camera. The N best candidates are always
    returned, ``present`` tells which reach the score threshold: a user may set another one later.

    Args:
        model: left as it is.
        score_threshold: lowest score that counts as a boat.
    """

    def __init__(self, model: USVNet, score_threshold: float = 0.25) -> None:
        super().__init__()
        model = copy.deepcopy(model).eval().requires_grad_(False)
        fold_norms(model)
        model.score_threshold = 0.0
        self.model = model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.score_threshold = score_threshold

    def forward(
        self,
        image: Tensor,
        K: Tensor,
        distortion: Tensor,
        height_m: Tensor,
        pitch_rad: Tensor,
        roll_rad: Tensor,
        camera_std: Tensor | None = None,
        hull_points_m: Tensor | None = None,
        hull_std: Tensor | None = None,
        native_picture: Tensor | None = None,
        native_to_image: Tensor | None = None,
    ) -> dict[str, Tensor]:
        """Find and range the boats in B pictures; see :data:`INPUTS`, :data:`NATIVE_INPUTS` and :data:`ANSWERS`."""
        batch, height, width = image.shape[0], image.shape[2], image.shape[3]
        if camera_std is None:
            camera_std = torch.zeros([batch, 5], dtype=K.dtype, device=K.device)
        camera = Camera(
            K=K,
            distortion=distortion,
            size_px=torch.tensor([width, height], dtype=K.dtype, device=K.device).expand(batch, 2),
            height_m=height_m,
            pitch_rad=pitch_rad,
            roll_rad=roll_rad,
            focal_std_px=camera_std[:, 0],
            height_std_m=camera_std[:, 1],
            pitch_std_rad=camera_std[:, 2],
            roll_std_rad=camera_std[:, 3],
            wave_std_m=camera_std[:, 4],
        )
        hull: Hull | None = None
        if hull_points_m is not None:
            if hull_std is None:
                hull_std = torch.zeros([batch, 2], dtype=K.dtype, device=K.device)
            hull = Hull(hull_points_m, hull_std[:, 0], hull_std[:, 1])
        native: Native | None = None
        if native_picture is not None and native_to_image is not None:
            native = Native(native_picture, native_to_image)
        filled = fill_up(image, self.model.network.largest_stride_px)
        prediction = self.model(filled.contiguous(memory_format=torch.channels_last), camera, hull, native)
        named = {
            "boxes_px": prediction.boxes_px,
            "scores": prediction.scores,
            "present": prediction.present & (prediction.scores >= self.score_threshold),
            "keypoints_px": prediction.keypoints_px,
            "keypoint_covariance_px2": prediction.keypoint_covariance_px2,
            "visibility": prediction.visibility,
            "heading_rad": prediction.heading_rad,
            "heading_std_rad": prediction.heading_std_rad,
            "misfit": prediction.misfit,
        }
        add_estimate(named, "box_bottom", prediction.box_bottom)
        add_estimate(named, "waterline", prediction.waterline)
        add_estimate(named, "hull", prediction.hull)
        add_estimate(named, "fused", prediction.fused)
        return named


class PositionalUSVNet(nn.Module):
    """The same with every input required, and the outputs as a tuple in the order of :data:`ANSWERS`.

    For formats without optional inputs and named outputs.
    """

    def __init__(self, deployed: DeployedUSVNet) -> None:
        super().__init__()
        self.deployed = deployed

    def forward(
        self,
        image: Tensor,
        K: Tensor,
        distortion: Tensor,
        height_m: Tensor,
        pitch_rad: Tensor,
        roll_rad: Tensor,
        camera_std: Tensor,
        hull_points_m: Tensor,
        hull_std: Tensor,
    ) -> tuple[Tensor, ...]:
        """Find and range the boats in B pictures; see :data:`INPUTS`."""
        mount = (height_m, pitch_rad, roll_rad, camera_std)
        return tuple(self.deployed(image, K, distortion, *mount, hull_points_m, hull_std).values())


def camera_std(camera: Camera) -> Tensor:
    """The standard deviations of B cameras in the order of the input ``camera_std``."""
    std = (camera.focal_std_px, camera.height_std_m, camera.pitch_std_rad, camera.roll_std_rad, camera.wave_std_m)
    return torch.stack(std, -1)


def plain_inputs(image: Tensor, camera: Camera, hull: Hull) -> tuple[Tensor, ...]:
    """All of :data:`INPUTS` in their order."""
    mount = (camera.K, camera.distortion, camera.height_m, camera.pitch_rad, camera.roll_rad, camera_std(camera))
    return (image, *mount, hull.points_m, torch.stack([hull.scale_std, hull.point_std_m], -1))


def fill_up(image: Tensor, multiple: int, value: float = GREY) -> Tensor:
    """Grow pictures (B, 3, H, W) at the right and at the bottom to multiples of the network's largest stride."""
    right = (multiple - image.shape[3] % multiple) % multiple
    bottom = (multiple - image.shape[2] % multiple) % multiple
    return functional.pad(image, [0, right, 0, bottom], value=value)


def add_estimate(named: dict[str, Tensor], estimator: str, estimate: RangeEstimate) -> None:
    """Add every field of ``estimate`` under its name."""
    named[estimator + "_slant_m"] = estimate.slant_m
    named[estimator + "_slant_std_m"] = estimate.slant_std_m
    named[estimator + "_horizontal_m"] = estimate.horizontal_m
    named[estimator + "_bearing_rad"] = estimate.bearing_rad
    named[estimator + "_position_m"] = estimate.position_m
    named[estimator + "_valid"] = estimate.valid
    named[estimator + "_reason"] = estimate.reason


def fold_norms(model: nn.Module) -> None:
    """Fold every batch normalisation into its convolution, in place; the model must be in evaluation mode."""
    for block in model.modules():
        if isinstance(block, Conv):
            block.conv = fuse_conv_bn_eval(block.conv, block.norm)
            block.norm = nn.Identity()  # type: ignore[assignment]
