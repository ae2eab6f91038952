"""The necks: a path aggregation network (Liu et al., CVPR 2018) over three levels, and one over four."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from usvnet.network.blocks import C2, Conv


class Neck(nn.Module):
    """Coarse features go down to stride 8 and back up to stride 32, meeting the backbone at every level.

    Args:
        c_in: the backbone's channels at strides 8, 16 and 32.
        c_out: the neck's channels at strides 8, 16 and 32.
        block: makes a stage from its channels in and out.
        last_block: makes the stage at the end, at stride 32.
    """

    def __init__(
        self,
        c_in: tuple[int, ...],
        c_out: tuple[int, ...],
        block: Callable[[int, int], nn.Module],
        last_block: Callable[[int, int], nn.Module],
    ):
        super().__init__()
        self.down16 = block(c_in[2] + c_in[1], c_out[1])
        self.down8 = block(c_out[1] + c_in[0], c_out[0])
        self.to16 = Conv(c_out[0], c_out[0], 3, stride=2)
        self.up16 = block(c_out[0] + c_out[1], c_out[1])
        self.to32 = Conv(c_out[1], c_out[1], 3, stride=2)
        self.up32 = last_block(c_out[1] + c_in[2], c_out[2])
        self.channels = c_out

    def forward(self, features: list[Tensor]) -> list[Tensor]:
        """Features at strides 8, 16 and 32, before and after."""
        p3, p4, p5 = features
        down16 = self.down16(p4, coarse=p5)
        out8 = self.down8(p3, coarse=down16)
        out16 = self.up16(torch.cat([self.to16(out8), down16], 1))
        out32 = self.up32(torch.cat([self.to32(out16), p5], 1))
        return [out8, out16, out32]


class NeckP6(nn.Module):
    """The same over the four levels of YOLOv8-P6, from stride 64 down to 8 and back up.

    Args:
        channels: the backbone's channels at strides 8, 16, 32 and 64, and the neck's.
        repeats: bottlenecks in each stage.
    """

    def __init__(self, channels: tuple[int, ...], repeats: int):
        super().__init__()
        c8, c16, c32, c64 = channels
        self.down32 = C2(c64 + c32, c32, repeats)
        self.down16 = C2(c32 + c16, c16, repeats)
        self.down8 = C2(c16 + c8, c8, repeats)
        self.to16 = Conv(c8, c8, 3, stride=2)
        self.up16 = C2(c8 + c16, c16, repeats)
        self.to32 = Conv(c16, c16, 3, stride=2)
        self.up32 = C2(c16 + c32, c32, repeats)
        self.to64 = Conv(c32, c32, 3, stride=2)
        self.up64 = C2(c32 + c64, c64, repeats)
        self.channels = channels

    def forward(self, features: list[Tensor]) -> list[Tensor]:
        """Features at strides 8, 16, 32 and 64, before and after."""
        p3, p4, p5, p6 = features
        down32 = self.down32(p5, coarse=p6)
        down16 = self.down16(p4, coarse=down32)
        out8 = self.down8(p3, coarse=down16)
        out16 = self.up16(torch.cat([self.to16(out8), down16], 1))
        out32 = self.up32(torch.cat([self.to32(out16), down32], 1))
        out64 = self.up64(torch.cat([self.to64(out32), p6], 1))
        return [out8, out16, out32, out64]
