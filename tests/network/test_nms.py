"""Non-maximum suppression against the textbook's greedy loop."""

import torch

from usvnet.network.nms import pairwise_iou, select_boats, suppress
from usvnet.types import NetworkOutput


def greedy(boxes: torch.Tensor, threshold: float) -> list[int]:
    iou = pairwise_iou(boxes[None])[0]
    kept: list[int] = []
    for i in range(len(boxes)):
        if all(iou[i, j] <= threshold for j in kept):
            kept.append(i)
    return kept


def random_boxes(count: int) -> torch.Tensor:
    corner = torch.rand(count, 2) * 40
    return torch.cat([corner, corner + 5 + torch.rand(count, 2) * 40], 1)


def dense(boxes: torch.Tensor, scores: torch.Tensor) -> NetworkOutput:
    b, a = scores.shape
    return NetworkOutput(
        boxes_px=boxes,
        box_logits=torch.zeros(b, a, 4, 16),
        class_logits=scores.logit()[..., None],
        keypoints_px=torch.arange(a).float()[None, :, None, None].expand(b, a, 7, 2),
        visibility_logits=torch.zeros(b, a, 7),
        heatmap_logits=torch.zeros(b, 7, 4, 4),
        anchors_px=torch.zeros(a, 2),
        strides_px=torch.ones(a),
    )


def test_iou_by_hand() -> None:
    # 2 x 2 and 2 x 4 boxes sharing 2 x 1: 2 / (4 + 8 - 2).
    boxes = torch.tensor([[[0.0, 0, 2, 2], [0, 1, 2, 5], [9, 9, 9, 9]]])
    torch.testing.assert_close(pairwise_iou(boxes)[0, 0], torch.tensor([1.0, 0.2, 0.0]))


def test_suppression_equals_the_greedy_loop() -> None:
    torch.manual_seed(0)
    for threshold in (0.1, 0.3, 0.7):
        boxes = torch.stack([random_boxes(60) for _ in range(4)])
        keep = suppress(boxes, threshold)
        assert [k.nonzero().flatten().tolist() for k in keep] == [greedy(b, threshold) for b in boxes]


def test_a_fallen_box_suppresses_nothing() -> None:
    # A chain: the second falls to the first, so the third, which overlaps only the second, stays.
    boxes = torch.tensor([[[0.0, 0, 10, 10], [4, 0, 14, 10], [8, 0, 18, 10]]])
    assert suppress(boxes, 0.3).tolist() == [[True, False, True]]


def test_boats_come_best_first_and_padded() -> None:
    boxes = torch.tensor([[[0.0, 0, 10, 10], [1, 0, 11, 10], [50, 50, 60, 60], [80, 80, 90, 90]]])
    boats = select_boats(dense(boxes, torch.tensor([[0.5, 0.9, 0.7, 0.0005]])), 5, 0.001, 0.7)
    assert boats.present.tolist() == [[True, True, False, False]]
    torch.testing.assert_close(boats.scores, torch.tensor([[0.9, 0.7, 0.0, 0.0]]))
    assert boats.boxes_px[0, 0].tolist() == [1, 0, 11, 10]
    assert boats.keypoints_px[0, :2, 0, 0].tolist() == [1, 2]
    assert not boats.boxes_px[0, 2:].any()


def test_gradient_reaches_the_chosen_boats() -> None:
    boxes = random_boxes(30)[None].requires_grad_()
    output = dense(boxes, torch.rand(1, 30))
    select_boats(output, 5, 0.001, 0.7).boxes_px.sum().backward()
    assert boxes.grad is not None
    assert boxes.grad.any()
