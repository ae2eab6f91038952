"""Training and validation of :class:`usvnet.model.USVNet` as a Lightning module."""

from typing import Any

import torch
from lightning.pytorch import Callback, LightningModule
from torch import Tensor
from torch.optim import Optimizer

from usvnet.checkpoints import STAMP, check_variant
from usvnet.config import LossWeights, OptimiserConfig
from usvnet.evaluation.pose_metrics import PAPER_SIGMA, STRICT_SIGMA, score_keypoints, score_pose
from usvnet.evaluation.range_metrics import score_range
from usvnet.evaluation.records import BoatRecord, TruthRecord, to_records, to_truths
from usvnet.losses import Assignment, Criterion, assign
from usvnet.model import USVNet
from usvnet.optimiser import MovingAverage, WarmupSchedule, build_optimiser, resolve_auto, warmup_steps
from usvnet.types import Batch, Boats, Camera, NetworkOutput, Prediction


class USVModule(LightningModule):
    """The network with its losses, its optimiser and its validation scores.

    Args:
        variant: size of the network, one of n, s, m, l, x.
        loss_weights: what each loss counts.
        optimiser: which optimiser and how its learning rate moves.
        range_loss_start_epoch: first epoch (from 0) in which laser ranges teach; keypoints are too rough before.
        curved_water: range on the curved Earth with refraction, for long range.
        ema_decay: share of the averaged weights that one update keeps.
        ema_ramp_steps: steps over which the averaging slows down to ``ema_decay``.
    """

    def __init__(
        self,
        variant: str = "n",
        loss_weights: LossWeights = LossWeights(),  # noqa: B008 (frozen)
        optimiser: OptimiserConfig = OptimiserConfig(),  # noqa: B008 (frozen)
        range_loss_start_epoch: int = 10,
        curved_water: bool = False,
        ema_decay: float = 0.9999,
        ema_ramp_steps: float = 2000.0,
    ) -> None:
        super().__init__()
        self.model = USVNet(variant, curved_water=curved_water).to(memory_format=torch.channels_last)
        self.criterion = Criterion(loss_weights)
        self.optimiser = optimiser
        self.range_loss_start_epoch = range_loss_start_epoch
        self.average = MovingAverage(ema_decay, ema_ramp_steps)
        self.stamp = {"variant": variant, "curved_water": curved_water}
        self._records: list[list[BoatRecord]] = []
        self._truths: list[list[TruthRecord]] = []

    def forward(self, image: Tensor, camera: Camera) -> Prediction:
        """Find and range the boats, see :meth:`usvnet.model.USVNet.forward`."""
        prediction: Prediction = self.model(image.contiguous(memory_format=torch.channels_last), camera)
        return prediction

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """Return the total loss of a batch."""
        losses = self.losses(batch)
        ranged = (batch.boats.present & (batch.boats.range_m > 0)).sum()
        size = len(batch.image)
        self.log("loss", losses["total"].detach(), prog_bar=True, logger=False, batch_size=size)
        scalars = {f"train/{name}": loss.detach() for name, loss in losses.items()}
        self.log_dict(scalars | {"train/ranged_boats": ranged.float()}, on_step=True, on_epoch=False, batch_size=size)
        return losses["total"]

    def losses(self, batch: Batch) -> dict[str, Tensor]:
        """All losses of a batch by name, and their weighted sum ``total`` (see :class:`usvnet.losses.Criterion`)."""
        output: NetworkOutput = self.model.network(batch.image.contiguous(memory_format=torch.channels_last))
        with torch.autocast(batch.image.device.type, enabled=False):
            output = NetworkOutput(*[tensor.float() for tensor in output])
            assignment = assign(output, batch.boats)
            slant_m, valid = self.ranges(output, assignment, batch.boats, batch.camera)
            started = self.current_epoch >= self.range_loss_start_epoch
            return self.criterion(output, batch.boats, assignment, slant_m, valid, float(started))

    def ranges(
        self, output: NetworkOutput, assignment: Assignment, boats: Boats, camera: Camera
    ) -> tuple[Tensor, Tensor]:
        """Range each labelled boat from its best anchor, to the point that its laser reading belongs to.

        Returns:
            (B, N) slant range in metres and (B, N) whether there is one.
        """
        picture = torch.arange(len(assignment.best_anchor), device=assignment.best_anchor.device).unsqueeze(1)
        coarse_px = output.keypoints_px[picture, assignment.best_anchor]
        boxes_px = output.boxes_px[picture, assignment.best_anchor]
        keypoints_px, covariance_px2 = self.model.locate(output.heatmap_logits, coarse_px)
        _, waterline = self.model.ranging(keypoints_px, covariance_px2, boxes_px, camera)
        boat = torch.arange(boats.reference.shape[1], device=picture.device)
        keypoint = boats.reference.clamp(min=0)
        stated = self.model.ranging.range_points(
            keypoints_px[picture, boat, keypoint], covariance_px2[picture, boat, keypoint], camera
        )
        nearest = boats.reference < 0
        return (
            torch.where(nearest, waterline.slant_m, stated.slant_m),
            torch.where(nearest, waterline.valid, stated.valid),
        )

    def validation_step(self, batch: Batch, batch_idx: int) -> dict[str, Prediction]:
        """Predict with the averaged weights and keep the boats for scoring."""
        prediction = self(batch.image, batch.camera)
        self._records += to_records(prediction)
        self._truths += to_truths(batch.boats)
        return {"prediction": prediction}

    def on_validation_epoch_end(self) -> None:
        """Score the whole validation set, the pictures of other processes included."""
        records, truths = self._gather(self._records), self._gather(self._truths)
        self._records, self._truths = [], []
        self.log_dict({f"val/{name}": value for name, value in scores(records, truths).items()}, rank_zero_only=False)

    def _gather(self, pictures: list[Any]) -> list[Any]:
        if self.trainer.world_size == 1:
            return pictures
        parts: list[Any] = [None] * self.trainer.world_size
        torch.distributed.all_gather_object(parts, pictures)
        return [picture for part in parts for picture in part]

    def configure_optimizers(self) -> dict[str, Any]:
        """Build the optimiser and the learning rate's course over the whole run."""
        steps = int(self.trainer.estimated_stepping_batches)
        config = resolve_auto(self.optimiser, steps)
        optimiser: Optimizer = build_optimiser(self, config)
        warmup = warmup_steps(config, steps / max(self.trainer.max_epochs or 1, 1), steps)
        schedule = WarmupSchedule(optimiser, config, steps, warmup)
        return {"optimizer": optimiser, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def configure_callbacks(self) -> list[Callback]:
        """Average the weights: part of the method, so no configuration can forget it."""
        return [self.average]

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Write what :func:`usvnet.checkpoints.load_model` needs to build the network."""
        checkpoint[STAMP] = self.stamp

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Refuse a checkpoint of another size."""
        check_variant(self.trainer.ckpt_path or "checkpoint", checkpoint, self.model.variant)


def scores(records: list[list[BoatRecord]], truths: list[list[TruthRecord]]) -> dict[str, float]:
    """Validation scores by name: pose at both OKS sigmas, keypoint error and the ``waterline`` range's errors."""
    loose, strict = score_pose(records, truths, PAPER_SIGMA), score_pose(records, truths, STRICT_SIGMA)
    ranges = score_range(records, truths).overall["waterline"]
    return {
        "precision": loose.precision,
        "recall": loose.recall,
        "mAP50": loose.map50,
        "mAP50-95": loose.map50_95,
        "strict_mAP50-95": strict.map50_95,
        "keypoint_median_px": score_keypoints(records, truths).overall.median_px,
        "range_rmse_m": ranges.rmse_m,
        "range_mae_m": ranges.mae_m,
        "missed": float(ranges.missed),
    }
