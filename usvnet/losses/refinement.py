"""The losses of the refined heatmaps: those of the heatmaps, each crop taken as a picture with one boat."""

import torch

from usvnet.crops import Refinement, inside_crop, to_crop
from usvnet.types import Boats


def boats_in_crops(refinement: Refinement, boats: Boats) -> Boats:
    """The labels of the M boats that were looked at again, (M, 1) of them, in the pixels of their crops.

    A keypoint outside its crop has visibility 0, as it would outside a picture. Boxes and ranges are left as they are:
    the losses of heatmaps do not ask for them.
    """
    chosen = Boats(*[field[refinement.picture, refinement.boat].unsqueeze(1) for field in boats])
    keypoints_px = to_crop(chosen.keypoints_px.squeeze(1), refinement.crops).unsqueeze(1)
    visibility = torch.where(inside_crop(keypoints_px), chosen.visibility, 0)
    return chosen._replace(keypoints_px=keypoints_px, visibility=visibility)
