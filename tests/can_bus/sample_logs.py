"""Frames that the tests of logs write, and how."""

from __future__ import annotations

from pathlib import Path

import can
import pytest

from can_bus import (
    LOG_SUFFIXES,
    load_database,
    make_message,
    open_log_writer,
)

DATABASE = load_database()
ENCODER = DATABASE.message("ENCODER")
each_suffix = pytest.mark.parametrize("suffix", LOG_SUFFIXES)


def encoder(tick: int) -> can.Message:
    """Return an encoder frame."""
    return make_message(ENCODER, ENCODER.pack((tick, 0), tick % 15), tick * 10_000)


SAMPLES = [
    encoder(0),
    can.Message(timestamp=0.25, arbitration_id=0x18FEF1FE, is_extended_id=True, data=b"\x01\x02"),
    can.Message(timestamp=0.5, arbitration_id=0x7FF, is_extended_id=False, data=b""),
    can.Message(
        timestamp=0.75, arbitration_id=0x55, is_extended_id=False, is_remote_frame=True, dlc=4
    ),
    encoder(150),
]


def write(path: Path, messages: list[can.Message]) -> None:
    """Write a log; every other frame counts as received."""
    with open_log_writer(path) as log:
        for number, message in enumerate(messages):
            log.write(message, received=number % 2 == 0)
