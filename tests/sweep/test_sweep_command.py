"""The command over runs that do not train: what is skipped, refused, reported and written."""

import csv
import json
import multiprocessing
import shutil

import pytest
import yaml

from usvnet.commands.sweep import sweep
from usvnet.files import alone_in
from usvnet.sweep import local
from usvnet.sweep.board import Board

GRID = {"model.variant": ["n"], "trainer.max_epochs": [2, 50], "seed_everything": [0, 1]}
TABLES = ("table_2.csv", "table_4.csv", "runs.csv")


@pytest.fixture(autouse=True, scope="module")
def fake_runs(root):
    """Runs that take milliseconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(local, "POLL_S", 0.01)
        patch.setattr(local, "COMMAND", (str(root / "tests" / "sweep" / "fake_run.py"),))
        yield


def starts(out) -> dict[str, int]:
    return {path.parent.name: len(path.read_text().splitlines()) for path in sorted(out.glob("*/starts.txt"))}


def tables(out) -> dict[str, str]:
    return {name: (out / name).read_text() for name in TABLES}


@pytest.fixture(scope="module")
def straight(fake_runs, root, tmp_path_factory):
    """The tables of a sweep that nothing has stopped."""
    folder = tmp_path_factory.mktemp("straight")
    sweep(config=write(root, folder), out=str(folder / "out"), parallel=4)
    return folder / "out"


def write(root, folder):
    path = folder / "tiny.yaml"
    small = {"data.root": str(root / "data" / "sample"), "data.image_size": 64, "data.eval_image_size": 64}
    experiment = str(root / "configs" / "experiment" / "quickstart.yaml")
    path.write_text(yaml.safe_dump({"experiment": experiment, "settings": small, "grid": GRID}, sort_keys=False))
    return path


def test_every_run_is_trained_once_and_compared(straight):
    assert set(starts(straight).values()) == {1}
    assert list(starts(straight)) == [f"n_{epochs}-epochs_seed-{seed}" for epochs in (2, 50) for seed in (0, 1)]
    rows = list(csv.DictReader((straight / "table_2.csv").open()))
    assert [(row["variant"], row["epochs"], row["seeds"]) for row in rows] == [("n", "2", "2"), ("n", "50", "2")]
    runs = list(csv.DictReader((straight / "runs.csv").open()))
    scores = [float(row["mAP50-95 1/7"]) for row in runs if row["epochs"] == "2"]
    assert float(rows[0]["mAP50-95 1/7"]) == pytest.approx(sum(scores) / 2, rel=1e-5)
    assert float(rows[0]["mAP50-95 1/7 std"]) == pytest.approx(abs(scores[0] - scores[1]) / 2**0.5, rel=1e-4)
    report = (straight / "report.md").read_text()
    for text in ("| YOLO11n |", "Table 4", " ± ", "(accuracy_and_cost.png)", "0.545"):
        assert text in report
    assert (straight / "accuracy_and_cost.png").read_bytes().startswith(b"\x89PNG")


def test_finished_runs_are_skipped_and_the_tables_stay(straight, root, tmp_path):
    out = tmp_path / "out"
    shutil.copytree(straight, out)
    sweep(config=write(root, tmp_path), out=str(out))
    assert starts(out) == starts(straight)
    assert tables(out) == tables(straight)


def test_stopped_anywhere_and_started_again_it_ends_in_the_same_tables(straight, root, tmp_path, monkeypatch):
    out, config = tmp_path / "out", write(root, tmp_path)
    begin = Board.begin
    for victim in ("n_2-epochs_seed-0", "n_2-epochs_seed-1", "n_50-epochs_seed-1"):

        def stop(board, run, victim=victim):
            begin(board, run)
            if run.name == victim:
                raise KeyboardInterrupt

        monkeypatch.setattr(Board, "begin", stop)
        with pytest.raises(KeyboardInterrupt):
            sweep(config=config, out=str(out), parallel=2)
        assert not (out / "table_2.csv").exists()
    monkeypatch.setattr(Board, "begin", begin)
    sweep(config=config, out=str(out))
    assert tables(out) == tables(straight)


def test_a_run_that_fails_is_named_and_the_others_go_on(root, tmp_path, monkeypatch, capsys):
    out, config = tmp_path / "out", write(root, tmp_path)
    monkeypatch.setenv("FAKE_FAILS", "n_2-epochs_seed-1")
    with pytest.raises(ValueError, match=r"1 of 4 runs failed, .* n_2-epochs_seed-1: the sea is too rough .*log\.txt"):
        sweep(config=config, out=str(out), parallel=4)
    assert "n_2-epochs_seed-1: failed: the sea is too rough" in capsys.readouterr().out
    assert len(list(csv.DictReader((out / "runs.csv").open()))) == 3
    with (out / "n_2-epochs_seed-1" / "log.txt").open() as log:
        assert log.readline() == local.BEGUN
    monkeypatch.setenv("FAKE_VANISHES", "n_2-epochs_seed-1")  # an error of before is not why it fails now
    with pytest.raises(ValueError, match=r"n_2-epochs_seed-1: exit code 9"):
        sweep(config=config, out=str(out))
    monkeypatch.delenv("FAKE_FAILS")
    monkeypatch.delenv("FAKE_VANISHES")
    sweep(config=config, out=str(out))
    assert {name for name, count in starts(out).items() if count == 3} == {"n_2-epochs_seed-1"}


@pytest.mark.parametrize(("lent", "taken"), [("", "1"), ("2,3", "3")])
def test_runs_take_turns_on_the_cards_that_the_sweep_was_lent(monkeypatch, lent, taken):
    monkeypatch.setattr("torch.cuda.device_count", lambda: 2)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", lent)
    assert local.environment(4, 3)["CUDA_VISIBLE_DEVICES"] == taken


def test_a_changed_configuration_is_refused_naming_the_key_and_a_larger_grid_is_welcome(straight, root, tmp_path):
    out, config = tmp_path / "out", write(root, tmp_path)
    shutil.copytree(straight, out)
    content = yaml.safe_load(config.read_text())
    content["settings"]["model.optimiser.learning_rate"] = 0.5
    config.write_text(yaml.safe_dump(content))
    with pytest.raises(ValueError, match=r"begun with model\.optimiser\.learning_rate 0\.002, now it is 0\.5"):
        sweep(config=config, out=str(out))
    del content["settings"]["model.optimiser.learning_rate"]
    content["grid"]["seed_everything"] = [0, 1, 2]
    config.write_text(yaml.safe_dump(content, sort_keys=False))
    sweep(config=config, out=str(out), parallel=4)
    assert len(starts(out)) == 6
    kept = json.loads((out / "sweep.json").read_text())
    assert kept["config"] == config.read_text()
    assert len(kept["configuration_sha256"]) == 6


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grid": {"model.variant": ["q"]}}, "model.variant: got 'q', expected one of n, s"),
        ({"grid": {"model.varian": ["n"]}}, "varian"),
        ({"settings": {"data.image_size": "wide"}}, "image_size"),
    ],
)
def test_a_wrong_key_is_named_before_anything_is_trained(root, tmp_path, change, message):
    config = write(root, tmp_path)
    config.write_text(yaml.safe_dump(yaml.safe_load(config.read_text()) | change))
    with pytest.raises(ValueError, match=message):
        sweep(config=config, out=str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_a_folder_of_something_else_or_in_use_is_left_alone(root, tmp_path):
    config = write(root, tmp_path)
    with pytest.raises(ValueError, match=r"holds other files and no sweep\.json"):
        sweep(config=config, out=str(tmp_path))
    with pytest.raises(ValueError, match="--parallel is 0"):
        sweep(config=config, out=str(tmp_path / "out"), parallel=0)
    (tmp_path / "out").mkdir()
    context = multiprocessing.get_context("fork")
    held, release = context.Event(), context.Event()

    def hold():
        with alone_in(tmp_path / "out"):
            held.set()
            release.wait(60)

    holder = context.Process(target=hold)
    holder.start()
    held.wait(60)
    try:
        with pytest.raises(ValueError, match="another run is writing into this folder"):
            sweep(config=config, out=str(tmp_path / "out"))
    finally:
        release.set()
        holder.join()
