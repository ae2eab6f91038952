"""Milliseconds a picture, of the network alone and from pixels to ranges, beside the peer's in the same run.

    python benchmarks/inference_speed.py --peer_python PEER/bin/python

PEER is an environment as ``peer/environment.py`` describes it. The programs take turns ``--rounds`` times, because a
shared machine's speed drifts; a figure is the median over all turns, a ratio the median of the ratios of neighbours.
Weights are random: no time depends on them, but for the number of boats found. Ours always ranges 20; the peer, asked
for 20 down to a score of 0.001, has fewer to sort, so that its chain looks faster here than on real pictures. All
networks have their norms folded in and channels_last weights. A chain of ours is from a uint8 picture to ranges; the
peer's is its ``predict`` on such a picture, which knows no ranges.

``--modes`` chooses among ``eager`` PyTorch, ``script``, frozen TorchScript as ``usvnet export`` writes it, both beside
the peer's PyTorch, and ``openvino``: our whole chain from the file that ``usvnet export`` writes, beside the network
alone from the peer's own float32 export, with seven keypoints. These two run in this process, by the same OpenVINO, in
float32 and with as many threads as PyTorch has: ``OMP_NUM_THREADS``. ``openvino_chain_over_peer_network`` is ours over
the peer's, the other ratios are the peer's over ours.
"""

import json
import statistics
import subprocess
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from jsonargparse import auto_cli

from usvnet.deploy.deployed import DeployedUSVNet, plain_inputs
from usvnet.deploy.formats import write_openvino
from usvnet.deploy.runtimes import needed, open_runtime, openvino_settings
from usvnet.files import atomic_write
from usvnet.geometry.camera import make_camera
from usvnet.geometry.hull_model import generic_hull
from usvnet.model import USVNet
from usvnet.types import Camera

WARM_UP = 2
PEER_SCRIPTS = Path(__file__).with_name("peer")
Times = dict[str, float]
Job = Callable[[], object]
Mode = Literal["eager", "script", "openvino"]


def torch_jobs(deployed: DeployedUSVNet, modes: list[Mode]) -> Callable[[int], dict[str, Job]]:
    """Give a function side in pixels -> what to time in PyTorch."""
    modules = {}
    if "eager" in modes:
        modules["eager"] = (deployed.model.network, deployed)
    if "script" in modes:
        with torch.inference_mode():
            parts = (deployed.model.network, deployed)
            modules["script"] = tuple(torch.jit.freeze(torch.jit.script(part)) for part in parts)

    def jobs(size_px: int) -> dict[str, Job]:
        picture, image = random_picture(size_px)
        camera = camera_of(size_px)
        plain = (camera.K, camera.distortion, camera.height_m, camera.pitch_rad, camera.roll_rad)
        found: dict[str, Job] = {}
        for mode, (network, chain) in modules.items():
            found[f"{mode}_network_ms"] = partial(network, image)
            found[f"{mode}_chain_ms"] = partial(from_pixels, chain, picture, *plain)
        return found

    return jobs


def openvino_jobs(
    deployed: DeployedUSVNet, models: list[Path], size_px: int, folder: Path, peer: bool
) -> dict[str, Job]:
    """Our whole chain, also from ``models``, and, where it was exported into ``folder``, the peer's network alone."""
    file = folder / f"ours_{size_px}.xml"
    write_openvino(deployed, file, size_px)
    picture, image = random_picture(size_px)
    _, *rest = plain_inputs(image, camera_of(size_px), generic_hull())
    jobs: dict[str, Job] = {}
    for name, path in {"openvino": file, **{path.stem: path for path in models}}.items():
        jobs[f"{name}_chain_ms"] = partial(from_pixels, open_runtime(path), picture, *rest)
    if peer:
        network = needed("openvino").Core().compile_model(folder / f"{size_px}.xml", "CPU", openvino_settings())
        array = np.ascontiguousarray(image.numpy())
        jobs["peer_openvino_network_ms"] = partial(network, [array])
    return jobs


def random_picture(size_px: int) -> tuple[torch.Tensor, torch.Tensor]:
    """A picture (1, H, W, 3) of uint8, and as the network sees it."""
    picture = torch.randint(0, 256, (1, size_px, size_px, 3), dtype=torch.uint8)
    return picture, as_image(picture)


def as_image(picture: torch.Tensor) -> torch.Tensor:
    """Interleaved pixels of uint8 to (1, 3, H, W): channels_last in memory."""
    return picture.permute(0, 3, 1, 2).float().div(255)


def from_pixels(chain: Callable[..., object], picture: torch.Tensor, *rest: torch.Tensor) -> object:
    """One picture as it comes from a camera to its ranges."""
    return chain(as_image(picture), *rest)


def camera_of(size_px: int) -> Camera:
    """A camera 1.5 m above the water whose pictures are ``size_px`` wide and high."""
    centre_px = (size_px - 1) / 2
    K = [[1.1 * size_px, 0.0, centre_px], [0.0, 1.1 * size_px, centre_px], [0.0, 0.0, 1.0]]
    return make_camera(K, (size_px, size_px), height_m=1.5, pitch_rad=0.1)


def median_ms(job: Job, count: int) -> float:
    """Median time of ``count`` calls after a warm-up."""
    times_ms = []
    with torch.inference_mode():
        for _ in range(WARM_UP + count):
            start_s = time.perf_counter()
            job()
            times_ms.append(1000 * (time.perf_counter() - start_s))
    return statistics.median(times_ms[WARM_UP:])


class Peer:
    """The peer's PyTorch in a process of its own, which times itself when asked."""

    def __init__(self, python: str, model: str, settings: Path) -> None:
        command = [python, str(PEER_SCRIPTS / "inference.py"), "--model", model, "--settings", str(settings)]
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

    def close(self) -> None:
        """End the process."""
        if self.process.stdin:
            self.process.stdin.close()
        self.process.wait()


def export_peer(python: str, model: str, sizes: list[int], folder: Path) -> None:
    """Let the peer write its OpenVINO exports into ``folder``.

    Raises:
        ValueError: it does not.
    """
    command = [python, str(PEER_SCRIPTS / "export_openvino.py"), "--model", model, "--out", str(folder)]
    if subprocess.run([*command, "--sizes", *map(str, sizes)], stdout=subprocess.DEVNULL).returncode:
        raise ValueError("the peer wrote no OpenVINO export: see what it says above (its environment needs openvino)")


def ratios(row: Times) -> Times:
    """The peer's time over ours in PyTorch, ours over the peer's in OpenVINO, as far as both were measured."""
    found: Times = {}
    for name, own_ms in row.items():
        mode, _, part = name.removesuffix("_ms").rpartition("_")
        if mode in ("eager", "script"):
            if f"peer_{part}_ms" in row:
                found[f"{mode}_{part}_ratio"] = row[f"peer_{part}_ms"] / own_ms
        elif not mode.startswith("peer") and "peer_openvino_network_ms" in row:
            found[f"{mode}_chain_over_peer_network"] = own_ms / row["peer_openvino_network_ms"]
    return found


def main(
    variant: str = "n",
    peer_python: str | None = None,
    peer_model: str | None = None,
    sizes: list[int] = [320, 640],  # noqa: B006 (a default on the command line)
    modes: list[Mode] = ["eager", "script", "openvino"],  # noqa: B006
    models: list[Path] = [],  # noqa: B006
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
        modes: what to time.
        models: exported files of ours to time with the mode openvino, such as one in int8.
        count: forward passes a turn.
        rounds: turns.
        output: JSON file of the figures.
    """
    torch.manual_seed(0)
    deployed = DeployedUSVNet(USVNet(variant).eval()).eval()
    peer_model = peer_model or f"yolo{variant if variant.startswith('v8') else '11' + variant}-pose.yaml"
    in_torch = torch_jobs(deployed, modes)
    rows: dict[int, list[Times]] = {size_px: [] for size_px in sizes}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if peer_python and "openvino" in modes:
            export_peer(peer_python, peer_model, sizes, folder)
        jobs = {size_px: in_torch(size_px) for size_px in sizes}
        if "openvino" in modes:
            for size_px in sizes:
                jobs[size_px] |= openvino_jobs(deployed, models, size_px, folder, bool(peer_python))
        peer = Peer(peer_python, peer_model, folder / "settings") if peer_python and modes != ["openvino"] else None
        for _ in range(rounds):
            for size_px in sizes:
                row = {name: median_ms(job, count) for name, job in jobs[size_px].items()}
                if peer:
                    row |= peer.measure(size_px, count)
                rows[size_px].append(row | ratios(row))
        if peer:
            peer.close()
    medians = {
        size_px: {name: statistics.median(row[name] for row in turns) for name in turns[0]}
        for size_px, turns in rows.items()
    }
    for size_px, median in medians.items():
        print(f"{size_px} px  " + "  ".join(f"{name} {value:.2f}" for name, value in median.items()))
    settings_used: dict[str, Any] = {
        "variant": variant,
        "peer_model": peer_model if peer_python else None,
        "threads": torch.get_num_threads(),
        "torch": torch.__version__,
        "openvino": needed("openvino").__version__ if "openvino" in modes else None,
        "count": count,
    }
    with atomic_write(Path(output)) as temporary:
        temporary.write_text(json.dumps({"settings": settings_used, "rounds": rows, "median": medians}, indent=1))


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
