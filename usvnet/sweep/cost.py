"""What a network costs: parameters, floating point operations and milliseconds a picture, on this machine."""

import json
import platform
import statistics
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from torch.utils.flop_counter import FlopCounterMode

from usvnet.files import atomic_write
from usvnet.geometry.camera import camera_to, make_camera
from usvnet.model import USVNet

WARM_UP, FORWARDS = 2, 7


@dataclass(frozen=True)
class Cost:
    """Of one network at one size of picture."""

    parameters: int
    """All of them."""
    parameters_without_heatmaps: int
    """Those of the pose network alone, which is what published counts are of."""
    gflops: float
    """Floating point operations of the network (heatmap head included) for one picture / 1e9; a multiply-add is two."""
    ms: float
    """Median time of the whole chain for one picture, from the picture on the device to ranges, in eager PyTorch."""
    device: str


def measure_costs(networks: Iterable[tuple[str, int]], path: Path) -> dict[tuple[str, int], Cost]:
    """Measure networks, one after another, and keep the figures in a file so that they are measured once.

    Args:
        networks: variant and side of the picture in pixels.
        path: JSON file; what it holds of another device is measured again.

    Raises:
        ValueError: a network does not take such a picture.
    """
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    kept = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    costs = {}
    for variant, size_px in dict.fromkeys(networks):
        name = f"{variant} at {size_px} px"
        if kept.get(name, {}).get("device") != device_name(device):
            kept[name] = asdict(measure_cost(variant, size_px, device))
            with atomic_write(path) as temporary:
                temporary.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
        costs[variant, size_px] = Cost(**kept[name])
    return costs


def measure_cost(variant: str, size_px: int, device: torch.device) -> Cost:
    """Measure a network with random weights: no figure depends on them.

    Raises:
        ValueError: the network is not known.
    """
    model = USVNet(variant).eval().to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    heatmaps = sum(parameter.numel() for parameter in model.network.heatmap_head.parameters())
    parameters = sum(parameter.numel() for parameter in model.parameters())
    image = torch.rand(1, 3, size_px, size_px, device=device).to(memory_format=torch.channels_last)
    centre_px = (size_px - 1) / 2
    K = [[1.1 * size_px, 0.0, centre_px], [0.0, 1.1 * size_px, centre_px], [0.0, 0.0, 1.0]]
    camera = camera_to(make_camera(K, (size_px, size_px), height_m=1.5, pitch_rad=0.1), device)
    with torch.inference_mode():
        with FlopCounterMode(display=False) as counter:
            model.network(image)
        times_ms = [_milliseconds(model, image, camera) for _ in range(WARM_UP + FORWARDS)]
    return Cost(
        parameters=parameters,
        parameters_without_heatmaps=parameters - heatmaps,
        gflops=counter.get_total_flops() / 1e9,
        ms=statistics.median(times_ms[WARM_UP:]),
        device=device_name(device),
    )


def _milliseconds(model: USVNet, image: torch.Tensor, camera: object) -> float:
    start_s = time.perf_counter()
    model(image, camera)
    if image.is_cuda:
        torch.cuda.synchronize()
    return 1000 * (time.perf_counter() - start_s)


def device_name(device: torch.device) -> str:
    """Name a device for people: the graphics card, or the processor and the threads used."""
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    return f"{_processor()}, {torch.get_num_threads()} threads"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()
