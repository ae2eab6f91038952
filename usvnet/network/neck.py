"""The neck: a path aggregation network over strides 8, 16 and 32 (Liu et al., CVPR 2018)."""

import torch
from torch import Tensor, nn

from usvnet.network.blocks import C3k2, Conv


class Neck(nn.Module):
    """Coarse features go down to stride 8 and back up to stride 32, meeting the backbone at every level.

    Args:
        c_in: the backbone's channels at strides 8, 16 and 32.
        c_out: the neck's channels at strides 8, 16 and 32.
        repeats: blocks in each stage.
        deep: C3k blocks at strides 8 and 16 too.
    """

    def __init__(self, c_in: tuple[int, ...], c_out: tuple[int, ...], repeats: int, deep: bool):
        super().__init__()
        self.upsample = nn.Upsample(scale_factor=2.0, mode="nearest")
        self.down16 = C3k2(c_in[2] + c_in[1], c_out[1], repeats, deep)
        self.down8 = C3k2(c_out[1] + c_in[0], c_out[0], repeats, deep)
        self.to16 = Conv(c_out[0], c_out[0], 3, stride=2)
        self.up16 = C3k2(c_out[0] + c_out[1], c_out[1], repeats, deep)
        self.to32 = Conv(c_out[1], c_out[1], 3, stride=2)
        self.up32 = C3k2(c_out[1] + c_in[2], c_out[2], repeats, deep=True)
        self.channels = c_out

    def forward(self, p3: Tensor, p4: Tensor, p5: Tensor) -> list[Tensor]:
        """Features at strides 8, 16 and 32, before and after."""
        down16 = self.down16(torch.cat([self.upsample(p5), p4], 1))
        out8 = self.down8(torch.cat([self.upsample(down16), p3], 1))
        out16 = self.up16(torch.cat([self.to16(out8), down16], 1))
        out32 = self.up32(torch.cat([self.to32(out16), p5], 1))
        return [out8, out16, out32]
