"""Reading trained weights, strictly and without running any code that a file may carry."""

import hashlib
import pickle
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from usvnet.files import atomic_write
from usvnet.intervals import IntervalFactors
from usvnet.model import USVNet

STAMP = "usvnet"
"""Key of what training writes beside the weights: variant, curved_water, refine (see :class:`USVNet`; absent is
None), image_size (px, None where not known) and, once they are calibrated, intervals: factor_68, factor_90 and boats of
each estimator (see :mod:`usvnet.intervals`), keypoint_share and size_std (see :mod:`usvnet.keypoint_noise`)."""
MODEL_PREFIX = "model."
"""Where the weights of :class:`USVNet` stand in the ``state_dict`` of :class:`usvnet.training.USVModule`."""


def read_checkpoint(path: Path | str) -> dict[str, Any]:
    """Read a checkpoint as training wrote it; its ``state_dict`` holds the averaged weights.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is not a checkpoint of usvnet.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such checkpoint file")
    try:
        if not zipfile.is_zipfile(path):  # torch.load takes older formats too
            raise pickle.UnpicklingError("not a zip archive")
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # a damaged pickle leads torch.load to nearly every kind of error
        raise ValueError(f"{path}: got a file that is not a checkpoint, expected one written by train.py") from error
    stamp, weights = (checkpoint.get(key) for key in (STAMP, "state_dict")) if isinstance(checkpoint, dict) else (0, 0)
    if not isinstance(stamp, dict) or not isinstance(weights, dict) or not isinstance(stamp.get("variant"), str):
        raise ValueError(f"{path}: got a checkpoint of something else, expected one written by train.py")
    return checkpoint


def check_variant(path: Path | str, checkpoint: dict[str, Any], variant: str) -> None:
    """Make sure that a checkpoint belongs to a network of size ``variant``.

    Raises:
        ValueError: it belongs to another size.
    """
    found = checkpoint[STAMP]["variant"]
    if found != variant:
        raise ValueError(f"{path}: got a checkpoint of size {found!r}, expected size {variant!r}")


def load_model(path: Path | str, variant: str | None = None) -> USVNet:
    """Build the network that a checkpoint belongs to, with its averaged weights and interval factors, ready to predict.

    Args:
        path: a checkpoint written by train.py.
        variant: the size that is expected, or None to take whichever the checkpoint has.

    Returns:
        The model on the CPU in evaluation mode.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is not a checkpoint of usvnet, of another size, or its weights or factors do not fit.
    """
    checkpoint = read_checkpoint(path)
    if variant is not None:
        check_variant(path, checkpoint, variant)
    stamp = checkpoint[STAMP]
    if not isinstance(stamp.get("curved_water"), bool):
        raise ValueError(f"{path}: curved_water is {stamp.get('curved_water')!r}, expected True or False")
    try:
        model = USVNet(stamp["variant"], curved_water=stamp["curved_water"], refine=stamp.get("refine"))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    weights = {
        name.removeprefix(MODEL_PREFIX): value
        for name, value in checkpoint["state_dict"].items()
        if str(name).startswith(MODEL_PREFIX)
    }
    try:
        model.load_state_dict(weights, strict=True)
    except RuntimeError as error:
        reason = str(error).splitlines()[1].strip() if "\n" in str(error) else str(error)
        raise ValueError(f"{path}: its weights do not fit a network of size {stamp['variant']!r}: {reason}") from error
    try:
        model.noise.set_share(stamp.get("keypoint_share", 0.0))
        model.noise.set_size_std(stamp.get("size_std", 0.0))
        model.intervals.set_factors({name: IntervalFactors(*row) for name, row in stamp.get("intervals", {}).items()})
    except (ValueError, TypeError, AttributeError, OverflowError, RuntimeError) as error:
        raise ValueError(f"{path}: {error}") from error
    return model.eval()


def write_calibration(
    path: Path | str, keypoint_share: float, size_std: float, factors: Mapping[str, IntervalFactors]
) -> None:
    """Put a calibration in the place of a checkpoint's own, leaving everything else in it as it is.

    Args:
        path: the checkpoint.
        keypoint_share: doubt of the keypoints as a share of the boat's size (see :mod:`usvnet.keypoint_noise`).
        size_std: doubt of the size of a boat as it is drawn.
        factors: of the intervals, by estimator.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is not a checkpoint of usvnet.
    """
    checkpoint = read_checkpoint(path)
    checkpoint[STAMP]["keypoint_share"] = keypoint_share
    checkpoint[STAMP]["size_std"] = size_std
    checkpoint[STAMP]["intervals"] = {name: list(found) for name, found in factors.items()}
    with atomic_write(path) as temporary:
        torch.save(checkpoint, temporary)


def pack_checkpoint(path: Path | str, output: Path | str) -> None:
    """Write what prediction needs of a checkpoint, small enough to pass on: weights in float16, no optimiser.

    Statistics of the norms stay in float32: variances leave float16's range easily, and they are few.

    Args:
        path: a checkpoint written by train.py.
        output: file to write; :func:`load_model` reads it as it reads the checkpoint.

    Raises:
        FileNotFoundError: no such checkpoint.
        ValueError: the file is not a checkpoint of usvnet, or a weight has no place in float16.
    """
    checkpoint = read_checkpoint(path)
    weights = {name: value for name, value in checkpoint["state_dict"].items() if str(name).startswith(MODEL_PREFIX)}
    packed = {
        name: value if "running_" in name or not value.is_floating_point() else value.half()
        for name, value in weights.items()
    }
    if lost := [name for name, value in packed.items() if not value.isfinite().all()]:
        raise ValueError(f"{path}: the weight {lost[0]} is too large for float16")
    with atomic_write(output) as temporary:
        torch.save({STAMP: checkpoint[STAMP], "state_dict": packed}, temporary)


def sha256(path: Path | str) -> str:
    """Hexadecimal SHA-256 of a file."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
