"""The second look: what it may touch, what its gradient reaches, and that it learns."""

import pytest
import torch
from torch import Tensor

from usvnet.crops import Refinement, from_crop, inside_crop
from usvnet.detector_errors import confuse_ends, exchange_ends
from usvnet.heatmap import encode
from usvnet.losses.keypoints import heatmap_loss
from usvnet.losses.refinement import boats_in_crops
from usvnet.network.refiner import Refiner
from usvnet.types import NEAREST_WATERLINE, Boats, Native

SCALE = 3
"""Native pixels of one pixel of the image."""
IMAGE_PX = 64
COLOURS = torch.tensor([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0], [255, 0, 255], [0, 255, 255], [0, 0, 0]])
TO_IMAGE = torch.tensor([[1 / SCALE, 0, 0.5 / SCALE - 0.5], [0, 1 / SCALE, 0.5 / SCALE - 0.5], [0, 0, 1]])


def boats(count: int) -> Boats:
    """One boat of seven keypoints in each of ``count`` images, somewhere in a box of 24 x 16 px."""
    keypoints_px = torch.rand(count, 1, 7, 2) * torch.tensor([20.0, 12.0]) + 22
    return Boats(
        boxes_px=torch.tensor([20.0, 20, 44, 36]).expand(count, 1, 4),
        keypoints_px=keypoints_px,
        visibility=torch.full((count, 1, 7), 2),
        present=torch.ones(count, 1, dtype=torch.bool),
        range_m=torch.zeros(count, 1),
        range_std_m=torch.zeros(count, 1),
        reference=torch.full((count, 1), NEAREST_WATERLINE),
    )


def seen(labels: Boats) -> Native:
    """Native pictures of the boats: a soft dot of its own colour on each keypoint."""
    side = torch.arange(float(SCALE * IMAGE_PX))
    native_px = (labels.keypoints_px[:, 0] - TO_IMAGE[:2, 2]) * SCALE
    near = [torch.exp(-(side - native_px[..., axis, None]).square() / 8) for axis in (0, 1)]
    dots = torch.einsum("bkv,bku->bkvu", near[1], near[0])
    picture = torch.full((len(dots), 3, len(side), len(side)), 128.0)
    for dot, colour in zip(dots.unbind(1), COLOURS):
        picture = torch.lerp(picture, colour[:, None, None].float(), dot[:, None])
    return Native(picture.to(torch.uint8), TO_IMAGE.expand(len(dots), 3, 3))


def look(refiner: Refiner, labels: Boats, error_px: float, confused: float = 0.0) -> Refinement:
    """Refine from keypoints ``error_px`` off along each axis, in the image's pixels, and some boats' at wrong ends."""
    keypoints_px = confuse_ends(labels.keypoints_px, labels.visibility, confused)
    keypoints_px = keypoints_px + error_px * torch.randn_like(keypoints_px)
    covariance_px2 = torch.eye(2).expand(*keypoints_px.shape, 2)
    refined: Refinement = refiner(seen(labels), labels.boxes_px, keypoints_px, covariance_px2, labels.present)
    return refined


def median_error_px(refiner: Refiner, labels: Boats, confused: float = 0.0) -> float:
    with torch.no_grad():
        found = look(refiner, labels, 1.0, confused)
    return float((found.keypoints_px - labels.keypoints_px).norm(dim=-1).median())


def refiner(seed: int = 0) -> Refiner:
    torch.manual_seed(seed)
    return Refiner().eval()


def test_a_short_run_learns_to_be_five_times_as_exact_as_untrained_and_as_its_hints_at_either_end():
    model, unseen = refiner(), boats(8)
    untrained_px = median_error_px(model, unseen)
    optimiser = torch.optim.AdamW(model.parameters(), lr=0.003)
    model.train()
    for _ in range(40):
        labels = boats(4)
        found = look(model, labels, error_px=1.0, confused=0.5)
        loss: Tensor = heatmap_loss(found.heatmap_logits, boats_in_crops(found, labels), 1.0, None, stride=model.stride)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    for norm in (module for module in model.modules() if isinstance(module, torch.nn.BatchNorm2d)):
        norm.momentum = None  # an average over all batches: 0.03 still remembers its arbitrary start
        norm.reset_running_stats()
    with torch.no_grad():
        for _ in range(4):
            look(model, boats(4), error_px=1.0)
    model.eval()
    hints_px = 1.18  # their own median error, where they are at the right ends; 7.0 where they are not
    assert untrained_px > hints_px  # 7.5
    for confused in (0.0, 1.0):
        assert median_error_px(model, unseen, confused) < hints_px / 5  # 0.03


def test_scripted_equals_eager():
    model, labels = refiner(), boats(3)
    covariance_px2 = torch.eye(2).expand(3, 1, 7, 2, 2)
    arguments = (seen(labels), labels.boxes_px, labels.keypoints_px, covariance_px2, labels.present)
    with torch.no_grad():
        eager, scripted = model(*arguments), torch.jit.script(model)(*arguments)
    assert (eager.keypoints_px != labels.keypoints_px).any()
    torch.testing.assert_close(scripted.keypoints_px, eager.keypoints_px, rtol=0, atol=1e-4)
    torch.testing.assert_close(scripted.covariance_px2, eager.covariance_px2, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("larger", [1, 12])  # 12: 288 px long, of which a crop shows every second pixel
def test_perfect_heatmaps_give_the_labels_back(larger):
    """What the crop's pixels say must land on the image's, through stride, crop and letterbox."""
    model, labels = refiner(), boats(3)
    labels = labels._replace(boxes_px=larger * labels.boxes_px, keypoints_px=larger * labels.keypoints_px)
    variance_cells2 = model.hint_sigma_cells**2
    model.heatmaps.forward = lambda crop, hints: variance_cells2 * hints.clamp(min=1e-30).log()  # the hints are right
    found = look(model, labels, error_px=0.0)
    torch.testing.assert_close(found.keypoints_px, labels.keypoints_px, rtol=0, atol=0.02 * larger)
    torch.testing.assert_close(from_crop(found.hints_px, found.crops), labels.keypoints_px[:, 0], rtol=1e-5, atol=1e-4)


def test_boats_that_are_not_there_are_left_alone():
    model, labels = refiner(), boats(2)
    found = look(model, labels._replace(present=torch.zeros_like(labels.present)), error_px=0.0)
    assert len(found.picture) == 0
    torch.testing.assert_close(found.keypoints_px, labels.keypoints_px, rtol=0, atol=0)
    torch.testing.assert_close(found.covariance_px2, torch.eye(2).expand(2, 1, 7, 2, 2), rtol=0, atol=0)


def test_the_gradient_reaches_every_weight_and_the_detector_s_keypoints():
    model, labels = refiner(), boats(2)
    keypoints_px = labels.keypoints_px.clone().requires_grad_()
    covariance_px2 = torch.eye(2).expand(2, 1, 7, 2, 2)
    found = model(seen(labels), labels.boxes_px, keypoints_px, covariance_px2, labels.present)
    (found.keypoints_px.sum() + found.covariance_px2.sum()).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad.isfinite().all(), name
        assert name == "heatmaps.heatmap.bias" or parameter.grad.abs().sum() > 0, name  # softmax knows no constant
    assert keypoints_px.grad.isfinite().all()
    assert keypoints_px.grad.abs().sum() > 0


def test_a_boat_whose_hints_lie_at_its_other_end_is_read_where_its_heatmaps_are_highest():
    model, labels = refiner(), boats(2)
    exact = look(model, labels, error_px=0.0)
    logits = encode(exact.hints_px, model.cells, model.cells, model.stride, 1.0)
    model.heatmaps.forward = lambda crop, hints: logits
    found = look(model, labels._replace(keypoints_px=exchange_ends(labels.keypoints_px)), error_px=0.0)
    torch.testing.assert_close(found.keypoints_px, labels.keypoints_px, rtol=0, atol=0.02)


def test_a_batch_without_boats_trains_without_nan():
    model = refiner().train()
    labels = boats(2)
    found = look(model, labels._replace(present=torch.zeros_like(labels.present)), error_px=0.0)
    found.heatmap_logits.sum().backward()
    assert all(parameter.grad.isfinite().all() for parameter in model.parameters())
    assert all(buffer.isfinite().all() for buffer in model.buffers())


def test_a_boat_is_seen_alike_however_many_there_are():
    model, labels = refiner(), boats(5)
    with torch.no_grad():
        together = look(model, labels, error_px=0.0)
        model.crops_at_once = 2
        in_turn = look(model, labels, error_px=0.0)
    torch.testing.assert_close(in_turn.heatmap_logits, together.heatmap_logits, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(in_turn.keypoints_px, together.keypoints_px, rtol=0, atol=1e-3)


def test_in_use_it_looks_again_with_its_own_keypoints_as_hints_wherever_the_first_ones_lay():
    model, labels = refiner(), boats(1)
    hinted: list[Tensor] = []
    exact = look(model, labels, error_px=0.0).hints_px
    logits = encode(exact, model.cells, model.cells, model.stride, 1.0)

    def draw(crop: Tensor, hints_px: Tensor) -> Tensor:
        hinted.append(hints_px)
        return logits

    model.draw = draw
    strayed_px = labels.keypoints_px + 2.0
    strayed_px[0, 0, 5] = 500.0  # outside the crop
    found = look(model, labels._replace(keypoints_px=strayed_px), error_px=0.0)
    assert len(hinted) == 2
    torch.testing.assert_close(hinted[0], found.hints_px)
    assert inside_crop(hinted[0]).sum() == 6
    torch.testing.assert_close(hinted[1], exact, rtol=0, atol=0.1)
    torch.testing.assert_close(found.keypoints_px, labels.keypoints_px, rtol=0, atol=0.02)
    look(model.train(), labels, error_px=0.0)
    assert len(hinted) == 3  # training looks once
