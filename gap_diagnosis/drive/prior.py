"""How large the drive's parameters may be; the numbers are in data/prior.toml."""

from __future__ import annotations

from typing import Final

from gap_diagnosis.priors import ParameterPrior, Range, default_prior

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
