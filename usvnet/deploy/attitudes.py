"""Pitch and roll of every frame: the mount's, an inertial unit's at that time, or the horizon's in the picture."""

import math
from collections import Counter
from pathlib import Path

from usvnet.data.attitudes import AttitudeConfig, turn_to_horizon
from usvnet.data.formats.imu import read_imu
from usvnet.deploy.sources import Frame
from usvnet.geometry.camera import with_attitude
from usvnet.types import Camera


class FrameAttitudes:
    """Turns a camera to the attitude that it had when a frame was taken, and counts how that went.

    Args:
        config: where the attitude comes from; "file" is the inertial unit's where there is a log, else the mount's.
        imu: log of an inertial unit (see :mod:`usvnet.data.formats.imu`); its times are those of the frames.

    Raises:
        FileNotFoundError: no such log.
        ValueError: a faulty log, naming the line.
    """

    def __init__(self, config: AttitudeConfig, imu: Path | None = None) -> None:
        self.config = config
        self.log = None if imu is None else read_imu(imu)
        self.outcomes: Counter[str] = Counter()
        """How often the horizon was seen, or why not, and how often the log had nothing to say."""

    def turn(self, frame: Frame, camera: Camera) -> Camera:
        """Turn the camera (a batch of 1) of a frame."""
        if self.log is not None:
            camera = self._read(frame, camera)
        if self.config.source in ("horizon", "combined"):
            camera, outcome = turn_to_horizon(frame.picture, camera, self.config.source == "combined")
            self.outcomes[f"horizon {outcome}"] += 1
        return camera

    def _read(self, frame: Frame, camera: Camera) -> Camera:
        assert self.log is not None
        reading = None
        if frame.time_s is not None:
            reading = self.log.at(frame.time_s + self.config.time_offset_s, self.config.max_gap_s)
        self.outcomes["imu read" if reading else "imu silent"] += 1
        if reading is None:
            return camera
        angles_deg, stds_deg = reading
        pitch, roll = (math.radians(angle) for angle in angles_deg)
        if stds_deg is None:
            return with_attitude(camera, pitch, roll)
        return with_attitude(camera, pitch, roll, *(math.radians(std) for std in stds_deg))
