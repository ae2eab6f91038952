"""Milliseconds a picture, of the network alone and from pixels to ranges, beside the peer's PyTorch in the same run.

    python benchmarks/inference_speed.py --peer_python PEER/bin/python

PEER is an environment as ``peer/environment.py`` describes it. The programs take turns ``--rounds`` times, because a
shared machine's speed drifts; a figure is the median over all turns, a ratio the median of the ratios of neighbours.
Weights are random: no time depends on them, but for the number of boats found. Ours always ranges 20; the peer, asked
for 20 down to a score of 0.001, has fewer to sort, so that its chain looks faster here than on real pictures. All
networks have their norms folded in and channels_last weights. Ours: ``eager`` PyTorch, and ``script``,
frozen TorchScript as ``usvnet export`` writes it. A chain of ours is from a uint8 picture to ranges; the peer's is its
``predict`` on such a picture, which knows no ranges.
"""

import json
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from jsonargparse import auto_cli

from usvnet.deploy.deployed import DeployedUSVNet
from usvnet.files import atomic_write
from usvnet.geometry.camera import make_camera
from usvnet.model import USVNet
from usvnet.types import Camera

WARM_UP = 2
Times = dict[str, float]


def ours(model: USVNet) -> Callable[[int, int], Times]:
    """Give a function (side in pixels, how often) -> median times."""
    deployed = DeployedUSVNet(model).eval()
    network = deployed.model.network
    with torch.inference_mode():
        scripted, scripted_network = (torch.jit.freeze(torch.jit.script(part)) for part in (deployed, network))

    def measure(size_px: int, count: int) -> Times:
        picture = torch.randint(0, 256, (1, size_px, size_px, 3), dtype=torch.uint8)
        image = picture.permute(0, 3, 1, 2).float().div(255)  # of interleaved pixels: channels_last
        camera = camera_of(size_px)
        plain = (camera.K, camera.distortion, camera.height_m, camera.pitch_rad, camera.roll_rad)

        def chain(module: Callable[..., Any]) -> Callable[[], object]:
            return lambda: module(picture.permute(0, 3, 1, 2).float().div(255), *plain)

        jobs: dict[str, Callable[[], object]] = {
            "eager_network_ms": lambda: network(image),
            "script_network_ms": lambda: scripted_network(image),
            "eager_chain_ms": chain(deployed),
            "script_chain_ms": chain(scripted),
        }
        with torch.inference_mode():
            return {name: median_ms(job, count) for name, job in jobs.items()}

    return measure


def camera_of(size_px: int) -> Camera:
    """A camera 1.5 m above the water whose pictures are ``size_px`` wide and high."""
    centre_px = (size_px - 1) / 2
    K = [[1.1 * size_px, 0.0, centre_px], [0.0, 1.1 * size_px, centre_px], [0.0, 0.0, 1.0]]
    return make_camera(K, (size_px, size_px), height_m=1.5, pitch_rad=0.1)


def median_ms(job: Callable[[], object], count: int) -> float:
    """Median time of ``count`` calls after a warm-up."""
    times_ms = []
    for _ in range(WARM_UP + count):
        start_s = time.perf_counter()
        job()
        times_ms.append(1000 * (time.perf_counter() - start_s))
    return statistics.median(times_ms[WARM_UP:])


class Peer:
    """The peer's process, which times itself when asked."""

    def __init__(self, python: str, model: str, settings: Path) -> None:
        script = Path(__file__).with_name("peer") / "inference.py"
        command = [python, str(script), "--model", model, "--settings", str(settings)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def measure(self, size_px: int, count: int) -> Times:
        """Median times.

        Raises:
            ValueError: the process has ended.
        """
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(f"{size_px} {WARM_UP + count}\n")
        self.process.stdin.flush()
        for line in self.process.stdout:
            if line.startswith("RESULT "):
                times: dict[str, list[float]] = json.loads(line.removeprefix("RESULT "))
                return {f"peer_{name}": statistics.median(values[WARM_UP:]) for name, values in times.items()}
        raise ValueError("the peer's process has ended: see what it says above")


def main(
    variant: str = "n",
    peer_python: str | None = None,
    peer_model: str | None = None,
    sizes: list[int] = [320, 640],  # noqa: B006 (a default on the command line)
    count: int = 10,
    rounds: int = 3,
    output: str = "runs/inference_speed.json",
) -> None:
    """Measure and print.

    Args:
        variant: our network.
        peer_python: Python of the peer's environment; without it only ours is timed.
        peer_model: the peer's network; by default the one of the same family and size.
        sizes: sides of the pictures.
        count: forward passes a turn.
        rounds: turns.
        output: JSON file of the figures.
    """
    torch.manual_seed(0)
    measure = ours(USVNet(variant).eval())
    peer_model = peer_model or f"yolo{variant if variant.startswith('v8') else '11' + variant}-pose.yaml"
    rows: dict[int, list[Times]] = {size_px: [] for size_px in sizes}
    with tempfile.TemporaryDirectory() as settings:
        peer = Peer(peer_python, peer_model, Path(settings)) if peer_python else None
        for _ in range(rounds):
            for size_px in sizes:
                row = measure(size_px, count)
                if peer:
                    row |= peer.measure(size_px, count)
                    for part in ("network", "chain"):
                        for mode in ("eager", "script"):
                            row[f"{mode}_{part}_ratio"] = row[f"peer_{part}_ms"] / row[f"{mode}_{part}_ms"]
                rows[size_px].append(row)
        if peer and peer.process.stdin:
            peer.process.stdin.close()
            peer.process.wait()
    medians = {
        size_px: {name: statistics.median(row[name] for row in turns) for name in turns[0]}
        for size_px, turns in rows.items()
    }
    for size_px, median in medians.items():
        print(f"{size_px} px  " + "  ".join(f"{name} {value:.2f}" for name, value in median.items()))
    settings_used = {
        "variant": variant,
        "peer_model": peer_model if peer_python else None,
        "threads": torch.get_num_threads(),
        "torch": torch.__version__,
        "count": count,
    }
    with atomic_write(Path(output)) as temporary:
        temporary.write_text(json.dumps({"settings": settings_used, "rounds": rows, "median": medians}, indent=1))


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
