"""Which layer of an Ultralytics model is which of ours: ``model.9.cv1.conv.weight`` is a place in a list of layers.

Their model is one list: the backbone's layers, the neck's with an upsampling and a concatenation between, the head. A
part of ours finds its number by counting, and its inner names by the table :data:`NAMES`.
"""

from collections.abc import Iterator
from typing import NamedTuple

from torch import nn

from usvnet.network.blocks import C2, C2PSA, SPPF, Attention, AttentionBlock, Bottleneck, C2f, C3k, C3k2, Conv
from usvnet.network.variants import PoseNetwork

NAMES: dict[type[nn.Module], dict[str, str]] = {
    Conv: {"conv": "conv", "norm": "bn"},
    Bottleneck: {"conv1": "cv1", "conv2": "cv2"},
    C2: {"enter": "cv1", "chain": "m", "merge": "cv2"},
    C2f: {"enter": "cv1", "chain": "m", "merge": "cv2"},
    C3k2: {"enter": "cv1", "chain": "m", "merge": "cv2"},
    C3k: {"enter": "cv1", "bypass": "cv2", "bottlenecks": "m", "merge": "cv3"},
    SPPF: {"enter": "cv1", "merge": "cv2"},
    C2PSA: {"enter": "cv1", "blocks": "m", "merge": "cv2"},
    AttentionBlock: {"attention": "attn", "feed_forward": "ffn"},
    Attention: {"qkv": "qkv", "position": "pe", "project": "proj"},
}
"""Children of each of our blocks and what the peer calls them; a sequence's numbers are the same on both sides."""

COUNTED_BEFORE = {"down": 2, "to": 0, "up": 1}
"""Layers without weights that the peer counts before a stage of the neck: upsampling and concatenation; none; the
latter."""
BRANCHES = {"box": "cv2", "score": "cv3", "keypoint": "cv4"}
"""Of the pose head."""
DEPTHWISE_SCORE = ("0.0", "0.1", "1.0", "1.1", "2")
"""The peer's numbers in YOLO11's score branch, where a depthwise and a pointwise convolution make a pair."""


class Layer(NamedTuple):
    """A convolution with its normalisation, or a last convolution without one: taken as a whole or not at all."""

    ours: str
    peer: str
    parts: tuple[tuple[str, str], ...]
    """Names inside the layer, ours and the peer's."""

    def tensors(self, network: nn.Module) -> dict[str, str]:
        """Names of the layer's parameters and buffers in our ``state_dict`` and in the peer's."""
        return {
            f"{self.ours}{ours}.{key}": f"{self.peer}{peer}.{key}"
            for ours, peer in self.parts
            for key in network.get_submodule(f"{self.ours}{ours}").state_dict()
        }


class Layout(NamedTuple):
    """All layers that a network and its peer have in common."""

    trunk: list[Layer]
    """Backbone and neck."""
    branches: dict[str, list[list[Layer]]]
    """Of the pose head, by kind: the layers of each level, in their order."""
    head: int
    """The pose head's number in the peer's list."""


def layout(network: PoseNetwork) -> Layout:
    """Pair the layers of a network of ours with those of the peer."""
    trunk: list[Layer] = []
    number = 0
    for stage, blocks in network.backbone.named_children():
        whole = isinstance(blocks, Conv)  # the stem is a layer, every other stage a sequence of them
        for name, block in [("", blocks)] if whole else blocks.named_children():
            ours = f"backbone.{stage}" if whole else f"backbone.{stage}.{name}"
            trunk += layers(block, ours, f"model.{number}")
            number += 1
    for name, block in network.neck.named_children():
        if name != "upsample":
            number += COUNTED_BEFORE[name.rstrip("0123456789")]
            trunk += layers(block, f"neck.{name}", f"model.{number}")
            number += 1
    branches: dict[str, list[list[Layer]]] = {kind: [] for kind in BRANCHES}
    for i, level in enumerate(network.pose_head.levels):
        for kind, found in branches.items():
            branch = level.get_submodule(kind)
            depthwise = kind == "score" and len(list(branch.children())) == len(DEPTHWISE_SCORE)
            prefix = f"model.{number}.{BRANCHES[kind]}.{i}"
            found.append([])
            for j, (name, block) in enumerate(branch.named_children()):
                peer = DEPTHWISE_SCORE[j] if depthwise else name
                found[-1] += layers(block, f"pose_head.levels.{i}.{kind}.{name}", f"{prefix}.{peer}")
    return Layout(trunk, branches, head=number)


def layers(block: nn.Module, ours: str, peer: str) -> Iterator[Layer]:
    """Pair every layer inside a block."""
    if isinstance(block, Conv):
        yield Layer(ours, peer, tuple((f".{mine}", f".{theirs}") for mine, theirs in NAMES[Conv].items()))
    elif isinstance(block, nn.Conv2d):
        yield Layer(ours, peer, (("", ""),))
    else:
        names = NAMES.get(type(block), {})
        for name, child in block.named_children():
            yield from layers(child, f"{ours}.{name}", f"{peer}.{names.get(name, name)}")
