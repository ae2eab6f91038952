"""The boats that are there: born of sightings, confirmed, followed, and given up."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from usvnet.intervals import Z_90
from usvnet.tracking.association import associate
from usvnet.tracking.encounter import Encounter, encounter
from usvnet.tracking.filter import BoatFilter, Sighting
from usvnet.tracking.motion import BEARING, GROWTH, INVERSE, FloatArray, to_metres


@dataclass(frozen=True)
class TrackingConfig:
    """When a boat counts as one, how long it is believed in, and how it may move.

    Attributes:
        confirm_hits: a new boat is confirmed, and gets its number, once it was seen in so many ...
        confirm_frames: ... of so many frames in a row.
        lost_s: a boat that was not seen for longer is given up.
        gate_probability: that a boat's own sighting is accepted as such; farther ones begin a new boat.
        speed_std_m_s: standard deviation of either component of a new boat's velocity relative to the camera.
        wander_m_s: standard deviation of the change of either component in one second.
        lasting_share: part of the variance of a boat's own error (waves, keypoints) that lasts; the rest is new in
            every frame.
        noise_correlation_s: it lasts for so long: faster frames say little new about it.
        camera_correlation_s: time in which the error of the camera's pitch and roll changes: long for a fixed mount,
            a second or two for one that rocks without an IMU or horizon.
        trail_s: length of the trail that is drawn.
    """

    confirm_hits: int = 3
    confirm_frames: int = 5
    lost_s: float = 2.0
    gate_probability: float = 0.999
    speed_std_m_s: float = 5.0
    wander_m_s: float = 0.3
    lasting_share: float = 0.5
    noise_correlation_s: float = 0.5
    camera_correlation_s: float = 60.0
    trail_s: float = 10.0

    def __post_init__(self) -> None:
        if not 1 <= self.confirm_hits <= self.confirm_frames:
            raise ValueError(
                f"tracking.confirm_hits: got {self.confirm_hits}, expected 1 to confirm_frames ({self.confirm_frames})"
            )
        if not 0 < self.gate_probability < 1:
            raise ValueError(f"tracking.gate_probability: got {self.gate_probability:g}, expected between 0 and 1")
        for name in ("lost_s", "speed_std_m_s", "wander_m_s", "noise_correlation_s", "camera_correlation_s", "trail_s"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"tracking.{name}: got {getattr(self, name):g}, expected a finite number above 0")
        if not 0 <= self.lasting_share < 1:
            raise ValueError(f"tracking.lasting_share: got {self.lasting_share:g}, expected from 0 to below 1")


class Track(NamedTuple):
    """A confirmed boat at one time; ranges are horizontal."""

    number: int
    """From 1, in the order of confirmation; never given twice."""
    age_s: float
    """Since it was first seen."""
    unseen_s: float
    """Since it was last seen."""
    sighting: int | None
    """Place among the frame's sightings; None where it was not seen."""
    range_m: float
    range_std_m: float
    low_90_m: float
    """The 90 % interval, which is not symmetric: it is the one of 1 / range, turned over."""
    high_90_m: float
    bearing_rad: float
    bearing_std_rad: float
    motion: FloatArray
    """(4,) X, Z, VX, VZ relative to the camera, metres and metres a second."""
    motion_covariance: FloatArray
    """(4, 4)"""
    closing_m_s: float
    """Speed at which the range shrinks."""
    closing_std_m_s: float
    encounter: Encounter | None
    """None while no relative motion is certain."""
    trail_m: FloatArray
    """(N, 2) X, Z of the last seconds, oldest first."""


def track_of(tracks: Sequence[Track], sighting: int) -> Track | None:
    """The track that a sighting of the frame, by its place, is on; None where that is not confirmed."""
    return next((track for track in tracks if track.sighting == sighting), None)


class Tracker:
    """Follows boats through frames at any times, missed frames and false alarms among them.

    Args:
        config: its rules.
    """

    def __init__(self, config: TrackingConfig | None = None) -> None:
        self.config = config or TrackingConfig()
        self.time_s = -math.inf
        self.confirmed = 0
        """Boats confirmed so far."""
        self._boats: list[_Boat] = []

    def step(self, time_s: float, sightings: Sequence[Sighting]) -> list[Track]:
        """Go on to a frame.

        Args:
            time_s: its time; one that is not after the last frame's counts as no time passed, and one that is before it
                by more than ``lost_s`` is of a clock that was set back: everything begins anew, but for the numbers.
            sightings: what it shows.

        Returns:
            The confirmed boats, by number.
        """
        if self.time_s - time_s > self.config.lost_s:
            self._boats, self.time_s = [], time_s
        time_s = max(time_s, self.time_s)
        for boat in self._boats:
            boat.filter.predict(time_s - self.time_s)
        self.time_s = time_s
        self._boats = [boat for boat in self._boats if boat.filter.unseen_s <= self.config.lost_s]
        free = list(range(len(sightings)))
        for known in (True, False):  # a boat that is not confirmed takes nothing away from one that is
            boats = [boat for boat in self._boats if bool(boat.number) == known]
            offered = [sightings[place] for place in free]
            pairs = associate([boat.filter for boat in boats], offered, self.config.gate_probability)
            for number, boat in enumerate(boats):
                boat.see(free[pairs[number]] if number in pairs else None, sightings)
            free = [place for number, place in enumerate(free) if number not in pairs.values()]
        for place in free:
            if sightings[place].ranged:
                self._boats.append(_Boat(self._filter(sightings[place]), time_s, place, self.config.confirm_frames))
        self._boats = [boat for boat in self._boats if boat.number or self._confirm(boat)]
        confirmed = [boat for boat in self._boats if boat.number]
        return [boat.now(time_s, self.config.trail_s) for boat in sorted(confirmed, key=lambda boat: boat.number)]

    def _filter(self, first: Sighting) -> BoatFilter:
        config = self.config
        lasting = (config.lasting_share, config.noise_correlation_s, config.camera_correlation_s)
        return BoatFilter(first, config.speed_std_m_s, config.wander_m_s, *lasting)

    def _confirm(self, boat: "_Boat") -> bool:
        """Number a boat that was seen often enough; returns whether to keep it."""
        config = self.config
        if sum(boat.hits) >= config.confirm_hits:
            self.confirmed += 1
            boat.number = self.confirmed
        return len(boat.hits) - sum(boat.hits) <= config.confirm_frames - config.confirm_hits


class _Boat:
    """A boat, confirmed (its number is above 0) or not."""

    def __init__(self, filter: BoatFilter, born_s: float, sighting: int, remembered: int) -> None:
        self.filter = filter
        self.born_s = born_s
        self.sighting: int | None = sighting
        self.number = 0
        self.hits = deque([True], maxlen=remembered)
        self.trail: deque[tuple[float, FloatArray]] = deque()

    def see(self, sighting: int | None, sightings: Sequence[Sighting]) -> None:
        """Take in a frame: the sighting at that place, or that there is none."""
        self.sighting = sighting
        self.hits.append(sighting is not None)
        if sighting is not None:
            self.filter.update(sightings[sighting])

    def now(self, time_s: float, trail_s: float) -> Track:
        """Say where it is and where it goes."""
        state, P = self.filter.state[:4], self.filter.P[:4, :4]
        motion, J = to_metres(state)
        covariance = J @ P @ J.T
        self.trail.append((time_s, motion[:2]))
        while time_s - self.trail[0][0] > trail_s:
            self.trail.popleft()
        inverse, half_width = state[INVERSE], Z_90 * math.sqrt(P[INVERSE, INVERSE])
        closing_by = np.array([0.0, state[GROWTH] / inverse**2, 0.0, -1 / inverse])
        return Track(
            number=self.number,
            age_s=time_s - self.born_s,
            unseen_s=self.filter.unseen_s,
            sighting=self.sighting,
            range_m=1 / inverse,
            range_std_m=math.sqrt(P[INVERSE, INVERSE]) / inverse**2,
            low_90_m=1 / (inverse + half_width),
            high_90_m=1 / (inverse - half_width) if inverse > half_width else math.inf,
            bearing_rad=float(state[BEARING]),
            bearing_std_rad=math.sqrt(P[BEARING, BEARING]),
            motion=motion,
            motion_covariance=covariance,
            closing_m_s=-state[GROWTH] / inverse,
            closing_std_m_s=math.sqrt(closing_by @ P @ closing_by),
            encounter=encounter(motion, covariance),
            trail_m=np.array([place for _, place in self.trail]),
        )
