"""A log's frames by message, checked as the ECU checks them, as columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from can_bus import (
    COUNTER_MODULO,
    Database,
    LogColumns,
    MessageSpec,
    SignalSpec,
    crc8_profile1_array,
    decode_columns,
    present_columns,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Column = NDArray[np.int64] | NDArray[np.uint64] | NDArray[np.float64]

_WORD_BYTES = 8
_FNV_PRIME = np.uint64(0x100000001B3)
_FNV_START = np.uint64(0xCBF29CE484222325)
_SELDOM = 0.05
"""A range that more of an unprotected message's frames leave is not what its sender keeps to."""
_ERROR_CODES = 3
"""So many values outside a range may stand for an error or for not available."""


@dataclass(frozen=True)
class MessageFrames:
    """The believable frames of one message, in the log's order.

    Attributes:
        spec: the message.
        stamp_us: int64[f], reception stamps.
        counter: int64[f], alive counter 0 to 14; None where the message has none.
        raw: per payload signal float64[f], raw values; NaN where marked as not available.
        payload: uint64[f], all bits but counter and CRC (above eight bytes: a hash of them).
        boundless: signals whose described range cannot be theirs, so that it was not checked.
    """

    spec: MessageSpec
    stamp_us: Ints
    counter: Ints | None
    raw: Mapping[str, Floats]
    payload: NDArray[np.uint64]
    boundless: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.stamp_us)

    @property
    def modulo(self) -> int:
        """What the counter counts to; 0 without a counter."""
        return 0 if self.counter is None else COUNTER_MODULO


def checked_frames(
    columns: LogColumns, database: Database
) -> tuple[dict[str, MessageFrames], dict[str, int]]:
    """Return the frames of each message of *database* in the log, and what was refused by reason.

    Refused are frames of another bus (see `_of_its_bus`) and then, in the ECU's order: unknown
    identifiers, wrong lengths and remote frames, wrong CRCs, a counter that is never sent (15),
    values outside the described range. Age and sequence are not checked: the diagnosis wants to
    see what came late, twice or in another order. Nor is a
    range that cannot be the signal's (see `_cannot_be_its_range`).
    """
    rejected = dict.fromkeys(("other_bus", "unknown_id", "length", "crc", "counter", "range"), 0)
    found: dict[str, MessageFrames] = {}
    known = 0
    main = _main_bus(columns, database)
    for spec in database.messages.values():
        named = _named(columns, spec)
        known += int(np.count_nonzero(named))
        own = _of_its_bus(columns, named, main)
        count = int(np.count_nonzero(own))
        rejected["other_bus"] += int(np.count_nonzero(named)) - count
        if count == 0:
            continue
        rows = columns.rows_of(spec)
        rows = rows[own[rows]]
        rejected["length"] += count - len(rows)
        rows = _drop(rows, _crc_is_right(spec, columns.data[rows]), rejected, "crc")
        data = columns.data[rows]
        raw = decode_columns(spec, data)
        counter: Ints | None = None
        good = np.ones(len(rows), dtype=np.bool_)
        if spec.is_protected and spec.e2e is not None:
            counter = np.asarray(raw[spec.e2e.counter_signal], dtype=np.int64)
            good = counter < COUNTER_MODULO
            rejected["counter"] += int(np.count_nonzero(~good))
        present = present_columns(spec, raw)
        values = {
            signal.name: _value(signal, raw[signal.name], present[signal.name])
            for signal in spec.payload
        }
        inside = np.ones(len(rows), dtype=np.bool_)
        boundless = []
        for signal in spec.payload:
            there = present[signal.name]
            within = ~there | _in_range(signal, raw[signal.name])
            if not spec.is_protected and _cannot_be_its_range(signal, raw[signal.name], ~within):
                boundless.append(signal.name)
            else:
                inside &= within
        rejected["range"] += int(np.count_nonzero(good & ~inside))
        good &= inside
        if good.any():
            found[spec.name] = MessageFrames(
                spec=spec,
                stamp_us=columns.timestamp_us[rows][good],
                counter=None if counter is None else counter[good],
                raw={name: value[good] for name, value in values.items()},
                payload=_payload(spec, data[good]),
                boundless=tuple(boundless),
            )
    rejected["unknown_id"] = len(columns) - known
    return found, rejected


def _named(columns: LogColumns, spec: MessageSpec) -> Bools:
    return np.asarray(
        (columns.frame_id == spec.frame_id) & (columns.is_extended == spec.is_extended)
    )


def _main_bus(columns: LogColumns, database: Database) -> int | None:
    """Return the bus with most of the messages that a DBC knows, then most frames; None of one."""
    buses: list[int] = np.unique(columns.bus[columns.is_data]).tolist()
    if len(buses) < 2:
        return None
    frames = dict.fromkeys(buses, 0)
    messages = frames.copy()
    for spec in database.messages.values():
        on, counts = np.unique(
            columns.bus[_named(columns, spec) & columns.is_data], return_counts=True
        )
        for bus, count in zip(on.tolist(), counts.tolist(), strict=True):
            messages[bus] += 1
            frames[bus] += count
    return max(frames, key=lambda bus: (messages[bus], frames[bus]))


def _of_its_bus(columns: LogColumns, named: Bools, main: int | None) -> Bools:
    """Return which frames of a message are of one bus: the DBC's, if they are there.

    In a log of several buses a gateway's copies come some ms later, and an identifier may be
    another message elsewhere. What the main bus does not have is taken from where it comes most.
    """
    if main is None or not named.any():
        return named
    own: Bools = named & (columns.bus == main)
    if own.any():
        return own
    buses, counts = np.unique(columns.bus[named], return_counts=True)
    return np.asarray(named & (columns.bus == buses[np.argmax(counts)]))


def _drop(
    rows: NDArray[np.intp], good: Bools, rejected: dict[str, int], reason: str
) -> NDArray[np.intp]:
    rejected[reason] += int(np.count_nonzero(~good))
    return rows[good]


def _crc_is_right(spec: MessageSpec, data: NDArray[np.uint8]) -> Bools:
    if not spec.is_protected or spec.e2e is None:
        return np.ones(len(data), dtype=np.bool_)
    frames = data[:, : spec.length_bytes]
    return np.asarray(crc8_profile1_array(spec.e2e.data_id, frames) == frames[:, 0])


def _value(signal: SignalSpec, raw: Column, present: Bools) -> Floats:
    value = raw.astype(np.float64)
    if signal.invalid_raw is not None:
        value[raw == signal.invalid_raw] = np.nan
    value[~present] = np.nan
    return value


def _in_range(signal: SignalSpec, raw: Column) -> Bools:
    if signal.is_float:
        scaled = raw.astype(np.float64) * signal.factor + signal.offset
        good = np.isfinite(scaled)
        if signal.minimum is not None:
            good &= scaled >= signal.minimum
        if signal.maximum is not None:
            good &= scaled <= signal.maximum
        return good
    inside: Bools = (raw >= signal.low_raw) & (raw <= signal.high_raw)
    return inside if signal.invalid_raw is None else inside | (raw == signal.invalid_raw)


def _cannot_be_its_range(signal: SignalSpec, raw: Column, outside: Bools) -> bool:
    """Tell a range that says nothing of a signal some of whose values are *outside* it.

    In DBCs that were written by those who read a bus, ranges are often copied from another signal
    or say what raw values there may be: a yaw rate from -125 to 125 deg/s has [0|65535], and every
    turn to the right would be refused. Such a range has an end that the bits cannot hold, or the
    frames leave it again and again, by more values than error codes would have.
    """
    if signal.is_float or not outside.any():
        return False
    ends = [end for end in (signal.minimum, signal.maximum) if end is not None]
    held = sorted(signal.to_scaled(code) for code in (signal.low_code, signal.high_code))
    step = abs(signal.factor)
    if any(not held[0] - step <= end <= held[1] + step for end in ends):
        return True
    is_seldom = np.count_nonzero(outside) <= _SELDOM * len(outside)
    return not is_seldom and len(np.unique(raw[outside])) > _ERROR_CODES


def _payload(spec: MessageSpec, data: NDArray[np.uint8]) -> NDArray[np.uint64]:
    """Return what a frame says, as one number: equal numbers mean equal payloads."""
    frames = np.array(data[:, : spec.length_bytes])
    if spec.is_protected:
        frames[:, 0] = 0
        frames[:, 1] &= 0xF0
    if spec.length_bytes > _WORD_BYTES:
        mixed = np.full(len(frames), _FNV_START, dtype=np.uint64)
        for column in range(spec.length_bytes):
            mixed = (mixed ^ frames[:, column]) * _FNV_PRIME
        return mixed
    padded = np.zeros((len(frames), _WORD_BYTES), dtype=np.uint8)
    padded[:, : spec.length_bytes] = frames
    return np.ascontiguousarray(padded.view("<u8")[:, 0], dtype=np.uint64)
