from pathlib import Path

import numpy as np
import pytest

from usvnet.data.formats.imu import read_imu

HEADER = "time_s,pitch_deg,roll_deg,pitch_std_deg,roll_std_deg\n"


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "imu.csv"
    path.write_text(f"{HEADER}10,4,1,0.1,0.2\n10.1,5,-1,0.1,0.2\n10.2,6,0,0.3,0.4\n11.2,7,0,0.1,0.1\n")
    return path


def test_between_two_rows_angles_are_linear_and_variances_are_of_the_weights(path: Path):
    angles, stds = read_imu(path).at(10.125, 0.2)
    assert angles == pytest.approx([5.25, -0.75])
    assert stds == pytest.approx([np.hypot(0.75 * 0.1, 0.25 * 0.3), np.hypot(0.75 * 0.2, 0.25 * 0.4)])


def test_a_row_is_taken_as_it_is(path: Path):
    assert read_imu(path).at(10.2, 0.2) == ([6.0, 0.0], [0.3, 0.4])
    assert read_imu(path).at(11.2, 0.2) == ([7.0, 0.0], [0.1, 0.1])  # beside a gap, but no guess


@pytest.mark.parametrize("time_s", [9.99, 10.7, 11.21])
def test_outside_and_in_a_gap_there_is_nothing(path: Path, time_s: float):
    assert read_imu(path).at(time_s, 0.2) is None


def test_a_longer_gap_can_be_allowed(path: Path):
    assert read_imu(path).at(10.7, 1.01)[0] == pytest.approx([6.5, 0.0])


def test_without_deviations_there_are_none(tmp_path: Path):
    path = tmp_path / "imu.csv"
    path.write_text("roll_deg,time_s,pitch_deg\n1,0,4\n3,1,6\n")
    assert read_imu(path).at(0.5, 2.0) == ([5.0, 2.0], None)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("time_s,pitch_deg\n1,2\n", r":1: column roll_deg is missing"),
        ("time_s,pitch_deg,roll_deg,roll_std_deg\n1,2,3,4\n", r":1: expected both pitch_std_deg and roll_std_deg"),
        (f"{HEADER}", ": no readings"),
        (f"{HEADER}1,2,3,0.1,0.1\n1,2,3,0.1,0.1\n", r":3: time_s is 1, not after the row before \(1\)"),
        (f"{HEADER}1,north,3,0.1,0.1\n", r":2: pitch_deg is 'north', expected a number"),
        (f"{HEADER}1,,3,0.1,0.1\n", r":2: pitch_deg is '', expected a number"),
        (f"{HEADER}1,2\n", r":2: roll_deg is '', expected a number"),
        (f"{HEADER}1,inf,3,0.1,0.1\n", r":2: pitch_deg is inf, expected a finite"),
        (f"{HEADER}1,2,170,0.1,0.1\n", r":2: roll_deg is 170, expected -90 to 90"),
        (f"{HEADER}1,2,3,-1,0.1\n", r":2: pitch_std_deg is -1, expected a deviation"),
    ],
)
def test_a_faulty_file_is_named(tmp_path: Path, text: str, words: str):
    path = tmp_path / "imu.csv"
    path.write_text(text)
    with pytest.raises(ValueError, match=rf"imu\.csv{words}"):
        read_imu(path)
