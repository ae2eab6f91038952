"""A dataset folder as Lightning's train, validation and test loaders."""

from pathlib import Path

import cv2
import torch
from lightning import LightningDataModule
from torch.utils.data import DataLoader

from usvnet.data.attitudes import FROM_FILES, AttitudeConfig, see_horizons
from usvnet.data.augmentation import AugmentationConfig
from usvnet.data.dataset import BoatDataset, Sample, collate
from usvnet.data.reader import read_dataset
from usvnet.data.records import Frame
from usvnet.data.sampling import TrainingSampler

DEFAULT_AUGMENTATION = AugmentationConfig()
STAGE_SPLITS = {"fit": ("train", "val"), "validate": ("val",), "test": ("test",), "predict": ()}


class BoatDataModule(LightningDataModule):
    """Loaders of :class:`usvnet.types.Batch` from a dataset folder (see :mod:`usvnet.data.reader`).

    Args:
        root: the folder that holds data.yaml; a relative path counts from the working directory.
        image_size: side of the square picture that the network sees in training, a multiple of 32 (64 with
            YOLOv8-P6).
        eval_image_size: the same for validation and test; null for ``image_size``. With a training zoom that reaches
            ``eval_image_size / image_size``, a network trained on cheap small crops is at home in large pictures, save
            for boats that filled the crops: their ends were told by borders that large pictures do not have.
        native_size: side of the square that pictures of ``eval_image_size`` are shrunk from, for ``model.refine``;
            training pictures are shrunk as far. The longer side of the camera's pictures is right. null for none.
        batch_size: pictures a batch.
        num_workers: processes that prepare batches; 0 prepares them in the training process.
        cache_mb: memory for decoded pictures, for each split.
        augmentation: of the training pictures; null for none.
        attitude: where pitch and roll of each picture come from.
    """

    def __init__(
        self,
        root: str,
        image_size: int = 320,
        eval_image_size: int | None = None,
        native_size: int | None = None,
        batch_size: int = 16,
        num_workers: int = 0,
        cache_mb: int = 1024,
        augmentation: AugmentationConfig | None = DEFAULT_AUGMENTATION,
        attitude: AttitudeConfig = FROM_FILES,
    ) -> None:
        super().__init__()
        for name, size in (("image_size", image_size), ("eval_image_size", eval_image_size)):
            if size is not None and (size <= 0 or size % 32):
                raise ValueError(f"{name} is {size}, expected a multiple of 32")
        if native_size is not None and native_size < (eval_image_size or image_size):
            raise ValueError(
                f"native_size is {native_size}, expected at least the {eval_image_size or image_size} of the network's "
                "pictures"
            )
        if batch_size < 1 or num_workers < 0 or cache_mb < 0:
            raise ValueError(
                f"batch_size is {batch_size}, num_workers {num_workers}, cache_mb {cache_mb}, expected at least 1, 0, 0"
            )
        self.root = Path(root)
        self.image_size = image_size
        self.eval_image_size = eval_image_size or image_size
        self.native_size = native_size
        self.batch_size = batch_size
        self.num_workers = num_workers
        self.cache_mb = cache_mb
        self.augmentation = augmentation
        self.attitude = attitude
        self._datasets: dict[str, BoatDataset] = {}
        self._start = (0, 0)

    def setup(self, stage: str) -> None:
        """Read the splits of a stage and decode their pictures, so that a fault shows before training begins."""
        for split in STAGE_SPLITS[stage]:
            self.dataset(split).fill_cache()

    def dataset(self, split: str) -> BoatDataset:
        """Read a split, once.

        Raises:
            ValueError: unknown split or faulty files, see :func:`read_dataset`.
        """
        if split not in self._datasets:
            frames = see_horizons(read_dataset(self.root, split, attitude=self.attitude), self.attitude)
            training = split == "train"
            size_px, augmentation = (self.image_size, self.augmentation) if training else (self.eval_image_size, None)
            native_px = self.native_size and round(self.native_size * size_px / self.eval_image_size)
            self._datasets[split] = BoatDataset(frames, size_px, augmentation, self.cache_mb, native_px)
        return self._datasets[split]

    def frames(self, split: str) -> list[Frame]:
        """Give the frames of a split; a batch's ``frame_index`` counts in this list."""
        return self.dataset(split).frames

    def train_dataloader(self) -> DataLoader[Sample]:
        """Load augmented training pictures in random order, every one of them each epoch.

        Order and augmentation follow from torch's initial seed (``seed_everything``) and the epoch; a resumed run goes
        on with the epoch's next picture.
        """
        self.dataset("train").closing_epoch = self._closing_epoch()
        return self._loader("train", self._training_sampler())

    def val_dataloader(self) -> DataLoader[Sample]:
        """Load letterboxed validation pictures in order."""
        return self._loader("val")

    def test_dataloader(self) -> DataLoader[Sample]:
        """Load letterboxed test pictures in order."""
        return self._loader("test")

    def state_dict(self) -> dict[str, int]:
        """Say where training is: the epoch, and the batches of it that have been seen."""
        assert self.trainer is not None
        loop = self.trainer.fit_loop
        batches = loop.epoch_loop.batch_progress
        over = batches.is_last_batch and batches.current.completed == batches.current.ready
        epoch: int = loop.epoch_progress.current.processed  # type: ignore[attr-defined]
        return {"epoch": epoch, "batches_seen": 0 if over else batches.current.completed}

    def load_state_dict(self, state_dict: dict[str, int]) -> None:
        """Go on where a checkpoint was written."""
        self._start = (state_dict["epoch"], state_dict["batches_seen"])

    def _closing_epoch(self) -> int | None:
        epochs = None if self.trainer is None else self.trainer.max_epochs
        if self.augmentation is None or epochs is None or epochs < 0:
            return None
        return round(epochs * (1 - self.augmentation.closing))

    def _training_sampler(self) -> TrainingSampler:
        rank, processes = (0, 1) if self.trainer is None else (self.trainer.global_rank, self.trainer.world_size)
        epoch, batches_seen = self._start
        pictures, skip = len(self.dataset("train")), batches_seen * self.batch_size
        return TrainingSampler(pictures, torch.initial_seed(), rank, processes, epoch, skip)

    def _loader(self, split: str, sampler: TrainingSampler | None = None) -> DataLoader[Sample]:
        return DataLoader(
            self.dataset(split),
            batch_size=self.batch_size,
            sampler=sampler,
            num_workers=self.num_workers,
            collate_fn=collate,
            worker_init_fn=_calm_worker,
            persistent_workers=self.num_workers > 0,
            pin_memory=torch.cuda.is_available(),
        )


def _calm_worker(_: int) -> None:
    """Keep a worker to one thread: several processes that all use every core wait for each other most of the time."""
    torch.set_num_threads(1)
    cv2.setNumThreads(0)
