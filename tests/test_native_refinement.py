"""``refine: native`` from the dataset's pictures to the checkpoint and back to a predictor."""

import json

import cv2
import numpy as np
import pytest
import torch
from lightning.pytorch import Trainer
from torch.utils.data import DataLoader

from usvnet.checkpoints import load_model
from usvnet.config import LossWeights
from usvnet.data.augmentation import AugmentationConfig
from usvnet.data.dataset import BoatDataset, collate
from usvnet.data.pictures import Picture, read_picture
from usvnet.data.records import Frame
from usvnet.data.transforms import warp
from usvnet.deploy.deployed import INPUTS, NATIVE_INPUTS
from usvnet.deploy.export import export_model
from usvnet.deploy.exported import ExportedModel
from usvnet.deploy.predictor import Predictor
from usvnet.deploy.sidecar import sidecar_path
from usvnet.geometry.camera import letterbox_camera, letterbox_matrix, make_camera
from usvnet.model import USVNet
from usvnet.training import USVModule
from usvnet.types import Batch, Native

SIZE_PX = (480, 270)
DOT_PX = np.array([301.0, 180.0])
STILL = dict.fromkeys(("hue", "saturation", "value", "glare", "fog", "dim", "blur", "noise"), 0.0)
RANGE_ALONE = LossWeights(box=0, dfl=0, classification=0, keypoint=0, visibility=0, heatmap=0, range=1, covariance=0)


@pytest.fixture
def frame(tmp_path) -> Frame:
    """A dark picture with one small boat, whose every keypoint is the same bright dot."""
    picture = np.full((SIZE_PX[1], SIZE_PX[0], 3), 60, np.uint8)
    v, u = np.mgrid[: SIZE_PX[1], : SIZE_PX[0]]
    dot = 190 * np.exp(-((u - DOT_PX[0]) ** 2 + (v - DOT_PX[1]) ** 2) / 18)
    cv2.imwrite(str(tmp_path / "0.png"), (picture + dot[..., None]).astype(np.uint8))
    return Frame(
        image_path=tmp_path / "0.png",
        name="train/0.png",
        scene=None,
        camera=make_camera([[400, 0, 239.5], [0, 400, 134.5], [0, 0, 1]], SIZE_PX, height_m=1.5, pitch_rad=0.05),
        boxes_px=np.array([[*(DOT_PX - 18), *(DOT_PX + 18)]]),
        keypoints_px=np.tile(DOT_PX, (1, 7, 1)),
        visibility=np.full((1, 7), 2),
        range_m=np.array([9.0]),
        range_std_m=np.array([0.01]),
        reference=np.array([-1]),
    )


def dot_centre(picture: Picture) -> np.ndarray:
    light = (picture[..., 0].astype(float) - 130).clip(0)
    v, u = np.mgrid[: picture.shape[0], : picture.shape[1]]
    return np.array([(light * u).sum(), (light * v).sum()]) / light.sum()


def native_batch(frame: Frame, image_px: int = 160) -> Batch:
    return collate([BoatDataset([frame], image_px, native_px=480)[0]] * 2)


@pytest.fixture
def untrained_refiner(tmp_path):
    """A checkpoint of size n with a refiner, both of which have learnt nothing but that boats are two strides wide."""
    torch.manual_seed(0)
    model = USVNet("n", refine="native")
    for level in model.network.pose_head.levels:
        level.box[2].bias.data.view(4, 16)[:, 1] += 10
    weights = {f"model.{name}": value for name, value in model.state_dict().items()}
    stamp = {"variant": "n", "curved_water": False, "refine": "native", "image_size": 160}
    torch.save({"usvnet": stamp, "state_dict": weights}, tmp_path / "refined.ckpt")
    return tmp_path / "refined.ckpt"


@pytest.mark.parametrize("augmentation", [None, AugmentationConfig(mosaic=0, paste=0, **STILL)])
def test_both_pictures_show_the_keypoint_where_the_map_between_them_says(frame, augmentation):
    dataset = BoatDataset([frame], 160, augmentation, native_px=480)
    for seed in range(4):
        torch.manual_seed(seed)
        sample = dataset[0]
        batch = collate([sample])
        assert batch.native is not None
        assert batch.native.picture.shape == (1, 3, 480, 480)
        keypoint_px = sample.frame.keypoints_px[0, 0]
        np.testing.assert_allclose(dot_centre(sample.picture), keypoint_px, atol=0.15)
        seen_px = np.append(dot_centre(sample.native), 1.0)
        np.testing.assert_allclose((batch.native.to_image[0].numpy() @ seen_px)[:2], keypoint_px, atol=0.05)


def test_a_letterbox_through_the_native_picture_leads_back(frame):
    dataset = BoatDataset([frame], 160, native_px=472)  # 472 / 160 is no whole number, and neither are the margins
    keypoint = dataset[0].frame.keypoints_px[0, 0]
    np.testing.assert_allclose((dataset.letterbox_matrix(0).numpy() @ [*DOT_PX, 1])[:2], keypoint, atol=1e-9)


def test_without_native_size_a_batch_is_as_it_was(frame):
    assert collate([BoatDataset([frame], 160)[0]]).native is None


def test_range_alone_teaches_the_refiner_and_through_it_the_detector(frame):
    torch.manual_seed(0)
    module = USVModule(refine="native", loss_weights=RANGE_ALONE, range_loss_error=None).train()
    batch = native_batch(frame)
    module.losses(batch)["total"].backward()
    refiner = module.model.refiner.heatmaps.stem.conv.weight.grad
    detector = module.model.network.heatmap_head.heatmap[2].weight.grad
    for gradient in (refiner, detector):
        assert gradient.isfinite().all()
        assert gradient.abs().sum() > 0


def test_a_frozen_detector_is_not_asked_and_stays_as_it_is_while_the_refiner_learns(frame, untrained):
    module = USVModule(refine="native", freeze="detector", initial_weights=str(untrained)).train()
    module.model.network.register_forward_hook(lambda *_: pytest.fail("the detector was asked"))
    batch = native_batch(frame)
    before = {name: value.clone() for name, value in module.model.network.state_dict().items()}
    losses = module.losses(batch)
    losses["total"].backward()
    assert losses.keys() == {"refined_heatmap", "refined_covariance", "range", "total"}
    assert losses["refined_heatmap"] > 0
    assert all(parameter.grad is None for parameter in module.model.network.parameters())
    assert module.model.refiner.heatmaps.stem.conv.weight.grad.abs().sum() > 0
    for name, value in module.model.network.state_dict().items():
        torch.testing.assert_close(value, before[name], rtol=0, atol=0, msg=name)


def test_a_run_leaves_a_frozen_detector_as_it_is_norms_included(frame, untrained):
    """Lightning does not put a model into training mode by itself, so what was never out of it would stay in it."""
    module = USVModule(refine="native", freeze="detector", initial_weights=str(untrained))
    before = {name: value.clone() for name, value in module.model.state_dict().items()}
    loader = DataLoader(BoatDataset([frame] * 2, 160, native_px=480), batch_size=2, collate_fn=collate)
    quiet = dict.fromkeys(("logger", "enable_checkpointing", "enable_progress_bar", "enable_model_summary"), False)
    Trainer(max_steps=2, accelerator="cpu", **quiet).fit(module, loader)
    moved = {name for name, value in module.model.state_dict().items() if not torch.equal(value, before[name])}
    assert "refiner.heatmaps.stem.conv.weight" in moved
    assert not [name for name in moved if name.startswith("network.")]


@pytest.mark.parametrize("settings", [{"refine": "native"}, {}])
def test_nothing_to_freeze_is_refused(settings):
    with pytest.raises(ValueError, match="freeze is detector, which needs initial_weights"):
        USVModule(freeze="detector", **settings)


def test_an_older_checkpoint_starts_a_model_with_a_refiner(untrained):
    detector = load_model(untrained)
    assert detector.refiner is None
    module = USVModule(refine="native", initial_weights=str(untrained))
    for name, value in detector.state_dict().items():
        torch.testing.assert_close(module.model.state_dict()[name], value, rtol=0, atol=0)


def test_a_refiner_comes_back_from_its_checkpoint(untrained_refiner):
    loaded = load_model(untrained_refiner).state_dict()
    for name, value in torch.load(untrained_refiner, weights_only=True)["state_dict"].items():
        torch.testing.assert_close(loaded[name.removeprefix("model.")], value, rtol=0, atol=0)


def test_an_unknown_refinement_is_refused(untrained_refiner):
    checkpoint = torch.load(untrained_refiner, weights_only=True)
    checkpoint["usvnet"]["refine"] = "sonar"
    torch.save(checkpoint, untrained_refiner)
    with pytest.raises(ValueError, match=r"refined\.ckpt: refine: got 'sonar', expected native"):
        load_model(untrained_refiner)


def test_a_predictor_refines_on_the_picture_as_it_comes(untrained_refiner, frame):
    """The frozen script in use must say what the model says of the native pixels, which is not what it says without."""
    picture = read_picture(frame.image_path)
    found = Predictor(untrained_refiner, frame.camera, confidence=0.0)(picture)
    model = load_model(untrained_refiner)
    model.score_threshold = 0.0
    letterbox = letterbox_matrix(frame.camera.size_px[0], (160, 96))
    image = torch.from_numpy(warp(picture, letterbox.double().numpy(), (160, 96))).permute(2, 0, 1)[None] / 255
    native = Native(torch.from_numpy(picture).permute(2, 0, 1)[None], letterbox[None])
    camera = letterbox_camera(frame.camera, (160, 96))
    with torch.inference_mode():
        plain, refined = model(image, camera), model(image, camera, None, native)
    expected = (refined.keypoints_px[0] - letterbox[:2, 2]) / letterbox[0, 0]
    np.testing.assert_allclose(np.stack([boat.keypoints_px for boat in found]), expected.numpy(), atol=0.05)
    assert (refined.keypoints_px - plain.keypoints_px).abs().max() > 0.5


def test_a_file_refines_as_its_checkpoint_does(untrained_refiner, frame, tmp_path):
    path = tmp_path / "model.ts"
    parity = export_model(load_model(untrained_refiner), path, image_size=160)
    assert parity.px <= 0.01
    about = json.loads(sidecar_path(path).read_text())
    assert list(about["inputs"]) == [*INPUTS, *NATIVE_INPUTS]
    assert set(NATIVE_INPUTS) <= set(about["inputs_that_may_be_left_out"])
    picture = read_picture(frame.image_path)
    by_file = Predictor(ExportedModel(path), frame.camera, confidence=0.0)(picture)
    by_model = Predictor(untrained_refiner, frame.camera, confidence=0.0)(picture)
    expected = np.stack([boat.keypoints_px for boat in by_model])
    np.testing.assert_allclose(np.stack([boat.keypoints_px for boat in by_file]), expected, atol=0.05)


@pytest.mark.parametrize("suffix", [".pt2", ".onnx", ".xml"])
def test_formats_that_take_no_native_picture_refuse_a_model_that_refines(untrained_refiner, tmp_path, suffix):
    with pytest.raises(ValueError, match=rf"model\{suffix}: a model with refine: native .* expected \.ts, \.pt"):
        export_model(load_model(untrained_refiner), tmp_path / f"model{suffix}")
    assert list(tmp_path.glob("model*")) == []
