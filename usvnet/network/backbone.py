"""The backbones: image -> features at strides 4, 8, 16, 32 (and 64), one family below the other."""

from collections import OrderedDict
from itertools import pairwise

from torch import Tensor, nn

from usvnet.network.blocks import C2PSA, SPPF, C2f, C3k2, Conv


class Backbone(nn.Sequential):
    """A stem at stride 2 and stages that halve the picture each, ``stage4`` to ``stage32`` or ``stage64``.

    Args:
        stages: the stem and the stages by name.
        channels: the channels of each stage's features, from stride 4 on.
    """

    def __init__(self, stages: dict[str, nn.Module], channels: tuple[int, ...]):
        super().__init__(OrderedDict(stages))
        self.channels = channels

    def forward(self, image: Tensor) -> list[Tensor]:
        """(B, 3, H, W) -> features at strides 4, 8, 16, ..."""
        features: list[Tensor] = []
        x = image
        for stage in self:
            x = stage(x)
            features.append(x)
        return features[1:]


def yolov8_backbone(channels: tuple[int, ...], repeats: int) -> Backbone:
    """YOLOv8's backbone, YOLOv8-P6's where there is a stride 64.

    Args:
        channels: at strides 2, 4, 8, 16, 32 (and 64).
        repeats: blocks in the first stage and from stride 32 on; the stages at strides 8 and 16 have twice as many.
    """
    stages: dict[str, nn.Module] = {"stem": Conv(3, channels[0], 3, stride=2)}
    blocks = (repeats, 2 * repeats, 2 * repeats, repeats, repeats)
    for stride, (c_in, c_out), count in zip((4, 8, 16, 32, 64), pairwise(channels), blocks):
        stage = nn.Sequential(Conv(c_in, c_out, 3, stride=2), C2f(c_out, c_out, count, residual=True))
        stages[f"stage{stride}"] = stage
    stage.append(SPPF(channels[-1]))  # to the last one
    return Backbone(stages, channels[1:])


def yolo11_backbone(channels: tuple[int, ...], c_narrow: int, repeats: int, deep: bool) -> Backbone:
    """YOLO11's backbone: a stage may leave with more channels than it entered with, and the last one attends.

    Args:
        channels: of the stem and out of the stages at strides 4, 8, 16 and 32.
        c_narrow: channels into the stage at stride 4; the others enter with what the one before left with.
        repeats: blocks in each stage.
        deep: C3k blocks at strides 4 and 8 too.
    """
    c2, c4, c8, c16, c32 = channels
    stages: dict[str, nn.Module] = {
        "stem": Conv(3, c2, 3, stride=2),
        "stage4": nn.Sequential(Conv(c2, c_narrow, 3, stride=2), C3k2(c_narrow, c4, repeats, deep, expansion=0.25)),
        "stage8": nn.Sequential(Conv(c4, c4, 3, stride=2), C3k2(c4, c8, repeats, deep, expansion=0.25)),
        "stage16": nn.Sequential(Conv(c8, c16, 3, stride=2), C3k2(c16, c16, repeats, deep=True)),
        "stage32": nn.Sequential(
            Conv(c16, c32, 3, stride=2), C3k2(c32, c32, repeats, deep=True), SPPF(c32), C2PSA(c32, repeats)
        ),
    }
    return Backbone(stages, channels[1:])
