"""From a source through a predictor to its outputs, frame by frame, counted and timed."""

import signal
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from usvnet.deploy.outputs import FrameBoats, Outputs
from usvnet.deploy.predictor import Predictor
from usvnet.deploy.sources import Frame, Source, Tell
from usvnet.types import Camera


@dataclass
class Tally:
    """What a run came to so far."""

    frames: int = 0
    """Predicted and written."""
    misfits: int = 0
    """Pictures of another shape than the camera's, skipped."""
    boats: int = 0
    ranged: int = 0
    """Boats with a valid range by the chosen estimator."""
    nearest_m: float = float("inf")
    farthest_m: float = 0.0
    seconds: dict[str, float] = field(default_factory=lambda: {"read": 0.0, "predict": 0.0, "write": 0.0})
    """Where the time went."""
    began_s: float = field(default_factory=time.perf_counter)

    @property
    def frames_per_s(self) -> float:
        """Frames from reading to writing, a second."""
        return self.frames / max(time.perf_counter() - self.began_s, 1e-9)

    def count(self, found: FrameBoats, estimator: str) -> None:
        """Add a frame."""
        self.frames += 1
        self.boats += len(found.boats)
        for boat in found.boats:
            estimate = boat.ranges[estimator]
            if estimate.usable:
                self.ranged += 1
                self.nearest_m = min(self.nearest_m, estimate.slant_m)
                self.farthest_m = max(self.farthest_m, estimate.slant_m)

    @contextmanager
    def timing(self, stage: str) -> Iterator[None]:
        """Add the time inside to a stage's."""
        began_s = time.perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += time.perf_counter() - began_s


def predict_source(
    source: Source,
    predictor: Predictor,
    outputs: Outputs,
    estimator: str,
    tell: Tell,
    batch_size: int = 1,
    max_frames: int | None = None,
    watch: Callable[[Tally], None] = lambda tally: None,
    turn: Callable[[Frame, Camera], Camera] = lambda frame, camera: camera,
    follow: Callable[[FrameBoats], FrameBoats] | None = None,
) -> Tally:
    """Predict every frame and write it; never more than two batches of frames are held.

    Args:
        source: gone through to its end, or until it is stopped.
        predictor: the network behind its camera.
        outputs: already entered.
        estimator: whose ranges are counted.
        tell: is told of pictures that do not fit the camera.
        batch_size: frames of one size computed at once; a stream's go one by one.
        max_frames: predict so many at most.
        watch: is shown the tally after each frame.
        turn: gives a frame's camera the attitude that it had then.
        follow: adds to each frame, in order, the boats that are tracked in it; None tracks none.

    Raises:
        ValueError: the first frame does not fit the camera.
        OSError: an output cannot be written.
    """
    tally = Tally()
    frames = _fitting(_timed(source, tally, max_frames), predictor, tally, tell)
    for batch in batches(frames, 1 if source.is_live else batch_size):
        with tally.timing("predict"):
            cameras = [turn(frame, predictor.native_camera(*frame.picture.shape[1::-1])) for frame in batch]
            pictures = predictor.predict([frame.picture for frame in batch], cameras)
        for found in map(FrameBoats, batch, pictures, cameras):
            if follow is not None:
                found = follow(found)
            with tally.timing("write"):
                outputs.write(found)
            tally.count(found, estimator)
            watch(tally)
    return tally


def batches(frames: Iterable[Frame], most: int) -> Iterator[list[Frame]]:
    """Group neighbouring frames of one size, at most so many."""
    batch: list[Frame] = []
    for frame in frames:
        if batch and batch[0].picture.shape != frame.picture.shape:
            yield batch
            batch = []
        batch.append(frame)
        if len(batch) == most:
            yield batch
            batch = []
    if batch:
        yield batch


@contextmanager
def stopped_by_signals(source: Source) -> Iterator[list[int]]:
    """Let Ctrl-C and SIGTERM end the source at its next frame; yields a list that then holds the signal."""
    caught: list[int] = []

    def stop(number: int, _: object) -> None:
        caught.append(number)
        source.stop()

    before = {number: signal.signal(number, stop) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield caught
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _timed(source: Source, tally: Tally, max_frames: int | None) -> Iterator[Frame]:
    """The source's frames; the time that they take is counted as reading."""
    frames = iter(source)
    number = 0
    while max_frames is None or number < max_frames:
        with tally.timing("read"):
            frame = next(frames, None)
        if frame is None:
            return
        yield frame
        number += 1
    source.stop()


def _fitting(frames: Iterable[Frame], predictor: Predictor, tally: Tally, tell: Tell) -> Iterator[Frame]:
    """Those frames that fit the camera."""
    first = True
    for frame in frames:
        try:
            predictor.native_camera(*frame.picture.shape[1::-1])
        except ValueError as error:
            if first:
                raise
            tally.misfits += 1
            tell(f"skipped {frame.name}: {error}")
        else:
            yield frame
        first = False
