"""What the hull is worth: labelled keypoints with Gaussian noise, ranged by every estimator and held against the laser.

No network takes part. The hull is the one of each picture, and then a generic one; the camera's pitch is as measured,
and then disturbed, which its standard deviation is told.

Example: python benchmarks/hull_range.py data/sample --wave-std-m 0.015
"""

import argparse
import itertools
import math

import numpy as np
import torch
from torch import Tensor

from usvnet.data import read_dataset
from usvnet.data.records import SPLITS, Frame
from usvnet.files import run_program
from usvnet.geometry.camera import camera_to, stack_cameras
from usvnet.geometry.hull_model import generic_hull, hull_to, stack_hulls
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import Camera, Hull, RangeEstimate

EDGES_M = (0.0, 7.0, 15.0, math.inf)
Z_90 = 1.6449


def disturb(camera: Camera, pitch_deg: float, attitude_std_deg: float, wave_std_m: float) -> Camera:
    """Pitch the cameras by Gaussian errors, and say all standard deviations as they then are."""
    one = torch.ones_like(camera.pitch_rad)
    return camera._replace(
        pitch_rad=camera.pitch_rad + math.radians(pitch_deg) * torch.randn_like(one),
        pitch_std_rad=math.radians(math.hypot(pitch_deg, attitude_std_deg)) * one,
        roll_std_rad=math.radians(attitude_std_deg) * one,
        wave_std_m=wave_std_m * one,
    )


def row(name: str, estimate: RangeEstimate, truth_m: Tensor) -> str:
    """RMSE over all and by distance, median relative error, coverage of the 90 % interval and boats without a range."""
    valid = estimate.valid[:, 0]
    error_m, std_m = estimate.slant_m[:, 0] - truth_m, estimate.slant_std_m[:, 0]
    rmse = [
        float(error_m[valid & (truth_m >= low) & (truth_m < high)].square().mean().sqrt())
        for low, high in [(0.0, math.inf), *itertools.pairwise(EDGES_M)]
    ]
    relative = float((error_m / truth_m)[valid].abs().median())
    covered = float((error_m.abs() < Z_90 * std_m)[valid].double().mean())
    figures = " | ".join(f"{value:.3f}" for value in rmse)
    return f"{name} | {figures} | {100 * relative:.2f} % | {covered:.3f} | {int((~valid).sum())} |"


def measure(frames: list[Frame], arguments: argparse.Namespace) -> None:
    """Print a table of all noises, disturbances, hulls and estimators."""
    pairs = [
        (frame, i) for frame in frames for i in np.flatnonzero(frame.range_m > 0) if (frame.visibility[i] > 0).all()
    ]
    if not pairs:
        raise ValueError(f"{arguments.dataset}: no boat with a laser range and seven labelled keypoints")
    keypoints_px = torch.from_numpy(np.stack([frame.keypoints_px[i] for frame, i in pairs]))[:, None]
    truth_m = torch.tensor([frame.range_m[i] for frame, i in pairs], dtype=torch.float64)
    mounted = camera_to(stack_cameras([frame.camera for frame, _ in pairs]), dtype=torch.float64)
    known = hull_to(stack_hulls([frame.hull for frame, _ in pairs]), dtype=torch.float64)
    hulls: dict[str, Hull] = {"known": known, "generic": hull_to(generic_hull(len(pairs)), dtype=torch.float64)}
    print(f"{len(pairs)} boats; RMSE in m over all and by distance\n")
    print("| pitch error | noise | estimator | all | < 7 m | 7-15 m | > 15 m | median | in 90 % | refused |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    layer = RangingLayer()
    for pitch_deg in arguments.pitch_deg:
        for noise_px in arguments.noise_px:
            camera = disturb(mounted, pitch_deg, arguments.attitude_std_deg, arguments.wave_std_m)
            seen_px = keypoints_px + noise_px * torch.randn_like(keypoints_px)
            covariance = noise_px**2 * torch.eye(2, dtype=torch.float64).expand(*seen_px.shape, 2)
            boxes_px = torch.cat([seen_px.amin(2), seen_px.amax(2)], -1)
            start = f"| {pitch_deg:g} deg | {noise_px:g} px | "
            for i, (name, hull) in enumerate(hulls.items()):
                with torch.no_grad():
                    ranges = layer(seen_px, covariance, boxes_px, camera, hull)
                if i == 0:
                    print(start + row("waterline", ranges.waterline, truth_m))
                print(start + row(f"hull, {name}", ranges.hull, truth_m))
                print(start + row(f"fused, {name}", ranges.fused, truth_m), flush=True)


def main() -> None:
    """Read the command line and measure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", help="folder that holds data.yaml")
    parser.add_argument("--split", choices=SPLITS, nargs="+", default=SPLITS)
    parser.add_argument("--noise-px", type=float, nargs="+", default=[1.0, 2.0, 4.0])
    parser.add_argument("--pitch-deg", type=float, nargs="+", default=[0.0, 0.3], help="disturbance of the pitch")
    parser.add_argument("--attitude-std-deg", type=float, default=0.05, help="of the measured pitch and roll")
    parser.add_argument("--wave-std-m", type=float, default=0.0, help="of the water at a boat")
    arguments = parser.parse_args()
    torch.manual_seed(0)
    measure([frame for split in arguments.split for frame in read_dataset(arguments.dataset, split)], arguments)


if __name__ == "__main__":
    run_program(main)
