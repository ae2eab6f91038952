"""Which training picture comes when, and what chance does to it: decided by seed, epoch and picture alone.

Nothing is drawn from a process's own generator, so a run that was stopped and resumed sees what an uninterrupted one
sees, whatever the number of worker processes.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from torch.utils.data import DistributedSampler


class Draw(NamedTuple):
    """A picture of the dataset and the seed of its augmentation: that of the run, the epoch, the picture."""

    picture: int
    seed: tuple[int, int, int]

    @property
    def epoch(self) -> int:
        """The epoch it is drawn for."""
        return self.seed[1]


class TrainingSampler(DistributedSampler[Draw]):
    """Every picture once an epoch, in an order of that epoch's own.

    Lightning tells the epoch through ``set_epoch`` and leaves the sampler alone when several processes train, because
    it is a ``DistributedSampler`` already: each process then takes its share of the same order.

    Args:
        pictures: how many there are.
        seed: of the run.
        rank: number of this process.
        world_size: processes that train together; where the pictures do not divide evenly, some come twice.
        epoch: the first one.
        skip: pictures of this process in the first epoch that were seen before the run was interrupted.
    """

    def __init__(
        self, pictures: int, seed: int, rank: int = 0, world_size: int = 1, epoch: int = 0, skip: int = 0
    ) -> None:
        super().__init__(range(pictures), num_replicas=world_size, rank=rank, seed=seed)  # type: ignore[arg-type]
        self.pictures = pictures
        self.skip = (epoch, skip)
        self.set_epoch(epoch)

    def __iter__(self) -> Iterator[Draw]:
        """Yield this process's share of the epoch."""
        order = np.random.default_rng((self.seed, self.epoch)).permutation(self.pictures)
        own = np.resize(order, self.total_size)[self.rank :: self.num_replicas]
        first = self.skip[1] if self.epoch == self.skip[0] else 0
        for index in own[first:].tolist():
            yield Draw(index, (self.seed, self.epoch, index))
