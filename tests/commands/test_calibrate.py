from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from chessboards import poses, render
from turned_jpegs import write_turned

from usvnet.commands.calibrate import calibrate, choose_detector
from usvnet.geometry.camera_files import load_camera

POSES = poses(6, seed=2, tilt_rad=0.6)


@pytest.fixture(scope="module")
def pictures():
    return [render(*pose, seed=i) for i, pose in enumerate(POSES)]


@pytest.fixture
def photos(tmp_path, pictures):
    folder = tmp_path / "photos"
    folder.mkdir()
    for i, grey in enumerate(pictures):
        cv2.imwrite(str(folder / f"board{i}.png"), grey)
    return folder


def run(source, tmp_path, **options):
    settings = {"board": "9x6", "square_mm": 25, "height_m": 1.5, "detector": "classic"}
    output = tmp_path / "out" / "camera.yaml"
    calibrate(str(source), output=str(output), **{**settings, **options})
    return output


def check_camera(output):
    """The camera file holds the camera that rendered the pictures."""
    camera = load_camera(output)
    assert camera.K[0, 0, 0].item() == pytest.approx(400, rel=0.005)
    assert camera.K[0, 1, 1].item() == pytest.approx(404, rel=0.005)
    assert camera.size_px[0].tolist() == [480, 360]
    assert camera.distortion[0, 0].item() == pytest.approx(-0.25, abs=0.03)
    assert 0 < camera.focal_std_px.item() < 2
    return camera


def test_photographs_to_camera_file_and_coverage_picture(photos, tmp_path, capsys):
    output = run(photos / "*.png", tmp_path, detector="auto", pitch_deg=6, roll_deg=-1, pitch_std_deg=0.5)
    camera = check_camera(output)
    assert camera.height_m.item() == 1.5
    assert np.degrees(camera.pitch_rad.item()) == pytest.approx(6)
    assert np.degrees(camera.roll_rad.item()) == pytest.approx(-1)
    assert np.degrees(camera.pitch_std_rad.item()) == pytest.approx(0.5)
    coverage = cv2.imread(str(output.with_name("camera_coverage.png")))
    assert min(coverage.shape[:2]) > 500
    assert coverage.std() > 5
    said = capsys.readouterr().out
    for words in ("board3.png", "fx", "detector classic", "detector sb", "kept: smallest focal sigma", "field of view"):
        assert words in said
    assert sorted(path.name for path in output.parent.iterdir()) == ["camera.yaml", "camera_coverage.png"]


def test_a_folder_of_photographs_in_opencv_style(photos, tmp_path):
    (photos / "notes.txt").write_text("not a picture")
    output = run(photos, tmp_path, style="opencv", radial_terms=2)
    assert output.read_text().startswith("%YAML")
    assert check_camera(output).distortion[0, 4].item() == 0


def test_photographs_are_calibrated_as_they_stand_upright(pictures, tmp_path):
    (tmp_path / "phone").mkdir()
    for number, grey in enumerate(pictures):
        write_turned(tmp_path / "phone" / f"{number}.jpg", grey)
    check_camera(run(tmp_path / "phone", tmp_path))


def test_a_video_is_sampled_and_its_repeats_are_skipped(pictures, tmp_path, capsys):
    film = tmp_path / "board.mp4"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter_fourcc(*"mp4v"), 25, (480, 360))
    for grey in pictures:
        for _ in range(4):  # each board stands still for four frames: two of them are looked at
            writer.write(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))
    writer.release()
    check_camera(run(film, tmp_path, every_n_frames=2))
    said = capsys.readouterr().out
    assert "12 pictures" in said
    assert "6 repeated a view" in said


def test_a_bad_view_and_a_picture_without_a_board_are_passed_over_aloud(photos, tmp_path, capsys):
    flat = cv2.imread(str(photos / "board1.png"), cv2.IMREAD_GRAYSCALE)
    v, u = np.mgrid[:360, :480].astype(np.float32)
    cv2.imwrite(str(photos / "bent.png"), cv2.remap(flat, u, v + 8 * np.sin(u / 40), cv2.INTER_LINEAR))
    cv2.imwrite(str(photos / "water.png"), np.full((360, 480), 127, np.uint8))
    check_camera(run(photos, tmp_path))
    said = capsys.readouterr().out
    assert "left out bent.png" in said
    assert "left out board" not in said
    assert "no whole 9x6 board in 1: water.png" in said


def test_so_many_views_at_most(photos, tmp_path, capsys):
    run(photos, tmp_path, max_views=4)
    said = capsys.readouterr().out
    assert "used 4 of 6 views" in said


def test_bad_input_is_one_clear_sentence(photos, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"no file matches '.*none\*.jpg'"):
        run(photos / "none*.jpg", tmp_path)
    (tmp_path / "empty").mkdir()
    with pytest.raises(FileNotFoundError, match="no pictures in the folder"):
        run(tmp_path / "empty", tmp_path)
    with pytest.raises(ValueError, match="no 8x7 board found in any of 2 pictures; count the inner corners"):
        run(photos / "board[01].png", tmp_path, board="8x7")
    with pytest.raises(ValueError, match=r"no 10x7 board found in any of 2 pictures, but board0.png shows a 9x6 one"):
        run(photos / "board[01].png", tmp_path, board="10x7")
    with pytest.raises(
        ValueError, match="a whole 9x6 board was found in 1 of 1 picture, a calibration needs at least 3"
    ):
        run(photos / "board2.png", tmp_path)
    with pytest.raises(ValueError, match="square_mm must be above 0 millimetres, got -25"):
        run(photos, tmp_path, square_mm=-25)
    with pytest.raises(ValueError, match="height_m"):
        run(photos, tmp_path, height_m=0)
    with pytest.raises(ValueError, match=r"output must end in \.yaml or \.yml"):
        calibrate(str(photos), board="9x6", square_mm=25, height_m=1.5, output=str(tmp_path / "camera.json"))
    with pytest.raises(ValueError, match="every_n_frames must be at least 1, got 0"):
        run(photos, tmp_path, every_n_frames=0)
    with pytest.raises(ValueError, match="max_views must be at least 3, got 2"):
        run(photos, tmp_path, max_views=2)
    assert not (tmp_path / "out").exists()


def test_parallel_boards_are_no_calibration_whatever_their_sigma_claims():
    def result(tilt_deg, std_px):
        angles = np.radians([0, tilt_deg])
        rotation = np.array([cv2.Rodrigues(np.array([angle, 0, 0]))[0] for angle in angles])
        return SimpleNamespace(rotation=rotation, focal_std_px=std_px, focal_px=700.0)

    assert choose_detector({"classic": result(1.5, 0.2), "sb": result(40, 0.9)}) == "sb"
    assert choose_detector({"classic": result(30, 0.2), "sb": result(40, 0.9)}) == "classic"


def test_boards_held_parallel_are_refused(tmp_path, monkeypatch, photos):
    monkeypatch.setattr("usvnet.commands.calibrate.tilt_spread_deg", lambda _: 1.0)
    with pytest.raises(ValueError, match=r"parallel to one another within 1\.0 degrees, which tells no focal length"):
        run(photos, tmp_path)
    assert not (tmp_path / "out").exists()


def test_a_broken_file_is_named(photos, tmp_path):
    (photos / "board9.jpg").write_bytes(b"\xff\xd8\xff\xe0 not a photograph")
    with pytest.raises(ValueError, match=r"board9.jpg: corrupt JPEG"):
        run(photos / "board*", tmp_path)
    (tmp_path / "film.mp4").write_bytes(b"not a film")
    with pytest.raises(ValueError, match=r"film.mp4: not a video that can be read"):
        run(tmp_path / "film.mp4", tmp_path)


def test_photographs_of_two_sizes_name_the_odd_one(photos, tmp_path):
    cv2.imwrite(str(photos / "board4.png"), np.full((300, 480), 127, np.uint8))
    with pytest.raises(ValueError, match=r"board4.png is 480x300 px but board0.png is 480x360 px"):
        run(photos, tmp_path)
