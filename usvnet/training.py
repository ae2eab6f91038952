"""Training and validation of :class:`usvnet.model.USVNet` as a Lightning module."""

import math
from typing import Any, Literal, Self

import torch
from lightning.pytorch import Callback, LightningModule
from lightning.pytorch.utilities.types import OptimizerLRScheduler
from torch import Tensor
from torch.optim import Optimizer

from usvnet.callbacks import MovingAverage, NormWarmup
from usvnet.checkpoints import STAMP, check_variant, load_model
from usvnet.config import LossWeights, OptimiserConfig
from usvnet.detector_errors import confuse_ends, jitter_boxes, jitter_keypoints
from usvnet.evaluation.records import BoatRecord, TruthRecord, to_records, to_truths
from usvnet.evaluation.scores import Scores, score
from usvnet.heatmap import keypoints_from_moments, window_moments
from usvnet.losses import Criterion, RangeCurriculum, assign, best_keypoints, keypoint_error
from usvnet.model import USVNet
from usvnet.optimiser import WarmupSchedule, build_optimiser, resolve_auto, warmup_steps
from usvnet.types import (
    NEAREST_WATERLINE,
    WATERLINE_KEYPOINTS,
    Batch,
    Boats,
    Camera,
    Hull,
    Native,
    NetworkOutput,
    Prediction,
)


class USVModule(LightningModule):
    """The network with its losses, its optimiser and its validation scores.

    Args:
        variant: family and size of the network: n, s, m, l, x (YOLO11), v8n, v8s, v8m, v8l, v8x (YOLOv8), v8n-p6,
            v8s-p6, v8m-p6, v8l-p6 or v8x-p6 (YOLOv8-P6).
        loss_weights: what each loss counts.
        optimiser: which optimiser and how its learning rate moves.
        range_loss_start_epoch: first epoch (from 0) in which laser ranges may teach.
        range_loss_error: error of the keypoints in training, as a fraction of the boat's size, from which laser ranges
            teach fully; from twice that on they begin to. None lets them teach however rough the keypoints are.
        curved_water: range on the curved Earth with refraction, for long range.
        ema_decay: share of the averaged weights that one update keeps.
        ema_ramp_steps: steps over which the averaging slows down to ``ema_decay``.
        initial_weights: checkpoint of the same size whose weights training starts from, to adapt a network to other
            boats or waters; None starts from random weights.
        refine: "native" also trains a small network that looks at the boats again in the picture as the camera took it
            (needs ``data.native_size``).
        freeze: "detector" leaves the detector as ``initial_weights`` has it and trains the refinement alone, on hints
            that are labels made worse: the detector is not asked, which is quicker.

    Raises:
        ValueError: settings that do not fit together, or weights that do not fit.
    """

    def __init__(
        self,
        variant: str = "n",
        loss_weights: LossWeights = LossWeights(),  # noqa: B008 (frozen)
        optimiser: OptimiserConfig = OptimiserConfig(),  # noqa: B008 (frozen)
        range_loss_start_epoch: int = 0,
        range_loss_error: float | None = 0.1,
        curved_water: bool = False,
        ema_decay: float = 0.9999,
        ema_ramp_steps: float = 2000.0,
        initial_weights: str | None = None,
        refine: Literal["native"] | None = None,
        freeze: Literal["detector"] | None = None,
    ) -> None:
        super().__init__()
        if freeze is not None and (refine is None or initial_weights is None):
            raise ValueError("freeze is detector, which needs initial_weights for it and refine: native to train")
        self.model = USVNet(variant, curved_water=curved_water, refine=refine)
        if initial_weights is not None:
            own, found = self.model.state_dict(), load_model(initial_weights, variant).state_dict()
            self.model.load_state_dict({name: found.get(name, own[name]) for name in own})  # a refiner may be new
        self.freeze_detector = freeze is not None
        if self.freeze_detector:
            self.model.network.requires_grad_(False).eval()  # here, too: Lightning leaves modes as it finds them
        self.model.to(memory_format=torch.channels_last)  # type: ignore[call-overload]  # as the batches are: faster
        self.criterion = Criterion(loss_weights)
        self.optimiser = optimiser
        self.range_loss_start_epoch = range_loss_start_epoch
        self.curriculum = RangeCurriculum(range_loss_error)
        self.average = MovingAverage(ema_decay, ema_ramp_steps)
        self.stamp = {"variant": variant, "curved_water": curved_water, "refine": refine}
        self._scored: dict[int, tuple[list[BoatRecord], list[TruthRecord]]] = {}

    def train(self, mode: bool = True) -> Self:
        """Set training or evaluation mode; a frozen detector stays in evaluation mode, its norms as they are."""
        super().train(mode)
        if self.freeze_detector:
            self.model.network.eval()
        return self

    def forward(
        self, image: Tensor, camera: Camera, hull: Hull | None = None, native: Native | None = None
    ) -> Prediction:
        """Find and range the boats, see :meth:`usvnet.model.USVNet.forward`."""
        prediction: Prediction = self.model(image, camera, hull, native)
        return prediction

    def training_step(self, batch: Batch, batch_idx: int) -> Tensor:
        """Return the total loss of a batch."""
        losses = self.losses(batch)
        size = len(batch.image)
        self.log("loss", losses["total"].detach(), prog_bar=True, logger=False, batch_size=size)
        every = self.trainer.log_every_n_steps  # type: ignore[attr-defined]  # set by Lightning's logger connector
        if every > 0 and (self.global_step + 1) % every == 0:  # the logger drops the others, which cost time
            self.log_dict(self._scalars(losses, batch), batch_size=size)
        return losses["total"]

    def _scalars(self, losses: dict[str, Tensor], batch: Batch) -> dict[str, Tensor]:
        """What TensorBoard shows of a training step."""
        ranged = (batch.boats.present & (batch.boats.range_m > 0)).sum()
        scalars = {name: loss.detach() for name, loss in losses.items()} | {
            "ranged_boats": ranged.float(),
            "keypoint_error": self.curriculum.error,
            "range_scale": self.range_scale(),
        }
        return {f"train/{name}": value for name, value in scalars.items()}

    def losses(self, batch: Batch) -> dict[str, Tensor]:
        """All losses of a batch by name, and their weighted sum ``total`` (see :class:`usvnet.losses.Criterion`)."""
        if self.freeze_detector:
            return self._second_look(batch)
        output: NetworkOutput = self.model.network(batch.image)
        with torch.autocast(batch.image.device.type, enabled=False):
            output = NetworkOutput(*[tensor.float() for tensor in output])
            assignment = assign(output, batch.boats)
            coarse_px = best_keypoints(output, assignment)
            moments = window_moments(output.heatmap_logits, coarse_px)
            keypoints_px, covariance_px2 = keypoints_from_moments(moments, coarse_px)
            refinement = None
            if self.model.refiner is not None and batch.native is not None:
                # crops about the labels: a detector that has learnt little yet would show the refiner bare water
                boxes_px = jitter_boxes(batch.boats.boxes_px) if self.training else batch.boats.boxes_px
                refinement = self.model.refiner(
                    batch.native, boxes_px, keypoints_px, covariance_px2, batch.boats.present
                )
                keypoints_px, covariance_px2 = refinement.keypoints_px, refinement.covariance_px2
            slant_m, valid = self.ranges(keypoints_px, covariance_px2, batch.boats, batch.camera)
            if self.training:
                self.curriculum.update(self._mean_over_processes(keypoint_error(keypoints_px, batch.boats)))
            return self.criterion(
                output, batch.boats, assignment, moments, slant_m, valid, self.range_scale(), refinement
            )

    def _second_look(self, batch: Batch) -> dict[str, Tensor]:
        """The losses of the refinement alone."""
        boats = batch.boats
        boxes_px, keypoints_px = boats.boxes_px, boats.keypoints_px
        if self.training:
            keypoints_px = jitter_keypoints(confuse_ends(keypoints_px, boats.visibility), boxes_px)
            boxes_px = jitter_boxes(boxes_px)
        no_doubt = torch.zeros(*keypoints_px.shape, 2, device=keypoints_px.device)
        assert self.model.refiner is not None
        assert batch.native is not None
        with torch.autocast(batch.image.device.type, enabled=False):
            refined = self.model.refiner(batch.native, boxes_px, keypoints_px, no_doubt, boats.present)
            slant_m, valid = self.ranges(refined.keypoints_px, refined.covariance_px2, boats, batch.camera)
            if self.training:
                self.curriculum.update(self._mean_over_processes(keypoint_error(refined.keypoints_px, boats)))
            return self.criterion.second_look(boats, slant_m, valid, self.range_scale(), refined)

    def range_scale(self) -> Tensor:
        """How far laser ranges teach at present, 0 to 1."""
        return self.curriculum.scale() * float(self.current_epoch >= self.range_loss_start_epoch)

    def _mean_over_processes(self, error: Tensor) -> Tensor:
        """Mean of a scalar over the processes that train together, those that have none (NaN) left out."""
        if self._trainer is None or self.trainer.world_size == 1:
            return error
        total = torch.stack([error.nan_to_num(), (~error.isnan()).float()])
        torch.distributed.all_reduce(total)
        return total[0] / total[1]

    def ranges(
        self, keypoints_px: Tensor, covariance_px2: Tensor, boats: Boats, camera: Camera
    ) -> tuple[Tensor, Tensor]:
        """Range each labelled boat from its keypoints, to the point that its laser reading belongs to.

        Returns:
            (B, N) slant range in metres and (B, N) whether there is one.
        """
        estimate = self.model.ranging.range_points(keypoints_px.flatten(1, 2), covariance_px2.flatten(1, 2), camera)
        slant_m = estimate.slant_m.unflatten(1, keypoints_px.shape[1:3])
        nearest_m = slant_m[..., WATERLINE_KEYPOINTS].amin(-1)
        named_m = slant_m.gather(-1, boats.reference.clamp(min=0).unsqueeze(-1)).squeeze(-1)
        chosen_m = torch.where(boats.reference == NEAREST_WATERLINE, nearest_m, named_m)
        return chosen_m, chosen_m.isfinite()

    def validation_step(self, batch: Batch, batch_idx: int) -> dict[str, Prediction]:
        """Predict with the averaged weights and keep the boats for scoring."""
        prediction = self(batch.image, batch.camera, batch.hull, batch.native)
        pictures = zip(to_records(prediction), to_truths(batch.boats), strict=True)
        self._scored.update(zip(batch.frame_index.tolist(), pictures, strict=True))
        return {"prediction": prediction}

    def on_validation_epoch_end(self) -> None:
        """Score the whole validation set, the pictures of other processes included, each of them once."""
        pictures = [picture for _, picture in sorted(self._gather(self._scored).items())]
        self._scored = {}
        scalars = validation_scalars(score([boats for boats, _ in pictures], [truths for _, truths in pictures]))
        self.log_dict({f"val/{name}": value for name, value in scalars.items()})

    def _gather(self, pictures: dict[int, Any]) -> dict[int, Any]:
        """Merge by picture: where they do not divide evenly, the loaders of several processes repeat some."""
        if self.trainer.world_size == 1:
            return pictures
        parts: list[Any] = [None] * self.trainer.world_size
        torch.distributed.all_gather_object(parts, pictures)
        return {index: picture for part in parts for index, picture in part.items()}

    def configure_optimizers(self) -> OptimizerLRScheduler:
        """Build the optimiser and the learning rate's course over the whole run.

        Raises:
            ValueError: the run has no end.
        """
        batches = self.trainer.estimated_stepping_batches
        if math.isinf(batches):
            raise ValueError(
                f"trainer.max_epochs is {self.trainer.max_epochs} and trainer.max_steps {self.trainer.max_steps}, "
                "expected either above 0: the learning rate's course needs the run's end"
            )
        steps = int(batches)
        config = resolve_auto(self.optimiser, steps)
        optimiser: Optimizer = build_optimiser(self, config)
        warmup = warmup_steps(config, steps / max(self.trainer.max_epochs or 1, 1), steps)
        schedule = WarmupSchedule(optimiser, config, steps, warmup)
        return {"optimizer": optimiser, "lr_scheduler": {"scheduler": schedule, "interval": "step"}}

    def configure_callbacks(self) -> list[Callback]:
        """Average the weights, and warm up the norms: part of the method, so no configuration can forget it."""
        return [self.average, NormWarmup()]

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Write what :func:`usvnet.checkpoints.load_model` needs to build the network, and the curriculum's state."""
        image_size = getattr(getattr(self.trainer, "datamodule", None), "eval_image_size", None)  # as it is used
        checkpoint[STAMP] = {**self.stamp, "image_size": image_size}
        checkpoint["range_curriculum"] = float(self.curriculum.error)

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Refuse a checkpoint of another size or refinement; take up the curriculum."""
        path = self.trainer.ckpt_path or "checkpoint"
        check_variant(path, checkpoint, self.model.variant)
        if (found := checkpoint[STAMP].get("refine")) != self.stamp["refine"]:
            raise ValueError(f"{path}: got a run with model.refine {found}, expected {self.stamp['refine']}")
        self.curriculum.error = torch.tensor(checkpoint.get("range_curriculum", 1.0))


def validation_scalars(scores: Scores) -> dict[str, float]:
    """Pick what TensorBoard shows: pose at both OKS sigmas, keypoint errors and errors of the ``waterline`` range.

    ``fitness``, the mean of mAP50-95 at both sigmas, chooses the best checkpoint: the strict one alone is chance while
    it is near 0, and the other alone hardly sees a pixel.
    """
    waterline = scores.ranges.overall["waterline"]
    return {
        "precision": scores.pose.precision,
        "recall": scores.pose.recall,
        "mAP50": scores.pose.map50,
        "mAP50-95": scores.pose.map50_95,
        "strict_mAP50-95": scores.pose_strict.map50_95,
        "fitness": (scores.pose.map50_95 + scores.pose_strict.map50_95) / 2,
        "keypoint_median_px": scores.keypoints.overall.median_px,
        "range_rmse_m": waterline.rmse_m,
        "range_mae_m": waterline.mae_m,
        "missed": float(waterline.missed),
    }
