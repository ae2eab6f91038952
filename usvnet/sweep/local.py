"""Runs as processes of this machine, a few at a time."""

import contextlib
import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import torch

from usvnet.sweep.board import Board
from usvnet.sweep.plan import Run
from usvnet.sweep.progress import LOG

POLL_S = 0.2
BEGUN = "--- run begun ---\n"
"""Stands in the log before what each attempt says."""
COMMAND = ("-m", "usvnet.sweep.one_run")
"""What Python is started with for a run; its folder comes after."""


def default_parallel() -> int:
    """One run for each graphics card, or one."""
    return max(torch.cuda.device_count(), 1)


def run_locally(runs: list[Run], parallel: int, board: Board) -> dict[str, str]:
    """Train and score runs; one that fails is named, and the others go on.

    Args:
        runs: what is to be done, in this order.
        parallel: processes at a time, each with its share of the processor's cores and a graphics card in turn.
        board: is told what begins and ends.

    Returns:
        Name -> why it failed, in one line.
    """
    waiting, free = deque(runs), list(range(parallel))
    failed: dict[str, str] = {}
    running: dict[int, tuple[Run, subprocess.Popen[bytes]]] = {}
    try:
        while waiting or running:
            while waiting and free:
                run, slot = waiting.popleft(), free.pop(0)
                board.begin(run)
                running[slot] = (run, start_run(run.folder, environment(parallel, slot), COMMAND))
            for slot, (run, process) in list(running.items()):
                if process.poll() is not None:
                    del running[slot]
                    free.append(slot)
                    reason = failure(run.folder, process)
                    if reason:
                        failed[run.name] = reason
                    board.end(run, reason)
            time.sleep(POLL_S)
    finally:
        for _, process in running.values():
            end_run(process)
    return failed


@contextlib.contextmanager
def run_alone(folder: Path, command: tuple[str, ...]) -> Iterator[subprocess.Popen[bytes]]:
    """A run in a process that ends with the block; ``command`` is :data:`COMMAND` where the sweep was started."""
    process = start_run(folder, {}, command)
    try:
        yield process
    finally:
        end_run(process)


def start_run(folder: Path, variables: dict[str, str], command: tuple[str, ...]) -> subprocess.Popen[bytes]:
    """Start a run that is deaf to Ctrl-C, which is the sweep's to hear, and that ends when the sweep does."""
    with (folder / LOG).open("ab") as log:
        log.write(BEGUN.encode())
        log.flush()
        return subprocess.Popen(
            [sys.executable, *command, str(folder)],
            stdin=subprocess.PIPE,
            stdout=log,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            env=os.environ | {"OMP_WAIT_POLICY": "PASSIVE"} | variables,
        )


def end_run(process: subprocess.Popen[bytes]) -> None:
    """End a run at once: all it keeps is written in one piece."""
    process.kill()
    process.wait()
    if process.stdin is not None:
        process.stdin.close()  # its own processes, where it trains with several, end with this


def failure(folder: Path, process: subprocess.Popen[bytes]) -> str:
    """Say in one line why a run that has ended failed; nothing where it did not."""
    code = process.wait()
    if code == 0:
        return ""
    lines = (folder / LOG).read_text(encoding="utf-8", errors="replace").rpartition(BEGUN)[2].split("\n")
    said = [line for line in lines if line.strip()]
    named = [line for line in said if line.startswith("error: ")]
    return (named or said or [f"exit code {code}"])[-1].removeprefix("error: ").strip()


def environment(parallel: int, slot: int) -> dict[str, str]:
    """Variables of one of ``parallel`` processes: no more threads than its share of the cores, one graphics card."""
    variables = {}
    if parallel > 1:
        cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
        variables["OMP_NUM_THREADS"] = str(max(cores // parallel, 1))
        count = torch.cuda.device_count()
        if count > 1:
            lent = [card for card in os.environ.get("CUDA_VISIBLE_DEVICES", "").split(",") if card]
            variables["CUDA_VISIBLE_DEVICES"] = lent[slot % len(lent)] if lent else str(slot % count)
    return variables
