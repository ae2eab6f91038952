import pytest

from usvnet.data.sampling import Draw, TrainingSampler


def indices(sampler: TrainingSampler) -> list[int]:
    return [draw.picture for draw in sampler]


def test_every_epoch_has_every_picture_once_in_an_order_of_its_own():
    sampler = TrainingSampler(10, seed=0)
    orders = []
    for epoch in range(3):
        sampler.set_epoch(epoch)
        orders.append(indices(sampler))
        assert sorted(orders[-1]) == list(range(10))
    assert len(set(map(tuple, orders))) == 3
    assert orders[1] != indices(TrainingSampler(10, seed=1))  # another seed is not another epoch of the same orders


def test_a_picture_is_changed_by_seed_and_epoch_and_nothing_else():
    assert list(TrainingSampler(4, seed=5)) == list(TrainingSampler(4, seed=5))
    seeds = {draw.seed for epoch in range(3) for draw in TrainingSampler(4, seed=5, epoch=epoch)}
    assert len(seeds) == 12
    assert all(isinstance(draw, Draw) and draw.seed[0] == 5 for draw in TrainingSampler(4, seed=5))


@pytest.mark.parametrize("processes", [2, 3])
def test_processes_share_an_epoch(processes: int):
    whole = indices(TrainingSampler(10, seed=0))
    parts = [indices(TrainingSampler(10, 0, rank, processes)) for rank in range(processes)]
    assert len({len(part) for part in parts}) == 1
    assert set().union(*parts) == set(range(10))
    assert sum(map(len, parts)) - 10 < processes
    assert parts[0][:2] == whole[: 2 * processes : processes]


def test_an_interrupted_epoch_goes_on_with_the_next_picture_and_the_following_ones_are_whole():
    resumed = TrainingSampler(10, seed=0, epoch=2, skip=6)
    straight = TrainingSampler(10, seed=0)
    straight.set_epoch(2)
    assert indices(resumed) == indices(straight)[6:]
    for sampler in (resumed, straight):
        sampler.set_epoch(3)
    assert list(resumed) == list(straight)
