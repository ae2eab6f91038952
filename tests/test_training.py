"""Training learns, ranges teach the first convolution, averages average, and a run goes on where it stopped."""

import math

import cv2
import numpy as np
import pytest
import torch
from lightning.pytorch import Callback, Trainer
from torch import nn
from torch.utils.data import DataLoader

from usvnet.callbacks import LastCheckpoint, MovingAverage, norm_momentum
from usvnet.checkpoints import load_model
from usvnet.config import LossWeights, OptimiserConfig
from usvnet.geometry.camera import make_camera, project, stack_cameras
from usvnet.geometry.hull_model import generic_hull
from usvnet.training import USVModule
from usvnet.types import NEAREST_WATERLINE, Batch, Boats

SIZE_PX = 96
CAMERA = make_camera([[90, 0, 47.5], [0, 90, 47.5], [0, 0, 1]], (SIZE_PX, SIZE_PX), height_m=1.5)
HULL_M = torch.tensor(  # x along the boat, y up, z across
    [[1.4, 0.8, 0], [0.7, 0.7, 0.5], [0.7, 0.7, -0.5], [1.1, 0, 0], [-1.3, 0.6, 0.5], [-1.3, 0.6, -0.5], [-1.3, 0, 0]]
)
SETTINGS = {
    "optimiser": OptimiserConfig(name="AdamW", learning_rate=0.002, momentum=0.9, warmup_epochs=1),
    "ema_decay": 0.9,
    "ema_ramp_steps": 10.0,
}


def draw_boat(rng: np.random.Generator) -> tuple[np.ndarray, torch.Tensor, float]:
    """A dark boat on light water: picture, (7, 2) keypoints and the slant range of its nearer waterline keypoint."""
    yaw, x, z = rng.uniform(-0.6, 0.6), rng.uniform(-1, 1), rng.uniform(5, 7)
    c, s = math.cos(yaw), math.sin(yaw)
    along, up, across = HULL_M.unbind(1)
    points_m = torch.stack([c * along - s * across + x, 1.5 - up, s * along + c * across + z], dim=1)
    keypoints_px = project(points_m[None], CAMERA)[0]
    picture = np.full((SIZE_PX, SIZE_PX, 3), 190, np.uint8)
    picture[: SIZE_PX // 2] = 235
    outline = cv2.convexHull(keypoints_px.round().int().numpy())
    cv2.fillConvexPoly(picture, outline, (60, 30, 30))
    return picture, keypoints_px, float(points_m[[3, 6]].norm(dim=1).min())


def synthetic_batch(pictures: int, seed: int) -> Batch:
    rng = np.random.default_rng(seed)
    drawn = [draw_boat(rng) for _ in range(pictures)]
    keypoints_px = torch.stack([keypoints for _, keypoints, _ in drawn])[:, None]
    boats = Boats(
        boxes_px=torch.cat([keypoints_px.amin(2), keypoints_px.amax(2)], dim=-1),
        keypoints_px=keypoints_px,
        visibility=torch.full((pictures, 1, 7), 2),
        present=torch.ones(pictures, 1, dtype=torch.bool),
        range_m=torch.tensor([[range_m] for _, _, range_m in drawn]),
        range_std_m=torch.full((pictures, 1), 0.01),
        reference=torch.full((pictures, 1), NEAREST_WATERLINE),
    )
    image = torch.from_numpy(np.stack([picture for picture, _, _ in drawn])).permute(0, 3, 1, 2).float() / 255
    return Batch(image, stack_cameras([CAMERA] * pictures), boats, torch.arange(pictures), generic_hull(pictures))


def loader(batches: int, pictures: int, seed: int = 0) -> DataLoader:
    return DataLoader([synthetic_batch(pictures, seed + n) for n in range(batches)], batch_size=None)


def trainer(folder, epochs: int, *callbacks: Callback, **settings) -> Trainer:
    return Trainer(
        accelerator="cpu",
        max_epochs=epochs,
        default_root_dir=folder,
        logger=False,
        enable_progress_bar=False,
        enable_model_summary=False,
        num_sanity_val_steps=0,
        gradient_clip_val=10.0,
        callbacks=[LastCheckpoint(folder), *callbacks],
        **settings,
    )


def module(**settings) -> USVModule:
    torch.manual_seed(0)
    return USVModule(**SETTINGS | settings)


def test_a_short_run_learns(tmp_path):
    model = module()
    unseen = loader(2, pictures=8, seed=99)
    run = trainer(tmp_path, epochs=16, check_val_every_n_epoch=16)
    before = run.validate(model, unseen, verbose=False)[0]
    run.fit(model, loader(4, pictures=4), unseen)
    after = {name: float(value) for name, value in run.callback_metrics.items()}
    assert before["val/mAP50"] < 0.05
    assert after["val/mAP50"] > 0.8
    assert after["val/keypoint_median_px"] < 3
    assert after["val/missed"] == 0
    assert after["val/range_mae_m"] < 0.6
    assert after["train/keypoint_error"] < 0.2
    assert 0 < after["train/range_scale"] <= 1


def test_range_alone_teaches_the_first_convolution():
    weights = LossWeights(box=0, dfl=0, classification=0, keypoint=0, visibility=0, heatmap=0, range=1, covariance=0)
    model = module(loss_weights=weights, range_loss_error=None)
    model.losses(synthetic_batch(2, 0))["total"].backward()
    first = next(layer for layer in model.model.network.modules() if isinstance(layer, nn.Conv2d))
    assert first.weight.grad.isfinite().all()
    assert first.weight.grad.abs().sum() > 0


def test_the_bins_of_box_sides_are_no_weights():
    module = USVModule()
    bins = module.model.network.pose_head.bins
    assert bins.tolist() == list(range(16))
    assert [name for name, p in module.model.network.named_parameters() if not p.requires_grad] == ["pose_head.bins"]


def test_ranges_teach_nothing_before_their_epoch():
    weights = LossWeights(box=0, dfl=0, classification=0, keypoint=0, visibility=0, heatmap=0, range=1, covariance=0)
    model = module(loss_weights=weights, range_loss_start_epoch=1, range_loss_error=None)
    assert model.losses(synthetic_batch(2, 0))["total"] == 0


def test_ranges_teach_nothing_while_keypoints_are_rough():
    weights = LossWeights(box=0, dfl=0, classification=0, keypoint=0, visibility=0, heatmap=0, range=1, covariance=0)
    model = module(loss_weights=weights)
    assert model.losses(synthetic_batch(2, 0))["total"] == 0
    model.curriculum.error = torch.tensor(0.05)
    assert model.losses(synthetic_batch(2, 0))["total"] > 0


def test_a_checkpoint_carries_the_curriculum(tmp_path):
    first = module()
    trainer(tmp_path, 1).fit(first, loader(2, 2))
    error = float(first.curriculum.error)
    assert error < 1
    second = module()
    run = trainer(tmp_path, 1)
    run.fit(second, loader(2, 2), ckpt_path=tmp_path / "last.ckpt", weights_only=True)
    assert run.global_step == 2  # nothing was left to train
    assert float(second.curriculum.error) == error


class Momenta(Callback):
    """The first norm's momentum at each step."""

    def __init__(self):
        self.seen = []

    def on_train_batch_end(self, trainer, pl_module, *_):
        self.seen.append(next(m for m in pl_module.modules() if isinstance(m, nn.BatchNorm2d)).momentum)


def test_norms_look_back_over_a_twentieth_of_the_steps_until_they_are_as_slow_as_they_should_be(tmp_path):
    momenta = Momenta()
    trainer(tmp_path, 2, momenta).fit(module(), loader(2, 1))
    assert momenta.seen == [1 / 5, 1 / 5.05, 1 / 5.1, 1 / 5.15]
    assert norm_momentum(566) > 0.03 > norm_momentum(567)


def test_under_autocast_losses_and_geometry_stay_in_single_precision():
    """The same network answer, rounded to bfloat16 by the network alone, must give the same losses and ranges."""
    model, batch = module(range_loss_error=None).eval(), synthetic_batch(2, 0)
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        answer = model.model.network(batch.image)
        inside, prediction = model.losses(batch), model(batch.image, batch.camera)
    assert all(tensor.dtype == torch.float32 for tensor in answer)
    model.model.network.forward = lambda image: answer
    with torch.no_grad():
        outside, expected = model.losses(batch), model(batch.image, batch.camera)
    for name, loss in inside.items():
        assert loss.dtype == torch.float32, name
        torch.testing.assert_close(loss, outside[name], msg=name)
    for estimate, other in ((prediction.waterline, expected.waterline), (prediction.box_bottom, expected.box_bottom)):
        assert estimate.slant_m.dtype == estimate.slant_std_m.dtype == torch.float32
        torch.testing.assert_close(estimate.slant_m, other.slant_m)
        torch.testing.assert_close(estimate.slant_std_m, other.slant_std_m)
    torch.testing.assert_close(prediction.keypoint_covariance_px2, expected.keypoint_covariance_px2)


def test_a_bfloat16_run_trains(tmp_path):
    run = trainer(tmp_path, 1, precision="bf16-mixed")
    run.fit(module(), loader(2, 2))
    assert run.callback_metrics["loss"].isfinite()


def test_a_range_belongs_to_the_keypoint_it_names():
    """The same laser reading at the far end of the boat must give another loss than at the nearest point."""
    batch = synthetic_batch(2, 0)
    model = module(range_loss_error=None)
    losses = []
    for keypoint in (NEAREST_WATERLINE, 3, 6):
        boats = batch.boats._replace(reference=torch.full_like(batch.boats.reference, keypoint))
        torch.manual_seed(0)
        losses.append(float(model.losses(batch._replace(boats=boats))["range"]))
    assert losses[1] != losses[2]
    assert losses[0] != losses[1] or losses[0] != losses[2]


@pytest.mark.parametrize("change", ["no boats", "no ranges"])
def test_empty_batches_train_without_nan(change):
    batch = synthetic_batch(2, 0)
    if change == "no boats":
        boats = batch.boats._replace(present=torch.zeros_like(batch.boats.present))
    else:
        boats = batch.boats._replace(range_m=torch.zeros_like(batch.boats.range_m))
    model = module(range_loss_error=None)
    losses = model.losses(batch._replace(boats=boats))
    losses["total"].backward()
    assert losses["range"] == 0
    assert all(p.grad is None or p.grad.isfinite().all() for p in model.parameters())


def test_moving_average_by_hand():
    average = MovingAverage(decay=0.9, ramp_steps=2.0)
    values, counters = [torch.tensor([1.0, -2.0])], [torch.tensor(3)]
    average.update(values, [torch.tensor([2.0, 4.0])], updates=4)
    average.update(counters, [torch.tensor(7)], updates=4)
    keep = 0.9 * (1 - math.exp(-2))  # 0.77820
    assert values[0].tolist() == pytest.approx([keep * 1 + (1 - keep) * 2, keep * -2 + (1 - keep) * 4])
    assert counters[0] == 7


class AverageByHand(Callback):
    """The average of one weight and of one statistic, from their values after every step."""

    NAMES = ("model.network.backbone.stem.conv.weight", "model.network.backbone.stem.norm.running_mean")

    def __init__(self) -> None:
        self.averages: dict[str, torch.Tensor] = {}

    def on_train_batch_end(self, trainer, pl_module, *_):
        decay = 0.9 * (1 - math.exp(-(trainer.global_step - 1) / 10.0))
        for name in self.NAMES:
            current = pl_module.state_dict()[name].clone()
            self.averages[name] = decay * self.averages.get(name, current) + (1 - decay) * current


def test_every_step_moves_the_average(tmp_path):
    by_hand = AverageByHand()
    trainer(tmp_path, 2, by_hand).fit(module(), loader(2, pictures=2))
    checkpoint = torch.load(tmp_path / "last.ckpt", weights_only=True)
    for name, average in by_hand.averages.items():
        torch.testing.assert_close(checkpoint["state_dict"][name], average)
    assert checkpoint["averaging_state"]["n_averaged"] == 4
    assert checkpoint["state_dict"]["model.network.backbone.stem.norm.num_batches_tracked"] == 4


@pytest.mark.parametrize("setting", [{"ema_decay": 1.0}, {"ema_ramp_steps": 0.0}])
def test_an_impossible_average_is_named(setting):
    with pytest.raises(ValueError, match=next(iter(setting))):
        module(**setting)


class StopBefore(Callback):
    """Ctrl-C before a step; seeds every step, so that a run in two parts draws what a run in one part draws."""

    def __init__(self, step: int) -> None:
        self.step = step

    def on_train_batch_start(self, trainer, pl_module, batch, batch_idx):
        torch.manual_seed(trainer.global_step)
        if trainer.global_step == self.step:
            raise KeyboardInterrupt


@pytest.mark.usefixtures("interruptible")
def test_a_stopped_run_goes_on_as_if_it_had_not_stopped(tmp_path):
    batches = loader(2, pictures=2)
    trainer(tmp_path / "straight", 2, StopBefore(99)).fit(module(), batches)
    with pytest.raises(SystemExit):
        trainer(tmp_path / "stopped", 2, StopBefore(2)).fit(module(), batches)
    last = tmp_path / "stopped" / "last.ckpt"
    torch.manual_seed(7)  # the new process would not build the same random network
    run = trainer(tmp_path / "stopped", 2, StopBefore(99))
    run.fit(USVModule(**SETTINGS), batches, ckpt_path=last, weights_only=True)
    assert run.global_step == 4
    straight, resumed = (
        torch.load(tmp_path / name / "last.ckpt", weights_only=True) for name in ("straight", "stopped")
    )
    assert resumed["epoch"] == 1
    for key in ("state_dict", "current_model_state"):
        torch.testing.assert_close(resumed[key], straight[key])


def test_checkpoints_hold_the_averaged_weights_and_resume_the_raw_ones(tmp_path):
    batches = loader(3, pictures=2)
    trainer(tmp_path, epochs=1).fit(module(), batches)
    checkpoint = torch.load(tmp_path / "last.ckpt", weights_only=True)
    name = next(name for name in checkpoint["state_dict"] if name.endswith("weight"))
    average, raw = checkpoint["state_dict"][name], checkpoint["current_model_state"][name]
    assert not torch.equal(average, raw)
    loaded = load_model(tmp_path / "last.ckpt")
    torch.testing.assert_close(loaded.state_dict()[name.removeprefix("model.")], average)


def test_a_checkpoint_of_another_size_is_refused(tmp_path):
    trainer(tmp_path, epochs=1).fit(module(), loader(1, pictures=1))
    with pytest.raises(ValueError, match="size 'n', expected size 's'"):
        trainer(tmp_path, epochs=2).fit(
            module(variant="s"), loader(1, pictures=1), ckpt_path=tmp_path / "last.ckpt", weights_only=True
        )


def test_training_can_start_from_another_runs_weights(tmp_path):
    first = module()
    trainer(tmp_path, 1).fit(first, loader(2, 2))
    path = tmp_path / "first.ckpt"
    first.trainer.save_checkpoint(path)
    start = module(initial_weights=str(path)).model.state_dict()
    averaged = load_model(path).state_dict()
    assert start.keys() == averaged.keys()
    assert all(torch.equal(start[name], averaged[name]) for name in start)
    with pytest.raises(ValueError, match="got a checkpoint of size 'n', expected size 's'"):
        module(variant="s", initial_weights=str(path))
