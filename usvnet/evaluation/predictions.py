"""Predictions on disk: made once, with the record of what made them, and scored as often as one likes.

A file is JSON Lines. The first line is ``{"meta": {...}}``: everything that the predictions depend on. Every other
line is one picture, in its native pixels (integer centres), with its boats as :mod:`usvnet.evaluation.record_json`
writes them::

    {"image": "test/0003.jpg", "boats": [...]}
"""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import torch
from rich.console import Console
from rich.progress import track
from torch.utils.data import DataLoader

from usvnet.data.dataset import BoatDataset, collate
from usvnet.evaluation.record_json import boat_from_json, boat_to_json
from usvnet.evaluation.records import BoatRecord, to_records
from usvnet.files import atomic_write
from usvnet.geometry.camera import camera_to
from usvnet.geometry.hull_model import hull_to
from usvnet.intervals import IntervalFactors
from usvnet.model import USVNet
from usvnet.types import Native

Meta = dict[str, Any]
"""What predictions depend on; values that JSON can hold."""


class PicturePrediction(NamedTuple):
    """The boats of one picture, best first, in its native pixels."""

    image: str
    boats: list[BoatRecord]


def predict_dataset(model: USVNet, dataset: BoatDataset, path: Path | str, meta: Meta, batch_size: int = 16) -> None:
    """Predict every picture of a dataset and write the file, with a progress bar on stderr.

    Args:
        model: on the device to use.
        dataset: letterboxed and not augmented.
        path: the file to write; it appears when all pictures are done.
        meta: what the predictions depend on.
        batch_size: pictures a batch.
    """
    write_predictions(path, meta, predict_pictures(model, dataset, batch_size))


def write_predictions(path: Path | str, meta: Meta, pictures: Iterable[PicturePrediction]) -> None:
    """Write a predictions file, whole or not at all."""
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(json.dumps({"meta": meta}) + "\n")
        for image, boats in pictures:
            line = {"image": image, "boats": [boat_to_json(boat) for boat in boats]}
            file.write(json.dumps(line, allow_nan=False) + "\n")


def read_predictions(path: Path | str, meta: Meta | None = None) -> list[PicturePrediction]:
    """Read a predictions file.

    Args:
        path: the file.
        meta: what the predictions are expected to depend on; None takes any.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is damaged, or was made with something else than ``meta`` says.
    """
    path = Path(path)
    pictures = []
    read_meta(path)
    with path.open(encoding="utf-8", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            try:
                content = json.loads(line)
                if number == 1:
                    found = _meta_of(content)
                    factors = {name: IntervalFactors(*row) for name, row in found.get("intervals", {}).items()}
                else:
                    pictures.append(
                        PicturePrediction(
                            str(content["image"]), [boat_from_json(boat, factors) for boat in content["boats"]]
                        )
                    )
            except _DAMAGE as error:
                raise ValueError(f"{path}:{number}: not a line of a predictions file ({error!r})") from error
            if number == 1 and meta is not None:
                _check_meta(path, found, meta)
    return pictures


def read_meta(path: Path | str) -> Meta:
    """Read what a predictions file depends on.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file does not begin as one.
    """
    path = Path(path)
    with path.open(encoding="utf-8", errors="replace") as file:
        try:
            return _meta_of(json.loads(file.readline()))
        except _DAMAGE as error:
            raise ValueError(f"{path}:1: not the first line of a predictions file ({error!r})") from error


_DAMAGE = (KeyError, TypeError, ValueError, AttributeError, OverflowError, RecursionError)
"""What a line that is not ours leads to, as JSON or as a boat."""


def _meta_of(content: Any) -> Meta:
    meta: Meta = content["meta"]
    if not isinstance(meta, dict):
        raise TypeError(f"meta is {type(meta).__name__}, expected a mapping")
    return meta


HASHED = {"frames_sha256": "pictures, cameras or hulls", "checkpoint_sha256": "weights"}
"""What stands behind a hash that two evaluations may differ in."""


def _check_meta(path: Path, found: Meta, expected: Meta) -> None:
    for key in sorted(expected.keys() | found.keys()):
        if found.get(key) != expected.get(key):
            what = HASHED.get(key, "")
            told = f"of other {what}" if what else f"with {key} {found.get(key)!r}, not {expected.get(key)!r}"
            raise ValueError(f"{path}: made {told}: add --overwrite to replace it, or choose another --output")


def predict_pictures(model: USVNet, dataset: BoatDataset, batch_size: int = 16) -> Iterator[PicturePrediction]:
    """Predict picture by picture, with a progress bar on stderr; arguments as in :func:`predict_dataset`."""
    factors = model.intervals.factors()
    device = next(model.parameters()).device
    loader = DataLoader(dataset, batch_size=batch_size, collate_fn=collate)
    model.eval()
    for batch in track(loader, "Predicting", console=Console(stderr=True), transient=True):
        image = batch.image.to(device, memory_format=torch.channels_last)
        with torch.inference_mode():
            native = None if batch.native is None else Native(*(tensor.to(device) for tensor in batch.native))
            prediction = model(image, camera_to(batch.camera, device), hull_to(batch.hull, device), native)
        indices = batch.frame_index.tolist()
        letterbox = torch.stack([dataset.letterbox_matrix(index) for index in indices])
        for index, boats in zip(indices, to_records(prediction, letterbox, factors)):
            yield PicturePrediction(dataset.frames[index].name, boats)
