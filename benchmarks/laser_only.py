r"""What a laser alone teaches: a trained network goes on learning from pictures with a range and nothing else.

Pictures of a split that was not trained on are dealt out in turn: every other one is learnt from, the others are held
out. Of a picture that is learnt from, only its camera, its hull and the laser's range are used. The boat is the
best-scoring detection, and the loss is that of its fused range, which reaches the heatmap branch through fusion, the
fit of the hull, keypoints and heatmaps. The rest of the network stays as it is, so its features are computed once and
the same boats are found throughout; labels of keypoints are only read to draw their error into the curve.

python benchmarks/laser_only.py --checkpoint best.ckpt --root sixscenes-v0 --output out --image_size 320 \
    --attitude_std_deg 0.05 --wave_std_m 0.014
"""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import torch
from jsonargparse import auto_cli
from matplotlib.figure import Figure
from ranging_evidence import with_sigmas
from rich.console import Console
from rich.progress import track
from torch import Tensor
from torch.utils.data import DataLoader

from usvnet.checkpoints import load_model
from usvnet.data import read_dataset
from usvnet.data.dataset import BoatDataset, collate
from usvnet.evaluation.records import RANGE_CONFIDENCE
from usvnet.evaluation.tables import Cell, Column, Table
from usvnet.files import atomic_write
from usvnet.geometry.camera import stack_cameras
from usvnet.geometry.hull_model import stack_hulls
from usvnet.losses.ranges import range_loss
from usvnet.model import USVNet
from usvnet.network.nms import select_boats
from usvnet.types import Boats, Camera, Hull, Ranges

ESTIMATORS = ("waterline", "hull", "fused")
GROSS = 0.2
"""Relative error that a boat counts with which was missed or is further off."""


class Seen(NamedTuple):
    """What the detector makes of N pictures, of one boat each."""

    stride4: Tensor
    """(N, c, H / 4, W / 4) of the backbone, what the heatmap branch reads."""
    stride8: Tensor
    """(N, c, H / 8, W / 8) of the neck, the same."""
    coarse_px: Tensor
    """(N, 1, 7, 2) of the best-scoring boat."""
    boxes_px: Tensor
    """(N, 1, 4)"""
    found: Tensor
    """(N, 1) bool, whether it scores enough."""
    camera: Camera
    hull: Hull
    boats: Boats
    """The laser's range, and the labels that are only looked at."""


def main(
    checkpoint: Path,
    root: Path,
    output: Path,
    image_size: int = 640,
    split: str = "val",
    estimator: Literal["waterline", "hull", "fused"] = "fused",
    attitude_std_deg: float | None = None,
    wave_std_m: float | None = None,
    keypoint_share: float | None = None,
    steps: int = 300,
    every: int = 30,
    batch_size: int = 16,
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
        estimator: whose range is held against the laser's.
        attitude_std_deg: standard deviation of pitch and roll as measured; as the camera files say by default.
        wave_std_m: standard deviation of the water at a boat; as the camera files say by default.
        keypoint_share: doubt of the keypoints as a share of the boat's size; the checkpoint's by default.
        steps: optimiser steps.
        every: steps between two looks at the pictures held out.
        batch_size: pictures a step.
        learning_rate: of AdamW, falling to 0 along a cosine.
        seed: of the order.
    """
    model = load_model(checkpoint)
    if keypoint_share is not None:
        model.noise.set_share(keypoint_share)
    alone = [f for f in read_dataset(root, split) if len(f.boxes_px) == 1 and f.range_m[0] > 0]
    frames = [with_sigmas(frame, attitude_std_deg, wave_std_m) for frame in alone]
    if len(frames) < 2 * batch_size:
        raise ValueError(f"{root}: {split} has {len(frames)} pictures of one boat with a laser range, too few")
    learnt, held_out = (see(model, BoatDataset(some, image_size)) for some in (frames[::2], frames[1::2]))
    head = model.network.heatmap_head
    optimiser = torch.optim.AdamW(head.parameters(), learning_rate, weight_decay=0.0)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    generator = torch.Generator().manual_seed(seed)
    curve: list[list[Cell]] = [[0, *measure(model, learnt)[:1], *measure(model, held_out)]]
    for step in track(range(1, steps + 1), "Learning", console=Console(stderr=True), transient=True):
        chosen = torch.randperm(len(learnt.found), generator=generator)[:batch_size]
        ranges, _ = ranged(model, learnt, chosen)
        estimate = getattr(ranges, estimator)
        boats = Boats(*(field[chosen] for field in learnt.boats))
        loss, _ = range_loss(estimate.slant_m, estimate.valid & learnt.found[chosen], boats)
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(head.parameters(), 10.0)
        optimiser.step()
        schedule.step()
        if step % every == 0 or step == steps:
            curve.append([step, *measure(model, learnt)[:1], *measure(model, held_out)])
            write(curve, output, estimator, len(learnt.found), len(held_out.found))
    print((output / "laser_only.md").read_text(encoding="utf-8"))


def see(model: USVNet, dataset: BoatDataset) -> Seen:
    """Run the part of the network that stays as it is."""
    read: list[tuple[Tensor, ...]] = []
    watch = model.network.heatmap_head.register_forward_pre_hook(lambda _, features: read.append(features))
    best, batches = [], []
    with torch.no_grad():
        for batch in DataLoader(dataset, 16, collate_fn=collate):
            best.append(select_boats(model.network(batch.image), 1, 0.0, model.iou_threshold))
            batches.append(batch)
    watch.remove()
    return Seen(
        stride4=torch.cat([features[0] for features in read]),
        stride8=torch.cat([features[1] for features in read]),
        coarse_px=torch.cat([boat.keypoints_px for boat in best]),
        boxes_px=torch.cat([boat.boxes_px for boat in best]),
        found=torch.cat([boat.scores for boat in best]) >= RANGE_CONFIDENCE,
        camera=stack_cameras([batch.camera for batch in batches]),
        hull=stack_hulls([batch.hull for batch in batches]),
        boats=Boats(*(torch.cat(fields) for fields in zip(*(batch.boats for batch in batches)))),
    )


def ranged(model: USVNet, seen: Seen, chosen: Tensor) -> tuple[Ranges, Tensor]:
    """Ranges of the chosen pictures' boats and their keypoints (B, 1, 7, 2)."""
    logits = model.network.heatmap_head(seen.stride4[chosen], seen.stride8[chosen])
    keypoints_px, covariance_px2 = model.locate(logits, seen.coarse_px[chosen])
    boxes_px = seen.boxes_px[chosen]
    camera = Camera(*(field[chosen] for field in seen.camera))
    hull = Hull(*(field[chosen] for field in seen.hull))
    covariance_px2, hull = model.noise(covariance_px2, boxes_px), model.noise.resized(hull)
    ranges: Ranges = model.ranging(keypoints_px, covariance_px2, boxes_px, camera, hull)
    return ranges, keypoints_px


def measure(model: USVNet, seen: Seen) -> list[float]:
    """Mean of the capped relative error of ``fused``; by estimator RMSE, that mean, median; keypoint error; missed."""
    figures, truth_m = [], seen.boats.range_m[:, 0].numpy()
    with torch.no_grad():
        ranges, keypoints_px = ranged(model, seen, torch.arange(len(seen.found)))
    for name in ESTIMATORS:
        estimate = getattr(ranges, name)
        valid = (estimate.valid & seen.found)[:, 0].numpy()
        error_m = estimate.slant_m[:, 0].numpy()[valid] - truth_m[valid]
        relative = np.full(len(truth_m), GROSS)
        relative[valid] = np.minimum(np.abs(error_m) / truth_m[valid], GROSS)
        figures += [math.sqrt(np.mean(error_m**2)), float(np.mean(relative)), float(np.median(relative))]
    off_px = (keypoints_px - seen.boats.keypoints_px).norm(dim=-1)[
        seen.found.unsqueeze(-1) & (seen.boats.visibility > 0)
    ]
    return [figures[7], *figures, float(off_px.median()), int((~(ranges.fused.valid & seen.found)).sum())]


def write(curve: Sequence[Sequence[Cell]], output: Path, estimator: str, learnt: int, held_out: int) -> None:
    """Write table and curve, as far as they are known."""
    shown = [[row[0], row[1], *row[3:]] for row in curve]
    columns = [Column("Step"), Column("learnt from: fused mean", digits=2, percent=True)]
    for name in ESTIMATORS:
        columns += [Column(f"{name} RMSE m"), *(Column(title, digits=2, percent=True) for title in ("mean", "median"))]
    columns += [Column("keypoints px", digits=2), Column("missed")]
    note = (
        f"{learnt} pictures learnt from by the range of {estimator}; all other columns on the {held_out} held out; "
        f"mean and median of |error| / reading, more than {GROSS:.0%} and missed boats counted as {GROSS:.0%}."
    )
    table = Table("Learning from laser ranges only", columns, shown, note=note)
    with atomic_write(output / "laser_only.md") as temporary:
        temporary.write_text(table.to_markdown(), encoding="utf-8")
    figure = Figure(figsize=(10, 3.6), layout="constrained")
    for place, (panel, title) in enumerate(
        zip(figure.subplots(1, 3), ("RMSE, m", "mean relative error, %", "median relative error, %"))
    ):
        for n, name in enumerate(ESTIMATORS):
            values = [float(row[2 + 3 * n + place] or 0) * (100 if place else 1) for row in shown]
            panel.plot([row[0] for row in shown], values, label=f"{name}, held out")
        if place == 1:
            panel.plot(
                [row[0] for row in shown], [100 * float(row[1] or 0) for row in shown], "k:", label="fused, learnt"
            )
        panel.set(xlabel="step", title=title, ylim=(0, 1.08 * panel.dataLim.ymax))
        panel.grid(alpha=0.3)
    figure.axes[1].legend(fontsize="small")
    with atomic_write(output / "laser_only.png") as temporary:
        figure.savefig(temporary, format="png", dpi=120)


if __name__ == "__main__":
    auto_cli(main, as_positional=False)
