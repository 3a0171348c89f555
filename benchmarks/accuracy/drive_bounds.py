"""The Cramér-Rao bound of a drive's parameters, at the noise levels that a log shows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from gap_diagnosis.drive.block import DriveBlock
from gap_diagnosis.drive.noise import whitened
from gap_diagnosis.drive.shapes import PARAMETERS
from hil_harness.effects.model import Value

SMOOTH_DRIVE: Final = frozenset({"drive_gain", "drive_lag", "drive_delay"})
"""Effects without thresholds."""

_STEP: Final = 1e-3


def bounds(block: DriveBlock, effect: str, truth: Mapping[str, Value]) -> dict[str, float]:
    """Return the least standard deviation of each parameter of an effect of size *truth*.

    Gains and the other dynamics are free within half their tolerances, noise levels are those of
    the effect's own fit.
    """
    names = ["left", "right"] if effect == "drive_gain" else [PARAMETERS[effect]]
    setting = block.setting_of(effect)
    levels = block.levels_with(frozenset({effect}))
    values = {} if effect == "drive_gain" else {effect: float(truth[names[0]])}
    if effect == "drive_gain":
        own = setting.columns(values)[1:]
    else:
        change = _STEP * max(values[effect], 1e-3)
        high = setting.shapes.angle({effect: values[effect] + change})
        low = setting.shapes.angle({effect: values[effect] - change})
        own = ((high - low) / (2 * change))[np.newaxis]
    white, _ = whitened(block.data, np.concatenate((own, setting.nuisances)), levels)
    precision = white @ white.T
    at = np.arange(len(own), len(precision))
    precision[at, at] += setting.nuisance_sd**-2.0
    variance = np.diag(np.linalg.inv(precision))
    return {name: float(np.sqrt(variance[i])) for i, name in enumerate(names)}
