"""Frames as people read them: names, scaled values, units and value-table words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import can

from can_bus import Database, MessageSpec, Raw, SignalSpec

Value = float | int | None


@dataclass(frozen=True, repr=False)
class DecodedFrame(Mapping[str, Value]):
    """One frame of the bus: ``frame["x_m"]`` is the scaled value, or None if marked invalid.

    `raw` holds the integers as they lay in the frame. Signals without scale and offset stay
    integers.
    """

    spec: MessageSpec
    time_us: int
    raw: Mapping[str, Raw]

    @property
    def name(self) -> str:
        """The message's name."""
        return self.spec.name

    @property
    def time_s(self) -> float:
        """Bus time in seconds."""
        return self.time_us * 1e-6

    def label(self, signal: str) -> str | None:
        """Return the value-table word of a signal's value, or None if it has none."""
        raw = self.raw[signal]
        return self.spec.signals[signal].choices.get(raw) if isinstance(raw, int) else None

    def __getitem__(self, signal: str) -> Value:
        """Return a signal's scaled value, None if it is marked invalid."""
        return scaled(self.spec.signals[signal], self.raw[signal])

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names of the signals in the frame."""
        return iter(self.raw)

    def __len__(self) -> int:
        """Return how many signals the frame has."""
        return len(self.raw)

    def __str__(self) -> str:
        """Return one line: time, who sends it by the DBC, name, and each signal with its unit."""
        sender = "".join(f"{name}  " for name in self.spec.senders[:1])
        return f"{self.time_s:.6f} s  {sender}{self.name}  {self.show()}"

    def __repr__(self) -> str:
        """Return the same line: what a failed assertion shows."""
        return f"<{self}>"

    def show(self, signals: tuple[str, ...] | None = None) -> str:
        """Return the given signals, or all but counter and CRC, as ``name = value unit``."""
        if signals is None:
            e2e = self.spec.e2e
            housekeeping = () if e2e is None else (e2e.counter_signal, e2e.crc_signal)
            signals = tuple(name for name in self.raw if name not in housekeeping)
        return ", ".join(f"{name} = {self._show_value(name)}" for name in signals)

    def _show_value(self, signal: str) -> str:
        value, label = self[signal], self.label(signal)
        if value is None:
            return "invalid"
        unit = self.spec.signals[signal].unit
        text = str(value) if isinstance(value, int) else f"{value:.9g}"
        if label is not None:
            return f"{text} ({label})"
        return text if unit in ("", "1") else f"{text} {unit}"


def scaled(signal: SignalSpec, raw: Raw) -> Value:
    """Return the scaled value of a raw one, None if it is the signal's invalid value."""
    if raw == signal.invalid_raw:
        return None
    if signal.factor == 1 and signal.offset == 0:
        return raw
    return signal.to_scaled(raw)


def decode(database: Database, message: can.Message, time_us: int) -> DecodedFrame | None:
    """Return the frame decoded, or None if the DBC does not know it or its length is wrong."""
    spec = database.by_id(message.arbitration_id, message.is_extended_id)
    if spec is None or message.is_remote_frame or len(message.data) != spec.length_bytes:
        return None
    return DecodedFrame(spec, time_us, spec.decode_raw(message.data))
