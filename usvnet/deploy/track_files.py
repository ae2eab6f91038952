"""Tracks as files: a table for people, and MOT text for the programs that score trackers."""

import csv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from usvnet.deploy.outputs import FrameBoats, Write, open_table
from usvnet.deploy.track_fields import FIELDS, track_fields
from usvnet.files import atomic_write


@contextmanager
def track_table(path: Path) -> Iterator[Write]:
    """Write a CSV with a row for every confirmed track in every frame, also while its boat is not seen.

    ``boat`` is the boat's place in the frame, as in the table of boats; empty where it is not seen.
    """
    with atomic_write(path) as temporary, open_table(temporary) as file:
        table = csv.writer(file)
        table.writerow(["image", "frame", "time_s", "boat", *FIELDS])

        def write(found: FrameBoats) -> None:
            frame, height_m = found.frame, found.camera.height_m.item()
            for track in found.tracks or ():
                time_s = None if frame.time_s is None else round(frame.time_s, 6)
                table.writerow(
                    [frame.name, frame.number, time_s, track.sighting, *track_fields(track, height_m).values()]
                )

        yield write


@contextmanager
def mot_text(path: Path) -> Iterator[Write]:
    """Write MOTChallenge text: ``frame,id,bb_left,bb_top,bb_width,bb_height,conf,x,y,z``, a line for each boat seen.

    Frames, ids and pixels begin at 1, as that format has it; x, y, z are metres in the level frame.
    """
    with atomic_write(path) as temporary, temporary.open("w", encoding="utf-8") as file:

        def write(found: FrameBoats) -> None:
            file.writelines(f"{','.join(map(str, line))}\n" for line in mot_lines(found))

        yield write


def mot_lines(found: FrameBoats) -> Iterator[list[Any]]:
    """The numbers of each line of a frame."""
    for track in found.tracks or ():
        if track.sighting is None:
            continue
        boat = found.boats[track.sighting]
        x1, y1, x2, y2 = boat.box_px.tolist()
        left, top = x1 + 1.5, y1 + 1.5  # the outer edge of the first pixel is -0.5 here and 1 there
        box = [round(value, 2) for value in (left, top, x2 - x1, y2 - y1)]
        place = [round(value, 3) for value in (track.motion[0], found.camera.height_m.item(), track.motion[1])]
        yield [found.frame.number + 1, track.number, *box, round(boat.score, 4), *place]
