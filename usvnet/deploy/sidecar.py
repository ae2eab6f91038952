"""What stands beside an exported file: everything that a user of it must know, written and read."""

import hashlib
import json
import platform
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch import nn

from usvnet import __version__
from usvnet.checkpoints import sha256
from usvnet.deploy.deployed import ANSWERS, INPUTS, NATIVE_INPUTS
from usvnet.deploy.formats import format_of
from usvnet.geometry.hull_model import generic_hull
from usvnet.intervals import IntervalFactors
from usvnet.model import USVNet
from usvnet.types import KEYPOINT_NAMES

CONVENTIONS = {
    "pixel": "u right, v down, the centre of a pixel is an integer: a picture spans [-0.5, W - 0.5] x [-0.5, H - 0.5]",
    "camera_frame": "x right, y down, z forward",
    "level_frame": "at the camera: X right, Y down along gravity, Z horizontal and forward; "
    "p_level = Rx(pitch) Rz(roll) p_camera",
    "pitch": "above 0: the optical axis points below the horizontal",
    "roll": "above 0: the camera is turned clockwise, seen from behind it",
    "range": "slant is the straight line from the optical centre to the point, horizontal is along the water",
    "units": "stand in the names: px, px2, m, rad",
}


def sidecar_path(path: Path) -> Path:
    """Where the description of the file ``path`` stands: ``model.onnx.json`` of ``model.onnx``."""
    return path.with_name(f"{path.name}.json")


def describe(model: USVNet, path: Path, score_threshold: float, image_size: int | None) -> dict[str, Any]:
    """Everything that a user of the file must know but how it compares, ready for JSON."""
    hull = generic_hull()
    kind = format_of(path)
    more = NATIVE_INPUTS if model.refiner is not None else {}
    return {
        "format": kind.title,
        "shapes": kind.shapes,
        "usvnet": __version__,
        "torch": torch.__version__,
        "python": platform.python_version(),
        "model": {
            "variant": model.variant,
            "parameters": sum(parameter.numel() for parameter in model.parameters()),
            "trained_image_size_px": image_size,
            "largest_stride_px": model.network.largest_stride_px,
            "max_boats": model.max_boats,
            "score_threshold": score_threshold,
            "iou_threshold": model.iou_threshold,
            "curved_water": model.ranging.curved_water,
            "refine": None if model.refiner is None else "native",
            "interval_factors": {name: found._asdict() for name, found in model.intervals.factors().items()},
        },
        "inputs": INPUTS | more,
        "inputs_that_may_be_left_out": (*kind.optional_inputs, *more),
        "outputs": ANSWERS,
        "generic_hull": {name: value[0].tolist() for name, value in hull._asdict().items()},
        "keypoint_names": KEYPOINT_NAMES,
        "conventions": CONVENTIONS,
        "sha256": {"weights": weights_sha256(model)}
        | {suffix.removeprefix("."): sha256(path.with_suffix(suffix)) for suffix in (path.suffix, *kind.companions)},
    }


def weights_sha256(model: nn.Module) -> str:
    """SHA-256 of the names and bytes of all weights, in order."""
    digest = hashlib.sha256()
    for name, tensor in model.state_dict().items():
        digest.update(name.encode())
        digest.update(tensor.cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()


class Sidecar(NamedTuple):
    """What running a file needs of its description."""

    score_threshold: float
    image_size: int | None
    """Side of the pictures that the network was trained on."""
    largest_stride_px: int
    refines: bool
    """Whether it looks at boats again in native pictures."""
    factors: dict[str, IntervalFactors]


def read_sidecar(path: Path) -> Sidecar:
    """Read the description of the exported file ``path``.

    Raises:
        FileNotFoundError: there is none.
        ValueError: it is not one, it describes another file, or its keypoints are others than ours.
    """
    where = sidecar_path(path)
    if not where.is_file():
        raise FileNotFoundError(
            f"{where}: no such file, expected the description that usvnet export wrote of {path.name}"
        )
    try:
        about = json.loads(where.read_text())
        model, digests = about["model"], about["sha256"]
        size = model["trained_image_size_px"]
        found = Sidecar(
            score_threshold=float(model["score_threshold"]),
            image_size=None if size is None else int(size),
            largest_stride_px=int(model["largest_stride_px"]),
            refines=model.get("refine") == "native",  # files of before have no such field
            factors={name: IntervalFactors(**factors) for name, factors in model["interval_factors"].items()},
        )
        names = tuple(about["keypoint_names"])
        digests = {suffix: digests[suffix] for suffix in digests if suffix != "weights"}
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise ValueError(f"{where}: got something else, expected a description that usvnet export wrote") from error
    if names != KEYPOINT_NAMES:
        raise ValueError(
            f"{where}: keypoint_names are {', '.join(map(str, names))}, expected {', '.join(KEYPOINT_NAMES)}"
        )
    for suffix, digest in digests.items():
        file = path.with_suffix(f".{suffix}")
        if not file.is_file() or sha256(file) != digest:
            raise ValueError(f"{where}: describes another {file.name}: export the model again")
    return found
