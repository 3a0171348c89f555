"""Whether a counter is wide enough to tell which way a wheel went, whatever its noise.

A counter of b bits tells increments apart modulo 2^b. In a gap of k ticks a wheel at its fastest
counts up to N = ⌈rate · k + noise⌉; the kernel believes B = max_step_ticks · k either way. B stays
within half the counter's range, N may not: as a signed number of b bits it is 2^b − N the other
way, and that is believed where N + B >= 2^b. Both grow with the gap: the longest one is the worst.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Final

from firmware_model.config import KernelConfig
from firmware_model.errors import FirmwareError

NOISE_DEVIATIONS: Final = 6
"""So many standard deviations a reading's noise may be off; a normal one is beyond that in two of
a thousand million readings."""
_WIDEST: Final = 32


def told_apart(config: KernelConfig, rate: Fraction, noise_ticks: Fraction, ticks: int) -> int:
    """Return N + B of a gap [encoder ticks]: a counter has to tell so many apart.

    Args:
        config: from `build_config`.
        rate: of the fastest wheel [encoder ticks a tick].
        noise_ticks: by how much the noise of two readings may differ [encoder ticks].
        ticks: the gap.
    """
    return math.ceil(rate * ticks + noise_ticks) + config.max_step_ticks * ticks


def least_counter_bits(
    config: KernelConfig, rate: Fraction, noise_ticks: Fraction, mission_ticks: int
) -> int:
    """Return how wide a counter has to be, at least the configured width.

    A wider one bridges longer gaps, where nothing else than its range limits them.
    """
    bits = config.counter_bits
    is_limited = config.gap_limit_ticks < _gap_limit(config, bits)
    while bits <= _WIDEST:
        gap = config.gap_limit_ticks if is_limited else _gap_limit(config, bits)
        if told_apart(config, rate, noise_ticks, min(gap, mission_ticks)) < 1 << bits:
            break
        bits += 1
    return bits


def require_told_apart(
    config: KernelConfig, rate: Fraction, noise_ticks: Fraction, mission_ticks: int
) -> None:
    """Refuse a counter that takes the way of a wheel for one that is believed the other way.

    Raises:
        FirmwareError: field, value and what would be right.
    """
    bits = config.counter_bits
    gap = min(config.gap_limit_ticks, mission_ticks)
    if told_apart(config, rate, noise_ticks, gap) < 1 << bits:
        return
    counts = told_apart(config, rate, noise_ticks, gap) - config.max_step_ticks * gap
    least = least_counter_bits(config, rate, noise_ticks, mission_ticks)
    right = f"at least {least}, " if least <= _WIDEST else ""
    raise FirmwareError(
        f"encoder.counter_bits = {bits}: with noise a wheel counts up to {counts} in a gap of "
        f"{gap} tick{'s' * (gap > 1)}, of which {bits} bits make {(1 << bits) - counts} backward "
        f"that are believed: expected {right}less encoder.noise_ticks or a slower wheel"
    )


def _gap_limit(config: KernelConfig, counter_bits: int) -> int:
    return ((1 << (counter_bits - 1)) - 1) // config.max_step_ticks
