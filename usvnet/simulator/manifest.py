"""``manifest.json``: what a dataset was rendered with, so that a later run goes on with the same or says no.

It holds no time, no path and no number of workers: the same dataset has the same manifest.
"""

import dataclasses
import hashlib
import json
import platform
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from usvnet import __version__
from usvnet.files import atomic_write
from usvnet.simulator.engine import versions
from usvnet.simulator.settings import SimulatorSettings

MANIFEST = "manifest.json"
MUST_AGREE = {
    "config_sha256": "another configuration",
    "files_sha256": "other files behind the configuration",
    "quality": "quality {}",
    "scale": "scale {}",
}
"""What makes another dataset, and how to say so."""


def make_manifest(config: Path, settings: SimulatorSettings, quality: str, scale: float, engine: str) -> dict[str, Any]:
    """Describe a dataset.

    Args:
        config: the simulator's settings file.
        settings: what was read from it.
        quality: of the rendering.
        scale: of every camera's picture.
        engine: Mitsuba's variant.

    Raises:
        OSError: a file cannot be read.
    """
    text = config.read_text(encoding="utf-8")
    return {
        "command": f"usvnet simulate --config {config.name} --quality {quality} --scale {scale:g}",
        "frames": dataclasses.asdict(settings.frames),
        "seed": settings.seed,
        "quality": quality,
        "scale": scale,
        "engine": engine,
        "versions": {
            "usvnet": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "opencv": cv2.__version__,
            **versions(),
        },
        "config_sha256": hashlib.sha256(text.encode()).hexdigest(),
        "files_sha256": {
            place: hashlib.sha256(path.read_bytes()).hexdigest() for place, path in _files_behind(settings).items()
        },
        "config": text,
    }


def _files_behind(settings: Any, place: str = "") -> dict[str, Path]:
    """Every file that the settings name, such as meshes and cameras, by the keys that lead to it."""
    if isinstance(settings, Path):
        return {place: settings}
    if dataclasses.is_dataclass(settings):
        settings = {field.name: getattr(settings, field.name) for field in dataclasses.fields(settings)}
    if not isinstance(settings, dict):
        return {}
    found: dict[str, Path] = {}
    for key, value in settings.items():
        found |= _files_behind(value, f"{place}.{key}" if place else str(key))
    return found


def claim_folder(root: Path, manifest: dict[str, Any]) -> list[str]:
    """Write the manifest into a new folder, or insist that the folder's own is of the same dataset.

    Returns:
        Sentences about other versions that the dataset was begun with: its pictures will not agree bit for bit.

    Raises:
        ValueError: the folder holds another dataset, or something else.
    """
    path = root / MANIFEST
    if not path.is_file():
        if root.exists() and not root.is_dir():
            raise ValueError(f"{root} is a file, expected a folder")
        if root.is_dir() and any(not entry.name.startswith(".") for entry in root.iterdir()):
            raise ValueError(f"{root} holds other files and no {MANIFEST}: choose another folder")
        with atomic_write(path) as temporary:
            temporary.write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
        return []
    found = read_manifest(path)
    for key, words in MUST_AGREE.items():
        if found.get(key) != manifest[key]:
            before = words.format(found.get(key))
            raise ValueError(f"{root} was rendered with {before}: delete it or choose another folder")
    then = {"engine": found.get("engine"), **found.get("versions", {})}
    now = {"engine": manifest["engine"], **manifest["versions"]}
    return [
        f"{root} was begun with {key} {then.get(key)}, now it is {now[key]}: pictures may differ in their last bits"
        for key in now
        if then.get(key) != now[key]
    ]


def read_manifest(path: Path) -> dict[str, Any]:
    """Read a manifest.

    Raises:
        ValueError: it is damaged.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ValueError("no mapping")
    except ValueError as error:
        raise ValueError(f"{path}: damaged ({error}): delete its folder or choose another one") from None
    return content
