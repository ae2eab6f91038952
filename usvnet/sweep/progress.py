"""What a run's folder says about the run: how far it is, and what came of it."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from usvnet.files import atomic_write

PROGRESS, RESULT, LOG = "progress.json", "result.json", "log.txt"


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    stage: str
    """Training or scoring."""
    epochs_done: int
    training_s: float
    """Seconds spent in the epochs that are done, over all interruptions."""


@dataclass(frozen=True)
class Result:
    """What came of a run; the file appears last, so a run that has one is finished."""

    configuration_sha256: str
    metrics: dict[str, Any]
    """Scores on the test split, as in ``metrics.json``."""
    training_s: float
    device: str
    versions: dict[str, str]


def write_progress(folder: Path, progress: Progress) -> None:
    """Replace ``progress.json``."""
    _write(folder / PROGRESS, progress)


def read_progress(folder: Path) -> Progress | None:
    """Read ``progress.json``; None where there is none yet."""
    content = _read(folder / PROGRESS)
    return None if content is None else Progress(**content)


def write_result(folder: Path, result: Result) -> None:
    """Write ``result.json``: from then on the run is finished."""
    _write(folder / RESULT, result)


def read_result(folder: Path) -> Result | None:
    """Read ``result.json``; None where the run is not finished.

    Raises:
        ValueError: the file is damaged.
    """
    content = _read(folder / RESULT)
    return None if content is None else Result(**content)


def _write(path: Path, content: Progress | Result) -> None:
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(asdict(content), indent=1) + "\n", encoding="utf-8")


def _read(path: Path) -> dict[str, Any] | None:
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except ValueError as error:
        raise ValueError(f"{path}: damaged ({error}): delete it") from None
    return content
