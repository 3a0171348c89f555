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
    unit_si = _TURN_RAD if mapped.quantity == "angle" else 1.0
    step = unit_si / mapped.si_per_lsb / (1 << frac_bits)
    start = signal.offset / signal.factor
    low, high = signal.low_raw, signal.high_raw
    turn = round(_TURN_RAD / abs(mapped.si_per_lsb)) if mapped.quantity == "angle" else 0
    same = step == 1.0 and start == 0.0

    def to_raw(value_q: int) -> Raw:
        raw = value_q if same else round(value_q * step - start)
        if signal.is_float:
            return value_q * step - start
        if turn and not low <= raw <= high:
            raw = (raw - low) % turn + low
        if low <= raw <= high:
            return raw
        if signal.invalid_raw is None:
            raise HarnessError(
                f"{signal.path}: raw value {raw} for {value_q / (1 << frac_bits):g} "
                f"{'turns' if turn else 'm'}: its range ends at {low if raw < low else high}"
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
