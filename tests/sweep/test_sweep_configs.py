"""The sweeps of the repository plan what they say."""

from pathlib import Path

import pytest

from usvnet.evaluation.paper_tables import TABLE_2, TABLE_4
from usvnet.sweep.grid import load_sweep
from usvnet.sweep.plan import Run, plan_runs
from usvnet.sweep.tables import paper_row


@pytest.fixture
def plan(root, monkeypatch):
    monkeypatch.chdir(root)

    def plan(name: str) -> list[Run]:
        return plan_runs(load_sweep(root / "configs" / "sweep" / f"{name}.yaml"), Path("out"))

    return plan


@pytest.mark.parametrize("name", ["variants", "quick"])
def test_the_papers_seven_networks(plan, name):
    runs = plan(name)
    assert [paper_row(run.variant).model for run in runs] == [row.model for row in TABLE_2[:4]] + [
        f"YOLO11{size}-pose" for size in "mlx"
    ]
    assert all(run.eval_size_px % 64 == run.configuration["data.image_size"] % 64 == 0 for run in runs)


def test_variants_follow_the_papers_protocol(plan):
    for run in plan("variants"):
        assert (run.epochs, run.eval_size_px) == (100, 640)
        assert run.configuration["data.batch_size"] == 8
        assert run.configuration["model.loss_weights.range"] == 0


def test_epochs_are_the_papers(plan):
    runs = plan("epochs")
    assert [run.epochs for run in runs] == list(TABLE_4)
    assert {run.variant for run in runs} == {"m"}


def test_another_dataset_takes_the_place_of_the_experiments(root, monkeypatch):
    monkeypatch.chdir(root)
    sweep = load_sweep(root / "configs" / "sweep" / "quick.yaml")
    assert {run.configuration["data.root"] for run in plan_runs(sweep, Path("out"), "elsewhere")} == {"elsewhere"}
