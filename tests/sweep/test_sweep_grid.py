import pytest
import yaml

from usvnet.sweep.grid import load_sweep


@pytest.fixture
def load(tmp_path):
    (tmp_path / "x.yaml").write_text("{}")

    def load(**content):
        path = tmp_path / "sweep.yaml"
        path.write_text(yaml.safe_dump({"experiment": "x.yaml"} | content, sort_keys=False))
        return load_sweep(path)

    return load


def test_runs_are_all_choices_and_named_by_them(load):
    runs = load(
        grid={
            "model.variant": ["n", "v8m-p6"],
            "trainer.max_epochs": [50],
            "seed_everything": [0, 1],
            "model.loss_weights.range": [0.0, 3],
        }
    ).runs()
    assert list(runs)[:3] == [
        "n_50-epochs_range-0.0_seed-0",
        "n_50-epochs_range-3_seed-0",
        "n_50-epochs_range-0.0_seed-1",
    ]
    assert len(runs) == 8
    assert runs["v8m-p6_50-epochs_range-3_seed-1"] == {
        "model.variant": "v8m-p6",
        "trainer.max_epochs": 50,
        "seed_everything": 1,
        "model.loss_weights.range": 3,
    }


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"grid": {"model.variant": "n"}}, r"sweep.yaml: grid: model.variant: expected a list of values, got 'n'"),
        ({"grid": {"model.variant": []}}, "expected a list"),
        ({"grid": {}, "settngs": {}}, "unknown key 'settngs'"),
        ({}, "grid is missing"),
        ({"grid": {}, "experiment": "y.yaml"}, r"y\.yaml: no such file"),
        ({"grid": {"run_dir": ["a"]}}, "grid: run_dir is decided by the sweep"),
        ({"grid": {}, "settings": {"resume": True}}, "settings: resume is decided by the sweep"),
        ({"grid": {"a": [1]}, "settings": {"a": 2}}, "a stands under settings and under grid"),
    ],
)
def test_a_faulty_sweep_is_named(load, content, message):
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        load(**content)


def test_the_order_of_the_keys_changes_no_name(load):
    first = load(grid={"seed_everything": [0, 1], "model.variant": ["n"]}).runs()
    second = load(grid={"model.variant": ["n"], "seed_everything": [0, 1]}).runs()
    assert first == second
    assert list(first) == ["n_seed-0", "n_seed-1"]


def test_two_runs_never_share_a_folder(load):
    with pytest.raises(ValueError, match="two runs would be called seed-1"):
        load(grid={"seed_everything": [1, 1]}).runs()
