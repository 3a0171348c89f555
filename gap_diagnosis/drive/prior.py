"""How large the drive's parameters may be: one table, numbers only.

`tolerance`: a deviation up to this is no news; every hypothesis, no effect included, may deviate by
about half of it. Ranges: docs/reference/effects.md, section 2.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Size:
    """How large a parameter may be, in its own unit.

    Attributes:
        tolerance: smaller is no news.
        high: beyond the typical range.
    """

    tolerance: float
    high: float

    def scales(self, count: int = 4) -> Floats:
        """Return standard deviations of the equally weighted normals that make the prior."""
        return np.asarray(np.geomspace(self.tolerance, self.high, count), dtype=np.float64)

    def log_density(self, value: Floats) -> Floats:
        """Return the log density of the mixture's positive half."""
        ratio = value[..., np.newaxis] / self.scales()
        logs = -0.5 * ratio**2 - np.log(self.scales()) + 0.5 * np.log(2 / np.pi)
        return np.asarray(np.logaddexp.reduce(logs, axis=-1) - np.log(len(self.scales())))


GAIN: Final = Size(tolerance=0.01, high=0.15)
"""Steady wheel speed over commanded - 1; 1 to 10 % are typical, an engine's motor model more."""

LAG_S: Final = Size(tolerance=0.010, high=0.3)
DELAY_S: Final = Size(tolerance=0.005, high=0.15)

DEADBAND_SHARE: Final = (0.0002, 0.3)
"""Of the described largest wheel rate: log-uniform; 3 to 15 % are typical, the low end is
never seen."""

SATURATION_SHARE: Final = (0.05, 1.0)
"""Of the described largest wheel rate: log-uniform."""

ACCELERATION_SHARE: Final = (0.02, 1.0)
"""Of the described largest wheel acceleration: log-uniform."""

TICKS_PER_REV: Final = Size(tolerance=0.002, high=0.05)
MISSED_TICKS: Final = Size(tolerance=0.0005, high=0.08)
EXTRA_TICKS_PER_S: Final = Size(tolerance=0.2, high=100.0)
"""Effects of the encoder that these residuals see too; their parameters are told elsewhere."""

FOREIGN: Final = Size(tolerance=0.05, high=1.5)
"""Weights of responses that no described drive has."""
