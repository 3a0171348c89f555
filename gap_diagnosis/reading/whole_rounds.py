"""By how many whole rounds of its counter the gyro's message is late beside the wheels'.

A counter that counts to fifteen tells a delay only up to whole rounds, and the stamps, of which
the nearest round is taken, no more. But gyro and wheels turn together: where the turns lie so many
whole rounds apart, and the stamps are off as well, it is the frames that are late. A gyro that lags
by itself lags by any time, and its frames come in time.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

Floats = NDArray[np.float64]

MOST_ROUNDS: Final = 8
"""A delay of more rounds is not looked for: 1.2 s at 100 Hz."""
_SMOOTHED_TICKS: Final = 5.0
_NEAR_TICKS: Final = 2
"""The turns lie so near to whole rounds where frames are late: no gyro's own lag is asked for."""
_ALIKE: Final = 0.8
_LEFT_PART: Final = 0.5
"""Of what the two do not share at no round, so much may be left at the right one."""


def rounds_late(wheel_turn: Floats, gyro_turn: Floats, round_ticks: int) -> int:
    """Return by how many rounds the gyro's turns come after the wheels'; below 0: before them.

    Args:
        wheel_turn: float64[n], the wheels' turn in each tick, in any unit and of either sign; NaN
            where it is not known.
        gyro_turn: float64[n], the gyro's likewise.
        round_ticks: ticks to a round of the counter.
    """
    reach = MOST_ROUNDS * round_ticks + _NEAR_TICKS
    if len(wheel_turn) <= 4 * reach:
        return 0
    wheels, gyro = _smooth(wheel_turn), _smooth(gyro_turn)
    middle = slice(reach, -reach)
    shared = np.array(
        [
            _correlation(wheels[middle], gyro[reach + lag : len(gyro) - reach + lag])
            for lag in range(-reach, reach + 1)
        ]
    )
    peak = int(np.argmax(shared)) - reach
    rounds = round(peak / round_ticks)
    at_peak, at_none = float(shared[rounds * round_ticks + reach]), float(shared[reach])
    is_whole = abs(peak - rounds * round_ticks) <= _NEAR_TICKS
    is_better = 1 - at_peak**2 < _LEFT_PART * (1 - at_none**2)
    return rounds if is_whole and is_better and at_peak > _ALIKE else 0


def _smooth(turn: Floats) -> Floats:
    known = np.isfinite(turn)
    if not known.any():
        return np.zeros(len(turn))
    place = np.arange(len(turn))
    filled = np.interp(place, place[known], turn[known])
    return np.asarray(gaussian_filter1d(filled, _SMOOTHED_TICKS), dtype=np.float64)


def _correlation(one: Floats, other: Floats) -> float:
    """Return the size of the correlation of two series; 0 where one does not vary."""
    ours, theirs = one - one.mean(), other - other.mean()
    power = float(ours @ ours) * float(theirs @ theirs)
    return abs(float(ours @ theirs)) / np.sqrt(power) if power > 0 else 0.0
