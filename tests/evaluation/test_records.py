from dataclasses import replace

import numpy as np
import pytest
import torch

from usvnet.data.dataset import BoatDataset, collate
from usvnet.evaluation.evaluator import frame_truths
from usvnet.evaluation.examples import find_examples
from usvnet.evaluation.range_metrics import ranged_boats
from usvnet.evaluation.records import ESTIMATORS, match_boats, to_records, to_truths
from usvnet.types import Boats, Prediction, RangeEstimate, Reason

from .boats import boat, truth

LETTERBOX = torch.tensor([[[0.5, 0.0, 3.0], [0.0, 0.5, 83.0], [0.0, 0.0, 1.0]]])


def estimate(slant_m):
    slant_m = torch.as_tensor(slant_m)
    return RangeEstimate(
        slant_m,
        0.1 * slant_m,
        0.9 * slant_m,
        0 * slant_m,
        torch.zeros(*slant_m.shape, 3),
        torch.isfinite(slant_m),
        torch.isinf(slant_m).long(),
    )


def prediction():
    torch.manual_seed(0)
    return Prediction(
        boxes_px=torch.rand(1, 3, 4) * 100,
        scores=torch.tensor([[0.4, 0.8, 0.0]], requires_grad=True),
        keypoints_px=torch.rand(1, 3, 7, 2) * 100,
        keypoint_covariance_px2=torch.eye(2).expand(1, 3, 7, 2, 2),
        visibility=torch.rand(1, 3, 7),
        present=torch.tensor([[True, True, False]]),
        box_bottom=estimate([[5.0, float("inf"), 0.0]]),
        waterline=estimate([[6.0, 7.0, 0.0]]),
        hull=estimate([[6.5, 7.5, 0.0]]),
        fused=estimate([[6.6, 7.6, 0.0]]),
        heading_rad=torch.tensor([[0.1, 0.2, 0.3]]),
        heading_std_rad=torch.tensor([[0.01, 0.02, 0.03]]),
        misfit=torch.tensor([[0.4, 0.5, 0.6]]),
    )


def test_estimators_are_the_range_estimates_of_a_prediction():
    assert ESTIMATORS == ("box_bottom", "waterline", "hull", "fused")


def test_boats_come_best_first_without_padding():
    batch = prediction()
    (records,) = to_records(batch)
    assert [round(record.score, 6) for record in records] == [0.8, 0.4]
    np.testing.assert_allclose(records[0].box_px, batch.boxes_px[0, 1])
    assert records[0].ranges["waterline"].slant_m == 7.0
    assert (records[0].heading_rad, records[0].misfit) == pytest.approx((0.2, 0.5))
    assert not records[0].ranges["box_bottom"].usable
    assert records[0].ranges["box_bottom"].reason == Reason.HORIZON
    assert records[1].ranges["box_bottom"].usable


def test_a_letterbox_is_undone_and_leaves_ranges_alone():
    batch = prediction()
    (records,), (native,) = to_records(batch), to_records(batch, LETTERBOX)
    for moved, back in zip(records, native):
        np.testing.assert_allclose(back.keypoints_px * 0.5 + [3.0, 83.0], moved.keypoints_px)
        np.testing.assert_allclose(back.box_px * 0.5 + [3.0, 83.0, 3.0, 83.0], moved.box_px)
        np.testing.assert_allclose(back.keypoint_covariance_px2, 4 * moved.keypoint_covariance_px2)
        assert back.ranges["waterline"].slant_m == moved.ranges["waterline"].slant_m


def test_labels_leave_out_padding_and_carry_the_scene():
    boats = Boats(
        boxes_px=torch.ones(1, 2, 4),
        keypoints_px=torch.ones(1, 2, 7, 2),
        visibility=torch.full((1, 2, 7), 2),
        present=torch.tensor([[False, True]]),
        range_m=torch.tensor([[0.0, 9.5]]),
        range_std_m=torch.tensor([[0.0, 0.5]]),
        reference=torch.tensor([[-1, 3]]),
    )
    ((label,),) = to_truths(boats, ["IV"], LETTERBOX)
    assert (label.range_m, label.range_std_m, label.reference, label.scene) == (9.5, 0.5, 3, "IV")
    np.testing.assert_allclose(label.keypoints_px[0], [-4.0, -164.0])


def test_each_labelled_boat_is_matched_once():
    first, second = truth(), truth(30.0)  # overlapping boxes
    best, other = boat(second, 0.9), boat(second, 0.8)
    assert match_boats([other, best], [first, second]) == [other, best]
    assert match_boats([best], [first, second]) == [None, best]
    assert match_boats([best], []) == []


def test_neither_label_goes_to_a_boat_that_is_found_twice():
    first, second = truth(), truth(30.0)  # overlapping boxes
    twice, neighbour = boat(truth(4.0), 0.95), boat(truth(33.0), 0.5)
    found = boat(first, 0.9)
    assert match_boats([twice, found, neighbour], [first, second]) == [found, neighbour]
    assert match_boats([boat(first, 0.9), boat(truth(76.0), 0.9)], [truth(200.0), first])[0] is None


def test_boxes_that_hardly_touch_are_of_two_boats():
    assert match_boats([boat(truth(76.0))], [truth(), truth(500.0)]) == [None, None]


@pytest.mark.parametrize(
    ("reference", "visibility", "kept"),
    [
        (-1, [2] * 7, True),
        (3, [2] * 7, True),  # the lower one in the picture
        (6, [2] * 7, False),
        (6, [2, 2, 2, 0, 2, 2, 1], True),
        (3, [2, 2, 2, 0, 2, 2, 1], False),
        (6, [2, 2, 2, 0, 2, 2, 0], True),
    ],
)
def test_a_reading_of_the_farther_waterline_point_is_not_compared(dataset, reference, visibility, kept):
    frame = replace(dataset.frames[0], reference=np.array([reference]), visibility=np.array([visibility]))
    labels = [frame_truths(frame)[0], to_truths(collate([BoatDataset([frame], 128)[0]]).boats)[0][0]]
    assert [label.range_m for label in labels] == pytest.approx([frame.range_m[0] * kept] * 2)
    records, truths = [[boat(labels[0])]], [[labels[0]]]
    assert len(ranged_boats(records, truths)) == kept
    (example,) = find_examples([frame], records, truths, 0.25, "fused")
    assert (example.truth.range_m > 0) == kept
