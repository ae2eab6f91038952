"""The network's families and sizes, its gradients and its conventions."""

import hashlib

import pytest
import torch

from usvnet.network.variants import VARIANTS, PoseNetwork, build_network, check_picture_size

# With kpt_shape [7, 3] and one class, as counted by the authors' own tool (8.4.190).
PUBLISHED_PARAMETERS = {
    "n": 2_688_252,
    "s": 9_716_338,
    "m": 20_906_514,
    "l": 26_163_986,
    "x": 58_789_906,
    "v8n": 3_109_260,
    "v8s": 11_424_146,
    "v8m": 26_420_434,
    "v8l": 44_483_346,
    "v8x": 69_484_434,
    "v8n-p6": 4_922_352,
    "v8s-p6": 18_279_816,
    "v8m-p6": 45_660_824,
    "v8l-p6": 63_488_936,
    "v8x-p6": 99_172_920,
}
# SHA-256 (its beginning) of the lines "name [shape]" of state_dict() as of the first trained checkpoints.
YOLO11_KEYS = {
    "n": "ac1cce9e690e92fc",
    "s": "fcd5285c6e6a83ac",
    "m": "22e09c80d1925650",
    "l": "bdd75ce21fc19042",
    "x": "36a61d92a9081d68",
}
SMALLEST = ("n", "v8n", "v8n-p6")
LONGER_CHAINS = [pytest.param(variant, marks=pytest.mark.slow) for variant in ("l", "v8m", "v8m-p6")]


def on_paper(variant: str) -> PoseNetwork:
    """A network that takes no memory."""
    with torch.device("meta"):
        return build_network(variant)


@pytest.mark.parametrize("variant", VARIANTS)
def test_parameter_counts_are_the_published_ones(variant: str) -> None:
    count = sum(p.numel() for name, p in on_paper(variant).named_parameters() if not name.startswith("heatmap_head."))
    assert count == PUBLISHED_PARAMETERS[variant]


@pytest.mark.parametrize("variant", YOLO11_KEYS)
def test_old_checkpoints_still_fit(variant: str) -> None:
    keys = "".join(f"{name} {list(tensor.shape)}\n" for name, tensor in on_paper(variant).state_dict().items())
    assert hashlib.sha256(keys.encode()).hexdigest().startswith(YOLO11_KEYS[variant])


def test_unknown_variant_is_named() -> None:
    with pytest.raises(ValueError, match=r"variant: got 'q', expected one of n, s, m, l, x, v8n, .*, v8x-p6"):
        build_network("q")


@pytest.fixture(scope="module", params=SMALLEST)
def network(request: pytest.FixtureRequest) -> PoseNetwork:
    torch.manual_seed(0)
    return build_network(request.param).eval()


def test_shapes_and_anchor_centres(network: PoseNetwork) -> None:
    output = network(torch.rand(2, 3, 64, 128))
    anchors = 8 * 16 + 4 * 8 + 2 * 4
    last_centre = [111.5, 47.5]  # integer pixel centres: the last cell of stride 32 covers pixels 96 to 127, 32 to 63
    if network.largest_stride_px == 64:
        anchors, last_centre = anchors + 2, [95.5, 31.5]
    assert output.boxes_px.shape == (2, anchors, 4)
    assert output.keypoints_px.shape == (2, anchors, 7, 2)
    assert output.heatmap_logits.shape == (2, 7, 16, 32)
    assert output.anchors_px[0].tolist() == [3.5, 3.5]  # the first cell of stride 8 covers pixels 0 to 7
    assert output.anchors_px[-1].tolist() == last_centre
    assert output.strides_px[-1] == network.largest_stride_px
    assert (output.boxes_px[..., 2:] > output.boxes_px[..., :2]).all()


@pytest.mark.parametrize("variant", [*SMALLEST, *LONGER_CHAINS])
def test_every_trained_parameter_gets_a_gradient(variant: str) -> None:
    network = build_network(variant)
    output = network(torch.rand(2, 3, 64, 64))
    sum(t.float().square().mean() for t in output[:6]).backward()
    without = [name for name, p in network.named_parameters() if p.grad is None or not p.grad.any()]
    assert without == ["pose_head.bins"]  # the bin distances are constants that the published counts include


def test_scripted_equals_eager_at_two_sizes(network: PoseNetwork) -> None:
    scripted = torch.jit.script(network)
    for rows, columns in ((1, 1), (1, 2)):
        image = torch.rand(1, 3, rows * network.largest_stride_px, columns * network.largest_stride_px)
        for ours, theirs in zip(network(image), scripted(image)):
            torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-4)


@pytest.mark.parametrize("variant", LONGER_CHAINS)
def test_longer_chains_script(variant: str) -> None:
    torch.jit.script(on_paper(variant))


def test_a_picture_does_not_depend_on_its_neighbours(network: PoseNetwork) -> None:
    images = torch.rand(3, 3, 64, 64)
    together, alone = network(images), network(images[1:2])
    torch.testing.assert_close(together.keypoints_px[1:2], alone.keypoints_px, rtol=0, atol=1e-3)


def test_a_size_that_does_not_fit_is_named(network: PoseNetwork) -> None:
    check_picture_size(network, "image_size", 128)
    with pytest.raises(ValueError, match=f"image_size is 80, expected a multiple of {network.largest_stride_px}"):
        check_picture_size(network, "image_size", 80)
