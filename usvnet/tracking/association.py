"""Which sighting is which boat's: global nearest neighbours inside a chi-squared gate."""

import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import chdtri

from usvnet.tracking.filter import BoatFilter, Sighting

NEVER = 1e6
"""Cost of a pair outside the gate."""


def associate(filters: Sequence[BoatFilter], sightings: Sequence[Sighting], gate_probability: float) -> dict[int, int]:
    """Pair boats with sightings so that the total of their negative log-likelihoods is least.

    Sightings with a range come first, for they say more; those with a bearing only are shared out among the boats that
    are left. One without a bearing is nobody's.

    Args:
        filters: of the boats, brought to the time of the sightings.
        sightings: of one frame.
        gate_probability: that a boat's own sighting lies inside the gate.

    Returns:
        Places of sightings by places of boats; who has no partner is left out.
    """
    pairs: dict[int, int] = {}
    for ranged in (True, False):
        boats = [i for i in range(len(filters)) if i not in pairs]
        known = [j for j, sighting in enumerate(sightings) if math.isfinite(sighting.bearing_rad)]
        seen = [j for j in known if sightings[j].ranged == ranged]
        gate = chdtri(2 if ranged else 1, 1 - gate_probability)
        cost = np.full((len(boats), len(seen)), NEVER)
        for row, i in enumerate(boats):
            for column, j in enumerate(seen):
                found = filters[i].innovation(sightings[j], lasting_share=0.0)
                squared = found.squared
                if squared <= gate:
                    cost[row, column] = squared + math.log(np.linalg.det(found.S))
        for row, column in zip(*linear_sum_assignment(cost)):
            if cost[row, column] < NEVER:
                pairs[boats[row]] = seen[column]
    return pairs
