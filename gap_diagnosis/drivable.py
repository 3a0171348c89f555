"""The bus of drives that are simulated to advise one: the log's, as far as a loop can use it."""

from __future__ import annotations

from dataclasses import replace

from can_bus import MessageSpec
from hil_harness.assembly import Wire, load_wire


def drivable(wire: Wire) -> Wire:
    """Return a wire that a simulated loop can use.

    Wheels' speeds can only be read from a log: the shipped bus stands for theirs.
    """
    is_speed = wire.signal_map["left_count"].quantity in ("speed", "turn rate")
    return load_wire() if is_speed else _in_whole_ticks(wire)


def _in_whole_ticks(wire: Wire) -> Wire:
    """Return a wire on which each message comes every so many ticks, as the log's rows have it.

    A car's gyro may well be faster than its wheels, and cycles measured in a log are multiples of
    nothing; what comes at no known cycle comes in every tick.
    """
    tick_us = wire.tick_period_us

    def whole(spec: MessageSpec) -> MessageSpec:
        every = max(1, round((spec.cycle_time_us or tick_us) / tick_us))
        phase = round(spec.start_delay_us / tick_us) % every
        return replace(spec, cycle_time_us=every * tick_us, start_delay_us=phase * tick_us)

    mapped = (one.message for one in wire.signal_map.signals.values())
    return wire.with_messages({spec.name: whole(spec) for spec in mapped})
