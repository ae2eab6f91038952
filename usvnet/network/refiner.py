"""The second look: seven heatmaps of each boat alone, from a crop of the native picture."""

import torch
from torch import Tensor, nn

from usvnet.crops import (
    CROP_SIZE_PX,
    REFINED_STRIDE,
    Crops,
    Refinement,
    cut,
    from_crop,
    place_crops,
    to_crop,
)
from usvnet.heatmap import Moments, encode, highest_px, keypoints_from_moments, window_moments
from usvnet.network.blocks import Bottleneck, Conv
from usvnet.types import NUM_KEYPOINTS, Native

HINT_SIGMA_CELLS = 3.0
"""Spread of the maps that show where the detector saw the keypoints."""
HINT_NOISE_PX = 3.0
"""Training moves each boat's hints by this much together, and each by as much again (crop pixels, one standard
deviation): on pictures that it trains on the detector is better than elsewhere, and copying it must not pay."""
CROPS_AT_ONCE = 8
"""In use. A batch of pictures may have 160, and together they took a gigabyte more and twice the time on a CPU."""
CONTRAST_FLOOR = 0.02
"""Five grey levels: a crop whose contrast is less is mostly noise, and is not stretched as far as others."""


class RefinedHeatmaps(nn.Module):
    """A small hourglass at strides 2 to 16 of the crop: for one boat a fifth of the smallest detector's work a look.

    At stride 16 it sees the whole boat, and so which end of it a corner belongs to. Each crop is seen in its own
    contrast, since dusk and fog leave a boat a few grey levels only.
    """

    def __init__(self, hidden: int = 32) -> None:
        super().__init__()
        self.stem = Conv(3, hidden, 3, stride=2)
        self.enter = Conv(hidden + NUM_KEYPOINTS, hidden, 3)
        self.down4 = nn.Sequential(Conv(hidden, 2 * hidden, 3, stride=2), Bottleneck(2 * hidden, hidden))
        self.down8 = nn.Sequential(
            Conv(2 * hidden, 2 * hidden, 3, stride=2), *(Bottleneck(2 * hidden, 2 * hidden) for _ in range(2))
        )
        self.down16 = nn.Sequential(
            Conv(2 * hidden, 3 * hidden, 3, stride=2),
            *(Bottleneck(3 * hidden, 3 * hidden) for _ in range(2)),
            Conv(3 * hidden, 2 * hidden, 1),
        )
        self.up8 = Conv(2 * hidden, 2 * hidden, 3)
        self.up4 = Conv(2 * hidden, hidden, 3)
        self.up2 = Conv(hidden, hidden, 3)
        self.enlarge = nn.Upsample(scale_factor=2.0, mode="bilinear")
        self.heatmap = nn.Conv2d(hidden, NUM_KEYPOINTS, 1)
        self.contrast_floor = CONTRAST_FLOOR

    def forward(self, crop: Tensor, hints: Tensor) -> Tensor:
        """(M, 3, S, S) and (M, 7, S / 2, S / 2) where the keypoints seem to be -> logits (M, 7, S / 2, S / 2)."""
        seen = crop - crop.mean([1, 2, 3], keepdim=True)
        seen = seen / (seen.square().mean([1, 2, 3], keepdim=True) + self.contrast_floor**2).sqrt()
        stride2 = self.enter(torch.cat([self.stem(seen), hints], 1))
        stride4 = self.down4(stride2)
        stride8 = self.down8(stride4)
        stride8 = self.up8(stride8 + self.enlarge(self.down16(stride8)))
        stride4 = self.up4(stride4 + self.enlarge(stride8))
        return self.heatmap(self.up2(stride2 + self.enlarge(stride4)))


class Refiner(nn.Module):
    """Look again at every boat, in a crop of the native picture.

    End to end: the hints carry the gradient on to the detector's keypoints, so a range that is read from refined
    keypoints teaches both networks. The crop's place is a choice and has no gradient.
    """

    def __init__(self) -> None:
        super().__init__()
        self.heatmaps = RefinedHeatmaps()
        self.stride = REFINED_STRIDE
        self.cells = CROP_SIZE_PX // REFINED_STRIDE
        self.hint_sigma_cells = HINT_SIGMA_CELLS
        self.hint_noise_px = HINT_NOISE_PX
        self.crops_at_once = CROPS_AT_ONCE

    def forward(
        self, native: Native, boxes_px: Tensor, keypoints_px: Tensor, covariance_px2: Tensor, present: Tensor
    ) -> Refinement:
        """Refine the keypoints of N boats in B pictures.

        A boat that fills the picture is looked at as well, though a crop shows it no finer than the image does: in
        crops all boats are of one size.

        Args:
            native: the pictures before they were shrunk.
            boxes_px: (B, N, 4)
            keypoints_px: (B, N, 7, 2) as the detector found them.
            covariance_px2: (B, N, 7, 2, 2)
            present: (B, N) bool, False for boats to leave alone.

        Returns:
            All keypoints, and what training needs of the M boats looked at.
        """
        picture, boat = torch.unbind(present.nonzero(), 1)
        crops = place_crops(boxes_px[picture, boat], native.to_image[picture])

        hints_px = to_crop(keypoints_px[picture, boat], crops)
        if self.training:
            together, each = torch.randn_like(hints_px[:, :1]), torch.randn_like(hints_px)
            hints_px = hints_px + self.hint_noise_px * (together + each)
        logits = self.look(native, picture, crops, hints_px)

        moments, found_px, found_px2 = self.read(logits)
        scaled_px2 = found_px2.squeeze(1) * crops.step_px[:, :, None, None].square()
        return Refinement(
            keypoints_px=keypoints_px.index_put([picture, boat], from_crop(found_px.squeeze(1), crops)),
            covariance_px2=covariance_px2.index_put([picture, boat], scaled_px2),
            picture=picture,
            boat=boat,
            crops=crops,
            hints_px=hints_px,
            heatmap_logits=logits,
            moments=moments,
        )

    def look(self, native: Native, picture: Tensor, crops: Crops, hints_px: Tensor) -> Tensor:
        """The heatmaps (M, 7, h, w) of M crops; a few at a time but in training, whose norms see the whole batch.

        In use they are drawn twice: where the first ones are read is a better hint than the detector's.
        """
        at_once = max(picture.shape[0], 1) if self.training else self.crops_at_once
        logits: list[Tensor] = []
        for start in range(0, max(picture.shape[0], 1), at_once):  # once if there are none
            end = start + at_once
            crop = cut(native, picture[start:end], Crops(crops.corner_px[start:end], crops.step_px[start:end]))
            drawn = self.draw(crop, hints_px[start:end])
            if not self.training:
                drawn = self.draw(crop, self.read(drawn)[1].squeeze(1))
            logits.append(drawn)
        return torch.cat(logits)

    def draw(self, crop: Tensor, hints_px: Tensor) -> Tensor:
        """The heatmaps (M, 7, h, w) of crops (M, 3, S, S) with hints (M, 7, 2)."""
        hints = encode(hints_px, self.cells, self.cells, self.stride, self.hint_sigma_cells).exp()
        logits: Tensor = self.heatmaps(crop, hints)
        return logits.float()

    def read(self, logits: Tensor) -> tuple[Moments, Tensor, Tensor]:
        """Moments, keypoints (M, 1, 7, 2) and covariance (M, 1, 7, 2, 2) of heatmaps (M, 7, h, w), one boat each."""
        peak_px = highest_px(logits, self.stride).unsqueeze(1)  # anywhere: hints may lie at the boat's other end
        moments = window_moments(logits, peak_px, self.stride)
        found_px, found_px2 = keypoints_from_moments(moments, peak_px, self.stride)
        return moments, found_px, found_px2
