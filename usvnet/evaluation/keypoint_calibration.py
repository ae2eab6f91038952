"""How far keypoints stray beyond what their heatmaps say, measured on labelled boats that were not trained on.

The maximum of the likelihood of :func:`usvnet.losses.covariances.robust_nll` over one number, the share of a boat's
size in :mod:`usvnet.keypoint_noise`: a Student t, so that bow and stern taken for each other do not rule it. Labels of
keypoints are enough, no laser is needed.

One number and no factor on the covariance itself: with both, the likelihood gained little, and the fused ranges of
sixscenes-v0 (val) nothing.
"""

from collections.abc import Sequence

import numpy as np
import torch

from usvnet.evaluation.records import BoatRecord, FloatArray, TruthRecord
from usvnet.losses.covariances import robust_nll

MIN_KEYPOINTS = 200
"""Of about 30 boats. Fewer say too little."""

SHARES: FloatArray = np.concatenate([[0.0], np.geomspace(0.002, 0.2, 47)])
"""Those that are tried, 10 % apart."""


def fit_keypoint_share(boats: Sequence[tuple[BoatRecord, TruthRecord]]) -> float:
    """The share of a boat's size by which its keypoints stray beyond their covariances.

    Args:
        boats: predicted boats, with the covariances of the heatmaps alone, and their labels, in the same pixels.

    Returns:
        0 where fewer than :data:`MIN_KEYPOINTS` keypoints are labelled.
    """
    labelled = [truth.visibility > 0 for _, truth in boats]
    if sum(int(seen.sum()) for seen in labelled) < MIN_KEYPOINTS:
        return 0.0
    errors = [(boat.keypoints_px - truth.keypoints_px)[seen] for (boat, truth), seen in zip(boats, labelled)]
    covariances = [boat.keypoint_covariance_px2[seen] for (boat, _), seen in zip(boats, labelled)]
    sides = [np.clip(boat.box_px[2:] - boat.box_px[:2], 0, None) for boat, _ in boats]
    areas = [np.full(int(seen.sum()), np.prod(side)) for side, seen in zip(sides, labelled)]
    error, covariance, area_px2 = (torch.from_numpy(np.concatenate(parts)) for parts in (errors, covariances, areas))
    unit = torch.eye(2, dtype=covariance.dtype)
    losses = [
        float(robust_nll(error, covariance + (share**2 * area_px2)[:, None, None] * unit).mean()) for share in SHARES
    ]
    return float(SHARES[int(np.argmin(losses))])
