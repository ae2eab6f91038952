"""The command with the real renderer, small and coarse."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mitsuba", reason="the extra sim is not installed")
pytest.importorskip("pyoidn", reason="the extra sim is not installed")

from usvnet import cli
from usvnet.data.check import check_dataset
from usvnet.simulator.dataset_writer import whole_frames

SMALL = ["--quality", "preview", "--scale", "0.2"]


def arguments(root, out, config, frames, workers):
    settings = str(root / "configs" / "simulator" / f"{config}.yaml")
    chosen = ["--config", settings, "--out", str(out), "--frames", str(frames), "--workers", str(workers)]
    return ["simulate", *chosen, *SMALL]


def files_of(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("config", ["mine", "diverse"])
def test_a_rendered_dataset_has_no_fault(root, tmp_path, config):
    out = tmp_path / config
    cli.run(arguments(root, out, config, 3, 1))
    frames, faults = check_dataset(out)
    assert faults == []
    assert sum(map(len, frames.values())) == 3
    assert (out / "contact_sheet.png").is_file()


@pytest.mark.slow
def test_killed_ten_times_at_random_it_ends_like_an_uninterrupted_run(root, tmp_path):
    complete, killed = tmp_path / "complete", tmp_path / "killed"
    cli.run(arguments(root, complete, "paper", 18, 1))
    rng = np.random.default_rng(5)
    counts = []
    for _ in range(10):
        command = [sys.executable, "-m", "usvnet.cli", *arguments(root, killed, "paper", 18, 2)]
        run = subprocess.Popen(command, start_new_session=True, stdout=subprocess.DEVNULL, cwd=root)
        enough = min(len(whole_frames(killed)) + rng.integers(3), 17)  # not by the clock: machines differ
        while len(whole_frames(killed)) < enough and run.poll() is None:
            time.sleep(0.05)
        time.sleep(rng.uniform(0, 0.3))
        os.killpg(run.pid, signal.SIGKILL)
        run.wait()
        counts.append(len(whole_frames(killed)))
    assert len({count for count in counts if 0 < count < 18}) >= 2, f"no kill fell between two frames: {counts}"
    cli.run(arguments(root, killed, "paper", 18, 2))
    assert files_of(killed) == files_of(complete)
