"""Mistakes of the set-up that bend the way from command to wheel: sides, signs, units."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive.data import DriveData
from gap_diagnosis.setup_mistakes import FACTORS, TURN_FACTORS, counts_per_step

Floats = NDArray[np.float64]

SETUP: Final = ("setup_sign", "setup_unit", "setup_wheels_swapped")

COMMANDS: Final = frozenset({"command_speed", "command_turn"})
COUNTS: Final = frozenset({"left_ticks", "right_ticks", "ticks"})
"""Signals of which a mistake of the set-up may be. Where the motion shows that the counts are
right, only the commands can be wrong; where it shows that something is grossly wrong, they are
not."""

_WHEELS: Final[Mapping[str, tuple[int, ...]]] = {
    "left_ticks": (0,),
    "right_ticks": (1,),
    "ticks": (0, 1),
}


@dataclass(frozen=True)
class Mistake:
    """One mistake undone.

    Attributes:
        data: as they would be without it.
        values: its parameters.
        log_scale: log of how much narrower the measured angles have become, over all of them.
    """

    data: DriveData
    values: Mapping[str, str | float]
    log_scale: float = 0.0


def possible(doubted: frozenset[str]) -> frozenset[str]:
    """Return the mistakes that can be where these signals are in doubt."""
    found = {"setup_unit", "setup_sign"}
    return frozenset(found | ({"setup_wheels_swapped"} if COUNTS & doubted else set()))


def mistakes(data: DriveData, effect: str, doubted: frozenset[str]) -> list[Mistake]:
    """Return the ways in which a mistake can be, each undone."""
    if effect == "setup_wheels_swapped":
        return [Mistake(data.told(data.commanded[::-1]), {})]
    if effect == "setup_sign":
        signals = sorted({"command_turn", "left_ticks", "right_ticks"} & doubted)
        return [_read_wrong(data, signal, -1.0, {"signal": signal}) for signal in signals]
    return [
        _read_wrong(data, signal, factor, {"signal": signal, "factor": factor})
        for signal in sorted((COMMANDS | COUNTS) & doubted)
        for known in (TURN_FACTORS if signal == "command_turn" else FACTORS)
        for factor in (known, 1 / known)
    ]


def _read_wrong(
    data: DriveData, signal: str, factor: float, values: Mapping[str, str | float]
) -> Mistake:
    """Undo that a signal reads so many times what it should."""
    if signal in COMMANDS:
        left, right = data.commanded
        speed, turn = 0.5 * (left + right), 0.5 * (right - left)
        if signal == "command_speed":
            speed = speed / factor
        else:
            turn = turn / factor
        return Mistake(data.told(np.stack([speed - turn, speed + turn])), values)
    scale = np.ones(2)
    scale[list(_WHEELS[signal])] = 1 / factor
    coarse = np.ones((2, 1))
    coarse[list(_WHEELS[signal])] = counts_per_step(factor)
    right_data = replace(
        data,
        angle=data.angle * scale[:, np.newaxis],
        rate_0=data.rate_0 * scale,
        turning=data.turning * np.abs(scale)[:, np.newaxis],
        # worth as many readings less as the variance of each is larger
        count=data.count / coarse**2,
    )
    told = data.seen.sum(axis=1) - 1
    log_scale = float(np.sum(told * np.log(np.abs(scale))))
    return Mistake(right_data.told(data.commanded), values, log_scale)
