"""Exported files read back and run, each by the library that knows its format, behind one signature."""

import importlib
import warnings
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from usvnet.deploy.deployed import ANSWERS, INPUTS


class Runtime(Protocol):
    """A file ready to run."""

    def __call__(self, *inputs: Tensor) -> dict[str, Tensor]:
        """Find and range boats: all of :data:`INPUTS` in their order -> :data:`ANSWERS` by name.

        TorchScript also takes :data:`usvnet.deploy.deployed.NATIVE_INPUTS` after them.
        """


def needed(package: str, extra: str = "export") -> ModuleType:
    """Import a package that only exports need; ``extra`` of usvnet installs it.

    Raises:
        ValueError: it is not installed.
    """
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise ValueError(f"{package} is not installed: needs pip install usvnet[{extra}]") from error


class TorchScriptRuntime:
    """A ``.ts`` or ``.pt`` file."""

    def __init__(self, path: Path, device: torch.device) -> None:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=DeprecationWarning)  # TorchScript is deprecated, and still works
            self.module = torch.jit.load(path, map_location=device)

    def __call__(self, *inputs: Tensor) -> dict[str, Tensor]:
        """Run it."""
        answers: dict[str, Tensor] = self.module(*inputs)
        return answers


class TorchExportRuntime:
    """A ``.pt2`` file."""

    def __init__(self, path: Path, device: torch.device) -> None:
        self.module = torch.export.load(path).module()

    def __call__(self, *inputs: Tensor) -> dict[str, Tensor]:
        """Run it."""
        return dict(zip(ANSWERS, self.module(*inputs)))


class OnnxRuntime:
    """An ``.onnx`` file in ONNX Runtime, with as many threads as PyTorch has."""

    def __init__(self, path: Path, device: torch.device) -> None:
        onnxruntime = needed("onnxruntime")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = torch.get_num_threads()
        self.session = onnxruntime.InferenceSession(path, options, providers=["CPUExecutionProvider"])

    def __call__(self, *inputs: Tensor) -> dict[str, Tensor]:
        """Run it."""
        found = self.session.run(list(ANSWERS), dict(zip(INPUTS, as_arrays(inputs))))
        return {name: torch.from_numpy(value) for name, value in zip(ANSWERS, found)}


class OpenVinoRuntime:
    """An ``.xml`` file, compiled for each shape of its inputs when it is first met; in full precision."""

    def __init__(self, path: Path, device: torch.device) -> None:
        self.core = needed("openvino").Core()
        self.model = self.core.read_model(path)
        self.compiled: dict[tuple[torch.Size, ...], Any] = {}

    def __call__(self, *inputs: Tensor) -> dict[str, Tensor]:
        """Run it."""
        shapes = tuple(value.shape for value in inputs)
        if shapes not in self.compiled:
            fix_shapes(self.model, inputs)
            self.compiled[shapes] = self.core.compile_model(interleaved(self.model), "CPU", openvino_settings())
        image, *rest = inputs
        found = self.compiled[shapes](as_arrays([image.permute(0, 2, 3, 1), *rest]))
        return {name: torch.from_numpy(found[n]) for n, name in enumerate(ANSWERS)}


def interleaved(model: Any) -> Any:
    """The same OpenVINO model with pictures (B, H, W, 3): as they lie in memory, and as its convolutions want them."""
    preprocess = needed("openvino.preprocess").PrePostProcessor(model.clone())
    picture = preprocess.input("image")
    picture.tensor().set_layout(needed("openvino").Layout("NHWC"))
    picture.model().set_layout(needed("openvino").Layout("NCHW"))
    return preprocess.build()


def openvino_settings() -> dict[str, Any]:
    """One picture at a time in full precision, with as many threads as PyTorch has."""
    return {
        "INFERENCE_NUM_THREADS": torch.get_num_threads(),
        "INFERENCE_PRECISION_HINT": "f32",  # some processors would take bfloat16, which is no pixel's match
        "PERFORMANCE_HINT": "LATENCY",
    }


def as_arrays(inputs: Sequence[Tensor]) -> list[NDArray[np.float32]]:
    """For libraries that know no strides."""
    return [np.ascontiguousarray(value.numpy()) for value in inputs]


def fix_shapes(model: Any, inputs: Sequence[Tensor]) -> None:
    """Set the input shapes of an OpenVINO model."""
    model.reshape({name: list(value.shape) for name, value in zip(INPUTS, inputs)})


RUNTIMES: dict[str, type[TorchScriptRuntime | TorchExportRuntime | OnnxRuntime | OpenVinoRuntime]] = {
    ".ts": TorchScriptRuntime,
    ".pt": TorchScriptRuntime,
    ".pt2": TorchExportRuntime,
    ".onnx": OnnxRuntime,
    ".xml": OpenVinoRuntime,
}


def usable_device(asked: torch.device | str) -> torch.device:
    """The device of this name.

    Raises:
        ValueError: there is none, or this PyTorch cannot compute on it.
    """
    try:
        return torch.empty(0, device=asked).device
    except (AssertionError, NotImplementedError, RuntimeError):  # AssertionError: PyTorch was built without CUDA
        raise ValueError(
            f"device: got {str(asked)!r}, which PyTorch cannot compute on here; cpu always works"
        ) from None


def open_runtime(path: Path, device: torch.device | str = "cpu") -> Runtime:
    """Read an exported file; all but TorchScript compute on the processor whatever the device.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it has none of the suffixes, its library is not installed or cannot read it, or it computes on the
            processor only and another device was asked for.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such exported file")
    if path.suffix not in RUNTIMES:
        raise ValueError(f"{path}: got the suffix {path.suffix!r}, expected one of {', '.join(RUNTIMES)}")
    runtime = RUNTIMES[path.suffix]
    device = torch.device(device)
    if device.type != "cpu" and runtime is not TorchScriptRuntime:
        raise ValueError(f"{path}: a file of this kind is computed on the processor, got the device {device}")
    try:
        return runtime(path, device)
    except ValueError:
        raise
    except Exception as error:  # each library has its own kinds of error
        raise ValueError(f"{path}: cannot be read as an exported model: {str(error).splitlines()[0]}") from error
