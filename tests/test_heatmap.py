"""The stride rule, and encode and decode as each other's inverse."""

import pytest
import torch

from usvnet.heatmap import cell_to_px, decode, encode, find_peak, gather_windows, highest_px, px_to_cell

SIGMA, RADIUS = 1.0, 6


@pytest.mark.parametrize("stride", [1, 2, 4, 8, 16, 32])
def test_first_and_last_cell_are_centred_on_their_pixels(stride: int) -> None:
    # A cell covers `stride` pixels, and its centre is the mean of their integer coordinates.
    pixels = torch.arange(3 * stride, dtype=torch.float64).view(3, stride)
    torch.testing.assert_close(cell_to_px(torch.arange(3).double(), stride), pixels.mean(1))
    torch.testing.assert_close(px_to_cell(pixels.mean(1), stride), torch.arange(3).double())


@pytest.mark.parametrize("stride", [2, 4, 8])
def test_decode_inverts_encode(stride: int) -> None:
    torch.manual_seed(stride)
    keypoints = (torch.rand(1, 1, 7, 2, dtype=torch.float64) * 30 + 8) * stride
    logits = encode(keypoints[:, 0], 48, 48, stride, SIGMA)
    coarse = keypoints + torch.randn_like(keypoints) * stride
    found, covariance = decode(logits, coarse, stride, RADIUS, SIGMA)
    torch.testing.assert_close(found, keypoints, rtol=0, atol=1e-4)
    # A perfectly sharp map claims the floor of a tenth of a pixel, no better.
    expected = (0.01 * torch.eye(2, dtype=torch.float64)).expand_as(covariance)
    torch.testing.assert_close(covariance, expected, rtol=0, atol=1e-3)


@pytest.mark.parametrize("edge_px", [-1.0, 0.0, 2.5, 6.0, 11.0])
def test_decode_inverts_encode_at_the_edge(edge_px: float) -> None:
    keypoint = torch.tensor([[[[edge_px, 159.0 - edge_px]]]], dtype=torch.float64)
    found, _ = decode(encode(keypoint[:, 0], 40, 40, 4, SIGMA), keypoint.clamp(0, 159), 4, RADIUS, SIGMA)
    torch.testing.assert_close(found, keypoint, rtol=0, atol=0.01)


def test_several_boats_share_one_map() -> None:
    keypoints = torch.tensor([[[[40.0, 60.0]], [[120.0, 64.0]]]])
    maps = torch.stack([encode(keypoints[:, n], 40, 40, 4, SIGMA) for n in range(2)]).logaddexp(torch.tensor(-20.0))
    found, _ = decode(maps[0].logaddexp(maps[1]), keypoints + 5, 4, RADIUS, SIGMA)
    torch.testing.assert_close(found, keypoints, rtol=0, atol=1e-2)


def test_doubt_becomes_covariance() -> None:
    # A keypoint known to 6 px along u and perfectly along v, seen through the training Gaussian of 4 px.
    cells = torch.stack(torch.meshgrid(torch.arange(40.0), torch.arange(40.0), indexing="xy"), -1)
    doubt_cells = 1.5
    variance = torch.tensor([SIGMA**2 + doubt_cells**2, SIGMA**2])
    logits = -((cells - 20).square() / (2 * variance)).sum(-1)[None, None]
    centre = cell_to_px(torch.full((1, 1, 1, 2), 20.0), 4)
    _, covariance = decode(logits, centre, 4, 12, SIGMA)
    torch.testing.assert_close(covariance[0, 0, 0], torch.tensor([[36.0, 0.0], [0.0, 0.01]]), rtol=1e-3, atol=1e-2)


def test_outside_the_map_the_coarse_keypoint_stands() -> None:
    coarse = torch.tensor([[[[-30.0, 10.0]]]])
    found, covariance = decode(torch.zeros(1, 1, 20, 20), coarse, 4, RADIUS, SIGMA)
    torch.testing.assert_close(found, coarse)
    assert covariance[0, 0, 0, 0, 0] == (RADIUS * 4) ** 2


def test_windows_leave_the_map_without_probability() -> None:
    logits = torch.zeros(1, 1, 5, 5)
    window, cells = gather_windows(logits, torch.tensor([[[[0, 0]]]]), 2)
    assert window.softmax(-1).gt(0).sum() == 9  # of 25 cells, 3 x 3 are on the map
    assert cells[0, 0, 0, 0].tolist() == [-2.0, -2.0]


def test_gradients() -> None:
    torch.manual_seed(0)
    logits = torch.randn(1, 2, 8, 9, dtype=torch.float64, requires_grad=True)
    coarse = torch.tensor([[[[14.0, 15.0], [20.0, 12.0]]]], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: decode(x, coarse, 4, 3, 0.3), (logits,))
    keypoints = torch.rand(3, 2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda p: encode(p * 20, 6, 7, 4, SIGMA), (keypoints,))


def test_flat_maps_have_finite_gradients() -> None:
    logits = torch.zeros(1, 1, 20, 20, requires_grad=True)
    found, covariance = decode(logits, torch.tensor([[[[39.5, 39.5]]]]), 4, RADIUS, SIGMA)
    (found.sum() + covariance.sum()).backward()
    assert logits.grad is not None
    assert logits.grad.isfinite().all()


def test_scripted_equals_eager() -> None:
    torch.manual_seed(0)
    logits, coarse = torch.randn(2, 7, 20, 24), torch.rand(2, 3, 7, 2) * 80
    for ours, theirs in zip(
        decode(logits, coarse, 4, RADIUS, SIGMA), torch.jit.script(decode)(logits, coarse, 4, RADIUS, SIGMA)
    ):
        torch.testing.assert_close(ours, theirs)


def test_a_coarse_keypoint_half_a_boat_off_finds_its_peak_on_a_map_that_is_flat_elsewhere() -> None:
    torch.manual_seed(0)
    keypoint = torch.tensor([[[[100.0, 60.0]]]])
    logits = encode(keypoint[:, 0], 50, 50, 4, SIGMA).clamp(min=-12) + 0.1 * torch.randn(1, 1, 50, 50)
    for coarse in (keypoint + torch.tensor([40.0, 0.0]), keypoint + torch.tensor([-30.0, 26.0])):
        found, covariance = decode(logits, coarse, 4, RADIUS, SIGMA)
        torch.testing.assert_close(found, keypoint, rtol=0, atol=0.5)
        assert covariance.diagonal(dim1=-2, dim2=-1).max() < 4


def test_two_boats_side_by_side_are_not_averaged() -> None:
    """5 cells apart, both in either's window: each coarse keypoint takes the peak that is nearer to it."""
    keypoints = torch.tensor([[[[80.0, 60.0]], [[100.0, 60.0]]]])
    maps = torch.stack([encode(keypoints[:, n], 40, 40, 4, SIGMA) for n in range(2)])
    cells = find_peak(
        maps[0].logaddexp(maps[1]), px_to_cell(keypoints + torch.tensor([[[[-3.0, 2.0]], [[4.0, 0.0]]]]), 4), RADIUS
    )
    torch.testing.assert_close(cells.float(), px_to_cell(keypoints, 4), rtol=0, atol=0.51)


def test_half_precision_maps_are_read_in_single() -> None:
    keypoints = torch.tensor([[[[901.3, 702.9]]]])
    logits = encode(keypoints[:, 0], 256, 256, 4, SIGMA).clamp(min=-12).bfloat16()
    with torch.autocast("cpu", torch.bfloat16):
        found, covariance = decode(logits, keypoints + 5, 4, RADIUS, SIGMA)
    assert found.dtype == covariance.dtype == torch.float32
    torch.testing.assert_close((found, covariance), decode(logits.float(), keypoints + 5, 4, RADIUS, SIGMA))
    torch.testing.assert_close(found, keypoints, rtol=0, atol=0.1)


def test_the_highest_cell_is_found_anywhere_on_a_map_that_is_not_square() -> None:
    keypoints_px = torch.tensor([[[3.0, 90.0], [121.0, 2.0]]])
    found_px = highest_px(encode(keypoints_px, 24, 32, 4, 1.0), 4)
    assert found_px.shape == (1, 2, 2)
    assert ((found_px - keypoints_px).abs() <= 2).all()
