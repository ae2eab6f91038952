"""Checkpoints laid out as the peer writes them, without the peer: stand-in classes of the same names."""

import sys
import types
from pathlib import Path
from typing import Any
from unittest.mock import patch

import torch
from torch import nn

from tests.pretrained.filling import fill
from usvnet.network.variants import build_network
from usvnet.pretrained.layout import layout

PACKAGES = {
    "PoseModel": "ultralytics.nn.tasks",
    "Pose": "ultralytics.nn.modules.head",
    "Detect": "ultralytics.nn.modules.head",
    "Segment": "ultralytics.nn.modules.head",
    "Block": "ultralytics.nn.modules.block",
}
STAND_INS = {name: type(name, (nn.Module,), {"__module__": package}) for name, package in PACKAGES.items()}


def peer_shapes(variant: str, keypoints: int = 7, classes: int = 1, detect: bool = False) -> dict[str, tuple[int, ...]]:
    """Names and shapes of the peer's state_dict, without the bins' distances."""
    with torch.device("meta"):
        network = build_network(variant, max(keypoints, 1), classes)
    pairs, state = layout(network), network.state_dict()
    kinds = ("box", "score") if detect else ("box", "score", "keypoint")
    layers = pairs.trunk + [layer for kind in kinds for level in pairs.branches[kind] for layer in level]
    return {theirs: tuple(state[ours].shape) for layer in layers for ours, theirs in layer.tensors(network).items()}


def peer_model(
    variant: str, keypoints: int = 7, classes: int = 1, head: str = "Pose", act: type[nn.Module] = nn.SiLU
) -> nn.Module:
    """A tree of stand-ins with the peer's names, filled by the rule; it computes nothing."""
    shapes = peer_shapes(variant, keypoints, classes, detect=head != "Pose")
    number = max(int(name.split(".")[1]) for name in shapes)
    shapes[f"model.{number}.dfl.conv.weight"] = (1, 16, 1, 1)
    root = STAND_INS["PoseModel"]()
    for name, shape in shapes.items():
        *path, key = name.split(".")
        part = root
        for depth, child in enumerate(path, 1):
            if child not in part._modules:
                is_head = path[:depth] == ["model", str(number)]
                part.add_module(child, STAND_INS[head if is_head else "Block"]())
            part = part._modules[child]
        value = torch.from_numpy(fill(name, shape))
        if key in ("running_mean", "running_var", "num_batches_tracked"):
            part.register_buffer(key, value.long() if key.startswith("num") else value)
        else:
            part.register_parameter(key, nn.Parameter(value, requires_grad=False))
    for name, part in list(root.named_modules()):
        if "conv" in part._modules and "bn" in part._modules:
            linear = name.endswith((".qkv", ".pe", ".proj", ".ffn.1"))
            part.add_module("act", nn.Identity() if linear else act())
    return root


def write(path: Path, content: Any) -> Path:
    """torch.save, while modules of the stand-ins' names are in place: pickle looks whether they exist."""
    packages = {*PACKAGES.values(), "ultralytics", "ultralytics.nn", "ultralytics.nn.modules"}
    modules = {package: types.ModuleType(package) for package in packages}
    for name, package in PACKAGES.items():
        setattr(modules[package], name, STAND_INS[name])
    with patch.dict(sys.modules, modules):
        torch.save(content, path)
    return path
