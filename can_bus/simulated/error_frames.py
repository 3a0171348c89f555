"""Error frames as python-can messages, in the words of Linux's `can/error.h`.

So that any program that reads SocketCAN's error frames reads these.
"""

from __future__ import annotations

from typing import Final

import can

from can_bus.simulated.confinement import WARNING_LIMIT, Confinement, ErrorState
from can_bus.simulated.disturbed_frame import SeenError

# Classes, in the identifier.
CONTROLLER: Final = 0x004
PROTOCOL: Final = 0x008
ACKNOWLEDGE: Final = 0x020
BUS_OFF: Final = 0x040
BUS_ERROR: Final = 0x080
RESTARTED: Final = 0x100
COUNTERS: Final = 0x200

# Data byte 1: state of the controller.
_RX_WARNING: Final = 0x04
_TX_WARNING: Final = 0x08
_RX_PASSIVE: Final = 0x10
_TX_PASSIVE: Final = 0x20
_ACTIVE: Final = 0x40
# Data byte 2: what was wrong; data byte 3: where.
_KINDS: Final = {"bit": 0x01, "form": 0x02, "stuff": 0x04, "crc": 0x00, "ack": 0x00}
_WHILE_SENDING: Final = 0x80
_PLACES: Final = {"crc": 0x08, "ack": 0x19}


def error_message(error: SeenError, after: Confinement, timestamp_s: float) -> can.Message:
    """Return an error as its node's controller reports it, with both counters."""
    classes = PROTOCOL | BUS_ERROR | COUNTERS
    if error.kind == "ack":
        classes |= ACKNOWLEDGE
    data = bytearray(8)
    data[2] = _KINDS[error.kind] | (_WHILE_SENDING if error.is_transmitter else 0)
    data[3] = _PLACES.get(error.kind, 0)
    if after.state is ErrorState.BUS_OFF:
        classes |= BUS_OFF
    data[1] = _controller_state(after)
    if data[1]:
        classes |= CONTROLLER
    data[6], data[7] = min(after.tec, 255), min(after.rec, 255)
    return _message(classes, data, timestamp_s)


def restart_message(timestamp_s: float) -> can.Message:
    """Return the report of a node that is back from bus-off."""
    data = bytearray(8)
    data[1] = _ACTIVE
    return _message(RESTARTED | CONTROLLER | COUNTERS, data, timestamp_s)


def _controller_state(after: Confinement) -> int:
    state = 0
    for count, warning, passive in (
        (after.tec, _TX_WARNING, _TX_PASSIVE),
        (after.rec, _RX_WARNING, _RX_PASSIVE),
    ):
        if count >= 128:
            state |= passive
        elif count >= WARNING_LIMIT:
            state |= warning
    return state


def _message(classes: int, data: bytearray, timestamp_s: float) -> can.Message:
    return can.Message(
        timestamp=timestamp_s,
        arbitration_id=classes,
        is_extended_id=False,
        is_error_frame=True,
        data=data,
    )
