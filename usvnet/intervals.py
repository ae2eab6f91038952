"""How sure a range is, made true: the rule by which a standard deviation becomes an interval, and its calibration.

The geometry's standard deviation is first order and counts only what camera and heatmaps say. On laser-ranged boats
that were not trained on, :mod:`usvnet.evaluation.conformal` finds by how much it is wrong; the factors travel in the
checkpoint and :class:`usvnet.model.USVNet` applies them. The rule, with the raw standard deviation s of an estimator:

- ``slant_std_m`` = ``factor_90`` s: the 90 % interval is slant +- Z_90 ``slant_std_m``, as of a Gaussian.
- The 68 % interval is slant +- Z_68 ``factor_68`` s: errors need not be Gaussian.
- s itself is ``slant_std_m / factor_90``. Without calibration both factors are 1.
"""

from collections.abc import Mapping
from typing import NamedTuple, get_type_hints

import torch
from torch import Tensor, nn

from usvnet.types import Prediction, RangeEstimate

ESTIMATORS = tuple(name for name, hint in get_type_hints(Prediction).items() if hint is RangeEstimate)
"""The range estimators in the order of :class:`usvnet.types.Prediction`; a new one there is scored by itself."""
Z_68, Z_90 = 0.994457883, 1.644853627
"""Half-widths of the central 68 % and 90 % of a Gaussian, in standard deviations."""


class IntervalFactors(NamedTuple):
    """What the standard deviation of one estimator is multiplied by."""

    factor_68: float = 1.0
    factor_90: float = 1.0
    boats: int = 0
    """Laser-ranged boats that the factors were found on; 0 where they were not."""


UNCALIBRATED = IntervalFactors()


class IntervalScale(nn.Module):
    """Applies ``factor_90`` to standard deviations; no weights, and nothing in the ``state_dict``."""

    def __init__(self) -> None:
        super().__init__()
        self.factor_68: Tensor
        self.factor_90: Tensor
        self.boats: Tensor
        self.register_buffer("factor_68", torch.ones(len(ESTIMATORS)), persistent=False)
        self.register_buffer("factor_90", torch.ones(len(ESTIMATORS)), persistent=False)
        self.register_buffer("boats", torch.zeros(len(ESTIMATORS), dtype=torch.int64), persistent=False)

    def forward(self, estimate: RangeEstimate, estimator: int) -> RangeEstimate:
        """Calibrate what the estimator of that place in ``ESTIMATORS`` says, any shape (...)."""
        return RangeEstimate(
            slant_m=estimate.slant_m,
            slant_std_m=estimate.slant_std_m * self.factor_90[estimator].to(estimate.slant_std_m.dtype),
            horizontal_m=estimate.horizontal_m,
            bearing_rad=estimate.bearing_rad,
            position_m=estimate.position_m,
            valid=estimate.valid,
            reason=estimate.reason,
        )

    @torch.jit.unused
    def set_factors(self, factors: Mapping[str, IntervalFactors]) -> None:
        """Use these factors; an estimator that is not among them keeps its raw standard deviation.

        Raises:
            ValueError: an unknown estimator, or a factor that is not a number above 0.
        """
        for name, found in factors.items():
            if name not in ESTIMATORS:
                raise ValueError(f"interval factors: unknown estimator {name!r}, expected {', '.join(ESTIMATORS)}")
            if not all(0 < factor < float("inf") for factor in found[:2]):
                raise ValueError(f"interval factors: {name}: expected numbers above 0, got {found[0]} and {found[1]}")
        for n, name in enumerate(ESTIMATORS):
            self.factor_68[n], self.factor_90[n], self.boats[n] = factors.get(name, UNCALIBRATED)

    @torch.jit.unused
    def factors(self) -> dict[str, IntervalFactors]:
        """The factors by estimator."""
        columns = (self.factor_68.tolist(), self.factor_90.tolist(), self.boats.tolist())
        return {name: IntervalFactors(*row) for name, row in zip(ESTIMATORS, zip(*columns))}
