"""Which frames are due at a tick, and the counter that the frames of one tick share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from can_bus import COUNTER_MODULO, MessageSpec, Raw, protect
from hil_harness.errors import HarnessError


class Cycle(NamedTuple):
    """When a message is due: at every tick k with k mod `every` = `phase`."""

    every: int
    phase: int


def cycle_of(spec: MessageSpec, tick_period_us: int) -> Cycle:
    """Return a message's cycle in ticks.

    Raises HarnessError where the DBC gives none, where cycle or start delay is no whole number of
    ticks, or the start delay is a cycle or more.
    """
    cycle_us = spec.cycle_time_us
    if cycle_us is None:
        raise HarnessError(
            f"{spec.name} has no GenMsgCycleTime: expected one, for example "
            f"{tick_period_us // 1000} ms, to know how often it is sent"
        )
    if cycle_us % tick_period_us or spec.start_delay_us % tick_period_us:
        raise HarnessError(
            f"{spec.name}: cycle {cycle_us} µs, start delay {spec.start_delay_us} µs: both must be "
            f"multiples of the tick period, {tick_period_us} µs (the wheel counter's cycle)"
        )
    if spec.start_delay_us >= cycle_us:
        raise HarnessError(
            f"{spec.name}: start delay {spec.start_delay_us} µs: expected less than its cycle, "
            f"{cycle_us} µs"
        )
    return Cycle(cycle_us // tick_period_us, spec.start_delay_us // tick_period_us)


def encode_frame(spec: MessageSpec, raw: Mapping[str, Raw], tick: int) -> bytearray:
    """Return the bytes of a frame of raw payload values, protected with the counter of the tick.

    The counter is the tick modulo 15; in the shipped DBC every slow cycle is 15·m + 1 ticks, so
    that it also advances by one per transmission, as E2E Profile 1 demands.
    """
    data = spec.encode_raw(raw)
    if spec.is_protected:
        protect(spec, data, tick % COUNTER_MODULO)
    return data
