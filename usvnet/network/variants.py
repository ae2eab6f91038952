"""The five sizes of YOLO11 by one depth and width table, and the network that they build."""

from typing import NamedTuple

from torch import Tensor, nn

from usvnet.network.backbone import Backbone
from usvnet.network.heads import HeatmapHead, PoseHead
from usvnet.network.neck import Neck
from usvnet.types import NUM_KEYPOINTS, NetworkOutput


class Variant(NamedTuple):
    """What makes one size of the network."""

    repeats: int
    """Blocks in every C3k2 and attention chain (2 scaled by the depth multiple)."""
    width: float
    """Channel multiple."""
    max_channels: int
    """Cap on the unscaled channels."""
    deep: bool
    """C3k blocks everywhere, not only at strides 16 and 32 of the backbone."""

    def channels(self, base: int) -> int:
        """Channels of a layer whose unscaled width is ``base``, a multiple of 8."""
        return -int(-min(base, self.max_channels) * self.width // 8) * 8


VARIANTS = {
    "n": Variant(repeats=1, width=0.25, max_channels=1024, deep=False),
    "s": Variant(repeats=1, width=0.50, max_channels=1024, deep=False),
    "m": Variant(repeats=1, width=1.00, max_channels=512, deep=True),
    "l": Variant(repeats=2, width=1.00, max_channels=512, deep=True),
    "x": Variant(repeats=2, width=1.50, max_channels=512, deep=True),
}


class PoseNetwork(nn.Module):
    """YOLO11-pose with a stride-4 heatmap head: image -> backbone -> neck -> pose head, heatmap head."""

    def __init__(self, backbone: Backbone, neck: Neck, pose_head: PoseHead, heatmap_head: HeatmapHead):
        super().__init__()
        self.backbone = backbone
        self.neck = neck
        self.pose_head = pose_head
        self.heatmap_head = heatmap_head

    def forward(self, image: Tensor) -> NetworkOutput:
        """(B, 3, H, W) RGB in [0, 1], H and W multiples of 32 -> the network's dense answer."""
        p2, p3, p4, p5 = self.backbone(image)
        pyramid = self.neck(p3, p4, p5)
        poses = self.pose_head(pyramid)
        return NetworkOutput(
            boxes_px=poses.boxes_px,
            box_logits=poses.box_logits,
            class_logits=poses.class_logits,
            keypoints_px=poses.keypoints_px,
            visibility_logits=poses.visibility_logits,
            heatmap_logits=self.heatmap_head(p2, pyramid[0]).float(),
            anchors_px=poses.anchors_px,
            strides_px=poses.strides_px,
        )


def build_network(variant: str, num_keypoints: int = NUM_KEYPOINTS, num_classes: int = 1) -> PoseNetwork:
    """The network of one size.

    Args:
        variant: one of n, s, m, l, x.
        num_keypoints: points per boat.
        num_classes: kinds of boat.

    Raises:
        ValueError: the variant is not known.
    """
    if variant not in VARIANTS:
        raise ValueError(f"variant: got {variant!r}, expected one of {', '.join(VARIANTS)}")
    size = VARIANTS[variant]
    c1, c2, c3, c4, c5, c6 = (size.channels(base) for base in (64, 128, 256, 512, 512, 1024))
    backbone = Backbone(c1, c2, c3, c4, c5, c6, size.repeats, size.deep)
    neck = Neck(backbone.channels[1:], tuple(size.channels(c) for c in (256, 512, 1024)), size.repeats, size.deep)
    return PoseNetwork(
        backbone,
        neck,
        PoseHead(neck.channels, num_keypoints, num_classes),
        HeatmapHead(backbone.channels[0], neck.channels[0], num_keypoints),
    )
