"""What a person may set: dataclasses that check themselves, filled from YAML or the command line."""

import math
from dataclasses import dataclass, fields
from typing import Literal


@dataclass(frozen=True)
class LossWeights:
    """What each loss counts in the total (see :mod:`usvnet.losses`); 0 switches it off.

    Attributes:
        box: 1 - CIoU of the box; as in Table 1 of the paper.
        dfl: distribution focal loss of the box's sides.
        classification: binary cross entropy of the score; as in Table 1 of the paper.
        keypoint: similarity of the coarse keypoints; as in Table 1 of the paper.
        visibility: binary cross entropy of "is seen".
        heatmap: divergence of the heatmaps; at 4, half a pixel costs about as much here as in the coarse keypoints.
            Counts for the refined heatmaps too.
        range: relative error of the slant range.
        covariance: likelihood of the labels under the keypoints' covariance; starts together with the range. Counts for
            the refined keypoints too.
    """

    box: float = 7.5
    dfl: float = 1.5
    classification: float = 0.5
    keypoint: float = 12.0
    visibility: float = 1.0
    heatmap: float = 4.0
    range: float = 1.0
    covariance: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"loss_weights.{field.name}: got {value}, expected a finite number of at least 0")


@dataclass(frozen=True)
class OptimiserConfig:
    """How the weights move (see :mod:`usvnet.optimiser`).

    Attributes:
        name: "auto" (the paper's tool chooses by the length of the run), "SGD" or "AdamW".
        learning_rate: after warm-up; "auto" chooses its own.
        momentum: of SGD, or the first beta of AdamW; "auto" chooses its own.
        weight_decay: of convolution and linear weights; biases and norm scales never decay.
        warmup_epochs: epochs during which the learning rate rises from 0 (0: no warm-up).
        warmup_momentum: SGD's momentum at the start of the warm-up.
        schedule: how the learning rate falls, "linear" or "cosine".
        final_fraction: learning rate at the last step, as a fraction of ``learning_rate``.
    """

    name: Literal["auto", "SGD", "AdamW"] = "auto"
    learning_rate: float = 0.01
    momentum: float = 0.937
    weight_decay: float = 0.0005
    warmup_epochs: float = 3.0
    warmup_momentum: float = 0.8
    schedule: Literal["linear", "cosine"] = "linear"
    final_fraction: float = 0.01

    def __post_init__(self) -> None:
        if self.learning_rate <= 0:
            raise ValueError(f"optimiser.learning_rate: got {self.learning_rate}, expected a number above 0")
        if self.weight_decay < 0 or self.warmup_epochs < 0:
            raise ValueError("optimiser: weight_decay and warmup_epochs must not be negative")
        for key in ("momentum", "warmup_momentum", "final_fraction"):
            if not 0 <= getattr(self, key) <= 1:
                raise ValueError(f"optimiser.{key}: got {getattr(self, key)}, expected a number in [0, 1]")
