"""The backbone: image -> features at strides 4, 8, 16 and 32."""

from torch import Tensor, nn

from usvnet.network.blocks import C2PSA, SPPF, C3k2, Conv


class Backbone(nn.Module):
    """YOLO11's backbone.

    Args:
        c1: channels at stride 2.
        c2: channels into the stage at stride 4.
        c3: channels out of the stage at stride 4 and into the one at stride 8.
        c4: channels out of the stage at stride 8.
        c5: channels at stride 16.
        c6: channels at stride 32.
        repeats: blocks in each stage.
        deep: C3k blocks at strides 4 and 8 too.
    """

    def __init__(self, c1: int, c2: int, c3: int, c4: int, c5: int, c6: int, repeats: int, deep: bool):
        super().__init__()
        self.stem = Conv(3, c1, 3, stride=2)
        self.stage4 = nn.Sequential(Conv(c1, c2, 3, stride=2), C3k2(c2, c3, repeats, deep, expansion=0.25))
        self.stage8 = nn.Sequential(Conv(c3, c3, 3, stride=2), C3k2(c3, c4, repeats, deep, expansion=0.25))
        self.stage16 = nn.Sequential(Conv(c4, c5, 3, stride=2), C3k2(c5, c5, repeats, deep=True))
        self.stage32 = nn.Sequential(
            Conv(c5, c6, 3, stride=2), C3k2(c6, c6, repeats, deep=True), SPPF(c6), C2PSA(c6, repeats)
        )
        self.channels = (c3, c4, c5, c6)

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """(B, 3, H, W) -> features at strides 4, 8, 16 and 32."""
        p2 = self.stage4(self.stem(image))
        p3 = self.stage8(p2)
        p4 = self.stage16(p3)
        return p2, p3, p4, self.stage32(p4)
