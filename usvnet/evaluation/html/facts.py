"""What an evaluation was made of: model, data, settings, versions."""

import platform
import subprocess
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path

import torch

LABELS = {
    "usvnet": "usvnet",
    "torch": "PyTorch",
    "variant": "Network",
    "max_boats": "Most boats a picture",
    "score_threshold": "Lowest score kept",
    "iou_threshold": "Overlap that counts as the same boat",
    "curved_water": "Curved water",
    "intervals": "Interval factors (68 %, 90 %, boats)",
    "keypoint_share": "Keypoints stray further by, share of the boat",
    "size_std": "Boats are drawn larger or smaller by, standard deviation",
    "image_size": "The network sees, px",
    "native_size": "Longer side for the second look, px",
    "split": "Split",
    "frames_sha256": "SHA-256 of pictures, cameras and hulls",
    "checkpoint": "Checkpoint",
    "checkpoint_sha256": "SHA-256 of the checkpoint",
}


def page_facts(made_with: Mapping[str, object]) -> dict[str, str]:
    """Everything worth knowing of how the figures came about, by the name that people read.

    Args:
        made_with: what the predictions depend on, see :func:`usvnet.evaluation.evaluator.prediction_meta`, and more.
    """
    known = {LABELS.get(name, name): _text(value) for name, value in made_with.items() if value is not None}
    return {
        **known,
        "Commit": commit() or "not known",
        "Python": platform.python_version(),
        "Machine": f"{platform.system()} {platform.machine()}, {_device()}",
        "Written": now(),
    }


def now() -> str:
    """This minute."""
    return datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")


def commit() -> str | None:
    """The commit of the usvnet that runs, None where it does not run from a repository of its own."""
    root = Path(__file__).resolve().parents[3]
    if not (root / ".git").exists():
        return None
    try:
        asked = subprocess.run(
            ["git", "-C", str(root), "rev-parse", "HEAD"], capture_output=True, text=True, timeout=10, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return asked.stdout.strip()


def _device() -> str:
    return torch.cuda.get_device_name() if torch.cuda.is_available() else "processor only"


def _text(value: object) -> str:
    if isinstance(value, Mapping):
        return "; ".join(f"{name} {_text(item)}" for name, item in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_text(item) for item in value)
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
