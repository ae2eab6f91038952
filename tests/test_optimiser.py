"""The optimiser rule, the learning rate's course and the weight-decay groups."""

import pytest
import torch
from torch import nn

from usvnet.config import OptimiserConfig
from usvnet.optimiser import WarmupSchedule, build_optimiser, parameter_groups, resolve_auto, warmup_steps


@pytest.mark.parametrize(
    ("steps", "classes", "name", "learning_rate"),
    [
        (10_000, 1, "AdamW", 0.002),
        (10_001, 1, "SGD", 0.01),
        (8_900, 80, "AdamW", 0.000119),  # 100 epochs of 712 pictures in batches of 8; 0.01 / 84 rounded to 6 places
    ],
)
def test_auto_chooses_by_the_length_of_the_run(steps, classes, name, learning_rate):
    config = resolve_auto(OptimiserConfig(name="auto", learning_rate=0.5, momentum=0.5), steps, classes)
    assert (config.name, config.learning_rate, config.momentum) == (name, learning_rate, 0.9)


def test_a_named_optimiser_is_left_alone():
    config = OptimiserConfig(name="SGD", learning_rate=0.03)
    assert resolve_auto(config, 50) is config


def test_only_weights_of_convolutions_and_linear_maps_decay():
    model = nn.Sequential(nn.Conv2d(3, 4, 3), nn.BatchNorm2d(4), nn.Linear(4, 2))
    decaying, others = parameter_groups(model, 0.0005)
    assert decaying["weight_decay"] == 0.0005
    assert others["weight_decay"] == 0.0
    assert {id(p) for p in decaying["params"]} == {id(model[0].weight), id(model[2].weight)}
    assert {id(p) for p in others["params"]} == {
        id(p) for p in (model[0].bias, model[1].weight, model[1].bias, model[2].bias)
    }


def test_frozen_parameters_are_left_out():
    model = nn.Linear(2, 2)
    model.bias.requires_grad_(False)
    assert [len(group["params"]) for group in parameter_groups(model, 0.1)] == [1, 0]


@pytest.mark.parametrize(
    ("epochs", "steps_per_epoch", "steps", "expected"),
    [(3, 89, 8900, 267), (3, 8, 4000, 100), (3, 8, 80, 20), (0, 89, 8900, 0)],
)
def test_warmup_takes_its_epochs_but_at_least_100_steps_and_at_most_a_quarter(epochs, steps_per_epoch, steps, expected):
    assert warmup_steps(OptimiserConfig(warmup_epochs=epochs), steps_per_epoch, steps) == expected


def rates(config: OptimiserConfig, steps: int, warmup: int) -> tuple[list[float], list[float]]:
    """Learning rate and momentum that each step is taken with, and after the last one."""
    optimiser = build_optimiser(nn.Linear(1, 1), config)
    schedule = WarmupSchedule(optimiser, config, steps, warmup)
    rates, momenta = [], []
    for _ in range(steps + 1):
        rates.append(optimiser.param_groups[0]["lr"])
        momenta.append(optimiser.param_groups[0].get("momentum", 0.0))
        optimiser.step()
        schedule.step()
    return rates, momenta


def test_linear_schedule_by_hand():
    config = OptimiserConfig(name="SGD", learning_rate=0.1, momentum=0.9, warmup_momentum=0.5, final_fraction=0.2)
    learning_rates, momenta = rates(config, steps=8, warmup=3)
    # the fall alone is 1 - 0.8 step / 8; the rise alone is 1/4, 2/4, 3/4, 1
    assert learning_rates == pytest.approx([0.025, 0.045, 0.06, 0.07, 0.06, 0.05, 0.04, 0.03, 0.02])
    assert momenta == pytest.approx([0.6, 0.7, 0.8, 0.9, 0.9, 0.9, 0.9, 0.9, 0.9])


def test_cosine_schedule_by_hand():
    config = OptimiserConfig(name="AdamW", learning_rate=1.0, schedule="cosine", final_fraction=0.0)
    learning_rates, _ = rates(config, steps=4, warmup=0)
    assert learning_rates == pytest.approx([1.0, (1 + 0.5**0.5) / 2, 0.5, (1 - 0.5**0.5) / 2, 0.0], abs=1e-12)


def test_a_schedule_goes_on_from_its_state():
    config = OptimiserConfig(name="AdamW", learning_rate=1.0)
    optimiser = build_optimiser(nn.Linear(1, 1), config)
    first = WarmupSchedule(optimiser, config, 100, 10)
    for _ in range(30):
        optimiser.step()
        first.step()
    second = WarmupSchedule(build_optimiser(nn.Linear(1, 1), config), config, 100, 10)
    second.load_state_dict(first.state_dict())
    second.optimizer.step()
    second.step()
    optimiser.step()
    first.step()
    assert second.get_last_lr() == first.get_last_lr()
    torch.testing.assert_close(second.optimizer.param_groups[0]["lr"], optimiser.param_groups[0]["lr"])


@pytest.mark.parametrize(
    ("setting", "key"),
    [
        ({"learning_rate": 0.0}, "learning_rate"),
        ({"momentum": 1.5}, "momentum"),
        ({"weight_decay": -1.0}, "weight_decay"),
    ],
)
def test_impossible_settings_are_named(setting, key):
    with pytest.raises(ValueError, match=key):
        OptimiserConfig(**setting)
