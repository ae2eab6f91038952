"""The heads: boxes, scores and coarse keypoints at strides 8, 16, 32 (and 64); heatmaps at stride 4."""

import math
from typing import NamedTuple

import torch
from torch import Tensor, nn

from usvnet.network.blocks import Conv, Pointwise

STRIDES_PX = (8, 16, 32, 64)
"""Of the pyramid's levels; all families but YOLOv8-P6 have the first three."""
BOX_BINS = 16
"""Bins of the distribution over each box side's distance (Li et al., Generalized Focal Loss, 2020)."""


class Poses(NamedTuple):
    """The pose head's answer for every anchor; fields as in :class:`usvnet.types.NetworkOutput`."""

    boxes_px: Tensor
    box_logits: Tensor
    class_logits: Tensor
    keypoints_px: Tensor
    visibility_logits: Tensor
    anchors_px: Tensor
    strides_px: Tensor


class PoseLevel(nn.Module):
    """The three branches at one stride; a forward pass concatenates them along the channels."""

    def __init__(
        self,
        c_in: int,
        c_box: int,
        c_class: int,
        c_keypoint: int,
        num_keypoints: int,
        num_classes: int,
        depthwise_score: bool,
    ):
        super().__init__()
        self.box = nn.Sequential(Conv(c_in, c_box, 3), Conv(c_box, c_box, 3), Pointwise(c_box, 4 * BOX_BINS))
        if depthwise_score:
            self.score = nn.Sequential(
                Conv(c_in, c_in, 3, groups=c_in),
                Conv(c_in, c_class),
                Conv(c_class, c_class, 3, groups=c_class),
                Conv(c_class, c_class),
                Pointwise(c_class, num_classes),
            )
        else:
            self.score = nn.Sequential(
                Conv(c_in, c_class, 3), Conv(c_class, c_class, 3), Pointwise(c_class, num_classes)
            )
        self.keypoint = nn.Sequential(
            Conv(c_in, c_keypoint, 3), Conv(c_keypoint, c_keypoint, 3), Pointwise(c_keypoint, 3 * num_keypoints)
        )

    def forward(self, x: Tensor) -> Tensor:
        """(B, c_in, h, w) -> (B, 4 * BOX_BINS + C + 3 K, h, w)."""
        return torch.cat([self.box(x), self.score(x), self.keypoint(x)], 1)


class PoseHead(nn.Module):
    """Anchor-free head of the YOLO pose family: one anchor per cell of every level.

    Args:
        channels: of the pyramid at strides 8, 16, 32 (and 64).
        num_keypoints: points per boat.
        num_classes: kinds of boat.
        depthwise_score: YOLO11's score branch of depthwise and pointwise convolutions; YOLOv8's is of plain ones.
    """

    def __init__(self, channels: tuple[int, ...], num_keypoints: int, num_classes: int, depthwise_score: bool):
        super().__init__()
        self.num_keypoints = num_keypoints
        self.num_classes = num_classes
        c_box = max(16, channels[0] // 4, 4 * BOX_BINS)
        c_class = max(channels[0], min(num_classes, 100))
        c_keypoint = max(channels[0] // 4, 3 * num_keypoints)
        self.levels = nn.ModuleList(
            PoseLevel(c, c_box, c_class, c_keypoint, num_keypoints, num_classes, depthwise_score) for c in channels
        )
        self.level_strides_px = STRIDES_PX[: len(channels)]
        # A parameter, though never trained: the published parameter counts include it.
        self.bins = nn.Parameter(torch.arange(float(BOX_BINS)), requires_grad=False)
        self._initialise_biases()

    def _initialise_biases(self) -> None:
        """Start with boxes about two strides wide and a score of about five boats a 640 px picture."""
        for level, stride_px in zip(self.levels, self.level_strides_px):
            last = len(level.get_submodule("score")) - 1  # type: ignore[arg-type]
            nn.init.constant_(level.get_parameter("box.2.bias"), 1.0)
            nn.init.constant_(
                level.get_parameter(f"score.{last}.bias"), math.log(5 / self.num_classes * (stride_px / 640) ** 2)
            )

    def forward(self, pyramid: list[Tensor]) -> Poses:
        """Features at strides 8, 16, 32 (and 64) -> the decoded answer of all A anchors, in float32 pixels."""
        answers: list[Tensor] = []
        anchors: list[Tensor] = []
        strides: list[Tensor] = []
        for i, level in enumerate(self.levels):
            feature = pyramid[i]
            height, width = feature.shape[2], feature.shape[3]
            answers.append(level(feature).float().flatten(2))
            v = torch.arange(height, device=feature.device, dtype=torch.float32)
            u = torch.arange(width, device=feature.device, dtype=torch.float32)
            cells = torch.stack([u.expand(height, width), v[:, None].expand(height, width)], -1).view(-1, 2)
            stride_px = self.level_strides_px[i]
            anchors.append(cells * stride_px + (stride_px - 1) / 2)
            strides.append(torch.full_like(cells[:, 0], stride_px))
        return self._decode(torch.cat(answers, 2).transpose(1, 2), torch.cat(anchors), torch.cat(strides))

    def _decode(self, answer: Tensor, anchors_px: Tensor, strides_px: Tensor) -> Poses:
        """Raw channels (B, A, 64 + C + 3 K) of each anchor to pixels (GFL's expectation, YOLO-pose's offsets)."""
        b, a = answer.shape[0], answer.shape[1]
        box_logits, class_logits, keypoint = answer.split(
            [4 * self.bins.shape[0], self.num_classes, 3 * self.num_keypoints], dim=2
        )
        box_logits = box_logits.reshape(b, a, 4, self.bins.shape[0])
        # not a matrix product: autocast would compute it in half precision
        distance_px = (box_logits.softmax(-1) * self.bins.float()).sum(-1) * strides_px[:, None]
        keypoint = keypoint.reshape(b, a, self.num_keypoints, 3)
        # Offsets count in double strides from the cell's upper left corner, half a stride before its centre.
        offset_px = (2 * keypoint[..., :2] - 0.5) * strides_px[:, None, None]
        return Poses(
            boxes_px=torch.cat([anchors_px - distance_px[..., :2], anchors_px + distance_px[..., 2:]], -1),
            box_logits=box_logits,
            class_logits=class_logits,
            keypoints_px=anchors_px[:, None] + offset_px,
            visibility_logits=keypoint[..., 2],
            anchors_px=anchors_px,
            strides_px=strides_px,
        )


class HeatmapHead(nn.Module):
    """One stride-4 heatmap per keypoint from the backbone's stride 4 and the neck's stride 8.

    The first knows where edges are to a fraction of a pixel, the second which edge is the bow's.
    """

    def __init__(self, c_stride4: int, c_stride8: int, num_keypoints: int):
        super().__init__()
        hidden = max(32, c_stride8 // 2)
        self.fine = Conv(c_stride4, hidden)
        self.coarse = nn.Sequential(Conv(c_stride8, hidden), nn.Upsample(scale_factor=2.0, mode="bilinear"))
        self.heatmap = nn.Sequential(Conv(hidden, hidden, 3), Conv(hidden, hidden, 3), Pointwise(hidden, num_keypoints))

    def forward(self, stride4: Tensor, stride8: Tensor) -> Tensor:
        """(B, c, H / 4, W / 4) and (B, c, H / 8, W / 8) -> logits (B, K, H / 4, W / 4)."""
        return self.heatmap(self.fine(stride4) + self.coarse(stride8))
