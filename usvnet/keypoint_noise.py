"""How far keypoints stray, made true before they are ranged: doubt that no heatmap shows, a share of the boat's size.

A heatmap that is sharp at the wrong place claims a tenth of a pixel, and the fit of a hull, which weights keypoints by
what they claim, believes it. On labelled boats that were not trained on, :mod:`usvnet.evaluation.keypoint_calibration`
finds the share k of a boat's size for which the covariance C of the heatmap and

    C + k^2 width height I,

width and height being those of the boat's box, makes the labels most likely: the form of the keypoint sigmas of COCO's
OKS.

Keypoints of one boat also err together: a boat that is drawn 3 % too small looks 3 % too far away, and seven keypoints
that agree on it are no surer. So the size of a hull is doubted too, however well the hull is known, by what
:mod:`usvnet.evaluation.size_calibration` finds on laser-ranged boats.

Both numbers travel in the checkpoint, and :class:`usvnet.model.USVNet` applies them between heatmap and geometry.
"""

import torch
from torch import Tensor, nn

from usvnet.types import Hull


class KeypointNoise(nn.Module):
    """Adds those doubts to covariances and hulls; no weights, and nothing in the ``state_dict``."""

    def __init__(self) -> None:
        super().__init__()
        self.share: Tensor
        self.size_std: Tensor
        self.register_buffer("share", torch.zeros(()), persistent=False)
        self.register_buffer("size_std", torch.zeros(()), persistent=False)

    def forward(self, covariance_px2: Tensor, boxes_px: Tensor) -> Tensor:
        """The covariance to range with.

        Args:
            covariance_px2: (..., 7, 2, 2) from the heatmaps.
            boxes_px: (..., 4) of the same boats, in the same pixels.

        Returns:
            (..., 7, 2, 2)
        """
        sides_px = (boxes_px[..., 2:] - boxes_px[..., :2]).clamp(min=0).to(covariance_px2.dtype)
        variance_px2 = self.share.to(covariance_px2.dtype).square() * sides_px[..., 0] * sides_px[..., 1]
        unit = torch.eye(2, dtype=covariance_px2.dtype, device=covariance_px2.device)
        return covariance_px2 + variance_px2[..., None, None, None] * unit

    @torch.jit.export
    def resized(self, hull: Hull) -> Hull:
        """The hulls to fit, of B boats: as they are, and no better known in size than the network draws them."""
        doubt = self.size_std.to(hull.scale_std.dtype)
        scale_std = torch.sqrt(hull.scale_std**2 + doubt**2)  # ONNX has no hypot
        return Hull(hull.points_m, scale_std, hull.point_std_m)

    @torch.jit.unused
    def set_share(self, share: float) -> None:
        """Use this share; 0 takes the heatmaps' word.

        Raises:
            ValueError: it is not a number in [0, 1].
        """
        if isinstance(share, bool) or not isinstance(share, (int, float)) or not 0 <= share <= 1:
            raise ValueError(f"keypoint noise: expected a share of the boat's size in [0, 1], got {share!r}")
        self.share.fill_(share)

    @torch.jit.unused
    def get_share(self) -> float:
        """The share in use."""
        return float(self.share)

    @torch.jit.unused
    def set_size_std(self, size_std: float) -> None:
        """Use this standard deviation of the logarithm of a boat's size as it is drawn; 0 takes it as right.

        Raises:
            ValueError: it is not a number in [0, 1].
        """
        if isinstance(size_std, bool) or not isinstance(size_std, (int, float)) or not 0 <= size_std <= 1:
            raise ValueError(f"drawn size: expected a standard deviation in [0, 1], got {size_std!r}")
        self.size_std.fill_(size_std)

    @torch.jit.unused
    def get_size_std(self) -> float:
        """The doubt of the size in use."""
        return float(self.size_std)
