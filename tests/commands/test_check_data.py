import shutil
from pathlib import Path

import cv2
import pytest

from usvnet.commands.check_data import check_data


@pytest.fixture
def dataset(root: Path, tmp_path: Path) -> Path:
    """The sample set's validation pictures, to be spoilt."""
    shutil.copytree(root / "data" / "sample", tmp_path / "set", ignore=shutil.ignore_patterns("train", "test"))
    data = tmp_path / "set" / "data.yaml"
    data.write_text("".join(line for line in data.open() if not line.startswith(("train", "test"))))
    for table in ("frames.csv", "ranges.csv"):
        lines = (tmp_path / "set" / table).read_text().splitlines(keepends=True)
        (tmp_path / "set" / table).write_text("".join(line for line in lines if line.startswith(("image", "val"))))
    return tmp_path / "set"


def test_a_sound_dataset_is_counted_and_drawn(dataset: Path, tmp_path: Path, capsys):
    check_data(str(dataset), output=str(tmp_path / "labels.png"))
    printed = capsys.readouterr().out
    for words in ("30", "VI", "320 x 320", "range m", "labels.png"):
        assert words in printed
    cameras = {line.split("│")[1].strip() for line in printed.splitlines() if "320 x 320" in line}
    assert cameras == {path.stem for path in (dataset / "cameras").iterdir()}
    assert cv2.imread(str(tmp_path / "labels.png")).shape[1] > 500


def test_every_fault_is_printed_with_its_place(dataset: Path, tmp_path: Path, capsys):
    labels = sorted((dataset / "labels" / "val").iterdir())
    labels[0].write_text(labels[0].read_text().rsplit(" ", 3)[0])
    labels[1].write_text(labels[1].read_text().replace("0 0.", "0 nan", 1))
    labels[2].rename(labels[2].with_name("stray.txt"))
    pictures = sorted((dataset / "images" / "val").iterdir())
    pictures[3].write_bytes(pictures[3].read_bytes()[:1000])
    with (dataset / "ranges.csv").open("a") as stream:
        stream.write("val/7777.jpg,4,0.01,0,nearest_waterline\n")
        stream.write(f"val/{pictures[5].name},4,0.01,1,mast\n")
    with pytest.raises(ValueError, match=r"^7 faults in "):
        check_data(str(dataset), output=str(tmp_path / "labels.png"))
    printed = capsys.readouterr().out
    expected = [
        f"{labels[0]}:1: 23 values (6 keypoints)",
        f"{labels[1]}:1: ",
        f"{labels[2].with_name('stray.txt')}: a label without its picture",
        f"has 0 boats in val/{labels[2].stem}.jpg",
        f"{pictures[3]}: corrupt JPEG",
        "ranges.csv:32: no picture",
        "ranges.csv:33: reference is mast",
    ]
    for words in expected:
        assert words in printed


def test_an_empty_dataset_is_a_fault(dataset: Path, tmp_path: Path, capsys):
    for path in (*dataset.glob("images/val/*"), *dataset.glob("labels/val/*"), *dataset.glob("*.csv")):
        path.unlink()
    with pytest.raises(ValueError, match="1 fault in"):
        check_data(str(dataset), output=str(tmp_path / "labels.png"))
    assert "no pictures" in capsys.readouterr().out


def test_no_dataset_is_an_error(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=r"data\.yaml: no such file"):
        check_data(str(tmp_path), output=str(tmp_path / "labels.png"))
