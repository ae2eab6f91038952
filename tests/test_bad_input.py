"""What a user gets wrong costs one line on stderr and exit code 2, in every program, as real processes."""

import csv
import multiprocessing
import os
import runpy
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

PROCESSES = multiprocessing.get_context("forkserver")  # the packages are imported once, for all processes
PROCESSES.set_forkserver_preload(["usvnet.training_cli", "usvnet.evaluation.evaluator"])


def run_script(arguments: list[str], folder: Path) -> None:
    """Become ``python <arguments>`` with stdout and stderr going to files."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        os.dup2(os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    sys.argv = arguments
    os.chdir(folder)
    runpy.run_path(arguments[0], run_name="__main__")


@pytest.fixture
def refused(root, tmp_path):
    """Run a script of the repository, and return the one line of its refusal."""

    def run(script, *arguments):
        process = PROCESSES.Process(target=run_script, args=([str(root / script), *map(str, arguments)], tmp_path))
        process.start()
        process.join()
        lines = (tmp_path / "stderr").read_text().splitlines()
        assert process.exitcode == 2, lines
        assert len(lines) == 1, lines
        return lines[0]

    return run


@pytest.fixture
def dataset(root, tmp_path):
    """Two training and two validation pictures of the sample set, to be spoilt."""
    sample, target = root / "data" / "sample", tmp_path / "dataset"
    shutil.copytree(sample / "cameras", target / "cameras")
    lines = (sample / "data.yaml").read_text().splitlines()
    (target / "data.yaml").write_text("\n".join(line for line in lines if not line.startswith("test")))
    kept = []
    for split in ("train", "val"):
        for picture in sorted((sample / "images" / split).iterdir())[:2]:
            kept.append(f"{split}/{picture.name}")
            for file in (Path("images", split, picture.name), Path("labels", split, picture.stem + ".txt")):
                (target / file).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(sample / file, target / file)
    for name in ("frames.csv", "ranges.csv"):
        header, *rows = csv.reader((sample / name).open())
        with (target / name).open("w", newline="") as stream:
            csv.writer(stream).writerows([header, *(row for row in rows if row[0] in kept)])
    return target


def first(folder: Path) -> Path:
    return min(folder.iterdir())


def missing_image(dataset):
    picture = first(dataset / "images" / "train")
    picture.unlink()
    return picture.name


def six_keypoints(dataset):
    label = first(dataset / "labels" / "train")
    label.write_text(" ".join(label.read_text().split()[:-3]) + "\n")
    return f"{label}:1"


def nan_coordinate(dataset):
    label = first(dataset / "labels" / "train")
    values = label.read_text().split()
    label.write_text(" ".join([*values[:5], "nan", *values[6:]]) + "\n")
    return f"{label}:1"


def negative_range(dataset):
    table = dataset / "ranges.csv"
    header, first_row, *rows = table.read_text().splitlines()
    name, _, *rest = first_row.split(",")
    table.write_text("\n".join([header, ",".join([name, "-4.2", *rest]), *rows]) + "\n")
    return f"{table}:2"


def no_focal_length(dataset):
    camera = first(dataset / "cameras")
    camera.write_text("".join(line for line in camera.open() if "camera_matrix" not in line))
    return f"{camera}: "


def corrupt_jpeg(dataset):
    picture = first(dataset / "images" / "train")
    picture.write_bytes(picture.read_bytes()[:2000])
    return picture


def empty_dataset(dataset):
    for split in ("train", "val"):
        for path in (*dataset.glob(f"*/{split}/*"), *dataset.glob("*.csv")):
            path.unlink()
    return "no pictures"


FAULTS = [missing_image, six_keypoints, nan_coordinate, negative_range, no_focal_length, corrupt_jpeg, empty_dataset]


@pytest.mark.parametrize("spoil", FAULTS, ids=lambda fault: fault.__name__)
def test_training_names_the_file_that_is_faulty(spoil, dataset, refused, tmp_path):
    place = spoil(dataset)
    arguments = ["--data.root", dataset, "--data.image_size", 64, "--run_dir", tmp_path / "run"]
    line = refused("train.py", *arguments, "--trainer.max_epochs", 1)
    assert line.startswith("error: ")
    assert str(place) in line
    assert not list(tmp_path.glob("run/**/*.ckpt"))


def test_a_validation_split_without_labels_is_refused_before_training(dataset, refused, tmp_path):
    shutil.move(dataset / "labels" / "val", dataset / "labels-of-val")
    (dataset / "ranges.csv").unlink()  # which would miss its boats
    line = refused("train.py", "--data.root", dataset, "--data.image_size", 64, "--run_dir", tmp_path / "run")
    assert f"{dataset}: no boat of val has a labelled keypoint" in line
    assert not list(tmp_path.glob("run/**/*.ckpt"))


def test_a_test_split_that_is_to_be_scored_is_looked_for_before_training(dataset, refused, tmp_path):
    arguments = ["--data.root", dataset, "--data.image_size", 64, "--run_dir", tmp_path / "run"]
    line = refused("train.py", *arguments, "--trainer.max_epochs", 1, "--evaluate_after", "true")
    assert "no split 'test'" in line
    assert not list(tmp_path.glob("run/**/*.ckpt"))


def test_a_run_without_end_is_refused(dataset, refused, tmp_path):
    arguments = ["--data.root", dataset, "--data.image_size", 64, "--run_dir", tmp_path / "run"]
    line = refused("train.py", *arguments, "--trainer.max_epochs", -1)
    assert "trainer.max_epochs is -1 and trainer.max_steps -1, expected either above 0" in line


def test_check_data_names_all_faults_at_once(dataset, tmp_path):
    places = [six_keypoints(dataset), negative_range(dataset)]
    arguments = ["check-data", str(dataset), "--output", str(tmp_path / "labels.png")]
    done = subprocess.run([sys.executable, "-m", "usvnet.cli", *arguments], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr == f"error: 2 faults in {dataset}\n"
    for place in places:
        assert place in done.stdout


def test_an_unknown_key_is_named(dataset, refused, tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text(f"data: {{root: {dataset}}}\nmodel: {{widht: 1}}\n")
    line = refused("train.py", "--config", config)
    assert line.startswith("error: ")
    assert "widht" in line


def test_an_option_is_never_guessed_from_its_beginning(dataset, refused):
    assert "max_epoch" in refused("train.py", "--data.root", dataset, "--trainer.max_epoch", 1)


def test_a_checkpoint_of_another_size_is_named(dataset, refused, untrained):
    line = refused("train.py", "--data.root", dataset, "--model.variant", "s", "--ckpt_path", untrained)
    assert f"{untrained}: got a checkpoint of size 'n', expected size 's'" in line
