"""From the kernel's accumulators to odometry signals of any DBC."""

import math
from collections.abc import Callable
from typing import Final

from can_bus.signals import Raw
from hil_harness.errors import HarnessError
from hil_harness.signal_map import MappedSignal, SignalMap
from hil_harness.signal_roles import Role

ODOMETRY_ROLES: Final[tuple[Role, ...]] = ("odom_x", "odom_y", "odom_heading")
"""Where the firmware says it is."""

_TURN_RAD: Final = 2 * math.pi


def odometry_raw(mapped: MappedSignal, frac_bits: int) -> Callable[[int], Raw]:
    """Return the way from a kernel accumulator to the raw value of *mapped*.

    The accumulator has *frac_bits* fraction bits and counts metres, or turns for a heading. Where
    the signal has the accumulator's own resolution the raw value is the accumulator; where it is
    coarser, the nearest (ties to even). A heading is given in the turn that the signal can hold.
    A position beyond the signal's range is sent as not available; without such a value the
    returned function raises HarnessError, as nothing is clipped.
    """
    signal = mapped.signal
    is_heading = mapped.quantity == "angle"
    step = (_TURN_RAD if is_heading else 1.0) / mapped.si_per_lsb / (1 << frac_bits)
    start = signal.offset / signal.factor
    low, high = signal.low_raw, signal.high_raw
    turn = _TURN_RAD / abs(mapped.si_per_lsb)
    same = step == 1.0 and start == 0.0

    def to_raw(value_q: int) -> Raw:
        if same and low <= value_q <= high:
            return value_q
        quotient = value_q * step - start
        if signal.is_float:
            return quotient
        raw = round(quotient)
        if is_heading and not low <= raw <= high:
            within = (quotient - low) % turn + low
            raw = round(within) if round(within) <= high else round(within - turn)
        if low <= raw <= high:
            return raw
        if signal.invalid_raw is None:
            raise HarnessError(
                f"{signal.path}: {value_q / (1 << frac_bits):g} {'turns' if is_heading else 'm'} "
                f"is raw value {raw}, its range ends at {low if raw < low else high}: expected a "
                "wider range in the DBC, or a value named SNA (VAL_) for what is beyond it"
            )
        return signal.invalid_raw

    return to_raw


def odometry_converters(
    signal_map: SignalMap, *, position_frac_bits: int, heading_frac_bits: int
) -> dict[Role, Callable[[int], Raw]]:
    """Return the conversion of each odometry role that the map has."""
    bits = dict(
        zip(
            ODOMETRY_ROLES,
            (position_frac_bits, position_frac_bits, heading_frac_bits),
            strict=True,
        )
    )
    return {
        role: odometry_raw(signal_map[role], bits[role])
        for role in ODOMETRY_ROLES
        if signal_map.get(role) is not None
    }
