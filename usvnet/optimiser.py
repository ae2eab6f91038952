"""Which optimiser, and which learning rate at which step."""

import math
from dataclasses import replace
from typing import Any

from torch import Tensor, nn
from torch.optim import SGD, AdamW, Optimizer
from torch.optim.lr_scheduler import LRScheduler

from usvnet.config import OptimiserConfig

AUTO_LONG_RUN_STEPS = 10_000
MIN_WARMUP_STEPS = 100


def resolve_auto(config: OptimiserConfig, steps: int, num_classes: int = 1) -> OptimiserConfig:
    """Put an optimiser in the place of ``"auto"``; any other configuration comes back as it is.

    The rule is the one that the paper's tool documents: a long run (more than 10 000 steps) gets SGD at a learning rate
    of 0.01, a shorter one AdamW at 0.002 * 5 / (4 + classes), both with momentum 0.9. A learning rate or a momentum
    that the configuration states beside ``"auto"`` is not used.

    Args:
        config: the configuration.
        steps: optimiser steps of the whole run.
        num_classes: number of classes.
    """
    if config.name != "auto":
        return config
    if steps > AUTO_LONG_RUN_STEPS:
        return replace(config, name="SGD", learning_rate=0.01, momentum=0.9)
    return replace(config, name="AdamW", learning_rate=round(0.002 * 5 / (4 + num_classes), 6), momentum=0.9)


def parameter_groups(model: nn.Module, weight_decay: float) -> list[dict[str, Any]]:
    """Split the trainable parameters in two: weights that decay, and biases and norm scales that do not.

    A weight is told by its shape: convolutions and linear maps have two or more dimensions, all others one.
    """
    parameters = [parameter for parameter in model.parameters() if parameter.requires_grad]
    return [
        {"params": [p for p in parameters if p.ndim >= 2], "weight_decay": weight_decay},
        {"params": [p for p in parameters if p.ndim < 2], "weight_decay": 0.0},
    ]


def build_optimiser(model: nn.Module, config: OptimiserConfig) -> Optimizer:
    """Build SGD with Nesterov momentum, or AdamW with ``momentum`` as its first beta.

    Raises:
        ValueError: if the name is still ``"auto"`` (see :func:`resolve_auto`).
    """
    groups = parameter_groups(model, config.weight_decay)
    on_cpu = groups[0]["params"][0].device.type == "cpu"
    fused = True if on_cpu else None  # on a CPU the default walks the parameters one by one: 12 times slower
    optimiser: Optimizer
    if config.name == "SGD":
        optimiser = SGD(groups, lr=config.learning_rate, momentum=config.momentum, nesterov=True, fused=fused)
    elif config.name == "AdamW":
        optimiser = AdamW(groups, lr=config.learning_rate, betas=(config.momentum, 0.999), fused=fused)
    else:
        raise ValueError(f"optimiser.name: got {config.name!r}, expected SGD or AdamW")
    # A fused optimiser can undo the scaling of mixed precision itself, and Lightning then refuses to clip gradients.
    # Without this the scaling is undone before, as for any other optimiser.
    optimiser._step_supports_amp_scaling = False
    return optimiser


def warmup_steps(config: OptimiserConfig, steps_per_epoch: float, steps: int) -> int:
    """``warmup_epochs`` in steps: at least 100, but never more than a quarter of the run; 0 switches warm-up off."""
    if config.warmup_epochs <= 0:
        return 0
    return min(max(round(config.warmup_epochs * steps_per_epoch), MIN_WARMUP_STEPS), steps // 4)


class WarmupSchedule(LRScheduler):
    """Learning rate by step: a straight rise over ``warmup`` steps times a fall to ``final_fraction`` at ``steps``.

    The fall is a straight line or half a cosine. SGD's momentum rises beside the learning rate.

    Args:
        optimiser: SGD or AdamW as :func:`build_optimiser` makes them.
        config: the resolved configuration.
        steps: optimiser steps of the whole run.
        warmup: steps of warm-up, 0 for none.
    """

    def __init__(self, optimiser: Optimizer, config: OptimiserConfig, steps: int, warmup: int) -> None:
        self.config = config
        self.steps = max(steps, 1)
        self.warmup = warmup
        super().__init__(optimiser)

    def factor(self, step: int) -> float:
        """Learning rate at ``step`` as a fraction of the configured one."""
        progress = min(step / self.steps, 1.0)
        fall = progress if self.config.schedule == "linear" else (1 - math.cos(math.pi * progress)) / 2
        rise = min((step + 1) / (self.warmup + 1), 1.0)
        return rise * (1 - fall * (1 - self.config.final_fraction))

    def get_lr(self) -> list[float | Tensor]:
        """Learning rate of each parameter group at the present step."""
        return [base * self.factor(self.last_epoch) for base in self.base_lrs]

    def step(self, epoch: int | None = None) -> None:
        """Move to the next step."""
        super().step(epoch)
        rise = min((self.last_epoch + 1) / (self.warmup + 1), 1.0)
        momentum = self.config.warmup_momentum + rise * (self.config.momentum - self.config.warmup_momentum)
        for group in self.optimizer.param_groups:
            if "momentum" in group:
                group["momentum"] = momentum

    def state_dict(self) -> dict[str, Any]:
        """Return the position only: everything else follows from the configuration."""
        return {"last_epoch": self.last_epoch, "_step_count": self._step_count, "_last_lr": self._last_lr}
