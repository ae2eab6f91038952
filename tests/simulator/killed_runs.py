"""Start a run, kill it with all its processes at a random moment, and so on: python killed_runs.py CONFIG ROOT KILLS.

Prints how many frames were whole after each kill. The moment is random, but counted from a number of new frames and not
from the start, so that kills fall between frames on a busy machine too. Processes are forked here: each run starts in
milliseconds.
"""

import os
import signal
import sys
import time
from pathlib import Path

import numpy as np
from small_dataset import TOTAL, simulate_small

from usvnet.simulator import workers
from usvnet.simulator.dataset_writer import whole_frames


def wait_for_frames(root: Path, count: int) -> None:
    """Wait until ``count`` frames are whole, or all are."""
    while len(whole_frames(root)) < min(count, TOTAL):
        time.sleep(0.002)


def main(config: Path, root: Path, kills: int) -> None:
    workers.START_METHOD = "fork"
    os.environ["FAKE_SECONDS"] = "0.02"
    rng = np.random.default_rng(3)
    for _ in range(kills):
        child = os.fork()
        if child == 0:
            os.setpgid(0, 0)
            simulate_small(config, root, workers=2)
            os._exit(0)
        wait_for_frames(root, len(whole_frames(root)) + int(rng.integers(0, 4)))
        time.sleep(rng.uniform(0, 0.04))
        os.killpg(child, signal.SIGKILL)
        os.waitpid(child, 0)
        print(len(whole_frames(root)), flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
