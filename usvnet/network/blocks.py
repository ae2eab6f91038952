"""The building blocks of YOLOv8 and YOLO11, channels explicit.

YOLOv8: Jocher, Chaurasia & Qiu 2023. YOLO11: Jocher & Qiu 2024; Khanam & Hussain, arXiv:2410.17725. Every block keeps
the height and width of its input, except :class:`Conv` with a stride. The families differ in the block that fills their
stages: :class:`C2f` (YOLOv8), :class:`C2` (the neck of YOLOv8-P6), :class:`C3k2` (YOLO11).
"""

from collections.abc import Iterable

import torch
from torch import Tensor, nn
from torch.nn import functional


class Pointwise(nn.Conv2d):
    """A 1 x 1 convolution, which trains on a CPU as one core computes it fastest: as the matrix product that it is."""

    def __init__(self, c_in: int, c_out: int, bias: bool = True):
        super().__init__(c_in, c_out, 1, bias=bias)

    def forward(self, x: Tensor) -> Tensor:
        """(B, c_in, H, W) -> (B, c_out, H, W)."""
        if self.training and x.device.type == "cpu":
            return matrix_product(x, weight_matrix(self.weight), self.bias)
        return self._conv_forward(x, self.weight, self.bias)


def weight_matrix(weight: Tensor) -> Tensor:
    """Weight (c_out, c_in, 1, 1) -> (c_out, c_in), so that its gradient is channels_last, as it is."""
    return weight.permute(0, 2, 3, 1).flatten(1)


def matrix_product(x: Tensor, weight: Tensor, bias: Tensor | None = None) -> Tensor:
    """(B, c_in, H, W) -> (B, c_out, H, W) by a weight (c_out, c_in); channels_last needs no copies."""
    return functional.linear(x.permute(0, 2, 3, 1), weight, bias).permute(0, 3, 1, 2)


class Conv(nn.Module):
    """Convolution, batch normalisation and SiLU, the atom of the whole network."""

    def __init__(self, c_in: int, c_out: int, kernel: int = 1, stride: int = 1, groups: int = 1, act: bool = True):
        super().__init__()
        self.conv: nn.Conv2d
        if kernel == 1 and stride == 1 and groups == 1:
            self.conv = Pointwise(c_in, c_out, bias=False)
        else:
            self.conv = nn.Conv2d(c_in, c_out, kernel, stride, kernel // 2, groups=groups, bias=False)
        self.norm = nn.BatchNorm2d(c_out, eps=1e-3, momentum=0.03)
        self.act = nn.SiLU() if act else nn.Identity()  # in place, the backward pass would need a copy of its input

    def forward(self, x: Tensor) -> Tensor:
        """(B, c_in, H, W) -> (B, c_out, H / stride, W / stride)."""
        return self.act(self.norm(self.conv(x)))


class Enter(Conv):
    """The 1 x 1 convolution at the start of a block, where a neck's coarser features join."""

    def __init__(self, c_in: int, c_out: int):
        super().__init__(c_in, c_out)

    def forward(self, x: Tensor, coarse: Tensor | None = None) -> Tensor:
        """(B, c, H, W) and (B, c_in - c, H / 2, W / 2), whose channels come first -> (B, c_out, H, W)."""
        if coarse is None:
            return self.act(self.norm(self.conv(x)))
        if self.training and x.device.type == "cpu":
            # enlarged after the product instead of before, which is the same: a quarter of the work, and no cat
            weight = weight_matrix(self.conv.weight)
            of_coarse, of_x = weight.split([coarse.shape[1], x.shape[1]], 1)
            joined = enlarge(matrix_product(coarse, of_coarse)) + matrix_product(x, of_x)
            return self.act(self.norm(joined))
        return self.act(self.norm(self.conv(torch.cat([enlarge(coarse), x], 1))))


def enlarge(x: Tensor) -> Tensor:
    """(B, C, H, W) -> (B, C, 2 H, 2 W), every cell four times."""
    return functional.interpolate(x, scale_factor=2.0, mode="nearest")


class Bottleneck(nn.Module):
    """Two 3 x 3 convolutions with an optional residual connection."""

    def __init__(self, channels: int, hidden: int, residual: bool = True):
        super().__init__()
        self.conv1 = Conv(channels, hidden, 3)
        self.conv2 = Conv(hidden, channels, 3)
        self.residual = residual

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C, H, W)."""
        y = self.conv2(self.conv1(x))
        return x + y if self.residual else y


class C3k(nn.Module):
    """Cross-stage-partial block: two bottlenecks on one half, the other half passed by."""

    def __init__(self, channels: int, residual: bool = True):
        super().__init__()
        hidden = channels // 2
        self.enter = Conv(channels, hidden)
        self.bypass = Conv(channels, hidden)
        self.bottlenecks = nn.Sequential(*(Bottleneck(hidden, hidden, residual) for _ in range(2)))
        self.merge = Conv(2 * hidden, channels)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C, H, W)."""
        return self.merge(torch.cat([self.bottlenecks(self.enter(x)), self.bypass(x)], 1))


class C2(nn.Module):
    """Split in two, run one half through a chain of bottlenecks without residuals, the other half passed by.

    Args:
        c_in: channels in.
        c_out: channels out.
        repeats: bottlenecks in the chain.
    """

    def __init__(self, c_in: int, c_out: int, repeats: int):
        super().__init__()
        hidden = c_out // 2
        self.enter = Enter(c_in, 2 * hidden)
        self.chain = nn.Sequential(*(Bottleneck(hidden, hidden, residual=False) for _ in range(repeats)))
        self.merge = Conv(2 * hidden, c_out)

    def forward(self, x: Tensor, coarse: Tensor | None = None) -> Tensor:
        """(B, c_in, H, W) -> (B, c_out, H, W); coarser features join as in :class:`Enter`."""
        y, bypass = self.enter(x, coarse).chunk(2, 1)
        return self.merge(torch.cat([self.chain(y), bypass], 1))


class SplitChain(nn.Module):
    """Split in two, run one half through a chain of blocks, concatenate every stage of the chain.

    Args:
        c_in: channels in.
        c_out: channels out.
        hidden: channels of each half and of every block.
        blocks: the chain.
    """

    def __init__(self, c_in: int, c_out: int, hidden: int, blocks: Iterable[nn.Module]):
        super().__init__()
        self.enter = Enter(c_in, 2 * hidden)
        self.chain = nn.ModuleList(blocks)
        self.merge = Conv((2 + len(self.chain)) * hidden, c_out)

    def forward(self, x: Tensor, coarse: Tensor | None = None) -> Tensor:
        """(B, c_in, H, W) -> (B, c_out, H, W); coarser features join as in :class:`Enter`."""
        first, last = self.enter(x, coarse).chunk(2, 1)
        stages = [first, last]
        for block in self.chain:
            last = block(last)
            stages.append(last)
        return self.merge(torch.cat(stages, 1))


class C2f(SplitChain):
    """YOLOv8's chain: bottlenecks as wide inside as outside.

    Args:
        c_in: channels in.
        c_out: channels out.
        repeats: blocks in the chain.
        residual: each block adds its input (in the backbone) or does not (in the neck).
    """

    def __init__(self, c_in: int, c_out: int, repeats: int, residual: bool):
        hidden = c_out // 2
        super().__init__(c_in, c_out, hidden, (Bottleneck(hidden, hidden, residual) for _ in range(repeats)))


class C3k2(SplitChain):
    """YOLO11's chain: bottlenecks half as wide inside, or blocks that are chains themselves.

    Args:
        c_in: channels in.
        c_out: channels out.
        repeats: blocks in the chain.
        deep: blocks are :class:`C3k` instead of :class:`Bottleneck`.
        expansion: hidden channels over ``c_out``.
    """

    def __init__(self, c_in: int, c_out: int, repeats: int, deep: bool, expansion: float = 0.5):
        hidden = int(c_out * expansion)
        blocks = (C3k(hidden) if deep else Bottleneck(hidden, hidden // 2) for _ in range(repeats))
        super().__init__(c_in, c_out, hidden, blocks)


class SPPF(nn.Module):
    """Spatial pyramid pooling, fast: three chained 5 x 5 max-pools see 5, 9 and 13 cells (He et al. 2015)."""

    def __init__(self, channels: int):
        super().__init__()
        hidden = channels // 2
        self.enter = Conv(channels, hidden)
        self.pool = nn.MaxPool2d(5, stride=1, padding=2)
        self.merge = Conv(4 * hidden, channels)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C, H, W)."""
        x = self.enter(x)
        y1 = self.pool(x)
        y2 = self.pool(y1)
        return self.merge(torch.cat([x, y1, y2, self.pool(y2)], 1))


class Attention(nn.Module):
    """Multi-head self-attention over all cells, keys half as wide as values, positions by a depthwise convolution."""

    def __init__(self, channels: int, heads: int):
        super().__init__()
        self.heads = heads
        self.head_dim = channels // heads
        self.key_dim = self.head_dim // 2
        self.scale = self.key_dim**-0.5
        self.qkv = Conv(channels, channels + 2 * heads * self.key_dim, act=False)
        self.position = Conv(channels, channels, 3, groups=channels, act=False)
        self.project = Conv(channels, channels, act=False)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C, H, W)."""
        b, c, h, w = x.shape
        qkv = self.qkv(x).view(b, self.heads, 2 * self.key_dim + self.head_dim, h * w)
        q, k, v = qkv.split([self.key_dim, self.key_dim, self.head_dim], 2)
        weights = ((q.transpose(2, 3) @ k) * self.scale).softmax(-1)
        y = (v @ weights.transpose(2, 3)).reshape(b, c, h, w)
        return self.project(y + self.position(v.reshape(b, c, h, w)))


class AttentionBlock(nn.Module):
    """Attention and a two-layer feed-forward network, each with a residual connection."""

    def __init__(self, channels: int):
        super().__init__()
        self.attention = Attention(channels, heads=channels // 64)
        self.feed_forward = nn.Sequential(Conv(channels, 2 * channels), Conv(2 * channels, channels, act=False))

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C, H, W)."""
        x = x + self.attention(x)
        return x + self.feed_forward(x)


class C2PSA(nn.Module):
    """Half of the channels through attention blocks, the other half passed by."""

    def __init__(self, channels: int, repeats: int):
        super().__init__()
        hidden = channels // 2
        self.enter = Conv(channels, 2 * hidden)
        self.blocks = nn.Sequential(*(AttentionBlock(hidden) for _ in range(repeats)))
        self.merge = Conv(2 * hidden, channels)

    def forward(self, x: Tensor) -> Tensor:
        """(B, C, H, W) -> (B, C, H, W)."""
        bypass, y = self.enter(x).chunk(2, 1)
        return self.merge(torch.cat([bypass, self.blocks(y)], 1))
