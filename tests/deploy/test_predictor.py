"""Native pixels in and out: the network's view of a picture, mapped back, is the picture's own."""

import numpy as np
import pytest
import torch

from usvnet.checkpoints import load_model
from usvnet.data.transforms import warp
from usvnet.deploy import predictor as room
from usvnet.deploy.predictor import Predictor, best_estimator, check_estimator, default_checkpoint, fit_camera
from usvnet.evaluation.records import ESTIMATORS, to_records
from usvnet.geometry.camera import letterbox_camera, letterbox_matrix, make_camera, scale_camera
from usvnet.geometry.camera_files import save_camera
from usvnet.geometry.hull_files import save_hull
from usvnet.geometry.hull_model import generic_hull

WIDTH, HEIGHT = 200, 120
SIZE_PX = 96


@pytest.fixture(scope="module")
def camera():
    K = [[210.0, 0, 99.5], [0, 205.0, 59.5], [0, 0, 1]]
    return make_camera(K, (WIDTH, HEIGHT), height_m=2.0, pitch_rad=0.12, roll_rad=0.02, pitch_std_rad=0.004)


@pytest.fixture(scope="module")
def predictor(untrained, camera):
    return Predictor(untrained, camera, image_size=SIZE_PX, confidence=0.0)


@pytest.fixture(scope="module")
def picture():
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 255, (HEIGHT // 8, WIDTH // 8, 3), np.uint8)
    return np.repeat(np.repeat(coarse, 8, 0), 8, 1)


def test_native_pixels_are_the_letterboxed_ones_mapped_back(untrained, camera, predictor, picture):
    input_px = (96, 64)
    assert predictor.input_size_px(camera) == input_px
    letterbox = letterbox_matrix(camera.size_px[0].double(), input_px)
    seen = torch.from_numpy(warp(picture, letterbox.numpy(), input_px)).permute(2, 0, 1)[None] / 255
    model = load_model(untrained)
    model.score_threshold = 0.0
    with torch.inference_mode():
        expected = to_records(model(seen, letterbox_camera(camera, input_px)))[0]
    found = predictor(picture)
    assert len(found) == len(expected) > 5
    scale, shift = float(letterbox[0, 0]), letterbox[:2, 2].numpy()
    for native, inside in zip(found, expected):
        np.testing.assert_allclose(native.keypoints_px * scale + shift, inside.keypoints_px, atol=0.01)
        np.testing.assert_allclose(native.box_px.reshape(2, 2) * scale + shift, inside.box_px.reshape(2, 2), atol=0.01)
        covariance = native.keypoint_covariance_px2 * scale**2
        np.testing.assert_allclose(covariance, inside.keypoint_covariance_px2, rtol=1e-3, atol=1e-5)
        for name in ESTIMATORS:
            if inside.ranges[name].usable and inside.ranges[name].slant_m < 100:
                assert native.ranges[name].slant_m == pytest.approx(inside.ranges[name].slant_m, rel=1e-3)


def test_pictures_together_are_pictures_one_by_one(predictor, picture):
    mirrored = picture[:, ::-1]
    together = predictor.predict([picture, mirrored])
    for one, alone in zip(together, (picture, mirrored)):
        for boat, same in zip(one, predictor(alone), strict=True):
            np.testing.assert_allclose(boat.keypoints_px, same.keypoints_px, atol=1e-3)


def test_a_picture_of_twice_the_size_gives_twice_the_pixels_and_the_same_ranges(predictor, picture):
    large = np.repeat(np.repeat(picture, 2, 0), 2, 1)
    best, larger = predictor(picture)[0], predictor(large)[0]
    np.testing.assert_allclose(larger.keypoints_px, 2 * best.keypoints_px + 0.5, atol=1.0)
    assert larger.ranges["waterline"].slant_m == pytest.approx(best.ranges["waterline"].slant_m, rel=0.02)
    assert predictor.sizes_px == [(WIDTH, HEIGHT), (2 * WIDTH, 2 * HEIGHT)]


def test_files_and_objects_are_the_same_and_confidence_counts(untrained, camera, tmp_path, predictor, picture):
    boats = predictor(picture)
    scores = [boat.score for boat in boats]
    assert scores == sorted(scores, reverse=True)
    save_camera(camera, tmp_path / "camera.yaml")
    model = load_model(untrained)
    before = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    fewer = Predictor(model, tmp_path / "camera.yaml", None, SIZE_PX, (scores[1] + scores[2]) / 2)(picture)
    assert len(fewer) == 2
    for boat, same in zip(fewer, boats):
        np.testing.assert_allclose(boat.keypoints_px, same.keypoints_px, atol=1e-3)
    assert all(torch.equal(before[name], tensor) for name, tensor in model.state_dict().items())


def test_a_hull_is_used_by_the_estimators_that_know_hulls(untrained, camera, tmp_path, picture, monkeypatch):
    monkeypatch.setattr(room, "_made_fast", lambda model, confidence: model)
    small, large = generic_hull(), generic_hull()
    exact = torch.tensor([0.001])
    save_hull(small._replace(scale_std=exact), tmp_path / "hull.yaml")
    fitted = [
        Predictor(untrained, camera, hull, SIZE_PX, 0.0)(picture)
        for hull in (tmp_path / "hull.yaml", large._replace(points_m=5 * large.points_m, scale_std=exact))
    ]
    assert any(one.ranges["hull"].slant_m != other.ranges["hull"].slant_m for one, other in zip(*fitted))
    for one, other in zip(*fitted, strict=True):
        assert one.ranges["waterline"].slant_m == other.ranges["waterline"].slant_m


def test_the_size_that_it_was_trained_on_is_the_default(tmp_path, untrained, camera, monkeypatch):
    monkeypatch.setattr(room, "_made_fast", lambda model, confidence: model)
    checkpoint = torch.load(untrained, weights_only=True)
    checkpoint["usvnet"]["image_size"] = 160
    torch.save(checkpoint, tmp_path / "best.ckpt")
    assert Predictor(tmp_path / "best.ckpt", camera).input_size_px(camera) == (160, 96)
    assert Predictor(untrained, camera).input_size_px(camera) == (640, 384)


def test_a_camera_is_scaled_to_its_shape_and_no_other():
    camera = make_camera([[1000.0, 0, 959.5], [0, 1000.0, 539.5], [0, 0, 1]], (1920, 1080), height_m=2.0)
    assert fit_camera(camera, 1920, 1080) is camera
    smaller = fit_camera(camera, 1280, 720)
    for field, expected in zip(smaller, scale_camera(camera, (1280, 720))):
        assert torch.equal(field, expected)
    assert fit_camera(camera, 1366, 768).size_px.tolist() == [[1366, 768]]  # whole pixels round the shape a little
    with pytest.raises(ValueError, match=r"front\.yaml .* 1920 x 1080, but these are 640 x 480, .* another shape"):
        fit_camera(camera, 640, 480, "front.yaml")
    with pytest.raises(ValueError, match="another shape"):
        fit_camera(camera, 1080, 1920)


def test_what_cannot_be_is_refused(untrained, camera, predictor, picture, monkeypatch):
    monkeypatch.setattr(room, "_made_fast", lambda model, confidence: model)
    with pytest.raises(ValueError, match="another shape"):
        predictor(picture[:100])
    with pytest.raises(ValueError, match="2 sizes"):
        predictor.predict([picture, picture[:100]])
    with pytest.raises(ValueError, match=r"confidence: got 1\.5"):
        Predictor(untrained, camera, confidence=1.5)
    with pytest.raises(ValueError, match="image_size: got 8"):
        Predictor(untrained, camera, image_size=8)
    with pytest.raises(ValueError, match=r"estimator: got 'sonar', expected one of .*waterline"):
        check_estimator("sonar")
    with pytest.raises(FileNotFoundError, match="no such checkpoint"):
        Predictor("no.ckpt", camera)


def test_the_best_estimator_is_one_that_there_is():
    assert best_estimator() in ESTIMATORS
    assert best_estimator() != "box_bottom"


def test_weights_that_came_along_are_found_or_asked_for(tmp_path, monkeypatch):
    package = tmp_path / "usvnet" / "deploy"
    monkeypatch.setattr(room, "__file__", str(package / "predictor.py"))
    with pytest.raises(FileNotFoundError, match="name some with --checkpoint"):
        default_checkpoint()
    (tmp_path / "checkpoints").mkdir()
    (tmp_path / "checkpoints" / "usvnet-n.pt").touch()
    assert default_checkpoint() == tmp_path / "checkpoints" / "usvnet-n.pt"
    with pytest.raises(FileNotFoundError, match="name some with --checkpoint"):
        default_checkpoint(refine=True)
    (tmp_path / "checkpoints" / "usvnet-n-refine.pt").touch()
    assert default_checkpoint(refine=True) == tmp_path / "checkpoints" / "usvnet-n-refine.pt"


@pytest.mark.parametrize("device", ["cuda:99", "gpu"])
def test_a_device_that_is_not_there_is_refused(untrained, camera, device):
    with pytest.raises(ValueError, match=f"device: got '{device}'.*cpu always works"):
        Predictor(untrained, camera, device=device)
