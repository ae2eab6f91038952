"""What prediction leaves behind: JSON Lines and a table, and in :mod:`usvnet.deploy.annotated` pictures or a video.

Everything is written frame by frame under a temporary name, and takes its own name when the writing ends, however it
ends: what was predicted before a line broke or Ctrl-C was pressed is kept, whole.
"""

import csv
import json
import math
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, TextIO

import numpy as np

from usvnet.deploy.sources import Frame
from usvnet.deploy.track_fields import FIELDS, track_fields
from usvnet.evaluation.record_json import boat_to_json, compact, interval_90_m
from usvnet.evaluation.records import ESTIMATORS, BoatRecord
from usvnet.files import atomic_write
from usvnet.tracking.tracker import Track, track_of
from usvnet.types import KEYPOINT_NAMES, Camera


class FrameBoats(NamedTuple):
    """A frame and what was found in it."""

    frame: Frame
    boats: list[BoatRecord]
    """Best first, in the frame's pixels."""
    camera: Camera
    """The frame's (a batch of 1)."""
    tracks: list[Track] | None = None
    """The boats that are followed, seen in this frame or not; None where boats are not followed."""


Write = Callable[[FrameBoats], None]
Writer = Callable[[], AbstractContextManager[Write]]


class Outputs:
    """Several writers as one; each opens with the first frame, so that a refusal leaves nothing behind.

    Use as a context; leaving it closes all and gives the files their names.

    Args:
        writers: by the path that each writes to.
    """

    def __init__(self, writers: dict[Path, Writer]) -> None:
        self.writers = writers
        self._opened = ExitStack()
        self._writes: list[Write] = []

    @property
    def written(self) -> list[Path]:
        """The files and folders that there are."""
        return list(self.writers) if self._writes else []

    def write(self, found: FrameBoats) -> None:
        """Hand a frame to every writer.

        Raises:
            OSError: a disk that is full, or a folder that cannot be written to.
        """
        if not self._writes:
            with ExitStack() as opening:  # what is open when another one refuses must not replace an earlier result
                self._writes = [opening.enter_context(writer()) for writer in self.writers.values()]
                self._opened = opening.pop_all()
        for write in self._writes:
            write(found)

    def __enter__(self) -> "Outputs":
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close and keep, also after an error."""
        self._opened.close()


@contextmanager
def json_lines(path: Path, meta: dict[str, Any], estimator: str) -> Iterator[Write]:
    """Write what :func:`usvnet.evaluation.predictions.read_predictions` reads.

    The first line is ``{"meta": {...}}``; each further one is a frame::

        {"image": name, "frame": number, "time_s": t, "size_px": [w, h], "pitch_deg": p, "roll_deg": r, "boats": [...]}

    Its boats carry every estimator (see :mod:`usvnet.evaluation.record_json`) and the name of the chosen
    ``"estimator"``; pitch and roll are those that the camera had. Where boats are followed, each also has its
    ``"track"`` (see :mod:`usvnet.deploy.track_fields`), null until it is confirmed.
    """
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(json.dumps({"meta": meta}) + "\n")

        def write(found: FrameBoats) -> None:
            frame = found.frame
            content = {
                "image": frame.name,
                "frame": frame.number,
                "time_s": _seconds(frame),
                "size_px": list(frame.picture.shape[1::-1]),
                "pitch_deg": compact(math.degrees(found.camera.pitch_rad.item())),
                "roll_deg": compact(math.degrees(found.camera.roll_rad.item())),
                "boats": [
                    boat_to_json(boat) | {"estimator": estimator} | _track_to_json(found, number)
                    for number, boat in enumerate(found.boats)
                ],
            }
            file.write(json.dumps(content, allow_nan=False) + "\n")

        yield write


def _track_to_json(found: FrameBoats, boat: int) -> dict[str, Any]:
    """``{"track": fields or None}``, or nothing where boats are not followed."""
    if found.tracks is None:
        return {}
    track = track_of(found.tracks, boat)
    return {"track": None if track is None else track_fields(track, found.camera.height_m.item())}


def table_header(tracked: bool = False) -> list[str]:
    """The columns of the table: one row is one boat. With ``tracked``, those of its track are the last."""
    ranges = ("estimator", "valid", "slant_m", "slant_std_m", "low_90_m", "high_90_m", "horizontal_m", "bearing_deg")
    others = (f"{name}_{what}" for name in ESTIMATORS for what in ("slant_m", "slant_std_m"))
    parts = ("u_px", "v_px", "visibility", "uu_px2", "uv_px2", "vv_px2")
    keypoints = (f"{name}_{part}" for name in KEYPOINT_NAMES for part in parts)
    boxes = ("score", "x1_px", "y1_px", "x2_px", "y2_px")
    tracks = (f"track_{name}" for name in FIELDS) if tracked else ()
    return ["image", "frame", "time_s", "boat", *boxes, *ranges, *others, *keypoints, *tracks]


def table_rows(found: FrameBoats, estimator: str) -> Iterator[list[Any]]:
    """The rows of one frame; what is not finite is empty."""
    frame = found.frame
    for number, boat in enumerate(found.boats):
        estimate = boat.ranges[estimator]
        covariance = boat.keypoint_covariance_px2[:, [0, 0, 1], [0, 1, 1]]
        keypoints = np.concatenate([boat.keypoints_px, boat.visibility[:, None], covariance], axis=1)
        chosen = [estimate.slant_m, estimate.slant_std_m, *interval_90_m(estimate), estimate.horizontal_m]
        others = [metres for other in boat.ranges.values() for metres in (other.slant_m, other.slant_std_m)]
        yield [
            *(frame.name, frame.number, _seconds(frame), number, compact(boat.score), *compact(boat.box_px)),
            *(estimator, int(estimate.valid), *compact(chosen), compact(math.degrees(estimate.bearing_rad))),
            *compact(others),
            *compact(keypoints.ravel()),
            *((track or {}).get(name) for track in _track_to_json(found, number).values() for name in FIELDS),
        ]


@contextmanager
def boat_table(path: Path, estimator: str, tracked: bool = False) -> Iterator[Write]:
    """Write a CSV with a row for each boat: the ranges of the chosen estimator, those of all, and its track."""
    with atomic_write(path) as temporary, open_table(temporary) as file:
        table = csv.writer(file)
        table.writerow(table_header(tracked))
        yield lambda found: table.writerows(table_rows(found, estimator))


def open_table(path: Path) -> TextIO:
    """A file for a CSV writer, in which a picture's name that is no UTF-8 stands as its bytes."""
    return path.open("w", encoding="utf-8", errors="backslashreplace", newline="")


def _seconds(frame: Frame) -> float | None:
    return None if frame.time_s is None else round(frame.time_s, 6)
