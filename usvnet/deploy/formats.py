"""Writing a deployed model in the formats of other runtimes, each with the whole method from pixels to metres."""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from usvnet.deploy.deployed import ANSWERS, INPUTS, DeployedUSVNet, PositionalUSVNet, plain_inputs
from usvnet.deploy.probes import probe_camera
from usvnet.deploy.runtimes import fix_shapes, needed
from usvnet.geometry.hull_model import generic_hull
from usvnet.model import USVNet

OPSET = 18
SMALLEST_STRIDES = 3
"""Least side of a picture in the network's largest strides, where the number of candidates is fixed: there must be
so many."""
LARGEST_STRIDES = 128
LARGEST_BATCH = 64
"""What ``torch.export`` is told to expect at most."""


class Format(NamedTuple):
    """A kind of file."""

    title: str
    write: Callable[[DeployedUSVNet, Path, int], None]
    """Called with the module, the file and the side of the pictures (px) that it should be ready for."""
    packages: tuple[str, ...]
    """What must be installed to write and to run it."""
    shapes: str
    """Which pictures the file takes, for the sidecar."""
    companions: tuple[str, ...] = ()
    """Suffixes of further files of the same name that belong to it."""
    optional_inputs: tuple[str, ...] = ()
    """Those that may be left out."""
    takes_native: bool = False
    """Whether it takes the pictures as the camera took them, which a model with ``refine: native`` looks at again."""


def example_inputs(stride_px: int, batch: int = 2) -> tuple[Tensor, ...]:
    """Inputs of every kind, no two sides alike, to trace a network of this largest stride with."""
    height, width = 4 * stride_px, 5 * stride_px
    return plain_inputs(
        torch.full((batch, 3, height, width), 0.5), probe_camera(batch, height, width), generic_hull(batch)
    )


def write_torchscript(deployed: DeployedUSVNet, path: Path, image_size: int) -> None:
    """Scripted and frozen; never passed through ``optimize_for_inference``, whose result cannot be read back."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=DeprecationWarning)  # TorchScript is deprecated, and still works
        torch.jit.save(torch.jit.freeze(torch.jit.script(deployed)), path)


def write_torch_export(deployed: DeployedUSVNet, path: Path, image_size: int) -> None:
    """``torch.export``: the graph as a program of ATen operators."""
    stride_px = deployed.model.network.largest_stride_px
    batch = torch.export.Dim("batch", min=1, max=LARGEST_BATCH)
    rows, columns = (torch.export.Dim(name, min=SMALLEST_STRIDES, max=LARGEST_STRIDES) for name in ("rows", "columns"))
    shapes = {name: {0: batch} for name in INPUTS}
    shapes["image"] = {0: batch, 2: stride_px * rows, 3: stride_px * columns}
    with torch.no_grad():
        program = torch.export.export(
            PositionalUSVNet(deployed), example_inputs(stride_px), dynamic_shapes=shapes, strict=False
        )
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="No complete tensor found")  # of views that share their memory
        torch.export.save(program, path)


def write_onnx(deployed: DeployedUSVNet, path: Path, image_size: int) -> None:
    """ONNX, traced.

    By the exporter that PyTorch calls legacy: the newer one, by way of ``torch.export``, takes many times as long over
    the thousands of small operations of the hull's fit, and its graphs run slower.
    """
    needed("onnx")
    axes: dict[str, dict[int, str]] = {name: {0: "batch"} for name in (*INPUTS, *ANSWERS)}
    axes["image"] = {0: "batch", 2: "height", 3: "width"}
    with warnings.catch_warnings(), torch.no_grad():
        warnings.simplefilter("ignore")  # of tracing: what depends on data or size is traced as such, or parity fails
        torch.onnx.export(
            PositionalUSVNet(deployed).eval(),
            example_inputs(deployed.model.network.largest_stride_px),
            str(path),
            dynamo=False,
            opset_version=OPSET,
            input_names=list(INPUTS),
            output_names=list(ANSWERS),
            dynamic_axes=axes,
        )


def write_openvino(deployed: DeployedUSVNet, path: Path, image_size: int) -> None:
    """OpenVINO's intermediate representation in float32, by way of ONNX; the weights go into a ``.bin`` beside it.

    Its shapes are those of one square picture of ``image_size``: with shapes left open, OpenVINO 2026.4 fits hulls
    wrongly. ``reshape`` before compiling makes it ready for others.
    """
    openvino = needed("openvino")
    traced = path.with_suffix(".onnx")
    write_onnx(deployed, traced, image_size)
    model = openvino.Core().read_model(traced)
    one = torch.empty(1, 3, image_size, image_size)
    fix_shapes(model, plain_inputs(one, probe_camera(1, image_size, image_size), generic_hull()))
    openvino.save_model(model, path, compress_to_fp16=False)
    traced.unlink()


OPTIONAL = ("camera_std", "hull_points_m", "hull_std")
ANY = "any batch, height and width"
FORMATS = {
    ".ts": Format("TorchScript", write_torchscript, (), ANY, (), OPTIONAL, takes_native=True),
    ".pt": Format("TorchScript", write_torchscript, (), ANY, (), OPTIONAL, takes_native=True),
    ".pt2": Format(
        "torch.export",
        write_torch_export,
        (),
        f"up to {LARGEST_BATCH} pictures; height and width multiples of the network's largest stride, "
        f"{SMALLEST_STRIDES} to {LARGEST_STRIDES} of them",
    ),
    ".onnx": Format(
        "ONNX",
        write_onnx,
        ("onnx", "onnxruntime"),
        f"any batch; any height and width from {SMALLEST_STRIDES} times the network's largest stride",
    ),
    ".xml": Format(
        "OpenVINO",
        write_openvino,
        ("onnx", "openvino"),
        "one square picture of trained_image_size_px as it is; reshape all inputs before compiling for others (with "
        f"fixed shapes: open ones fit hulls wrongly), sides from {SMALLEST_STRIDES} times the network's largest stride",
        (".bin",),
    ),
}
"""What there is, by suffix."""


def format_of(path: Path) -> Format:
    """The format that a file's suffix asks for.

    Raises:
        ValueError: there is none.
    """
    if path.suffix not in FORMATS:
        raise ValueError(f"{path}: got the suffix {path.suffix!r}, expected one of {', '.join(FORMATS)}")
    return FORMATS[path.suffix]


def check_takes(path: Path, model: USVNet) -> None:
    """Insist that the format of ``path`` takes what the model needs.

    Raises:
        ValueError: it does not take native pictures, and the model refines keypoints on them; or no such format.
    """
    if model.refiner is not None and not format_of(path).takes_native:
        able = ", ".join(suffix for suffix, kind in FORMATS.items() if kind.takes_native)
        raise ValueError(
            f"{path}: a model with refine: native looks at the native picture beside the image, which only TorchScript "
            f"takes: expected {able}, or a checkpoint trained without refine"
        )
