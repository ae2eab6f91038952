from pathlib import Path

import pytest
import torch

from usvnet import cli
from usvnet.geometry.camera import make_camera
from usvnet.geometry.camera_files import load_camera, save_camera
from usvnet.geometry.ranging import RangingLayer

K = [[700.0, 0, 320], [0, 700, 240], [0, 0, 1]]
HEADER = "image,kind,u_px,v_px,range_m,range_std_m\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A camera file with a guess of its mount, and readings of the true one, 1.5 m, 8 and 1 degrees."""
    guess = make_camera(
        K, (640, 480), height_m=1.4, pitch_rad=0.12, roll_rad=0.0, pitch_std_rad=0.05, focal_std_px=2.0, wave_std_m=0.03
    )
    save_camera(guess, tmp_path / "front.yaml", style="opencv", name="front")
    true = make_camera(K, (640, 480), height_m=1.5, pitch_rad=0.14, roll_rad=0.02, dtype=torch.float64)
    pixels = torch.tensor([[[60.0, 450], [600, 400], [320, 300], [30, 230], [610, 210]]], dtype=torch.float64)
    ranges = RangingLayer(curved_water=True).range_points(pixels, torch.zeros(1, 5, 2, 2).double(), true)
    rows = [f"{i}.jpg,,{u:.1f},{v:.1f},{r:.3f},0.02" for i, ((u, v), r) in enumerate(zip(pixels[0], ranges.slant_m[0]))]
    (tmp_path / "readings.csv").write_text(HEADER + "\n".join(rows) + "\n")
    return tmp_path


def run(folder: Path, *options: str) -> None:
    files = [str(folder / "readings.csv"), "--camera", str(folder / "front.yaml")]
    cli.run(["calibrate-mount", *files, "--output", str(folder / "mounted.yaml"), *options])


def test_it_writes_the_mount_and_keeps_the_lens(folder: Path, capsys):
    before = (folder / "front.yaml").read_bytes()
    run(folder)
    found, guess = load_camera(folder / "mounted.yaml"), load_camera(folder / "front.yaml")
    assert found.height_m.item() == pytest.approx(1.5, abs=3 * found.height_std_m.item())
    assert found.height_std_m.item() < 0.05
    assert found.pitch_rad.item() == pytest.approx(0.14, abs=3 * found.pitch_std_rad.item())
    assert found.pitch_std_rad.item() < 0.01
    assert found.roll_rad.item() == pytest.approx(0.02, abs=3 * found.roll_std_rad.item())
    for field in ("K", "distortion", "size_px", "focal_std_px", "wave_std_m"):
        torch.testing.assert_close(getattr(found, field), getattr(guess, field), rtol=0, atol=0)
    assert (folder / "mounted.yaml").read_text().startswith("%YAML:1.0")
    assert (folder / "front.yaml").read_bytes() == before
    shown = capsys.readouterr().out
    assert "chi-squared" in shown
    assert "4.jpg" in shown


def test_what_is_held_stays(folder: Path, capsys):
    run(folder, "--hold", "height,roll")
    found, guess = load_camera(folder / "mounted.yaml"), load_camera(folder / "front.yaml")
    assert torch.equal(found.height_m, guess.height_m)
    assert torch.equal(found.roll_rad, guess.roll_rad)
    assert not torch.equal(found.pitch_rad, guess.pitch_rad)
    assert "scatter more than they claim" in capsys.readouterr().out  # the guessed height is wrong


def test_nothing_is_overwritten_unasked(folder: Path):
    (folder / "mounted.yaml").write_text("mine")
    with pytest.raises(ValueError, match=r"mounted\.yaml: is there already"):
        run(folder)
    assert (folder / "mounted.yaml").read_text() == "mine"
    run(folder, "--overwrite")
    assert load_camera(folder / "mounted.yaml").height_m.item() > 1.4


def test_readings_that_leave_something_open_write_nothing(folder: Path):
    (folder / "readings.csv").write_text(HEADER + ",horizon,10,142,,\n,horizon,600,130,,\n")
    with pytest.raises(ValueError, match=r"readings\.csv: the readings do not say the height"):
        run(folder)
    assert not (folder / "mounted.yaml").exists()


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("a.jpg,,100,200,,", "range_m is empty, expected a number for a range"),
        ("a.jpg,,100,high,5,", "v_px is 'high', expected a number"),
        ("a.jpg,,100,200,nan,", "range_m is nan, expected a finite number"),
        ("a.jpg,,100,200,-5,", "range_m is -5, expected more than 0"),
        ("a.jpg,,100,200,5,-1", "range_std_m is -1"),
        ("a.jpg,mast,100,200,5,", "kind is 'mast', expected one of range, point, horizon"),
        ("a.jpg,point,100,200,,", "right_m is empty, expected a number for a point"),
    ],
)
def test_a_faulty_line_is_named(folder: Path, line: str, words: str):
    (folder / "readings.csv").write_text(f"{HEADER}b.jpg,,320,300,8,\n{line}\n")
    with pytest.raises(ValueError, match=rf"readings\.csv:3: {words}"):
        run(folder)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--hold", "yaw"], "hold: expected some of height, pitch, roll .* got 'yaw'"),
        (["--output", "mount.txt"], "must end in .yaml"),
        (["--camera", "nowhere.yaml"], "nowhere.yaml"),
    ],
)
def test_a_wrong_option_is_named(folder: Path, options: list[str], words: str):
    with pytest.raises((ValueError, FileNotFoundError), match=words):
        run(folder, *options)


def test_a_wrong_header_is_named(folder: Path):
    (folder / "readings.csv").write_text("u_px,v_px,range\n1,2,3\n")
    with pytest.raises(ValueError, match=r"readings\.csv:1: unknown column 'range'"):
        run(folder)
