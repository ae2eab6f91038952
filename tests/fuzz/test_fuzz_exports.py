"""Exports of labelling tools: converted whole, or refused in one sentence with nothing written, whatever is in them."""

import json
import shutil
from pathlib import Path

import pytest
from hypothesis import given

from usvnet.data.conversion import Format, open_export, write_dataset
from usvnet.data.records import Faults

from .mutations import EXAMPLES, quick, read_or_refused, spoilt_bytes, spoilt_json, spoilt_text
from .test_fuzz_labels import check_labels


def convert_or_refused(source: Path, kind: Format, output: Path) -> None:
    """Convert and look at the result, or find that there is none; then gather the faults as check-data does."""

    def convert() -> None:
        with open_export(source, kind, Faults()) as export:
            for picture in export.pictures:
                check_labels(picture.labels)
            write_dataset({"train": export.pictures}, output)

    read_or_refused(convert, source if source.is_dir() else source.parent)
    assert output.exists() == (output / "data.yaml").exists()
    assert [path for path in output.parent.iterdir() if path.name.startswith(".")] == []
    shutil.rmtree(output, ignore_errors=True)
    faults = Faults(collect=True)
    with faults.catch(), open_export(source, kind, faults) as export:
        assert export.pictures or faults.sentences
    assert all(str(source.parent) in sentence for sentence in faults.sentences)


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("name", ["data.yaml", "train.txt", "labels/train/a.txt"])
def test_cvat(cvat: Path, tmp_path: Path, name: str, examples: int):
    (tmp_path / "out").mkdir()

    @quick(examples)
    @given(spoilt_text((cvat / name).read_text()))
    def convert(data: bytes) -> None:
        (cvat / name).write_bytes(data)
        convert_or_refused(cvat, "cvat", tmp_path / "out" / "boats")

    convert()


@pytest.mark.parametrize("examples", EXAMPLES)
def test_zips(cvat: Path, tmp_path: Path, examples: int):
    source = Path(shutil.make_archive(str(tmp_path / "export"), "zip", cvat))
    (tmp_path / "out").mkdir()

    @quick(examples)
    @given(spoilt_bytes(source.read_bytes()))
    def convert(data: bytes) -> None:
        source.write_bytes(data)
        convert_or_refused(source, "cvat", tmp_path / "out" / "boats")

    convert()


@pytest.mark.parametrize("examples", EXAMPLES)
def test_label_studio(label_studio: Path, tmp_path: Path, examples: int):
    (tmp_path / "out").mkdir()

    @quick(examples)
    @given(spoilt_json(json.loads(label_studio.read_text())))
    def convert(data: bytes) -> None:
        label_studio.write_bytes(data)
        convert_or_refused(label_studio, "labelstudio", tmp_path / "out" / "boats")

    convert()


@pytest.mark.parametrize("examples", EXAMPLES)
@pytest.mark.parametrize("name", ["laser.csv", "VI/0001.txt"])
def test_scene_folder(scene_folder: Path, tmp_path: Path, name: str, examples: int):
    (tmp_path / "out").mkdir()

    @quick(examples)
    @given(spoilt_text((scene_folder / name).read_text()))
    def convert(data: bytes) -> None:
        (scene_folder / name).write_bytes(data)
        convert_or_refused(scene_folder, "folder", tmp_path / "out" / "boats")

    convert()
