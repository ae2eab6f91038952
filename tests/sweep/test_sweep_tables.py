"""Tables from results that are known, and costs that are published."""

import pytest
import torch

from usvnet.sweep.cost import Cost, measure_costs
from usvnet.sweep.figure import draw_figure
from usvnet.sweep.plan import Run
from usvnet.sweep.progress import Result
from usvnet.sweep.tables import (
    cost_table,
    epoch_table,
    figures_table,
    group_by_seed,
    network_name,
    paper_row,
    pose_table,
)


def finished(tmp_path, variant, epochs, seed, score, rmse_m=0.5, **others):
    choices = {"model.variant": variant, "trainer.max_epochs": epochs, "seed_everything": seed, **others}
    configuration = choices | {"data.image_size": 64, "data.eval_image_size": None}
    pose = dict.fromkeys(("precision", "recall", "map50", "map50_95"), score)
    strict = dict.fromkeys(pose, score / 2)
    ranges = {"overall": {"waterline": {"rmse_m": rmse_m, "mae_m": 0.1, "missed": 3}}}
    metrics = {"pose": pose, "pose_strict": strict, "ranges": ranges}
    return Run("name", tmp_path, choices, configuration, ""), Result("", metrics, 90.0, "a machine", {})


def cells(table, row):
    return {column.title: cell for column, cell in zip(table.columns, table.rows[row], strict=True)}


def test_seeds_become_mean_and_standard_deviation(tmp_path):
    runs = [finished(tmp_path, "m", 100, seed, score) for seed, score in enumerate((0.1, 0.2, 0.6))]
    table = pose_table(group_by_seed([*runs, finished(tmp_path, "v8s-p6", 100, 0, 0.4)]))
    at_the_papers_sigma, strict, other, _ = (cells(table, row) for row in range(4))
    assert at_the_papers_sigma["Network"] == "YOLO11m"
    assert at_the_papers_sigma["seeds"] == 3
    assert at_the_papers_sigma["mAP50-95"] == "0.300 ± 0.265"  # sample deviation of 0.1, 0.2, 0.6
    assert strict["mAP50-95"] == "0.150 ± 0.132"
    assert (at_the_papers_sigma["paper mAP50-95"], strict["paper mAP50-95"]) == (0.757, None)
    assert (other["Network"], other["mAP50-95"], other["paper Recall"]) == ("YOLOv8s-P6", 0.4, 0.767)
    numbers = cells(figures_table(group_by_seed(runs)), 0)
    assert numbers["mAP50-95 1/7 std"] == pytest.approx(0.264575, abs=1e-6)


@pytest.mark.parametrize(
    ("variant", "name", "paper"),
    [("n", "YOLO11n", 0.206), ("x", "YOLO11x", 0.670), ("v8l", "YOLOv8l", 0.276), ("v8x-p6", "YOLOv8x-P6", 0.518)],
)
def test_every_network_has_its_row_of_the_paper(variant, name, paper):
    assert network_name(variant) == name
    assert paper_row(variant).map50_95 == paper


def test_epochs_stand_side_by_side_above_the_papers(tmp_path):
    runs = [finished(tmp_path, "m", epochs, 0, epochs / 1000) for epochs in (100, 50)]
    table = epoch_table(group_by_seed([*runs, finished(tmp_path, "n", 50, 0, 0.3)]))
    assert [column.title for column in table.columns][2:] == ["50 epochs", "100 epochs"]
    assert [list(row) for row in table.rows] == [
        ["YOLO11m", "1/7", 0.05, 0.1],
        ["YOLO11m", "0.025", 0.025, 0.05],
        ["paper: YOLO11m-pose", "1/7", 0.524, 0.757],
        ["YOLO11n", "1/7", 0.3, None],
        ["YOLO11n", "0.025", 0.15, None],
    ]


def test_a_loss_that_varies_is_told(tmp_path):
    runs = [finished(tmp_path, "n", 5, 0, w / 10, **{"model.loss_weights.range": w}) for w in (0, 1)]
    assert [cells(pose_table(group_by_seed(runs)), row)["setting"] for row in (0, 2)] == ["range-0", "range-1"]


def test_a_network_that_ranged_nothing_has_no_error_and_is_drawn_without_one(tmp_path):
    groups = group_by_seed([finished(tmp_path, "n", 5, 0, 0.1, rmse_m=None), finished(tmp_path, "s", 5, 0, 0.2)])
    costs = {(variant, 64): Cost(2_000_000, 1_900_000, 0.1, 5.0, "a machine") for variant in ("n", "s")}
    table = cost_table(groups, costs)
    assert cells(table, 0)["waterline RMSE m"] is None
    assert cells(table, 1)["waterline RMSE m"] == 0.5
    assert cells(table, 0)["missed"] == 3
    assert "a machine" in table.note
    draw_figure(groups, costs, tmp_path / "figure.png")
    assert (tmp_path / "figure.png").stat().st_size > 10_000


def test_costs_are_the_published_ones_and_measured_once(tmp_path):
    """2,688,252 parameters and 6.85 GFLOPs at 640 px: the published pose network with 7 keypoints, without heatmaps."""
    path = tmp_path / "costs.json"
    cost = measure_costs([("n", 64), ("n", 64)], path)["n", 64]
    assert cost.parameters_without_heatmaps == 2_688_252
    assert 0 < cost.parameters - cost.parameters_without_heatmaps < 100_000
    assert 6.85 < cost.gflops * 100 < 8.5  # 640 px are 100 times the pixels; the heatmap head comes on top
    assert cost.ms > 0
    assert str(torch.get_num_threads()) in cost.device
    assert measure_costs([("n", 64)], path)["n", 64] == cost
