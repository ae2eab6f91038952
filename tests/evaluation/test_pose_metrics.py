import math

import numpy as np
import pytest
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from usvnet.evaluation.pose_metrics import PAPER_SIGMA, STRICT_SIGMA, score_keypoints, score_pose

from .boats import BOX_PX, boat, truth

AREA_PX2 = 80 * 50


def test_perfect_predictions_score_one_at_both_sigmas():
    truths = [[truth()], [truth(), truth(300.0)], []]
    records = [[boat(label) for label in labels] for labels in truths]
    for sigma in (PAPER_SIGMA, STRICT_SIGMA):
        scores = score_pose(records, truths, sigma)
        assert (scores.precision, scores.recall, scores.map50, scores.map50_95) == pytest.approx((1, 1, 1, 1))
        assert scores.boats == 3


@pytest.mark.parametrize("oks", [0.43, 0.52, 0.68, 0.83, 0.99])
def test_a_uniform_error_passes_exactly_the_thresholds_below_its_hand_computed_oks(oks):
    # OKS = exp(-d^2 / (2 area (2 sigma)^2)) solved for d
    error_px = math.sqrt(-math.log(oks) * 2 * AREA_PX2 * (2 * PAPER_SIGMA) ** 2)
    label = truth()
    scores = score_pose([[boat(label, error_px=error_px)]], [[label]], PAPER_SIGMA)
    passed = sum(oks >= threshold for threshold in np.linspace(0.5, 0.95, 10)) / 10
    assert scores.map50_95 == pytest.approx(passed)
    assert scores.map50 == pytest.approx(1.0 if oks > 0.5 else 0.0)


def test_unlabelled_keypoints_do_not_count():
    label = truth(visibility=(2, 2, 2, 2, 1, 1, 0))
    wrong = np.zeros((7, 1))
    wrong[6] = 500.0
    prediction = [[boat(label, error_px=wrong)]]
    assert score_pose(prediction, [[label]], STRICT_SIGMA).map50_95 == pytest.approx(1.0)
    errors = score_keypoints(prediction, [[label]])
    assert errors.overall.n == 6
    assert errors.overall.p95_px == 0.0
    assert errors.by_keypoint["stern_bottom"].n == 0
    assert math.isnan(errors.by_keypoint["stern_bottom"].median_px)


def test_a_small_shift_costs_the_strict_score_and_not_the_loose_one():
    label = truth()
    prediction = [[boat(label, error_px=3.7)]]
    assert score_pose(prediction, [[label]], PAPER_SIGMA).map50_95 == pytest.approx(1.0)
    assert score_pose(prediction, [[label]], STRICT_SIGMA).map50_95 < 0.5


def test_precision_and_recall_of_three_detections_by_hand():
    first, second, third = truth(), truth(200.0), truth(400.0)
    # by score: hit, hit, nothing there; third is never found. F1 = 2/(1+3), 4/(2+3), 4/(3+3): best after two.
    nothing_there = boat(truth(-900.0), score=0.3)
    records = [[boat(first, 0.9), boat(second, 0.6), nothing_there]]
    scores = score_pose(records, [[first, second, third]])
    assert (scores.precision, scores.recall, scores.confidence) == pytest.approx((1.0, 2 / 3, 0.6))
    # the false one in the middle: F1 = 2/4, 2/5, 4/6
    records = [[boat(first, 0.9), boat(second, 0.2), nothing_there]]
    scores = score_pose(records, [[first, second, third]])
    assert (scores.precision, scores.recall, scores.confidence) == pytest.approx((2 / 3, 2 / 3, 0.2))


def test_a_second_box_on_the_same_boat_is_a_false_positive():
    label = truth()
    scores = score_pose([[boat(label, 0.9), boat(label, 0.9)]], [[label]])
    assert (scores.precision, scores.recall) == pytest.approx((0.5, 1.0))  # equal scores cannot be told apart


def test_nothing_found_is_zero_and_nothing_labelled_is_nan():
    scores = score_pose([[], []], [[truth()], []])
    assert (scores.precision, scores.recall, scores.map50, scores.map50_95) == (0, 0, 0, 0)
    assert math.isnan(score_pose([[boat(truth())]], [[]]).map50)


def test_boats_without_a_labelled_keypoint_are_ignored():
    labelled, bare = truth(), truth(300.0, visibility=(0,) * 7)
    scores = score_pose([[boat(labelled), boat(bare)]], [[labelled, bare]])
    assert (scores.precision, scores.recall, scores.map50, scores.boats) == pytest.approx((1, 1, 1, 1))


def test_scores_equal_a_direct_use_of_pycocotools(capsys):
    generator = np.random.default_rng(0)
    truths = [
        [truth(300.0 * n, visibility=generator.integers(0, 3, 7)) for n in range(generator.integers(0, 3))]
        for _ in range(30)
    ]
    records = [
        [
            boat(label, generator.uniform(), generator.normal(0, 2.5, (7, 1)))
            for label in [*labels, truth(600.0)]
            if generator.uniform() < 0.9
        ]
        for labels in truths
    ]
    ours = score_pose(records, truths, STRICT_SIGMA)
    assert capsys.readouterr().out == ""
    assert 0.05 < ours.map50_95 < ours.map50 < 0.95

    coco, annotations, results = COCO(), [], []
    for image, labels in enumerate(truths):
        for label in labels:
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": image,
                    "category_id": 1,
                    "iscrowd": 0,
                    "area": AREA_PX2,
                    "bbox": [*label.box_px[:2], *(BOX_PX[2:] - BOX_PX[:2])],
                    "keypoints": np.c_[label.keypoints_px, label.visibility].ravel().tolist(),
                    "num_keypoints": int((label.visibility > 0).sum()),
                }
            )
        for found in records[image]:
            keypoints = np.c_[found.keypoints_px, np.ones(7)].ravel().tolist()
            results.append({"image_id": image, "category_id": 1, "score": found.score, "keypoints": keypoints})
    coco.dataset = {"images": [{"id": i} for i in range(30)], "annotations": annotations, "categories": [{"id": 1}]}
    coco.createIndex()
    direct = COCOeval(coco, coco.loadRes(results), "keypoints")
    direct.params.kpt_oks_sigmas = np.full(7, STRICT_SIGMA)
    direct.params.maxDets = [20]
    direct.evaluate()
    direct.accumulate()
    precision = direct.eval["precision"][:, :, 0, 0, 0]
    assert ours.map50 == pytest.approx(precision[0].mean(), abs=1e-12)
    assert ours.map50_95 == pytest.approx(precision.mean(), abs=1e-12)


def test_keypoint_errors_by_name_over_seen_and_hidden_and_misses_counted():
    label = truth(visibility=(2, 1, 2, 2, 2, 2, 2))
    error_px = np.arange(7.0)[:, None]
    errors = score_keypoints([[boat(label, error_px=error_px)], [boat(label, score=0.2)]], [[label], [label]])
    assert (errors.matched, errors.missed) == (1, 1)
    assert errors.overall.median_px == pytest.approx(3.0)
    assert errors.overall.p95_px == pytest.approx(5.7)
    assert [scores.median_px for scores in errors.by_keypoint.values()] == pytest.approx(list(range(7)))


def test_lists_of_different_lengths_are_refused():
    with pytest.raises(ValueError, match="predictions of 1 pictures cannot be scored on labels of 2"):
        score_pose([[]], [[], []])
