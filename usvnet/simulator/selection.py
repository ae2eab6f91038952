"""Which frames of a dataset to render: a small sample, or some by their numbers."""

import re
from collections import defaultdict
from collections.abc import Iterable
from itertools import chain, zip_longest

from usvnet.simulator.scenario import Scenario
from usvnet.simulator.settings import SPLITS

LOOKED_AT = 50
"""A sample is chosen of at least so many frames of each split: scenes that are rare may not be in it."""


def spread_sample(scenario: Scenario, count: int) -> list[int]:
    """Numbers of ``count`` frames in rising order, evenly over splits and in each split evenly over scenes.

    Raises:
        ValueError: ``count`` below 1.
    """
    if count < 1:
        raise ValueError(f"--frames is {count}, expected at least 1")
    splits, first = [], 0
    for split in SPLITS:
        frames = getattr(scenario.settings.frames, split)
        splits.append(_scenes_in_turn(scenario, range(first, first + min(frames, max(count, LOOKED_AT)))))
        first += frames
    return sorted(_in_turn(splits)[:count])


def _scenes_in_turn(scenario: Scenario, numbers: Iterable[int]) -> list[int]:
    scenes: dict[str, list[int]] = defaultdict(list)
    for number in numbers:
        scenes[scenario.frame(number).scene].append(number)
    return _in_turn(members for _, members in sorted(scenes.items()))


def _in_turn(queues: Iterable[list[int]]) -> list[int]:
    """The first of each queue, then the second of each, and so on."""
    return [number for number in chain.from_iterable(zip_longest(*queues)) if number is not None]


def parse_numbers(text: str, total: int) -> list[int]:
    """Read ``17`` or ``3,17,20-25`` as frame numbers, in rising order and each once.

    Raises:
        ValueError: something else, or a number that the dataset does not have.
    """
    numbers: set[int] = set()
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d+)\s*(?:-\s*(\d+)\s*)?", part)
        if match is None:
            raise ValueError(f"--only is {text!r}, expected frame numbers such as 17 or 3,17,20-25")
        first, last = int(match[1]), int(match[2] or match[1])
        if not first <= last < total:
            raise ValueError(f"--only names frames {part.strip()}, expected 0 to {total - 1}")
        numbers.update(range(first, last + 1))
    return sorted(numbers)
