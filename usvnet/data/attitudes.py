"""Pitch and roll of every picture, from whichever source is asked for: mount, files, or the horizon in the picture."""

import math
import sys
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from rich.console import Console
from rich.progress import track

from usvnet.data.formats.imu import read_imu
from usvnet.data.formats.ranges import FrameNotes
from usvnet.data.horizon_detector import find_horizon
from usvnet.data.pictures import Picture, read_picture
from usvnet.data.records import Frame
from usvnet.geometry.attitude import Attitude, camera_attitude, combine
from usvnet.geometry.camera import with_attitude
from usvnet.types import Camera

IMU_FILE = "imu.csv"


@dataclass(frozen=True)
class AttitudeConfig:
    """Where pitch and roll come from.

    Attributes:
        source: "file" takes what frames.csv and ranges.csv say of a picture, else what imu.csv says of its time, else
            the camera file's mount. "mount" takes the mount alone. "horizon" takes the horizon seen in the picture,
            searched around what the files say, and what the files say where none is seen. "combined" joins the two by
            inverse variance; where they contradict each other it takes the less certain one.
        time_offset_s: time of imu.csv less the time_s of frames.csv at the same moment.
        max_gap_s: a picture between two rows of imu.csv farther apart than this keeps the mount's attitude.
    """

    source: Literal["file", "mount", "horizon", "combined"] = "file"
    time_offset_s: float = 0.0
    max_gap_s: float = 0.2

    def __post_init__(self) -> None:
        if not math.isfinite(self.time_offset_s):
            raise ValueError(f"attitude.time_offset_s: got {self.time_offset_s}, expected a finite number of seconds")
        if not self.max_gap_s > 0:
            raise ValueError(f"attitude.max_gap_s: got {self.max_gap_s}, expected seconds above 0")


FROM_FILES = AttitudeConfig()


def fill_from_imu(root: Path, notes: dict[str, FrameNotes], config: AttitudeConfig) -> None:
    """Note the attitude that ``imu.csv``, if there is one, has at each picture's time; what is noted already stays.

    Raises:
        ValueError: a faulty row, or no picture has a time.
    """
    path = root / IMU_FILE
    if config.source == "mount" or not path.is_file():
        return
    log = read_imu(path)
    timed = [note for note in notes.values() if note.time_s is not None]
    if not timed:
        raise ValueError(f"{path}: no picture has a time, expected a column time_s in {root / 'frames.csv'}")
    lost = 0
    for note in timed:
        assert note.time_s is not None
        reading = log.at(note.time_s + config.time_offset_s, config.max_gap_s)
        if reading is None:
            lost += 1
            continue
        (pitch, roll), stds = reading
        if note.pitch_deg is None:
            note.pitch_deg, note.pitch_std_deg = pitch, note.pitch_std_deg if stds is None else stds[0]
        if note.roll_deg is None:
            note.roll_deg, note.roll_std_deg = roll, note.roll_std_deg if stds is None else stds[1]
    if lost:
        print(
            f"{path}: {lost} of {len(timed)} pictures lie outside it or in a gap of more than {config.max_gap_s:g} s; "
            "they keep their mount's attitude",
            file=sys.stderr,
        )


def noted_camera(camera: Camera, note: FrameNotes) -> Camera:
    """Turn a picture's camera to the attitude that was noted; what was not noted stays the mount's."""
    degrees = (note.pitch_deg, note.roll_deg, note.pitch_std_deg, note.roll_std_deg)
    angles = [
        mount if value is None else mount.new_tensor([math.radians(value)])
        for value, mount in zip(degrees, camera_attitude(camera))
    ]
    return with_attitude(camera, *angles)


def see_horizons(frames: list[Frame], config: AttitudeConfig) -> list[Frame]:
    """Turn the cameras of frames to the horizon in their pictures, where ``config`` asks for it and it is seen.

    It counts on stderr in how many pictures it was seen, why not in the others, and how often it was contradicted.

    Raises:
        ValueError: a damaged picture.
    """
    if config.source not in ("horizon", "combined"):
        return frames
    outcomes: Counter[str] = Counter()
    turned = []
    for frame in track(frames, "Looking for horizons", console=Console(stderr=True), transient=True):
        camera, outcome = turn_to_horizon(read_picture(frame.image_path), frame.camera, config.source == "combined")
        outcomes[outcome] += 1
        turned.append(replace(frame, camera=camera))
    told = ", ".join(f"{outcome} {count}" for outcome, count in outcomes.most_common())
    print(f"horizon in {len(frames)} pictures: {told}", file=sys.stderr)
    return turned


def turn_to_horizon(picture: Picture, camera: Camera, joined: bool) -> tuple[Camera, str]:
    """Turn a camera (a batch of 1) to the horizon in its picture.

    Args:
        picture: (H, W, 3) RGB.
        camera: its camera; as it is where no horizon is seen.
        joined: join what it says to the camera's own attitude, by inverse variance.

    Returns:
        The camera, and what came of it: seen, contradicted, or why no horizon was found.
    """
    sight = find_horizon(picture, camera)
    if sight.attitude is None:
        return camera, sight.reason
    horizon = Attitude(*(angle.to(camera.pitch_rad) for angle in sight.attitude))
    if not joined:
        return with_attitude(camera, *horizon), "seen"
    both = combine([camera_attitude(camera), horizon])
    return with_attitude(camera, *both.attitude), "seen" if both.consistent.item() else "contradicted"
