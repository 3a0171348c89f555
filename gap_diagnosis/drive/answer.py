"""How the wheels of a drive answer its commands, compiled."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numba import njit

_GONE: Final = 1e-20
"""What is left of a rate by then is less than any digit of it."""


@njit(cache=True, error_model="numpy")
def predict(
    commanded: Any,
    rate_0: Any,
    dt_s: float,
    lag_s: float,
    delay_s: float,
    deadband: float,
    limit_rate: float,
    limit_acceleration: float,
    gain: Any,
    braking: float,
) -> Any:
    """Return the wheel angles [rad] since row 0 of a drive with these parameters: float64[2, n].

    Args:
        commanded: float64[2, n], wheel rates in force from each row on [rad/s].
        rate_0: float64[2], wheel rates at row 0.
        dt_s: time from row to row.
        lag_s, delay_s, deadband, limit_rate, limit_acceleration: as described plus deviation.
        gain: float64[2], steady wheel speed over commanded.
        braking: by what share a wheel may slow down faster than it may speed up.

    The same exact solution as the simulated drive: delay, deadband, gain, saturation, then a
    first-order lag of limited acceleration. While a command stands, a wheel goes along a parabola
    as long as the limit binds, and then along an exponential: both are closed, whatever the rows.
    """
    n = commanded.shape[1]
    angle = np.zeros((2, n))
    whole = math.floor(delay_s / dt_s)
    # A row that a command reaches late has the one before it in force for so long.
    late_s = min(max(delay_s - whole * dt_s, 0.0), dt_s)
    speeding_up = limit_acceleration * (1.0 - 0.5 * braking)
    slowing_down = limit_acceleration * (1.0 + 0.5 * braking)
    unlimited = min(speeding_up, slowing_down) * lag_s
    fade = math.exp(-dt_s / lag_s) if lag_s > 0.0 else 0.0
    faded = np.zeros(n)
    faded[0] = 1.0
    for j in range(1, n):
        faded[j] = fade * faded[j - 1]
        if faded[j] < _GONE:
            break
    rates, targets = rate_0.copy(), np.zeros(2)
    told, first = 0, 1
    while first < n:
        # Rows from *first* to *last* obey the command of row *told*.
        next_told = told + 1
        while (
            next_told < n
            and commanded[0, next_told] == commanded[0, told]
            and commanded[1, next_told] == commanded[1, told]
        ):
            next_told += 1
        last = min(next_told + 1 + whole, n) if next_told < n else n
        for wheel in range(2):
            rate, turned, k = rates[wheel], angle[wheel, first - 1], first
            wanted = commanded[wheel, told]
            wanted = 0.0 if abs(wanted) < deadband else wanted * gain[wheel]
            target = min(max(wanted, -limit_rate), limit_rate)
            if told > 0 and late_s > 0.0:
                rate, went = _moved(rate, targets[wheel], late_s, lag_s, speeding_up, slowing_down)
                rate, more = _moved(rate, target, dt_s - late_s, lag_s, speeding_up, slowing_down)
                turned += went + more
                angle[wheel, k] = turned
                k += 1
            while k < last and abs(target - rate) > unlimited:
                slope, ramp_s, _ = _ramp(rate, target, lag_s, speeding_up, slowing_down)
                rows = min(math.floor(ramp_s / dt_s), last - k)
                if rows > 0:
                    ramp = angle[wheel, k : k + rows]
                    for j in range(rows):
                        since_s = dt_s * (j + 1)
                        ramp[j] = turned + (rate + 0.5 * slope * since_s) * since_s
                    turned = ramp[rows - 1]
                    rate += slope * dt_s * rows
                    k += rows
                else:
                    rate, went = _moved(rate, target, dt_s, lag_s, speeding_up, slowing_down)
                    turned += went
                    angle[wheel, k] = turned
                    k += 1
            gap = target - rate
            settling = angle[wheel, k:last]
            fading = faded[1 : 1 + last - k]
            for j in range(last - k):
                settling[j] = turned + target * (dt_s * (j + 1)) - gap * lag_s * (1.0 - fading[j])
            rates[wheel] = target - gap * faded[last - k]
            targets[wheel] = target
        told, first = next_told, last
    return angle


@njit(cache=True, error_model="numpy")
def for_a_while(
    described: Any, within: Any, first: int, last: int, lags_s: Any, dt_s: float
) -> Any:
    """Return the angles float64[2, n] of wheels that turn as *described*, and from row *first* to
    row *last* as a drive *within* has it.

    A rate goes on where drives change, and fades into the new one's with its lag: *lags_s* of the
    described drive and of that within.
    """
    n = described.shape[1]
    angle = np.zeros((2, n))
    for wheel in range(2):
        step, more, fade = 0.0, 0.0, 0.0
        for row in range(1, n):
            acts = first < row <= last
            drive = within if acts else described
            if row > 1 and (row == first + 1 or row == last + 1):
                more = step - (drive[wheel, row - 1] - drive[wheel, row - 2])
                lag_s = lags_s[1] if acts else lags_s[0]
                fade = math.exp(-dt_s / lag_s) if lag_s > 0.0 else 0.0
            more *= fade
            step = drive[wheel, row] - drive[wheel, row - 1] + more
            angle[wheel, row] = angle[wheel, row - 1] + step
    return angle


@njit(cache=True, error_model="numpy", inline="always")
def _ramp(
    rate: float, target: float, lag_s: float, speeding_up: float, slowing_down: float
) -> tuple[float, float, bool]:
    """Return the slope of a rate at its limit, for how long it is there (until the lag asks for no
    more or, where a wheel slows down otherwise than it speeds up, until it stands; 0 s where it is
    at no limit), and whether it stands then."""
    gap = target - rate
    slows = gap * rate < 0.0
    limit = slowing_down if slows else speeding_up
    if not abs(gap) > limit * lag_s or limit == math.inf:
        return 0.0, 0.0, False
    slope = limit if gap > 0.0 else -limit
    ramp_s = (abs(gap) - limit * lag_s) / limit
    stands_s = abs(rate) / limit
    if slows and slowing_down != speeding_up and stands_s < ramp_s:
        return slope, stands_s, True
    return slope, ramp_s, False


@njit(cache=True, error_model="numpy", inline="always")
def _moved(
    rate: float, target: float, left_s: float, lag_s: float, speeding_up: float, slowing_down: float
) -> tuple[float, float]:
    """Return a wheel's rate after a part of a row with one target, and how far it turned."""
    turned = 0.0
    for _ in range(2):  # slowing down, then speeding up the other way round
        slope, ramp_s, stands = _ramp(rate, target, lag_s, speeding_up, slowing_down)
        if ramp_s > left_s:
            ramp_s, stands = left_s, False
        turned += (rate + 0.5 * slope * ramp_s) * ramp_s
        rate = 0.0 if stands else rate + slope * ramp_s
        left_s -= ramp_s
        if not stands:
            break
    gap = target - rate
    closed = -math.expm1(-left_s / lag_s) if lag_s > 0.0 else 1.0
    if left_s > 0.0:
        turned += target * left_s - gap * lag_s * closed
        rate += gap * closed
    return rate, turned
