r"""What a laser alone teaches: a trained network goes on learning from pictures with a range and nothing else.

Pictures of the split are dealt out in turn: every other one is learnt from, the others are held out. Of a picture that
is learnt from, only its camera, its hull and the laser's range are used: the boat is the best-scoring detection, and
the loss is that of its fused range, which reaches the network through fusion, the fit of the hull, keypoints and
heatmaps. Norms keep their statistics. Labels of keypoints are only read to draw their error into the curve.

python benchmarks/laser_only.py --checkpoint best.ckpt --root sixscenes-v0 --output out --image_size 320 \
    --attitude_std_deg 0.05 --wave_std_m 0.014
"""

import dataclasses
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import torch
from jsonargparse import auto_cli
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import track
from torch import Tensor
from torch.utils.data import DataLoader

from usvnet.checkpoints import load_model
from usvnet.data import read_dataset
from usvnet.data.augmentation import AugmentationConfig
from usvnet.data.dataset import BoatDataset, collate
from usvnet.data.records import Frame
from usvnet.evaluation.records import RANGE_CONFIDENCE
from usvnet.evaluation.tables import Cell, Column, Table
from usvnet.files import atomic_write
from usvnet.losses.ranges import range_loss
from usvnet.model import USVNet
from usvnet.types import Batch, Prediction

ESTIMATORS = ("waterline", "hull", "fused")
AUGMENTATION = AugmentationConfig(zoom=(0.9, 1.25), mosaic=0.0, paste=0.0)
"""Whatever moves the picture moves its camera; the range stays."""


def main(
    checkpoint: Path,
    root: Path,
    output: Path,
    image_size: int = 640,
    split: str = "val",
    attitude_std_deg: float | None = None,
    wave_std_m: float | None = None,
    keypoint_share: float | None = None,
    steps: int = 200,
    every: int = 25,
    batch_size: int = 8,
    learning_rate: float = 2e-4,
    seed: int = 0,
) -> None:
    """Write ``laser_only.md`` and ``laser_only.png``.

    Args:
        checkpoint: written by train.py.
        root: dataset folder.
        output: folder of the results.
        image_size: side of the square picture that the network sees.
        split: which was not trained on; its pictures of one boat with a laser range are used.
        attitude_std_deg: standard deviation of pitch and roll as measured; as the camera files say by default.
        wave_std_m: standard deviation of the water at a boat; as the camera files say by default.
        keypoint_share: doubt of the keypoints as a share of the boat's size; the checkpoint's by default.
        steps: optimiser steps.
        every: steps between two looks at the pictures held out.
        batch_size: pictures a step.
        learning_rate: of AdamW, falling to 0 along a cosine.
        seed: of order and augmentation.
    """
    torch.manual_seed(seed)
    model = load_model(checkpoint)
    model.max_boats = 1
    model.intervals.set_factors({})
    if keypoint_share is not None:
        model.noise.set_share(keypoint_share)
    alone = [f for f in read_dataset(root, split) if len(f.boxes_px) == 1 and f.range_m[0] > 0]
    frames = [with_sigmas(frame, attitude_std_deg, wave_std_m) for frame in alone]
    if len(frames) < 2:
        raise ValueError(f"{root}: {split} has {len(frames)} pictures of one boat with a laser range, expected some")
    learnt = BoatDataset(frames[::2], image_size, AUGMENTATION)
    held_out = BoatDataset(frames[1::2], image_size)
    optimiser = torch.optim.AdamW(model.parameters(), learning_rate, weight_decay=0.0)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    curve: list[list[Cell]] = [[0, *measure(model, held_out)]]
    batches = endless(learnt, batch_size, seed)
    for step in track(range(1, steps + 1), "Learning", console=Console(stderr=True), transient=True):
        optimiser.zero_grad()
        batch = next(batches)
        prediction = predict(model, batch)
        found = prediction.fused.valid & (prediction.scores >= RANGE_CONFIDENCE)
        loss, _ = range_loss(prediction.fused.slant_m, found, batch.boats)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(model.parameters(), 10.0)
        optimiser.step()
        schedule.step()
        if step % every == 0 or step == steps:
            curve.append([step, *measure(model, held_out)])
            write(curve, output, f"{len(learnt)} pictures learnt from, {len(held_out)} held out")
    print((output / "laser_only.md").read_text(encoding="utf-8"))


def with_sigmas(frame: Frame, attitude_std_deg: float | None, wave_std_m: float | None) -> Frame:
    """The frame with other standard deviations of its camera."""
    camera, one = frame.camera, torch.ones_like(frame.camera.pitch_rad)
    if attitude_std_deg is not None:
        std_rad = math.radians(attitude_std_deg) * one
        camera = camera._replace(pitch_std_rad=std_rad, roll_std_rad=std_rad)
    if wave_std_m is not None:
        camera = camera._replace(wave_std_m=wave_std_m * one)
    return dataclasses.replace(frame, camera=camera)


def endless(dataset: BoatDataset, batch_size: int, seed: int) -> Iterator[Batch]:
    """Batches without end, every picture as often as every other."""
    order = torch.Generator().manual_seed(seed)
    loader = DataLoader(dataset, batch_size, shuffle=True, drop_last=True, collate_fn=collate, generator=order)
    while True:
        yield from loader


def predict(model: USVNet, batch: Batch) -> Prediction:
    """The best-scoring boat of each picture."""
    prediction: Prediction = model(batch.image, batch.camera, batch.hull)
    return prediction


def measure(model: USVNet, dataset: BoatDataset) -> list[float]:
    """RMSE, MAE and median relative error of every estimator, median keypoint error (px), and boats missed."""
    errors: dict[str, list[Tensor]] = {name: [] for name in ESTIMATORS}
    readings, keypoints_px = [], []
    with torch.inference_mode():
        for batch in DataLoader(dataset, 16, collate_fn=collate):
            prediction = predict(model, batch)
            found = (prediction.scores >= RANGE_CONFIDENCE)[:, 0]
            for name in ESTIMATORS:
                estimate = getattr(prediction, name)
                valid = found & estimate.valid[:, 0]
                errors[name].append(torch.where(valid, estimate.slant_m[:, 0] - batch.boats.range_m[:, 0], math.nan))
            readings.append(batch.boats.range_m[:, 0])
            off_px = (prediction.keypoints_px[:, 0] - batch.boats.keypoints_px[:, 0]).norm(dim=-1)
            keypoints_px.append(off_px[found.unsqueeze(1) & (batch.boats.visibility[:, 0] > 0)])
    reading_m = torch.cat(readings).numpy()
    figures = []
    for name in ESTIMATORS:
        error_m = torch.cat(errors[name]).numpy()
        relative = np.abs(error_m) / reading_m
        figures += [
            math.sqrt(np.nanmean(error_m**2)),
            float(np.nanmean(np.abs(error_m))),
            float(np.nanmedian(relative)),
        ]
    missed = int(np.isnan(torch.cat(errors["fused"]).numpy()).sum())
    return [*figures, float(torch.cat(keypoints_px).median()), missed]


def write(curve: Sequence[Sequence[Cell]], output: Path, note: str) -> None:
    """Write table and curve, as far as they are known."""
    columns = [Column("Step")]
    for name in ESTIMATORS:
        columns += [Column(f"{name} RMSE"), Column("MAE"), Column("rel. error", digits=2, percent=True)]
    columns += [Column("keypoints px", digits=2), Column("missed")]
    note = f"{note}; ranges in metres; rel. error: median of |error| / reading."
    table = Table("Learning from laser ranges only, on the pictures held out", columns, curve, note=note)
    with atomic_write(output / "laser_only.md") as temporary:
        temporary.write_text(table.to_markdown(), encoding="utf-8")
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    steps = [row[0] for row in curve]
    for place, (panel, title) in enumerate(
        zip(figure.subplots(1, 3), ("RMSE, m", "MAE, m", "median relative error, %"))
    ):
        for n, name in enumerate(ESTIMATORS):
            scale = 100 if place == 2 else 1
            panel.plot(steps, [scale * float(row[1 + 3 * n + place] or 0) for row in curve], label=name)
        panel.set(xlabel="step", title=title, ylim=(0, None))
        panel.grid(alpha=0.3)
    figure.axes[0].legend()
    with atomic_write(output / "laser_only.png") as temporary:
        figure.savefig(temporary, format="png", dpi=120)


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
