"""The lines of a slender hull with a raked stem: the monohulls and each hull of a catamaran."""

from dataclasses import dataclass

import numpy as np

from usvnet.simulator.hulls.loft import Loft, loft_sections

WIDEST = 0.45
"""Where the beam is greatest, from the stern."""


@dataclass(frozen=True)
class Lines:
    """A hull in shares: ``beam`` to ``sheer`` of the length, the rest of what they say."""

    beam: float
    freeboard: float
    draught: float
    sheer: float
    """How much higher the bow is than amidships."""
    transom: float
    """Width of the transom as a share of the beam."""
    fullness: float
    """Exponent of the forward waterlines: 1.6 is fine, 3.2 is full."""
    bluntness: float
    """Width of the bow as a share of the beam; 0 is sharp."""
    forefoot: float
    """Where the keel begins to rise, from the stern."""
    stem: float
    """Exponent of the stem: 2 is raked, 4.5 nearly plumb."""
    chine: float
    """Height of the chine between keel and gunwale."""
    chine_width: float
    """Beam at the chine as a share of the beam at the gunwale."""

    def loft(self, length_m: float, stations: int = 160, points: int = 40) -> Loft:
        """Sections, closer together towards the bow."""
        t = 1 - (1 - np.linspace(0, 1, stations)) ** 1.35
        aft = self.transom + (1 - self.transom) * np.sin(np.clip(t / WIDEST, 0, 1) * np.pi / 2)
        forward = 1 - (1 - self.bluntness) * np.clip((t - WIDEST) / (1 - WIDEST), 0, 1) ** self.fullness
        half = self.beam / 2 * np.where(t < WIDEST, aft, forward)
        top = self.freeboard + self.sheer * np.clip((t - 0.3) / 0.7, 0, 1) ** 2
        rise = np.clip((t - self.forefoot) / (1 - self.forefoot), 0, 1) ** self.stem
        keel = -self.draught + (top[-1] + self.draught) * rise
        narrow = t**6  # the chine runs into the stem
        width = self.chine_width * (1 - narrow) + 0.55 * narrow
        return loft_sections(
            length_m * (t - 0.5), length_m * half, length_m * top, length_m * keel, self.chine, width, points
        )
