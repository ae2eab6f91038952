"""A crop and its image are one scale and one shift apart, and the crop shows what lies there in the native picture."""

import pytest
import torch
from torch.nn import functional

from usvnet.crops import (
    CROP_SIZE_PX,
    MARGIN,
    MIN_STEP_NATIVE_PX,
    Crops,
    bilinear,
    cut,
    from_crop,
    inside_crop,
    place_crops,
    to_crop,
)
from usvnet.geometry.camera import letterbox_matrix
from usvnet.types import Native

BOXES_PX = torch.tensor([[20.0, 30, 26, 33], [100, 60, 180, 90], [60.5, 10, 62, 40]], dtype=torch.float64)
TO_IMAGE = letterbox_matrix(torch.tensor([1920.0, 1080.0], dtype=torch.float64), (640, 384))


def crops() -> Crops:
    return place_crops(BOXES_PX, TO_IMAGE.expand(3, 3, 3))


def ramp(height: int, width: int, slope: float) -> torch.Tensor:
    """A picture whose red is ``slope`` times the column and whose green is as much times the row."""
    v, u = torch.meshgrid(torch.arange(height), torch.arange(width), indexing="ij")
    return slope * torch.stack([u, v, torch.zeros_like(u)])[None].double()


def test_there_and_back_is_exact():
    points_px = torch.rand(3, 7, 2, dtype=torch.float64) * 600
    torch.testing.assert_close(from_crop(to_crop(points_px, crops()), crops()), points_px, rtol=0, atol=1e-9)


def test_gradients_of_both_ways():
    points_px = torch.rand(3, 2, 2, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda p: to_crop(p, crops()), points_px)
    assert torch.autograd.gradcheck(lambda p: from_crop(p, crops()), points_px)


def test_a_box_lies_in_the_middle_with_its_margin():
    corners = to_crop(BOXES_PX.view(3, 2, 2), crops())
    torch.testing.assert_close(corners.mean(1), torch.full((3, 2), (CROP_SIZE_PX - 1) / 2, dtype=torch.float64))
    assert inside_crop(corners).all()
    assert (corners[1, 1] - corners[1, 0]).max() == pytest.approx(CROP_SIZE_PX / MARGIN)


def test_small_boats_are_not_enlarged_without_end():
    native_px_in_image = float(TO_IMAGE[0, 0])
    assert crops().step_px[0].item() == pytest.approx(MIN_STEP_NATIVE_PX * native_px_in_image)
    assert crops().step_px[1].item() > MIN_STEP_NATIVE_PX * native_px_in_image


def test_places_have_no_gradient():
    boxes_px = BOXES_PX.clone().requires_grad_()
    assert not any(field.requires_grad for field in place_crops(boxes_px, TO_IMAGE.expand(3, 3, 3)))


def test_a_crop_shows_the_native_pixel_that_lies_there():
    """In a picture of its own coordinates each crop pixel must read where it lies, letterboxed or not."""
    native = Native(ramp(1080, 1920, 0.1), TO_IMAGE[None])
    shown = cut(native, torch.zeros(3, dtype=torch.int64), crops()) * 255 / 0.1
    side = torch.arange(float(CROP_SIZE_PX)).double()
    grid = torch.stack(torch.meshgrid(side, side, indexing="xy"), -1).view(1, -1, 2).expand(3, -1, -1)
    image_px = from_crop(grid, crops())
    expected = (image_px - TO_IMAGE[:2, 2]) / TO_IMAGE[0, 0]
    within = ((expected > 1) & (expected < torch.tensor([1918.0, 1078.0]))).all(-1)
    assert within.sum() > 40_000
    torch.testing.assert_close(shown[:, :2].flatten(2).transpose(1, 2)[within], expected[within], rtol=0, atol=1e-6)


def test_beyond_the_edge_the_edge_is_repeated():
    native = Native(ramp(1080, 1920, 0.1), TO_IMAGE[None])
    boxes_px = torch.tensor([[-20.0, 100, 20, 110]], dtype=torch.float64)
    shown = cut(native, torch.zeros(1, dtype=torch.int64), place_crops(boxes_px, TO_IMAGE[None]))
    assert (shown[0, 0, :, : CROP_SIZE_PX // 2 - 4] == 0).all()
    assert (shown[0, 0, :, CROP_SIZE_PX // 2 + 6 :] > 0).all()


def test_a_shrunk_crop_does_not_alias():
    """Stripes one native pixel wide, seen at every other pixel, would be all black or all white."""
    stripes = torch.zeros(1, 3, 300, 600, dtype=torch.uint8)
    stripes[..., ::2] = 255
    boxes_px = torch.tensor([[100.0, 60, 100 + 2 * CROP_SIZE_PX / MARGIN, 100]])
    identity = torch.eye(3)[None]
    shown = cut(Native(stripes, identity), torch.zeros(1, dtype=torch.int64), place_crops(boxes_px, identity))
    assert ((shown - 0.5).abs() < 0.1).all()


def test_interpolation_equals_that_of_torch_at_each_of_several_pictures():
    torch.manual_seed(0)
    pictures = torch.rand(2, 3, 11, 17, dtype=torch.float64)
    index = torch.tensor([1, 0, 1])
    u_px, v_px = torch.rand(3, 9, dtype=torch.float64) * 20 - 2, torch.rand(3, 5, dtype=torch.float64) * 14 - 2
    grid = torch.stack([u_px[:, None].expand(3, 5, 9) / 8 - 1, v_px[:, :, None].expand(3, 5, 9) / 5 - 1], -1)
    expected = functional.grid_sample(pictures[index], grid, padding_mode="border", align_corners=True)
    found = bilinear(pictures, index, u_px, v_px).permute(0, 3, 1, 2)
    torch.testing.assert_close(found, expected)


def test_gradients_of_interpolation():
    pictures = torch.rand(2, 2, 4, 5, dtype=torch.float64, requires_grad=True)
    u_px = torch.tensor([[0.3, 2.6], [1.2, 3.4]], dtype=torch.float64, requires_grad=True)
    v_px = torch.tensor([[0.7, 2.1], [1.6, 2.2]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda p, u, v: bilinear(p, torch.tensor([1, 0]), u, v), (pictures, u_px, v_px))
