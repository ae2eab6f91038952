"""What an error costs in range: to first order beside Monte Carlo through the real geometry.

Two questions. The error budget: how much of the range does each thing that is not known exactly cost, at which
distance? And the paper's Table 5: which RMSE and MAE does a set of boats have when something is wrong by so much?
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import torch
from rich.console import Console
from rich.progress import track
from torch import Tensor

from usvnet.evaluation.disturbances import (
    DISTURBANCES,
    disturb,
    drawn_amount,
    first_order_m,
    first_order_std_m,
    fixed_amount,
    known_stds,
    slopes,
)
from usvnet.evaluation.reranging import Cases, slants_m
from usvnet.evaluation.scenario_boats import scenario_cases
from usvnet.evaluation.sensitivity_settings import SensitivitySettings
from usvnet.geometry.ranging import RangingLayer
from usvnet.types import Camera, Hull

Item = TypeVar("Item")
ALL = "all"
CENTRAL_68 = (0.1586553, 0.8413447)
"""Quantiles one standard deviation below and above the mean of a Gaussian."""


@dataclass(frozen=True)
class Cost:
    """What one error of one amount does to one estimator at one distance, as a share of the range."""

    distance_m: float
    estimator: str
    source: str
    """A key of :data:`usvnet.evaluation.disturbances.DISTURBANCES`, or ``all``."""
    amount: float
    """In the unit of the source's name; nan for ``all``."""
    first_order: float
    """Of a constant error the signed change of range, of a random one its standard deviation."""
    exact: float
    """The same through the real geometry; of a random error half the width of the central 68.3 %, which is finite
    where the standard deviation is not: some draws see the boat above the horizon."""
    no_range: float
    """Share of the draws without a range."""


@dataclass(frozen=True)
class SetErrors:
    """RMSE and MAE of one estimator on a set of boats, with something wrong: a row of the paper's Table 5."""

    source: str
    amount: float
    estimator: str
    n: int
    missed: int
    """Boats that have no range any more."""
    first_order_rmse_m: float
    first_order_mae_m: float
    rmse_m: float
    mae_m: float


class Study:
    """A camera, a boat, distances and headings, ready to be disturbed.

    Args:
        settings: what was asked.
        camera: a batch of 1.
        hull: a batch of 1.

    Raises:
        ValueError: a distance at which there is nothing to see.
    """

    def __init__(self, settings: SensitivitySettings, camera: Camera, hull: Hull) -> None:
        self.settings = settings
        self.stds = known_stds(camera, settings.keypoint_std_px)
        self.ranging = RangingLayer(settings.curved_water)
        self.cases = scenario_cases(
            camera,
            hull,
            settings.distances_m,
            settings.headings_deg,
            settings.bearing_deg,
            settings.keypoint_std_px,
            settings.curved_water,
        )
        self.undisturbed_m = slants_m(self.cases, self.ranging)
        self.generator = torch.Generator().manual_seed(settings.seed)

    def budget(self) -> list[Cost]:
        """What each thing that is not known exactly costs, and all of them together.

        Raises:
            ValueError: everything is known exactly.
        """
        known = {name: std for name, std in self.stds.items() if std > 0}
        if not known:
            raise ValueError("keypoint_std_px and all standard deviations of the camera are 0: no error to budget")
        costs = []
        for name, std in _watched(known.items(), "Error budget"):
            costs += self._random(name, std, {name: std})
        return costs + self._random(ALL, math.nan, known)

    def curves(self) -> list[Cost]:
        """What each amount of each disturbance costs by distance, everything else being right."""
        costs = []
        for name, amounts in _watched(self.settings.disturbances.items(), "By distance"):
            for amount in amounts:
                if DISTURBANCES[name].noise:
                    costs += self._random(name, amount, {name: amount})
                else:
                    costs += self._fixed(name, amount)
        return costs

    def table(self) -> list[SetErrors]:
        """RMSE and MAE over all distances, the things that are not known exactly being drawn."""
        cases = self.cases.repeat(self.settings.draws)
        for name, std in self.stds.items():
            cases = disturb(cases, name, drawn_amount(name, std, cases.count, self.generator))
        truth_m = {name: slant.repeat(self.settings.draws) for name, slant in self.undisturbed_m.items()}
        return set_errors(cases, truth_m, self.settings.disturbances, self.ranging, self.generator)

    def _fixed(self, name: str, amount: float) -> list[Cost]:
        error = fixed_amount(name, amount, self.cases.count)
        found = slants_m(disturb(self.cases, name, error), self.ranging)
        slope = slopes(self.cases, name, self.ranging)
        costs = []
        for estimator, undisturbed in self.undisturbed_m.items():
            first = self._by_distance(first_order_m(slope[estimator], error) / undisturbed)
            exact = self._by_distance(found[estimator] / undisturbed - 1)
            for distance, linear, real in zip(self.settings.distances_m, first, exact):
                seen = real.isfinite()
                costs.append(
                    Cost(
                        distance, estimator, name, amount, float(linear.mean()),
                        float(real.mean()) if bool(seen.all()) else math.inf, 1 - float(seen.double().mean()),
                    )
                )  # fmt: skip
        return costs

    def _random(self, source: str, amount: float, stds: Mapping[str, float]) -> list[Cost]:
        """What random errors of the standard deviations ``stds`` cost together."""
        cases = self.cases.repeat(self.settings.draws)
        for name, std in stds.items():
            cases = disturb(cases, name, drawn_amount(name, std, cases.count, self.generator))
        found = slants_m(cases, self.ranging)
        slope = {name: slopes(self.cases, name, self.ranging) for name in stds}
        costs = []
        for estimator, undisturbed in self.undisturbed_m.items():
            parts = [first_order_std_m(slope[name][estimator], std) for name, std in stds.items()]
            first = self._by_distance(torch.stack(parts).square().sum(0).sqrt() / undisturbed)
            share = found[estimator].reshape(self.settings.draws, -1) / undisturbed - 1
            for distance, linear, errors in zip(self.settings.distances_m, first, self._by_distance(share)):
                rms = float(linear.square().mean().sqrt())
                no_range = 1 - float(errors.isfinite().double().mean())
                costs.append(Cost(distance, estimator, source, amount, rms, _half_width_68(errors), no_range))
        return costs

    def _by_distance(self, values: Tensor) -> Sequence[Tensor]:
        """Values (..., C) of all boats, as one tensor for each distance."""
        return values.unflatten(-1, (len(self.settings.distances_m), -1)).unbind(-2)


def set_errors(
    cases: Cases,
    truth_m: Mapping[str, Tensor],
    disturbances: Mapping[str, Sequence[float]],
    ranging: RangingLayer,
    generator: torch.Generator,
    draws: int = 1,
) -> list[SetErrors]:
    """Errors of a set of boats for every amount of every disturbance, to first order and exactly.

    Args:
        cases: C boats, as found.
        truth_m: their true slant ranges (C,) by estimator.
        disturbances: amounts by kind.
        ranging: the geometry.
        generator: of the kinds that are noise.
        draws: how often each boat is disturbed by each of those.
    """
    single = cases
    rows = []
    for name, amounts in _watched(disturbances.items(), "Over all boats"):
        times = draws if DISTURBANCES[name].noise else 1
        cases = single.repeat(times)
        found_m = slants_m(cases, ranging)
        slope = slopes(cases, name, ranging)
        for amount in amounts:
            error = (
                drawn_amount(name, amount, cases.count, generator)
                if DISTURBANCES[name].noise
                else fixed_amount(name, amount, cases.count)
            )
            exact_m = slants_m(disturb(cases, name, error), ranging)
            for estimator, truth in truth_m.items():
                truth = truth.repeat(times)
                first_m = found_m[estimator] + first_order_m(slope[estimator], error)
                rows.append(
                    SetErrors(
                        name, amount, estimator, *_seen(exact_m[estimator]),
                        *_rmse_mae(first_m - truth), *_rmse_mae(exact_m[estimator] - truth),
                    )
                )  # fmt: skip
    return rows


def costs_at(costs: Sequence[Cost], distance_m: float, estimator: str) -> Iterator[Cost]:
    """The costs of one estimator at one distance."""
    return (cost for cost in costs if cost.distance_m == distance_m and cost.estimator == estimator)


def _watched(items: Collection[Item], what: str) -> Iterable[Item]:
    """Go through ``items`` with a progress bar on stderr."""
    return track(items, what, console=Console(stderr=True), transient=True)


def _half_width_68(errors: Tensor) -> float:
    """Half the width of the central 68.3 %; errors without a range count as too far away, however far."""
    ordered = errors.flatten().sort().values
    low, high = (float(ordered[min(int(share * len(ordered)), len(ordered) - 1)]) for share in CENTRAL_68)
    return (high - low) / 2


def _seen(slant_m: Tensor) -> tuple[int, int]:
    seen = int(slant_m.isfinite().sum())
    return seen, len(slant_m) - seen


def _rmse_mae(error_m: Tensor) -> tuple[float, float]:
    error_m = error_m[error_m.isfinite()]
    if not len(error_m):
        return math.nan, math.nan
    return float(error_m.square().mean().sqrt()), float(error_m.abs().mean())
