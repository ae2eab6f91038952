import shutil
from pathlib import Path

import pytest

from usvnet.commands.check_data import check_data
from usvnet.commands.convert import convert
from usvnet.data.reader import read_dataset
from usvnet.geometry.camera import make_camera
from usvnet.geometry.camera_files import save_camera


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    K = [[170, 0, 80], [0, 170, 60], [0, 0, 1]]
    save_camera(make_camera(K, (160, 120), [0.0] * 5, height_m=1.5, pitch_rad=0.1), tmp_path / "front.yaml")
    return tmp_path / "front.yaml"


@pytest.mark.parametrize(
    ("fixture", "names"),
    [
        ("cvat", {"train": ["train/a.png", "train/b.png"], "val": ["val/c.png"]}),
        ("label_studio", {"train": ["train/I/b.png"], "val": ["val/a.png"]}),
        (
            "scene_folder",
            {"train": ["train/I/0001.png", "train/VI/0001.png"], "val": ["val/I/0002.png", "val/VI/0002.png"]},
        ),
    ],
)
def test_an_export_becomes_a_dataset_that_checks(
    fixture: str, names: dict[str, list[str]], camera: Path, tmp_path: Path, request, capsys
):
    source = request.getfixturevalue(fixture)
    split = None if fixture == "cvat" else "0.5,0.5,0"
    convert(source, output=tmp_path / "boats", camera=camera, split=split)
    assert f"next: usvnet check-data {tmp_path / 'boats'}" in capsys.readouterr().out
    found = {split: [frame.name for frame in read_dataset(tmp_path / "boats", split)] for split in ("train", "val")}
    assert {split: len(members) for split, members in found.items()} == {
        split: len(members) for split, members in names.items()
    }
    if fixture == "cvat":
        assert found == names
    check_data(str(tmp_path / "boats"), output=str(tmp_path / "labels.png"))


def test_a_zip_is_unpacked_and_its_folder_taken_away(cvat: Path, tmp_path: Path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    (tmp_path / "temporary").mkdir()
    source = Path(shutil.make_archive(str(tmp_path / "export"), "zip", cvat))
    convert(source, output=tmp_path / "boats")
    assert sorted(path.name for path in (tmp_path / "boats").rglob("*.png")) == ["a.png", "b.png", "c.png"]
    assert list((tmp_path / "temporary").iterdir()) == []


def test_pictures_of_label_studio_may_lie_elsewhere(label_studio: Path, tmp_path: Path):
    moved = tmp_path / "export.json"
    label_studio.rename(moved)
    convert(moved, output=tmp_path / "boats", pictures=label_studio.parent)
    assert len(list((tmp_path / "boats").rglob("*.png"))) == 2


def test_an_export_is_checked_before_it_is_converted(cvat: Path, tmp_path: Path, capsys):
    check_data(str(cvat), output=str(tmp_path / "labels.png"))
    printed = capsys.readouterr().out
    assert "usvnet convert" in printed
    assert "range m" not in printed  # no laser, no lengths
    assert (tmp_path / "labels.png").stat().st_size > 0
    for name in ("train/a", "val/c"):
        (cvat / "labels" / f"{name}.txt").write_text("1 2 3\n")
    with pytest.raises(ValueError, match="2 faults in"):
        check_data(str(cvat), output=str(tmp_path / "labels.png"))
    printed = capsys.readouterr().out
    assert "train/a.txt:1: 3 values" in printed
    assert "val/c.txt:1: 3 values" in printed


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"source": "nothing"}, "nothing: no such file or folder"),
        ({"source": "."}, "nothing that is known, expected CVAT's"),
        ({"split": "0.7,0.2"}, r"--split is 0\.7,0\.2, expected three shares"),
        ({"split": "0.7,0.2,x"}, "expected three shares"),
        ({"output": "."}, "there already, expected the name of a new folder"),
        ({"pictures": "."}, "--pictures is .*says itself where"),
        ({"format": "cvat"}, r"data\.yaml: no such file"),
        ({"camera": "none.yaml"}, r"none\.yaml: no such file"),
    ],
)
def test_refusals_leave_nothing(options: dict[str, str], words: str, scene_folder: Path, tmp_path: Path, monkeypatch):
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    if options.get("output"):
        (work / "kept.txt").touch()
    paths = {key: Path(value) for key, value in options.items() if key in ("source", "output", "pictures", "camera")}
    others = {key: value for key, value in options.items() if key not in paths}
    before = sorted(work.iterdir())
    with pytest.raises((ValueError, FileNotFoundError), match=words):
        convert(**{"source": scene_folder, "output": work / "out"} | paths | others)
    assert sorted(work.iterdir()) == before


def test_a_dataset_of_ours_needs_no_conversion(root: Path, tmp_path: Path):
    with pytest.raises(ValueError, match="a dataset already"):
        convert(root / "data" / "sample", output=tmp_path / "out")
