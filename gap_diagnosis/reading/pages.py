"""Multiplexed messages: each of their pages is read as a message of its own.

The wheels may lie in two pages that take turns. Taken as one message, every frame would be a tick,
most of them without a wheel, and the tick as short as two pages are apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from can_bus import MessageSpec, SignalSpec, present_columns
from gap_diagnosis.reading.cycle_times import page_cycle_us
from gap_diagnosis.reading.frames import Bools, MessageFrames
from hil_harness.assembly import Wire
from hil_harness.signal_map import MappedSignal
from hil_harness.signal_roles import Role

_Page = tuple[tuple[str, frozenset[int]], ...]
_SHARED_COUNTER = "tick_counter"


def by_pages(
    frames: Mapping[str, MessageFrames], wire: Wire
) -> tuple[dict[str, MessageFrames], Wire]:
    """Return frames and wire in which mapped pages of multiplexed messages are messages.

    The first page, in the order of roles, keeps the message's name; frames of pages that nobody
    mapped are left out.
    """
    found, signals = dict(frames), dict(wire.signal_map.signals)
    for name, roles in _multiplexed(signals).items():
        whole = found.pop(name, None)
        if whole is None:
            continue
        pages: dict[_Page, MessageSpec] = {}
        for role in roles:
            mapped = signals[role]
            page = _page_of(mapped.signal, whole.spec)
            if page not in pages:
                own = _frames_of_page(whole, mapped.signal, is_first=not pages)
                pages[page] = own.spec
                if len(own):
                    found[own.spec.name] = own
            signals[role] = replace(mapped, message=pages[page])
    signal_map = replace(wire.signal_map, signals=MappingProxyType(signals))
    return found, replace(wire, signal_map=signal_map)


def _multiplexed(signals: Mapping[Role, MappedSignal]) -> dict[str, list[Role]]:
    """Return the mapped roles of each message of which at least one lies in a page."""
    roles: dict[str, list[Role]] = {}
    for role, mapped in signals.items():
        roles.setdefault(mapped.message.name, []).append(role)
    return {
        name: own
        for name, own in roles.items()
        if any(signals[role].signal.multiplexer is not None for role in own)
    }


def _page_of(signal: SignalSpec, spec: MessageSpec) -> _Page:
    """Return what the selectors say where the signal is in the frame; empty: in all frames."""
    if signal.multiplexer is None:
        return ()
    above = spec.signals[signal.multiplexer]
    return ((signal.multiplexer, signal.multiplexer_values), *_page_of(above, spec))


def _frames_of_page(whole: MessageFrames, signal: SignalSpec, *, is_first: bool) -> MessageFrames:
    there: Bools = present_columns(whole.spec, dict(whole.raw))[signal.name]
    spec, stamp_us = whole.spec, whole.stamp_us[there]
    counter = whole.counter
    if spec.e2e is None or spec.e2e.counter_signal != _SHARED_COUNTER:
        counter = None  # it counts the frames of all pages
    return replace(
        whole,
        spec=replace(
            spec,
            name=spec.name if is_first else f"{spec.name}.{signal.name}",
            cycle_time_us=page_cycle_us(spec.cycle_time_us, stamp_us),
        ),
        stamp_us=stamp_us,
        counter=None if counter is None else counter[there],
        raw={name: value[there] for name, value in whole.raw.items()},
        payload=whole.payload[there],
    )
