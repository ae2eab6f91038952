"""Weights arrive where they belong: the imported network answers as the peer did, and says what it lacks."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from tests.pretrained.filling import fill, picture
from tests.pretrained.peer_files import STAND_INS, peer_model, peer_shapes, write
from usvnet.model import USVNet
from usvnet.network.variants import VARIANTS
from usvnet.pretrained.importer import import_weights, on_paper

PEER = json.loads((Path(__file__).parent / "peer_answers.json").read_text())
HALF_PX = 0.5
"""The peer's pixel i covers [i, i + 1), ours is centred on i."""


@pytest.mark.parametrize("variant", PEER["answers"])
def test_names_and_shapes_are_the_peers(variant):
    shapes = peer_shapes(variant)
    shapes[f"model.{max(int(name.split('.')[1]) for name in shapes)}.dfl.conv.weight"] = (1, 16, 1, 1)
    names = "".join(f"{name} {list(shape)}\n" for name, shape in sorted(shapes.items()))
    assert hashlib.sha256(names.encode()).hexdigest() == PEER["answers"][variant]["names_sha256"]


@pytest.mark.parametrize("variant", VARIANTS)
def test_every_layer_but_the_heatmap_heads_has_its_pair(variant):
    network, pairs = on_paper(variant)
    layers = pairs.trunk + [layer for levels in pairs.branches.values() for level in levels for layer in level]
    ours = [name for layer in layers for name in layer.tensors(network)]
    theirs = [name for layer in layers for name in layer.tensors(network).values()]
    assert len(set(theirs)) == len(theirs) == len(set(ours))
    rest = {name for name in network.state_dict() if not name.startswith("heatmap_head.")} - set(ours)
    assert rest == {"pose_head.bins"}


@pytest.mark.parametrize("variant", PEER["answers"])
def test_the_imported_network_answers_as_the_peer(variant, tmp_path):
    path = write(tmp_path / "peer.pt", {"model": peer_model(variant).half(), "ema": None})
    found = import_weights(path)
    assert (found.variant, found.keypoints, found.classes, found.key) == (variant, 7, 1, "model")
    assert all(taken == whole for taken, whole in found.taken.values())
    image = torch.from_numpy(picture(PEER["height_px"], PEER["width_px"])).double()
    with torch.inference_mode():
        output = found.model.network.double().eval()(image)
    recorded = PEER["answers"][variant]
    anchors = recorded["anchors"]
    expected = torch.tensor(recorded["cx_cy_w_h_score_keypoints"], dtype=torch.float64)
    centre_px, size_px, keypoints = expected[:, :2] - HALF_PX, expected[:, 2:4], expected[:, 5:].reshape(-1, 7, 3)
    boxes_px = torch.cat([centre_px - size_px / 2, centre_px + size_px / 2], 1)
    torch.testing.assert_close(output.boxes_px[0, anchors].double(), boxes_px, rtol=0, atol=1e-4)
    torch.testing.assert_close(
        output.keypoints_px[0, anchors].double(), keypoints[..., :2] - HALF_PX, rtol=0, atol=1e-4
    )
    torch.testing.assert_close(output.class_logits[0, anchors, 0].double().sigmoid(), expected[:, 4], rtol=0, atol=1e-5)
    visible = output.visibility_logits[0, anchors].double().sigmoid()
    torch.testing.assert_close(visible, keypoints[..., 2], rtol=0, atol=1e-5)


def test_the_average_goes_before_the_model(tmp_path):
    average, last = peer_model("n"), peer_model("n")
    with torch.no_grad():
        last.get_parameter("model.0.conv.weight").zero_()
    found = import_weights(write(tmp_path / "peer.pt", {"model": last, "ema": average}))
    assert found.key == "ema"
    stem = found.model.network.backbone.get_parameter("stem.conv.weight")
    np.testing.assert_array_equal(stem.detach(), fill("model.0.conv.weight", stem.shape))


def changed_layers(found):
    """Which parts of the pose head differ from the drawn network, as ``kind.layer``."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        before, after = USVNet(found.variant).state_dict(), found.model.state_dict()
    names = [name for name in before if not torch.equal(before[name], after[name])]
    heads = {".".join(name.split(".")[4:6]) for name in names if "pose_head.levels.1." in name}
    assert not any("heatmap_head" in name for name in names)
    return heads


BOX = {"box.0", "box.1", "box.2"}


@pytest.mark.parametrize(
    ("variant", "keypoints", "classes", "head", "taken"),
    [
        ("n", 17, 1, "Pose", BOX | {f"score.{i}" for i in range(5)}),  # its keypoint branch is wider than ours
        ("n", 0, 80, "Detect", BOX | {"score.0"}),  # its score branch is wider from the second layer on
        ("s", 0, 80, "Detect", BOX | {f"score.{i}" for i in range(4)}),
        ("m", 17, 1, "Pose", BOX | {f"score.{i}" for i in range(5)} | {"keypoint.0", "keypoint.1"}),
        ("v8s-p6", 0, 80, "Detect", BOX | {"score.0", "score.1"}),
    ],
)
def test_other_keypoints_and_classes_leave_fresh_layers(variant, keypoints, classes, head, taken, tmp_path):
    model = peer_model(variant, keypoints, classes, head)
    found = import_weights(write(tmp_path / "peer.pt", {"model": model.half(), "ema": None}))
    assert (found.variant, found.keypoints, found.classes) == (variant, keypoints, classes)
    assert changed_layers(found) == taken
    levels = len(found.model.network.pose_head.levels)
    assert found.taken["keypoint"][0] == levels * sum(name.startswith("keypoint") for name in taken)
    assert found.taken["score"][0] == levels * sum(name.startswith("score") for name in taken)


def test_the_same_file_gives_the_same_network(tmp_path):
    path = write(tmp_path / "peer.pt", {"model": peer_model("n", 17)})
    torch.manual_seed(5)
    first, state = import_weights(path), torch.get_rng_state()
    second = import_weights(path)
    assert torch.equal(state, torch.get_rng_state())
    for one, other in zip(first.model.state_dict().values(), second.model.state_dict().values()):
        assert torch.equal(one, other)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda model: model._modules["model"].add_module("99", STAND_INS["Block"]()), None),
        (lambda model: model._modules["model"]._modules.pop("3"), "fit none of n, s, .*, v8x-p6"),
        (lambda model: model.get_submodule("model.0").add_module("act", nn.ReLU()), "model.0 has the activation ReLU"),
        (lambda model: model.get_buffer("model.3.bn.running_var").fill_(torch.nan), "running_var holds numbers that"),
    ],
)
def test_another_network_is_refused(change, message, tmp_path):
    model = peer_model("n")
    change(model)
    path = write(tmp_path / "peer.pt", {"model": model})
    if message is None:
        import_weights(path)  # parts without weights do not matter
        return
    with pytest.raises(ValueError, match=message):
        import_weights(path)


def test_another_task_is_refused(tmp_path):
    path = write(tmp_path / "peer.pt", {"model": peer_model("n", head="Segment")})
    with pytest.raises(ValueError, match=r"peer\.pt: got a head of class 'Segment', expected Pose or Detect"):
        import_weights(path)


@pytest.mark.parametrize("content", [{}, {"model": None}, [1, 2], {"model": {"weight": torch.ones(2)}}])
def test_a_file_without_a_model_is_refused(content, tmp_path):
    with pytest.raises(ValueError, match=r"peer\.pt: got a file without a model"):
        import_weights(write(tmp_path / "peer.pt", content))


def test_a_model_that_holds_itself_is_refused(tmp_path):
    model = peer_model("n")
    model._modules["model"]._modules["5"] = model
    with pytest.raises(ValueError, match=r"peer\.pt: refused: its model has more than"):
        import_weights(write(tmp_path / "peer.pt", {"model": model}))
