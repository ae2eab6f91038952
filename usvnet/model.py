"""The whole method in one differentiable module: image -> network -> heatmaps -> keypoints -> camera -> range.

With ``refine="native"`` the keypoints are read a second time, from crops of the picture before it was shrunk
(:mod:`usvnet.network.refiner`).
"""

from typing import Literal

from torch import Tensor, nn

from usvnet.geometry.ranging import RangingLayer
from usvnet.heatmap import decode
from usvnet.intervals import IntervalScale
from usvnet.keypoint_noise import KeypointNoise
from usvnet.network.nms import select_boats
from usvnet.network.refiner import Refiner
from usvnet.network.variants import build_network
from usvnet.types import Camera, Hull, Native, Prediction


class USVNet(nn.Module):
    """How far away is every boat in the picture, and how sure are we?

    Every step is differentiable, so an error in a laser-measured range reaches the first convolution. Training calls
    the same three steps (:attr:`network`, :meth:`locate`, :attr:`ranging`) at the labelled boats' own anchors.

    Args:
        variant: family and size of the network: n, s, m, l, x (YOLO11), v8n, v8s, v8m, v8l, v8x (YOLOv8), v8n-p6,
            v8s-p6, v8m-p6, v8l-p6 or v8x-p6 (YOLOv8-P6).
        max_boats: N, boats reported a picture.
        score_threshold: lowest score reported.
        iou_threshold: boxes overlapping a better one by more than this are dropped (the paper's Table 1: 0.7).
        curved_water: range on the curved Earth with refraction, for long range.
        refine: "native" looks at the boats again in the picture as the camera took it; None does not.

    Raises:
        ValueError: unknown variant or refinement.
    """

    def __init__(
        self,
        variant: str = "n",
        max_boats: int = 20,
        score_threshold: float = 0.001,
        iou_threshold: float = 0.7,
        curved_water: bool = False,
        refine: Literal["native"] | None = None,
    ):
        super().__init__()
        self.variant = variant
        self.max_boats = max_boats
        self.score_threshold = score_threshold
        self.iou_threshold = iou_threshold
        if refine not in (None, "native"):
            raise ValueError(f"refine: got '{refine}', expected native or nothing")
        self.network = build_network(variant)
        self.refiner = Refiner() if refine else None
        self.noise = KeypointNoise()
        self.ranging = RangingLayer(curved_water)
        self.intervals = IntervalScale()

    def forward(
        self, image: Tensor, camera: Camera, hull: Hull | None = None, native: Native | None = None
    ) -> Prediction:
        """Find and range the boats.

        Args:
            image: (B, 3, H, W) RGB in [0, 1]; H and W multiples of the network's ``largest_stride_px``, 32
                (64 with YOLOv8-P6).
            camera: the B cameras of these very pictures (see :func:`usvnet.geometry.camera.letterbox_camera`).
            hull: the shape of the boats in each picture; None takes a generic one of uncertain size.
            native: the pictures that ``image`` was made from, to refine keypoints on; without them, or without
                ``refine``, the keypoints are the detector's.

        Returns:
            Up to N boats a picture, best first.
        """
        output = self.network(image)
        boats = select_boats(output, self.max_boats, self.score_threshold, self.iou_threshold)
        keypoints_px, covariance_px2 = self.locate(output.heatmap_logits, boats.keypoints_px)
        if self.refiner is not None and native is not None:
            refined = self.refiner(native, boats.boxes_px, keypoints_px, covariance_px2, boats.present)
            keypoints_px, covariance_px2 = refined.keypoints_px, refined.covariance_px2
        covariance_px2 = self.noise(covariance_px2, boats.boxes_px)
        if hull is not None:
            hull = self.noise.resized(hull)
        ranges = self.ranging(keypoints_px, covariance_px2, boats.boxes_px, camera, hull)
        return Prediction(
            boxes_px=boats.boxes_px,
            scores=boats.scores,
            keypoints_px=keypoints_px,
            keypoint_covariance_px2=covariance_px2,
            visibility=boats.visibility,
            present=boats.present,
            box_bottom=self.intervals(ranges.box_bottom, 0),
            waterline=self.intervals(ranges.waterline, 1),
            hull=self.intervals(ranges.hull, 2),
            fused=self.intervals(ranges.fused, 3),
            heading_rad=ranges.heading_rad,
            heading_std_rad=ranges.heading_std_rad,
            misfit=ranges.misfit,
        )

    def locate(self, heatmap_logits: Tensor, coarse_keypoints_px: Tensor) -> tuple[Tensor, Tensor]:
        """Read the heatmaps around coarse keypoints.

        Args:
            heatmap_logits: (B, 7, H / 4, W / 4).
            coarse_keypoints_px: (B, N, 7, 2).

        Returns:
            (B, N, 7, 2) keypoints in pixels and (B, N, 7, 2, 2) their covariance.
        """
        return decode(heatmap_logits, coarse_keypoints_px)
