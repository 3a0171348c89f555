"""How a drive of a robot starts: wheels alone, and a gyro that turns as the wheels gain speed."""

from __future__ import annotations

import numpy as np

from firmware_model import FRESH, INVALID, KernelConfig
from firmware_model.build_scales import exact
from precision_study.ranges.envelope import Envelope
from precision_study.ranges.stretches import Drive, Stretch


def zero_code(config: KernelConfig) -> int:
    """Return the gyro's nominal code at rest."""
    zero = round(config.constants.gyro_zero_rate_code)
    return min(max(zero, config.gyro_min_code + 1), config.gyro_max_code - 1)


def by_wheels(
    config: KernelConfig, ticks: int, left: int, right: int, every: int = 1, over: int = 1
) -> Stretch:
    """Return a stretch in which the gyro is invalid: every mode takes the turn of the wheels."""
    return Stretch(ticks, left, right, every, zero_code(config), INVALID, over)


def rates_q(config: KernelConfig, one: Stretch, offset_q: int) -> int:
    """Return the sum of code − offset over a ramp, what is taken for rest left out."""
    codes = one.codes(np.arange(1, one.ticks + 1, dtype=np.int64))
    rates_q = (np.asarray(codes) << config.offset_frac_bits) - offset_q
    return int(rates_q[np.abs(rates_q) >= config.auto_zero_rate_q].sum())


def turning_up(config: KernelConfig, envelope: Envelope, rest_code: int, code: int) -> Drive:
    """Return how the gyro's code leaves that of rest: the robot turns as its wheels gain speed."""
    if envelope.ramp_ticks == 0:
        return ()
    scales = exact(config.constants)
    turn_rate = abs(code - rest_code) * scales.sensitivity_turn / scales.tick_turn
    ticks = envelope.ramp_to(turn_rate / 2)
    if ticks == 0:
        return ()
    return (Stretch(ticks, 0, 0, 0, code, FRESH, ramp_ticks=ticks, rest_code=rest_code),)
