"""Frames as samples of a fixed size, and samples as batches of tensors."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import Dataset

from usvnet.data.augmentation import AugmentationConfig, Source, View, augment, plain_view, shrink_view
from usvnet.data.pictures import Picture, PictureCache
from usvnet.data.records import Frame
from usvnet.data.sampling import Draw
from usvnet.data.transforms import fit_matrix, resize_matrix
from usvnet.geometry.camera import stack_cameras
from usvnet.geometry.hull_model import stack_hulls
from usvnet.types import NEAREST_WATERLINE, NUM_KEYPOINTS, Batch, Boats, Native


@dataclass(frozen=True)
class Sample:
    """One picture of the network's size with its frame moved along."""

    picture: Picture
    frame: Frame
    index: int
    native: Picture | None = None
    """The picture before it was shrunk to the network's size."""


class BoatDataset(Dataset[Sample]):
    """Pictures letterboxed to ``size_px`` x ``size_px`` and, for training, augmented.

    A :class:`usvnet.data.sampling.Draw` brings the seed of its augmentation along; a plain index takes one from torch's
    generator.

    Args:
        frames: what :func:`usvnet.data.read_dataset` returned.
        size_px: side of the square that the network sees.
        augmentation: None letterboxes only.
        cache_mb: memory for decoded pictures, which are kept at no more than twice ``size_px`` or ``native_px``.
        native_px: side of the square that samples are made in before they are shrunk to ``size_px``, and in which they
            are handed out too; None makes them at ``size_px``.
    """

    def __init__(
        self,
        frames: list[Frame],
        size_px: int,
        augmentation: AugmentationConfig | None = None,
        cache_mb: int = 1024,
        native_px: int | None = None,
    ) -> None:
        self.frames = frames
        self.size_px = (size_px, size_px)
        self.native_px = native_px
        self.drawn_px = self.size_px if native_px is None else (native_px, native_px)
        """Width and height that pictures are drawn in."""
        self.augmentation = augmentation
        self.closing_epoch: int | None = None
        """First epoch of the run's end, see :class:`AugmentationConfig`; None where the end is not known."""
        self.cache = PictureCache(cache_mb, longest_px=max(2 * size_px, *self.drawn_px))

    def __len__(self) -> int:
        """Count the frames."""
        return len(self.frames)

    def letterbox_matrix(self, index: int) -> Tensor:
        """(3, 3) float64 matrix from the native pixels of a picture to those of its letterboxed sample."""
        drawn = fit_matrix(self.frames[index].size_px, self.drawn_px)
        return torch.tensor(resize_matrix(self.drawn_px, self.size_px) @ drawn)

    def fill_cache(self) -> None:
        """Decode pictures until the budget is used up: once, before worker processes are forked.

        Raises:
            ValueError: a picture is damaged or not of its camera's size.
        """
        for frame in self.frames:
            if self.cache.left_bytes < 3 * self.size_px[0] * self.size_px[1]:
                return
            self.cache.read(frame.image_path, frame.size_px)

    def __getitem__(self, draw: int | Draw) -> Sample:
        """Make a sample, a different one each time when augmenting."""
        index = draw.picture if isinstance(draw, Draw) else draw
        if self.augmentation is None:
            return self._sample(plain_view(self._source(index), self.drawn_px), index)
        seed = draw.seed if isinstance(draw, Draw) else int(torch.randint(2**63 - 1, (1,)))
        closing = isinstance(draw, Draw) and self.closing_epoch is not None and draw.epoch >= self.closing_epoch
        rng = np.random.default_rng(seed)
        view = augment(self._source(index), self._source, len(self), self.drawn_px, self.augmentation, rng, closing)
        return self._sample(view, index)

    def _sample(self, view: View, index: int) -> Sample:
        if self.native_px is None:
            return Sample(*view, index)
        return Sample(*shrink_view(view, self.size_px), index, view.picture)

    def _source(self, index: int) -> Source:
        frame = self.frames[index]
        return Source(self.cache.read(frame.image_path, frame.size_px), frame)


def collate(samples: list[Sample]) -> Batch:
    """Stack samples into a :class:`Batch`, boats padded to the largest number in it (at least 1)."""
    pictures = torch.from_numpy(np.stack([sample.picture for sample in samples]))
    frames = [sample.frame for sample in samples]
    longest = max(1, *(len(frame.boxes_px) for frame in frames))

    def padded(columns: list[NDArray], shape: tuple[int, ...], fill: int, dtype: torch.dtype) -> Tensor:
        out = torch.full((len(columns), longest, *shape), fill, dtype=dtype)
        for row, column in zip(out, columns):
            row[: len(column)] = torch.from_numpy(column)
        return out

    natives = [sample.native for sample in samples if sample.native is not None]
    boats = Boats(
        boxes_px=padded([f.boxes_px for f in frames], (4,), 0, torch.float32),
        keypoints_px=padded([f.keypoints_px for f in frames], (NUM_KEYPOINTS, 2), 0, torch.float32),
        visibility=padded([f.visibility for f in frames], (NUM_KEYPOINTS,), 0, torch.int64),
        present=padded([np.ones(len(f.boxes_px), bool) for f in frames], (), 0, torch.bool),
        range_m=padded([f.range_m for f in frames], (), 0, torch.float32),
        range_std_m=padded([f.range_std_m for f in frames], (), 0, torch.float32),
        reference=padded([f.reference for f in frames], (), NEAREST_WATERLINE, torch.int64),
    )
    return Batch(
        image=pictures.permute(0, 3, 1, 2).float().div_(255),  # of interleaved pixels: channels_last in memory
        camera=stack_cameras([frame.camera for frame in frames]),
        boats=boats,
        frame_index=torch.tensor([sample.index for sample in samples]),
        hull=stack_hulls([frame.hull for frame in frames]),
        native=_native(natives, (pictures.shape[2], pictures.shape[1])) if natives else None,
    )


def _native(pictures: list[Picture], size_px: tuple[int, int]) -> Native:
    """Stack the pictures of which images of ``size_px`` were made."""
    stacked = torch.from_numpy(np.stack(pictures)).permute(0, 3, 1, 2)
    to_image = torch.tensor(resize_matrix((stacked.shape[3], stacked.shape[2]), size_px), dtype=torch.float32)
    return Native(stacked, to_image.expand(len(pictures), 3, 3))
