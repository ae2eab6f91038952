from pathlib import Path

import pytest

from usvnet.data.formats.ranges import read_tables
from usvnet.data.records import Faults
from usvnet.types import NEAREST_WATERLINE


def test_absent_columns_and_empty_cells_mean_the_defaults(tmp_path: Path):
    (tmp_path / "ranges.csv").write_text("image,range_m,instance,scene\ntrain/a.jpg,4.5,,II\ntrain/a.jpg,6.5,1,\n")
    notes = read_tables(tmp_path, Faults())["train/a.jpg"]
    assert notes.scene == "II"
    assert notes.pitch_deg is None
    first, second = notes.readings[0], notes.readings[1]
    assert (first.range_m, first.range_std_m, first.reference) == (4.5, 0.0, NEAREST_WATERLINE)
    assert second.range_m == 6.5


def test_every_column_is_read(tmp_path: Path):
    (tmp_path / "frames.csv").write_text("image,camera,pitch_deg,true_pitch_deg\na.jpg,left,3.5,99\n")
    (tmp_path / "ranges.csv").write_text(
        "image,range_m,range_std_m,instance,reference,roll_deg,pitch_std_deg\na.jpg,4.5,0.02,1,stern_bottom,-1,0.1\n"
    )
    notes = read_tables(tmp_path, Faults())["a.jpg"]
    assert (notes.camera, notes.pitch_deg, notes.roll_deg, notes.pitch_std_deg) == ("left", 3.5, -1.0, 0.1)
    assert notes.readings[1].reference == 6
    assert notes.readings[1].range_std_m == 0.02


@pytest.mark.parametrize(
    ("header", "row", "words"),
    [
        ("range_m", "-1", "range_m is -1, expected metres above 0"),
        ("range_m", "0", "range_m is 0, expected metres above 0"),
        ("range_m", "nan", "range_m is nan, expected a finite number"),
        ("range_m", "far", "range_m is 'far', expected a number"),
        ("range_m", "", "range_m is empty"),
        ("range_m,range_std_m", "4,-0.1", "range_std_m is -0.1"),
        ("range_m,instance", "4,-1", "instance is -1"),
        ("range_m,instance", "4," + "9" * 400, "instance is 9+, expected a finite number"),
        ("range_m,instance", "1e300,0", r"range_m is 1e300, expected a finite number"),
        ("range_m,instance", "4,1.5", "instance is '1.5', expected a number"),
        ("range_m,reference", "4,mast", "reference is mast, expected one of nearest_waterline, bow"),
        ("range_m,reference", "4,bow_left", "reference is bow_left, .* nearest_waterline, bow_bottom, stern_bottom$"),
        ("range_m,pitch_deg", "4,nan", "pitch_deg is nan"),
        ("range_m,pitch_deg", "4,170", "pitch_deg is 170"),
        ("range_m,roll_std_deg", "4,-1", "roll_std_deg is -1"),
    ],
)
def test_a_faulty_row_is_named(tmp_path: Path, header: str, row: str, words: str):
    (tmp_path / "ranges.csv").write_text(f"image,{header}\na.jpg,{row}\n")
    with pytest.raises(ValueError, match=rf"ranges\.csv:2: {words}"):
        read_tables(tmp_path, Faults())


def test_two_readings_of_one_boat_are_refused(tmp_path: Path):
    (tmp_path / "ranges.csv").write_text("image,range_m\na.jpg,4\na.jpg,5\n")
    with pytest.raises(ValueError, match=r"ranges\.csv:3: a second range for instance 0 of a.jpg"):
        read_tables(tmp_path, Faults())


def test_tables_that_contradict_each_other_are_refused(tmp_path: Path):
    (tmp_path / "frames.csv").write_text("image,pitch_deg\na.jpg,4\n")
    (tmp_path / "ranges.csv").write_text("image,range_m,pitch_deg\na.jpg,4,5\n")
    with pytest.raises(ValueError, match=r"ranges\.csv:2: pitch_deg is 5.0, but an earlier row .* says 4.0"):
        read_tables(tmp_path, Faults())


@pytest.mark.parametrize(
    ("header", "words"),
    [("image,range_m,refrence", "unknown column 'refrence'"), ("image,range", "expected image and")],
)
def test_a_wrong_header_is_named(tmp_path: Path, header: str, words: str):
    (tmp_path / "ranges.csv").write_text(f"{header}\n")
    with pytest.raises(ValueError, match=rf"ranges\.csv:1: .*{words}"):
        read_tables(tmp_path, Faults())
