"""Three families in five sizes each, side by side, and the network that they build."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from torch import Tensor, nn

from usvnet.network.backbone import Backbone, yolo11_backbone, yolov8_backbone
from usvnet.network.blocks import C2f, C3k2
from usvnet.network.heads import HeatmapHead, PoseHead
from usvnet.network.neck import Neck, NeckP6
from usvnet.types import NUM_KEYPOINTS, NetworkOutput


class Variant(NamedTuple):
    """What makes one size of one family."""

    family: str
    """A key of :data:`FAMILIES`."""
    repeats: int
    """Blocks in a stage's chain (2 of YOLO11 or 3 of YOLOv8, scaled by the depth multiple)."""
    width: float
    """Channel multiple."""
    max_channels: int
    """Cap on the unscaled channels."""
    deep: bool = False
    """YOLO11: C3k blocks everywhere, not only at strides 16 and 32 of the backbone."""

    def channels(self, *bases: int) -> tuple[int, ...]:
        """Channels of layers whose unscaled widths are ``bases``, multiples of 8."""
        return tuple(-int(-min(base, self.max_channels) * self.width // 8) * 8 for base in bases)


VARIANTS = {
    "n": Variant("YOLO11", repeats=1, width=0.25, max_channels=1024),
    "s": Variant("YOLO11", repeats=1, width=0.50, max_channels=1024),
    "m": Variant("YOLO11", repeats=1, width=1.00, max_channels=512, deep=True),
    "l": Variant("YOLO11", repeats=2, width=1.00, max_channels=512, deep=True),
    "x": Variant("YOLO11", repeats=2, width=1.50, max_channels=512, deep=True),
    "v8n": Variant("YOLOv8", repeats=1, width=0.25, max_channels=1024),
    "v8s": Variant("YOLOv8", repeats=1, width=0.50, max_channels=1024),
    "v8m": Variant("YOLOv8", repeats=2, width=0.75, max_channels=768),
    "v8l": Variant("YOLOv8", repeats=3, width=1.00, max_channels=512),
    "v8x": Variant("YOLOv8", repeats=3, width=1.25, max_channels=512),
    "v8n-p6": Variant("YOLOv8-P6", repeats=1, width=0.25, max_channels=1024),
    "v8s-p6": Variant("YOLOv8-P6", repeats=1, width=0.50, max_channels=1024),
    "v8m-p6": Variant("YOLOv8-P6", repeats=2, width=0.75, max_channels=768),
    "v8l-p6": Variant("YOLOv8-P6", repeats=3, width=1.00, max_channels=512),
    "v8x-p6": Variant("YOLOv8-P6", repeats=3, width=1.25, max_channels=512),
}
"""Every network by name; "variant" means one of these names everywhere."""


def yolo11(size: Variant) -> tuple[Backbone, Neck]:
    """Chains of C3k2 and attention at stride 32."""
    c2, c_narrow, c4, c8, c16, c32 = size.channels(64, 128, 256, 512, 512, 1024)
    backbone = yolo11_backbone((c2, c4, c8, c16, c32), c_narrow, size.repeats, size.deep)
    block = partial(C3k2, repeats=size.repeats, deep=size.deep)
    last_block = partial(C3k2, repeats=size.repeats, deep=True)
    return backbone, Neck((c8, c16, c32), size.channels(256, 512, 1024), block, last_block)


def yolov8(size: Variant) -> tuple[Backbone, Neck]:
    """Chains of C2f, without residuals in the neck."""
    channels = size.channels(64, 128, 256, 512, 1024)
    block = partial(C2f, repeats=size.repeats, residual=False)
    return yolov8_backbone(channels, size.repeats), Neck(channels[2:], channels[2:], block, block)


def yolov8_p6(size: Variant) -> tuple[Backbone, NeckP6]:
    """One level more, at stride 64, for large boats in large pictures."""
    channels = size.channels(64, 128, 256, 512, 768, 1024)
    return yolov8_backbone(channels, size.repeats), NeckP6(channels[2:], size.repeats)


FAMILIES: dict[str, Callable[[Variant], tuple[Backbone, Neck | NeckP6]]] = {
    "YOLO11": yolo11,
    "YOLOv8": yolov8,
    "YOLOv8-P6": yolov8_p6,
}


class PoseNetwork(nn.Module):
    """A YOLO pose network with a stride-4 heatmap head: image -> backbone -> neck -> pose head, heatmap head.

    Attributes:
        largest_stride_px: height and width of a picture are multiples of it: 32, or 64 with four levels.
    """

    def __init__(self, backbone: Backbone, neck: Neck | NeckP6, pose_head: PoseHead, heatmap_head: HeatmapHead):
        super().__init__()
        self.backbone = backbone
        self.neck = neck
        self.pose_head = pose_head
        self.heatmap_head = heatmap_head
        self.largest_stride_px: int = pose_head.level_strides_px[-1]

    def forward(self, image: Tensor) -> NetworkOutput:
        """(B, 3, H, W) RGB in [0, 1], H and W multiples of ``largest_stride_px`` -> the network's dense answer."""
        features = self.backbone(image)
        pyramid = self.neck(features[1:])
        poses = self.pose_head(pyramid)
        return NetworkOutput(
            boxes_px=poses.boxes_px,
            box_logits=poses.box_logits,
            class_logits=poses.class_logits,
            keypoints_px=poses.keypoints_px,
            visibility_logits=poses.visibility_logits,
            heatmap_logits=self.heatmap_head(features[0], pyramid[0]).float(),
            anchors_px=poses.anchors_px,
            strides_px=poses.strides_px,
        )


def check_picture_size(network: PoseNetwork, name: str, size_px: int) -> None:
    """Make sure that square pictures fit a network.

    Args:
        network: that shall see them.
        name: of the setting, for the message.
        size_px: their side.

    Raises:
        ValueError: the side is not a multiple of the network's largest stride.
    """
    if size_px % network.largest_stride_px:
        raise ValueError(f"{name} is {size_px}, expected a multiple of {network.largest_stride_px} with this network")


def build_network(variant: str, num_keypoints: int = NUM_KEYPOINTS, num_classes: int = 1) -> PoseNetwork:
    """The network of one family and size.

    Args:
        variant: a key of :data:`VARIANTS`.
        num_keypoints: points per boat.
        num_classes: kinds of boat.

    Raises:
        ValueError: the variant is not known.
    """
    if variant not in VARIANTS:
        raise ValueError(f"variant: got {variant!r}, expected one of {', '.join(VARIANTS)}")
    size = VARIANTS[variant]
    backbone, neck = FAMILIES[size.family](size)
    return PoseNetwork(
        backbone,
        neck,
        PoseHead(neck.channels, num_keypoints, num_classes, depthwise_score=size.family == "YOLO11"),
        HeatmapHead(backbone.channels[0], neck.channels[0], num_keypoints),
    )
