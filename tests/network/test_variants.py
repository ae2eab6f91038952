"""The network's sizes, its gradients and its conventions."""

import pytest
import torch

from usvnet.network.variants import VARIANTS, build_network

# YOLO11-pose with kpt_shape [7, 3] and one class, as counted by its authors' tool.
PUBLISHED_PARAMETERS = {"n": 2_688_252, "s": 9_716_338, "m": 20_906_514, "l": 26_163_986, "x": 58_789_906}


@pytest.mark.parametrize("variant", VARIANTS)
def test_parameter_counts_are_the_published_ones(variant: str) -> None:
    with torch.device("meta"):
        network = build_network(variant)
    count = sum(p.numel() for name, p in network.named_parameters() if not name.startswith("heatmap_head."))
    assert count == PUBLISHED_PARAMETERS[variant]


def test_unknown_variant_is_named() -> None:
    with pytest.raises(ValueError, match=r"variant: got 'q', expected one of n, s, m, l, x"):
        build_network("q")


@pytest.fixture(scope="module")
def network() -> torch.nn.Module:
    torch.manual_seed(0)
    return build_network("n").eval()


def test_shapes_and_anchor_centres(network: torch.nn.Module) -> None:
    output = network(torch.rand(2, 3, 64, 96))
    anchors = 8 * 12 + 4 * 6 + 2 * 3
    assert output.boxes_px.shape == (2, anchors, 4)
    assert output.keypoints_px.shape == (2, anchors, 7, 2)
    assert output.heatmap_logits.shape == (2, 7, 16, 24)
    # Integer pixel centres: the first cell of stride 8 covers pixels 0 to 7, the last of stride 32 pixels 64 to 95.
    assert output.anchors_px[0].tolist() == [3.5, 3.5]
    assert output.anchors_px[-1].tolist() == [79.5, 47.5]
    assert (output.boxes_px[..., 2:] > output.boxes_px[..., :2]).all()


def test_every_trained_parameter_gets_a_gradient() -> None:
    network = build_network("n")
    output = network(torch.rand(2, 3, 64, 64))
    sum(t.float().square().mean() for t in output[:6]).backward()
    without = [name for name, p in network.named_parameters() if p.grad is None or not p.grad.any()]
    assert without == ["pose_head.bins"]  # the bin distances are constants that the published counts include


def test_scripted_equals_eager_at_two_sizes(network: torch.nn.Module) -> None:
    scripted = torch.jit.script(network)
    for size in (64, 96):
        image = torch.rand(1, 3, size, size)
        for ours, theirs in zip(network(image), scripted(image)):
            torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-4)


def test_a_picture_does_not_depend_on_its_neighbours(network: torch.nn.Module) -> None:
    images = torch.rand(3, 3, 64, 64)
    together, alone = network(images), network(images[1:2])
    torch.testing.assert_close(together.keypoints_px[1:2], alone.keypoints_px, rtol=0, atol=1e-3)
