"""Rendering frames in several processes, of which any may fail, be killed or be stopped by Ctrl-C."""

import contextlib
import importlib
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
from multiprocessing.connection import wait as wait_for_end
from pathlib import Path

import cv2
import torch

from usvnet.geometry.camera import scale_camera
from usvnet.simulator.dataset_writer import write_frame
from usvnet.simulator.engine import ENGINE_VARIABLE
from usvnet.simulator.frame_spec import FrameSpec
from usvnet.simulator.rendered import RenderedFrame
from usvnet.simulator.scenario import Scenario
from usvnet.simulator.settings import SimulatorSettings
from usvnet.types import Camera

START_METHOD = "spawn"
"""A fresh interpreter for each worker: libraries that have started threads do not survive a fork."""
ONE_THREAD = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "OIDN_NUM_THREADS"), "1"),
    "OMP_WAIT_POLICY": "PASSIVE",
}
"""A worker's environment, set before it starts: most libraries look at it only once, when they are imported."""
MAX_BARREN = 3
"""When workers died this often in a row without a single frame, they would for ever."""

Tell = Callable[["Outcome"], None]


@dataclass(frozen=True)
class Job:
    """What every worker is told."""

    settings: SimulatorSettings
    root: Path
    quality: str
    scale: float
    engine: str
    render: str
    """Dotted name of the function (FrameSpec, quality) -> RenderedFrame."""


@dataclass(frozen=True)
class Outcome:
    """What came of one frame."""

    number: int
    error: str = ""
    """Why there is no picture, in one line; empty where there is one."""
    seconds: dict[str, float] = field(default_factory=dict)
    """Processor time of each step."""


class _Worker:
    """What a worker process keeps between its frames."""

    def __init__(self, job: Job):
        self.job = job
        self.scenario = Scenario(job.settings)

    def render(self, number: int) -> Outcome:
        """Render and write one frame; only what concerns this frame alone is an outcome, a full disk is raised."""
        try:
            module, _, function = self.job.render.rpartition(".")
            render: Callable[[FrameSpec, str], RenderedFrame] = getattr(importlib.import_module(module), function)
            frame = render(scaled_spec(self.scenario.frame(number), self.job.scale), self.job.quality)
        except Exception as error:
            return Outcome(number, f"{type(error).__name__}: {' '.join(str(error).split())}")
        try:
            write_frame(self.job.root, frame)
        except ValueError as error:
            return Outcome(number, " ".join(str(error).split()))
        return Outcome(number, seconds=frame.seconds)


_worker: _Worker | None = None


def scaled_size(camera: Camera, scale: float) -> tuple[int, int]:
    """Width and height of a camera's picture at ``scale``."""
    width, height = (max(1, round(float(size) * scale)) for size in camera.size_px[0])
    return width, height


def scaled_spec(spec: FrameSpec, scale: float) -> FrameSpec:
    """The same frame through a camera with larger or smaller pixels."""
    if scale == 1:
        return spec
    return replace(spec, camera=scale_camera(spec.camera, scaled_size(spec.camera, scale)))


def render_frames(job: Job, numbers: Sequence[int], workers: int, tell: Tell) -> None:
    """Render and write frames; ``tell`` hears of each in the order in which they are done.

    Frames whose worker died (with all that were being rendered at that moment) are tried once more, each alone.

    Raises:
        ValueError: workers die again and again.
        OSError: a frame cannot be written.
    """
    left, barren = list(numbers), 0
    lost: list[int] = []
    while left:
        before = len(left)
        newly_lost, left = _render_until_death(job, left, workers, tell)
        lost += newly_lost
        barren = 0 if before - len(left) > len(newly_lost) else barren + 1
        if barren == MAX_BARREN:
            raise ValueError(
                f"rendering processes were killed {barren} times without one frame: start fewer --workers if memory "
                "is short, and see usvnet simulate --doctor"
            )
    for number in lost:
        if _render_until_death(job, [number], 1, tell)[0]:
            tell(Outcome(number, "its process was killed twice, the second time alone"))


def _render_until_death(job: Job, numbers: list[int], workers: int, tell: Tell) -> tuple[list[int], list[int]]:
    """Render frames until they are done or a worker dies; the frames lost with it, and those not begun."""
    waiting = deque(numbers)
    lost: list[int] = []
    others = set(multiprocessing.active_children())
    with _environment({**ONE_THREAD, ENGINE_VARIABLE: job.engine}), _pool(job, min(workers, len(numbers))) as pool:
        running: dict[Future[Outcome], int] = {}
        try:
            while not lost and (waiting or running):
                while waiting and len(running) < workers:  # no more, so that all that are lost had begun
                    with _no_interrupts():
                        future = pool.submit(_render_one, waiting[0])
                    running[future] = waiting.popleft()
                for done in wait(running, return_when=FIRST_COMPLETED).done:
                    number = running.pop(done)
                    try:
                        tell(done.result())
                    except BrokenProcessPool:
                        lost.append(number)
        except BrokenProcessPool:  # from submit
            pass
        except BaseException:
            for child in set(multiprocessing.active_children()) - others:
                child.terminate()  # what it was writing appears in one piece or not at all
            raise
        return [*lost, *running.values()], list(waiting)


def _pool(job: Job, workers: int) -> ProcessPoolExecutor:
    context = multiprocessing.get_context(START_METHOD)
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_start_worker, initargs=(job,))


def _start_worker(job: Job) -> None:
    global _worker
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides what Ctrl-C means
    threading.Thread(target=_end_with_parent, daemon=True).start()
    cv2.setNumThreads(1)
    torch.set_num_threads(1)
    _worker = _Worker(job)


def _render_one(number: int) -> Outcome:
    assert _worker is not None
    return _worker.render(number)


def _end_with_parent() -> None:
    """Stop when the parent was killed: nobody would fetch the next result."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for_end([parent.sentinel])
        os._exit(1)


@contextlib.contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Let processes that are started now see other environment variables than this one."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextlib.contextmanager
def _no_interrupts() -> Iterator[None]:
    """Start processes deaf to Ctrl-C from their first moment; one that comes meanwhile is heard right after."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
