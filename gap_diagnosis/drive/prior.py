"""How large the drive's parameters may be; the numbers are in data/prior.toml."""

from __future__ import annotations

import math
from typing import Final

from gap_diagnosis.priors import FOR_A_WHILE, ParameterPrior, Range, default_prior

Size = ParameterPrior

_PRIOR: Final = default_prior()


def _size(effect: str) -> Size:
    return _PRIOR.of(effect, "all")


def _share(effect: str) -> Range:
    return _PRIOR.ranges[effect]["share"]


GAIN: Final = _size("drive_gain")
LAG_S: Final = _size("drive_lag")
DELAY_S: Final = _size("drive_delay")
DEADBAND_SHARE: Final = _share("drive_deadband")
DEADBAND_TOLERANCE: Final = _PRIOR.tolerance("drive_deadband", "rate") or 0.0
SATURATION_SHARE: Final = _share("drive_saturation")
ACCELERATION_SHARE: Final = _share("drive_acceleration_limit")

TICKS_PER_REV: Final = _size("ticks_per_rev")
MISSED_TICKS: Final = _size("missed_ticks")
EXTRA_TICKS_PER_S: Final = _size("extra_ticks")
"""Effects of the encoder that these residuals see too; their parameters are told elsewhere."""

BRAKING: Final = _PRIOR.nuisances["drive_braking"]
FOREIGN: Final = _PRIOR.nuisances["foreign_drive"]


def log_of_spell(blocks: int, ends: int = 2) -> float:
    """Return the log probability that an effect acts in one spell of so many blocks alone, and that
    it is a certain one, of which one or two *ends* lie within the log: each as often."""
    alike = 2.0 * blocks if ends == 1 else 0.5 * blocks * (blocks + 1)
    return math.log(0.5 * FOR_A_WHILE / alike)
