"""From files on disk to batches of tensors: formats, frames, augmentation, loaders."""

from usvnet.data.augmentation import AugmentationConfig
from usvnet.data.datamodule import BoatDataModule
from usvnet.data.dataset import BoatDataset, Sample, collate
from usvnet.data.reader import read_dataset
from usvnet.data.records import Faults, Frame, Labels

__all__ = [
    "AugmentationConfig",
    "BoatDataModule",
    "BoatDataset",
    "Faults",
    "Frame",
    "Labels",
    "Sample",
    "collate",
    "read_dataset",
]
