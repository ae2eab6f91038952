"""All losses of a batch and their weighted sum."""

import torch
from torch import Tensor, nn

from usvnet import heatmap
from usvnet.config import LossWeights
from usvnet.crops import REFINED_STRIDE, Refinement
from usvnet.losses.assigner import Assignment
from usvnet.losses.covariances import covariance_loss
from usvnet.losses.detection import box_loss, classification_loss, distribution_focal_loss, side_distances
from usvnet.losses.keypoints import heatmap_loss, keypoint_loss, visibility_loss
from usvnet.losses.ranges import range_loss
from usvnet.losses.refinement import boats_in_crops
from usvnet.types import Boats, NetworkOutput

HEATMAP_JITTER_CELLS = 3
"""How far off the training windows of the heatmap may sit: as far as a fair coarse keypoint (12 px)."""


class Criterion(nn.Module):
    """The loss of the whole chain, picture to range.

    Args:
        weights: what each loss counts in the total.
        keypoint_sigma: COCO's constant in the similarity of the coarse keypoints.
        heatmap_sigma_cells: standard deviation of the heatmap's target.
        heatmap_radius: half-width of the heatmap's window in cells, as in decoding.

    Raises:
        ValueError: one of the numbers is not positive.
    """

    def __init__(
        self,
        weights: LossWeights,
        keypoint_sigma: float = 0.1,
        heatmap_sigma_cells: float = heatmap.SIGMA_CELLS,
        heatmap_radius: int = heatmap.WINDOW_RADIUS,
    ) -> None:
        super().__init__()
        settings = {
            "keypoint_sigma": keypoint_sigma,
            "heatmap_sigma_cells": heatmap_sigma_cells,
            "heatmap_radius": heatmap_radius,
        }
        for name, value in settings.items():
            if not value > 0:
                raise ValueError(f"{name} must be positive, got {value}")
        self.weights = weights
        self.keypoint_sigma = keypoint_sigma
        self.heatmap_sigma_cells = heatmap_sigma_cells
        self.heatmap_radius = heatmap_radius

    def forward(
        self,
        output: NetworkOutput,
        boats: Boats,
        assignment: Assignment,
        moments: heatmap.Moments,
        slant_m: Tensor,
        slant_valid: Tensor,
        range_scale: Tensor | float = 1.0,
        refinement: Refinement | None = None,
    ) -> dict[str, Tensor]:
        """The losses of a batch.

        In training mode the heatmap's windows are jittered; in evaluation mode the result is deterministic.

        Args:
            output: the network's answer with one class.
            boats: the labelled boats.
            assignment: of this output to these boats, see :func:`usvnet.losses.assigner.assign`.
            moments: of the heatmaps about the keypoints of each boat's best anchor, as they are read in use.
            slant_m: (B, N) predicted slant range of the point that each boat's range label belongs to.
            slant_valid: (B, N) bool, whether that range exists.
            range_scale: further factor on the weights of the range and of the covariance, for a curriculum.
            refinement: the second look at these boats, where there was one.

        Returns:
            Scalars: ``total``, the weighted sum (not multiplied by the batch size), to differentiate; and, detached
            and unweighted, ``box``, ``dfl``, ``classification``, ``keypoint``, ``visibility``, ``heatmap``, ``range``,
            ``covariance`` and, with a refinement, ``refined_heatmap`` and ``refined_covariance``, which have the
            weights of their namesakes.
        """
        picture, anchor = assignment.foreground.nonzero(as_tuple=True)
        boat = assignment.boat_index[picture, anchor]
        weight = assignment.target_score[picture, anchor]
        boxes_px = boats.boxes_px[picture, boat].float()
        visibility = boats.visibility[picture, boat]
        distances = side_distances(boxes_px, output.anchors_px[anchor].float(), output.strides_px[anchor].float())

        losses = {
            "box": box_loss(output.boxes_px[picture, anchor].float(), boxes_px, weight),
            "dfl": distribution_focal_loss(output.box_logits[picture, anchor].float(), distances, weight),
            "classification": classification_loss(output.class_logits[..., 0].float(), assignment.target_score),
            "keypoint": keypoint_loss(
                output.keypoints_px[picture, anchor].float(),
                boats.keypoints_px[picture, boat].float(),
                visibility,
                boxes_px,
                self.keypoint_sigma,
            ),
            "visibility": visibility_loss(output.visibility_logits[picture, anchor].float(), visibility),
            "heatmap": heatmap_loss(
                output.heatmap_logits.float(),
                boats,
                self.heatmap_sigma_cells,
                heatmap.SEARCH_FACTOR * self.heatmap_radius,  # wherever decoding may look, other ends of the boat too
                self._jitter_cells(),
            ),
            "range": range_loss(slant_m.float(), slant_valid, boats)[0],
            "covariance": covariance_loss(moments, boats, self.heatmap_sigma_cells, heatmap.COVARIANCE_FLOOR_PX2),
        }
        if refinement is not None:
            losses |= self._refined(refinement, boats)
        return self._with_total(losses, range_scale)

    def second_look(
        self,
        boats: Boats,
        slant_m: Tensor,
        slant_valid: Tensor,
        range_scale: Tensor | float,
        refinement: Refinement,
    ) -> dict[str, Tensor]:
        """The losses of a refinement that learns alone; arguments and answer as in :meth:`forward`."""
        losses = {"range": range_loss(slant_m.float(), slant_valid, boats)[0]}
        return self._with_total(losses | self._refined(refinement, boats), range_scale)

    def _with_total(self, losses: dict[str, Tensor], range_scale: Tensor | float) -> dict[str, Tensor]:
        scale = {name: getattr(self.weights, name.removeprefix("refined_")) for name in losses}
        for name in scale.keys() & {"range", "covariance", "refined_covariance"}:
            scale[name] *= range_scale
        total = torch.stack([scale[name] * loss for name, loss in losses.items()]).sum()
        return {name: loss.detach() for name, loss in losses.items()} | {"total": total}

    def _jitter_cells(self) -> int:
        return HEATMAP_JITTER_CELLS if self.training else 0

    def _refined(self, refinement: Refinement, boats: Boats) -> dict[str, Tensor]:
        """The losses of the refined heatmaps."""
        logits, labels = refinement.heatmap_logits, boats_in_crops(refinement, boats)
        return {  # one boat a crop, so the whole of it is taught: its keypoints are sought at either end
            "refined_heatmap": heatmap_loss(logits, labels, self.heatmap_sigma_cells, None, stride=REFINED_STRIDE),
            "refined_covariance": covariance_loss(
                refinement.moments, labels, self.heatmap_sigma_cells, heatmap.COVARIANCE_FLOOR_PX2, REFINED_STRIDE
            ),
        }
