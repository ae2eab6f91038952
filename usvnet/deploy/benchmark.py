"""How long each format takes on this very machine, one frame in to ranges out, and where the time goes."""

import statistics
import time
import warnings
from collections.abc import Callable, Mapping

import torch
from torch import Tensor, nn
from torch.nn import functional

from usvnet.deploy.deployed import DeployedUSVNet, plain_inputs
from usvnet.deploy.probes import probe_camera
from usvnet.geometry.hull_model import generic_hull
from usvnet.heatmap import decode
from usvnet.network.nms import select_boats

WARM_UP = 3
"""Calls that do not count: the first answers take longer, while graphs are fitted to their input."""
STAGES = ("network", "suppression", "heatmaps", "geometry", "hull fit")
Job = Callable[[], object]


def frame_inputs(image_size: int) -> tuple[Tensor, ...]:
    """The plain inputs of one random square picture, interleaved as a camera's are."""
    blobs = torch.rand((1, 3, 20, 20), generator=torch.Generator().manual_seed(0))
    image = functional.interpolate(blobs, (image_size, image_size), mode="bicubic").clamp(0, 1)
    camera = probe_camera(1, image_size, image_size)
    return plain_inputs(image.contiguous(memory_format=torch.channels_last), camera, generic_hull())


def median_times_ms(
    jobs: Mapping[str, Job], rounds: int, calls: int, watch: Callable[[], object] = lambda: None
) -> dict[str, float]:
    """Median time of each job; they take turns, since the speed of a shared machine drifts.

    Args:
        jobs: by name.
        rounds: turns of each.
        calls: counted calls a turn, after some that do not count in the first.
        watch: called after each turn.
    """
    times_ms: dict[str, list[float]] = {name: [] for name in jobs}
    with torch.inference_mode():
        for number in range(rounds):
            for name, job in jobs.items():
                for _ in range(WARM_UP if number == 0 else 1):
                    job()
                for _ in range(calls):
                    began_s = time.perf_counter()
                    job()
                    times_ms[name].append(1000 * (time.perf_counter() - began_s))
                watch()
    return {name: statistics.median(values) for name, values in times_ms.items()}


def stage_jobs(deployed: DeployedUSVNet, image_size: int, scripted: bool) -> dict[str, Job]:
    """Each stage of the chain by itself, eager or as frozen TorchScript; "ranging" holds geometry and hull fit."""
    model = deployed.model
    image = frame_inputs(image_size)[0]
    camera = probe_camera(1, image_size, image_size)
    network: nn.Module = model.network
    suppress, read, ranging = select_boats, decode, model.ranging
    range_points = ranging.range_points
    if scripted:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", category=DeprecationWarning)
            network = torch.jit.freeze(torch.jit.script(network))
            suppress, read = torch.jit.script(select_boats), torch.jit.script(decode)
            ranging = torch.jit.freeze(torch.jit.script(ranging), preserved_attrs=["range_points"])
            range_points = ranging.range_points
    choice = (model.max_boats, model.score_threshold, model.iou_threshold)
    with torch.inference_mode():
        output = network(image)
        boats = suppress(output, *choice)
        keypoints_px, covariance_px2 = read(output.heatmap_logits, boats.keypoints_px)
    points_px = torch.cat([keypoints_px[:, :, :1], keypoints_px], 2).flatten(1, 2)  # as many as with the box's bottom
    spread_px2 = torch.cat([covariance_px2[:, :, :1], covariance_px2], 2).flatten(1, 2)
    return {
        "network": lambda: network(image),
        "suppression": lambda: suppress(output, *choice),
        "heatmaps": lambda: read(output.heatmap_logits, boats.keypoints_px),
        "geometry": lambda: range_points(points_px, spread_px2, camera),
        "ranging": lambda: ranging(keypoints_px, covariance_px2, boats.boxes_px, camera),
    }


def stage_times_ms(times_ms: Mapping[str, float]) -> dict[str, float]:
    """Of each of :data:`STAGES` from those of the jobs: the hull's fit is what ranging takes beyond geometry."""
    fit_ms = max(times_ms["ranging"] - times_ms["geometry"], 0.0)
    return {stage: fit_ms if stage == "hull fit" else times_ms[stage] for stage in STAGES}
