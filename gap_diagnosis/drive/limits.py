"""From which size on a drive's effects show.

Bounds do where they move a wheel by more than any drive may; gain, lag and delay where they bend
the wheels' angles by more than noise and tolerances do.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.block import DriveBlock
from gap_diagnosis.drive.data import Floats, drive_data
from gap_diagnosis.drive.noise import STARTS, Levels, whitened
from gap_diagnosis.drive.shapes import Shapes
from gap_diagnosis.priors import ParameterPrior
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot

BOUNDS: Final = ("drive_acceleration_limit", "drive_deadband", "drive_saturation")

_NUISANCES: Final[Mapping[str, tuple[int, ...]]] = {
    "drive_gain": (0, 1),
    "drive_lag": (2,),
    "drive_delay": (3,),
}
"""Which of the columns that every hypothesis has are an effect's own."""

_SIZES: Final[Mapping[str, ParameterPrior]] = {
    "drive_gain": prior.GAIN,
    "drive_lag": prior.LAG_S,
    "drive_delay": prior.DELAY_S,
}


def limits_of_answers(
    blocks: Sequence[DriveBlock], *, typical: bool = False
) -> dict[str, float | None]:
    """Return the size of a gain [1], lag [s] and delay [s] whose expected separation from no effect
    is 29 on these drives together, the others being free within their tolerances; never below the
    effect's own. None where that is beyond what is believed, or nothing was driven.

    Of a gain of either wheel, that which shows the sooner. *typical*: at the noise that drives
    usually have, instead of that found.
    """
    found: dict[str, float | None] = {}
    for effect, own in _NUISANCES.items():
        power = np.zeros(len(own))
        for block in blocks:
            levels = Levels.of(STARTS[0], block.data.tick_rad) if typical else block.levels
            power += _powers(block, own, levels)
        size = _SIZES[effect]
        best = float(power.max())
        limit = math.sqrt(THRESHOLD / best) if best > 0 else math.inf
        found[effect] = max(limit, size.tolerance) if limit <= size.high else None
    return found


def _powers(block: DriveBlock, own: Sequence[int], levels: Levels) -> Floats:
    """Return the Fisher information of some columns' sizes, float64[own], one at a time; the
    columns that are not theirs are free within their tolerances."""
    if block.data.manner is not None:
        return np.zeros(len(own))  # a drive with a manner of its own is never said to have these
    setting = block.undisturbed
    white, _ = whitened(setting.variant.data, setting.fixed, levels)
    inner = white @ white.T
    place = np.array(own)
    rest = np.setdiff1d(np.arange(len(inner)), place)
    free = inner[np.ix_(rest, rest)] + np.diag(setting.nuisance_sd[rest] ** -2.0)
    across = inner[np.ix_(rest, place)]
    left = np.diag(inner)[place] - np.sum(across * np.linalg.solve(free, across), axis=0)
    return np.asarray(np.maximum(left, 0.0))


def limits_of_bounds(recordings: Sequence[Recording], robot: Robot) -> dict[str, float]:
    """Return the largest acceleration limit, the smallest deadband and the largest saturation that
    are news in one of these drives [rad/s², rad/s, rad/s]; nothing of what is none in any."""
    drives = [data for one in recordings if (data := drive_data(one, robot)) is not None]
    found = {}
    for effect in BOUNDS:
        news = [Shapes(data, robot).coordinate(effect).newsworthy for data in drives]
        least = min((low for low, _ in news), default=math.inf)
        most = max((high for _, high in news), default=0.0)
        if most > least:
            found[effect] = least if effect == "drive_deadband" else most
    return found
