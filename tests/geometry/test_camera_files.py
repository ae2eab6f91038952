import math

import cv2
import numpy as np
import pytest
import torch

from usvnet.geometry.camera import camera_to, make_camera, stack_cameras
from usvnet.geometry.camera_files import load_camera, save_camera

ROS = """\
image_width: 640
image_height: 480
camera_name: bow
camera_matrix: {rows: 3, cols: 3, data: [700.5, 0.0, 322, 0, 690.25, 236.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [-0.28, 0.09, 1e-3, -0.0007, 0.005]}
mount: {height_m: 1.5, pitch_deg: 6, roll_deg: -3.0, pitch_std_deg: 0.3, wave_std_m: 0.02}
"""

# What the calibration sample of OpenCV 4 writes (samples/cpp/calibration.cpp), shortened, and a mount below it.
OPENCV = """\
%YAML:1.0
---
calibration_time: "Fri Nov 22 13:21:00 2024"
nframes: 13
image_width: 640
image_height: 480
flags: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 7.0050000000000000e+02, 0., 322., 0., 690.25, 236.5, 0., 0.,
       1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -2.8000000000000003e-01, 9.0000000000000e-02, 1.0e-03,
       -7.0e-04, 5.0e-03 ]
avg_reprojection_error: 2.5e-01
mount:
   height_m: 1.5
   pitch_deg: 6.
   roll_deg: -3.
   pitch_std_deg: 0.3
   wave_std_m: 0.02
"""


@pytest.fixture
def example():
    return make_camera(
        [[700.5, 0, 322], [0, 690.25, 236.5], [0, 0, 1]],
        (640, 480),
        (-0.28, 0.09, 0.001, -0.0007, 0.005),
        height_m=1.5,
        pitch_rad=math.radians(6),
        roll_rad=math.radians(-3),
        pitch_std_rad=math.radians(0.3),
        wave_std_m=0.02,
    )


@pytest.mark.parametrize("text", [ROS, OPENCV, OPENCV.replace("%YAML:1.0", "%YAML 1.2"), "\ufeff" + OPENCV])
def test_both_styles_load_the_same_camera(tmp_path, example, text):
    path = tmp_path / "camera.yaml"
    path.write_text(text, encoding="utf-8")
    for got, expected in zip(load_camera(path), example):
        assert torch.equal(got, expected)


def test_a_fisheye_of_opencv_is_not_taken_for_another_lens(tmp_path):
    (tmp_path / "camera.yaml").write_text(OPENCV + "fisheye_model: 1\n")
    with pytest.raises(ValueError, match=r"camera\.yaml: fisheye_model: expected a lens of plumb_bob"):
        load_camera(tmp_path / "camera.yaml")


@pytest.mark.parametrize("style", ["ros", "opencv"])
def test_written_files_load_back_identically(tmp_path, camera, style):
    torch.manual_seed(0)
    for _ in range(20):
        noisy = type(camera)(*(field * (1 + 0.1 * torch.rand(1)) for field in camera_to(camera, dtype=torch.float32)))
        written = noisy._replace(K=noisy.K * torch.tensor([1, 1, 0]).view(3, 1) + torch.diag(torch.tensor([0, 0, 1.0])))
        written = written._replace(size_px=torch.tensor([[641.0, 480.0]]))
        save_camera(written, tmp_path / "camera.yaml", style, 'a "quoted" name')
        for got, expected in zip(load_camera(tmp_path / "camera.yaml"), written):
            assert torch.equal(got, expected)


def test_files_are_for_people(tmp_path, example):
    save_camera(example, tmp_path / "camera.yaml")
    text = (tmp_path / "camera.yaml").read_text()
    assert "pitch_deg: 6.0, roll_deg: -3.0" in text
    assert "data: [-0.28, 0.09, 0.001, -0.0007, 0.005]" in text


def test_opencv_opens_what_is_written(tmp_path, example):
    path = tmp_path / "camera.yaml"
    save_camera(example, path, "opencv", "bow")
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    np.testing.assert_allclose(storage.getNode("camera_matrix").mat(), example.K[0].numpy(), rtol=1e-7)
    coefficients = storage.getNode("distortion_coefficients").mat()
    np.testing.assert_allclose(coefficients[:, 0], example.distortion[0].numpy(), rtol=1e-6)
    assert storage.getNode("image_width").real() == 640
    assert storage.getNode("camera_name").string() == "bow"
    assert storage.getNode("mount").getNode("pitch_deg").real() == 6.0


def test_what_opencv_writes_is_read(tmp_path, example):
    path = tmp_path / "camera.yaml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write("camera_matrix", example.K[0].double().numpy())
    storage.write("distortion_coefficients", example.distortion.double().numpy())
    storage.startWriteStruct("mount", cv2.FileNode_MAP)
    mount = {"height_m": 1.5, "pitch_deg": 6.0, "roll_deg": -3.0, "pitch_std_deg": 0.3, "wave_std_m": 0.02}
    for key, value in mount.items():
        storage.write(key, value)
    storage.endWriteStruct()
    storage.release()
    for got, expected in zip(load_camera(path), example):
        assert torch.equal(got, expected)


def test_focal_std_stands_beside_the_mount(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(ROS + "focal_std_px: 2.5\n")
    assert load_camera(path).focal_std_px.item() == 2.5


def test_eight_coefficients_are_read_while_the_last_three_are_zero(tmp_path, example):
    path = tmp_path / "camera.yaml"
    path.write_text(ROS.replace("0.005]", "0.005, 0, 0, 0]").replace("plumb_bob", "rational_polynomial"))
    assert torch.equal(load_camera(path).distortion, example.distortion)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("camera_matrix", "matrix", "camera_matrix is missing"),
        ("700.5, 0.0", "0.0, 0.0", "camera_matrix: expected a focal length above 0 px, got fx = 0"),
        ("700.5, 0.0", "700.5", "camera_matrix: expected 9 numbers, got 8"),
        ("[700.5", "[wide", "camera_matrix: data: expected a finite number, got 'wide'"),
        ("[700.5", "[1e300", "camera_matrix: data: expected a finite number, got '1e300'"),  # not in float32
        ("700.5, 0.0", "700.5, 1.0", r"camera_matrix: expected \[\[fx, 0, cx\]"),
        ("plumb_bob", "equidistant", "distortion_model: expected plumb_bob or rational_polynomial, got 'equidistant'"),
        ("-0.28, 0.09, ", "", r"distortion_coefficients: expected 4 or 5 numbers .* got 3"),
        (
            "0.005]",
            "0.005, 0, 0, 0, 0, 0.1, 0, 0]",
            r"distortion_coefficients: .* \(thin .*\), got 0, 0.1, 0, 0",
        ),
        ("distortion_coefficients", "distortion", "distortion_coefficients is missing"),
        ("image_width: 640", "image_width: 0", "image_width: expected a whole number of pixels, got 0"),
        ("image_height: 480\n", "", "image_height is missing"),
        ("mount:", "mast:", "mount is missing"),
        ("pitch_std_deg", "pich_std_deg", "mount: unknown key 'pich_std_deg'; expected one of height_m, pitch_deg"),
        ("pitch_deg: 6, ", "", "mount: pitch_deg is missing"),
        ("height_m: 1.5", "height_m: -1.5", "mount: height_m: expected metres above the water, got -1.5"),
        ("pitch_deg: 6", "pitch_deg: 600", "mount: pitch_deg: expected an angle within 180 degrees, got 600"),
        ("pitch_std_deg: 0.3", "pitch_std_deg: -1", "mount: pitch_std_deg: expected a standard deviation"),
        ("pitch_deg: 6", "pitch_deg: .inf", "mount: pitch_deg: expected a finite number, got inf"),
        ("mount: {", "mount: [{", "not valid YAML"),
        (ROS, "just words", "expected a mapping of keys to values, got 'just words'"),
        (ROS, "", "expected a mapping of keys to values, got None"),
    ],
)
def test_bad_files_name_file_and_key(tmp_path, old, new, sentence):
    path = tmp_path / "camera.yaml"
    assert old in ROS
    path.write_text(ROS.replace(old, new))
    with pytest.raises(ValueError, match=r"camera\.yaml: " + sentence):
        load_camera(path)


def test_a_picture_given_as_camera_is_refused(tmp_path):
    path = tmp_path / "camera.jpg"
    path.write_bytes(bytes(range(256)))
    with pytest.raises(ValueError, match=r"camera\.jpg: expected a text file"):
        load_camera(path)


def test_missing_file(tmp_path):
    with pytest.raises(FileNotFoundError, match=r"nowhere\.yaml: no such file"):
        load_camera(tmp_path / "nowhere.yaml")


def test_a_file_holds_one_camera(tmp_path, example):
    with pytest.raises(ValueError, match="one camera, got a batch of 2"):
        save_camera(stack_cameras([example, example]), tmp_path / "camera.yaml")
    with pytest.raises(ValueError, match="style: expected ros or opencv, got 'matlab'"):
        save_camera(example, tmp_path / "camera.yaml", "matlab")
    assert not any(tmp_path.iterdir())
