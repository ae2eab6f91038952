"""An Ultralytics checkpoint becomes weights of ours: what fits is taken, layer by layer, and the rest is said."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn

from usvnet.model import USVNet
from usvnet.network.variants import VARIANTS, PoseNetwork, build_network
from usvnet.pretrained.archive import TorchArchive
from usvnet.pretrained.layout import Layer, Layout, layout
from usvnet.pretrained.pickle_reader import Record, StoredTensor, read_pickle

HEADS = ("Pose", "Detect")
"""The peer's heads that share ours; one of segmentation has branches of the same names and another meaning."""
MAX_PARTS = 20_000
"""More parts than any model has: the tree of a file may run in circles."""


class PeerModel(NamedTuple):
    """What a file says about its model: nothing is read from the storages yet."""

    tensors: dict[str, StoredTensor]
    """Parameters and buffers by name."""
    classes: dict[str, str]
    """Class of every part by name, without its package."""
    key: str
    """Of the checkpoint: "ema", a moving average of the weights, or "model", which may be one too."""


class ImportedWeights(NamedTuple):
    """A network of ours with the weights of a file."""

    variant: str
    model: USVNet
    """On the CPU; layers that the file does not have are as they were drawn (with seed 0)."""
    keypoints: int
    """Keypoints of the file's model, 0 for a detector."""
    classes: int
    """Classes of the file's model."""
    key: str
    """Of the file's checkpoint, "ema" or "model"."""
    taken: dict[str, tuple[int, int]]
    """By part (trunk, box, score, keypoint): how many of its layers were taken, and how many there are."""


def import_weights(path: Path | str) -> ImportedWeights:
    """Read a pose or detect checkpoint of YOLO11, YOLOv8 or YOLOv8-P6 without running anything in it.

    A layer is taken if its shape fits, up to the first in its branch that does not: another number of keypoints or
    classes changes the last layer of its branch and, in a small network, the width of the ones before.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is damaged, holds what no checkpoint needs, or a network that is not one of ours.
    """
    with TorchArchive(path) as archive:
        peer = find_model(read_pickle(archive.pickle(), str(path)), str(path))
        variant, network, pairs = find_variant(peer, str(path))
        keypoints = _rows(peer, pairs.branches["keypoint"]) // 3
        classes = _rows(peer, pairs.branches["score"])
        parts = {"trunk": [pairs.trunk], **pairs.branches}
        fitting = {part: [_fitting(level, network, peer) for level in levels] for part, levels in parts.items()}
        weights: dict[str, Tensor] = {}
        for layer in (layer for levels in fitting.values() for level in levels for layer in level):
            check_activation(layer, network, peer, str(path))
            for ours, theirs in layer.tensors(network).items():
                weights[f"network.{ours}"] = _finite(archive.tensor(peer.tensors[theirs]), theirs, str(path))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        model = USVNet(variant)
    state = model.state_dict()
    model.load_state_dict(state | {name: tensor.to(state[name].dtype) for name, tensor in weights.items()})
    taken = {part: (sum(map(len, fitting[part])), sum(map(len, levels))) for part, levels in parts.items()}
    return ImportedWeights(variant, model, keypoints, classes, peer.key, taken)


def find_model(content: Any, source: str) -> PeerModel:
    """Find the model in the content of a checkpoint and list its parts; the averaged one (EMA) goes first.

    Raises:
        ValueError: there is none, or it is not a tree.
    """
    checkpoint = content if isinstance(content, dict) else {}
    found = [(key, checkpoint[key]) for key in ("ema", "model") if isinstance(checkpoint.get(key), Record)]
    if not found:
        raise ValueError(f"{source}: got a file without a model, expected a checkpoint that Ultralytics wrote (.pt)")
    key, model = found[0]
    tensors: dict[str, StoredTensor] = {}
    classes: dict[str, str] = {}
    for name, part in walk(model, source):
        if isinstance(part, StoredTensor):
            tensors[name] = part
        else:
            classes[name] = part.name.rpartition(".")[2]
    return PeerModel(tensors, classes, key)


def walk(model: Record, source: str) -> Iterator[tuple[str, Record | StoredTensor]]:
    """Every module, parameter and buffer of a model with its dotted name.

    Raises:
        ValueError: the model has more parts than any has.
    """
    waiting: list[tuple[str, Record | StoredTensor]] = [("", model)]
    for _ in range(MAX_PARTS):
        if not waiting:
            return
        name, part = waiting.pop()
        yield name, part
        held = part.state if isinstance(part, Record) and isinstance(part.state, dict) else {}
        for kind in ("_modules", "_parameters", "_buffers"):
            children = held.get(kind)
            for child, value in children.items() if isinstance(children, dict) else ():
                if isinstance(value, Record if kind == "_modules" else StoredTensor):
                    waiting.append((f"{name}.{child}" if name else str(child), value))
    raise ValueError(f"{source}: refused: its model has more than {MAX_PARTS} parts, expected a network")


@cache
def on_paper(variant: str) -> tuple[PoseNetwork, Layout]:
    """A network of shapes only (on the meta device), and its layers beside the peer's."""
    with torch.device("meta"):
        network = build_network(variant)
    return network, layout(network)


def find_variant(peer: PeerModel, source: str) -> tuple[str, PoseNetwork, Layout]:
    """Find the network whose backbone, neck and box branches have exactly the shapes of a file's.

    Returns:
        Its name, and what :func:`on_paper` says of it.

    Raises:
        ValueError: there is none, or the head is of another task.
    """
    for variant in VARIANTS:
        network, pairs = on_paper(variant)
        head = f"model.{pairs.head}"
        expected = [*pairs.trunk, *(layer for level in pairs.branches["box"] for layer in level)]
        names = {theirs for layer in pairs.trunk for theirs in layer.tensors(network).values()}
        if {name for name in peer.tensors if not name.startswith(f"{head}.")} == names and all(
            _fits(layer, network, peer) for layer in expected
        ):
            if peer.classes.get(head) not in HEADS:
                raise ValueError(f"{source}: got a head of class {peer.classes.get(head)!r}, expected Pose or Detect")
            return variant, network, pairs
    raise ValueError(
        f"{source}: its weights fit none of {', '.join(VARIANTS)}, expected a pose or detect network of YOLO11, YOLOv8 "
        f"or YOLOv8-P6 before fusing"
    )


def check_activation(layer: Layer, network: PoseNetwork, peer: PeerModel, source: str) -> None:
    """Make sure that a layer does with its answer what ours does.

    Raises:
        ValueError: it has another activation.
    """
    ours = getattr(network.get_submodule(layer.ours), "act", None)
    theirs = peer.classes.get(f"{layer.peer}.act")
    if ours is not None and type(ours).__name__ != theirs:
        raise ValueError(f"{source}: {layer.peer} has the activation {theirs}, expected {type(ours).__name__}")


def _fits(layer: Layer, network: nn.Module, peer: PeerModel) -> bool:
    shapes = {name: tuple(tensor.shape) for name, tensor in network.get_submodule(layer.ours).state_dict().items()}
    return all(
        theirs in peer.tensors and peer.tensors[theirs].size == shapes[ours.removeprefix(f"{layer.ours}.")]
        for ours, theirs in layer.tensors(network).items()
    )


def _fitting(branch: list[Layer], network: nn.Module, peer: PeerModel) -> list[Layer]:
    """The layers of a branch before the first that does not fit: those behind it would be fed with noise."""
    misfit = next((i for i, layer in enumerate(branch) if not _fits(layer, network, peer)), len(branch))
    return branch[:misfit]


def _rows(peer: PeerModel, branches: list[list[Layer]]) -> int:
    """Channels out of the last layer of the first level's branch, 0 where there is none."""
    last = peer.tensors.get(f"{branches[0][-1].peer}.weight")
    return last.size[0] if last and last.size else 0


def _finite(tensor: Tensor, name: str, source: str) -> Tensor:
    if not bool(tensor.isfinite().all()):
        raise ValueError(f"{source}: {name} holds numbers that are not finite, expected the weights of a sound network")
    return tensor
