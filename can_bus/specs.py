"""One message of the database: its layout, its timing, and the codec of its frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from operator import index

from can_bus.e2e import (
    COUNTER_MODULO,
    PROFILE_1A,
    E2EProtection,
    crc8,
    crc8_start,
    unsupported_profile,
)
from can_bus.errors import CanBusError
from can_bus.signals import Raw, SignalSpec

PackField = tuple[int, int, int, int]
"""Shift, mask, lowest and highest code of a signal in the frame read as one integer."""

UnpackField = tuple[int, int, int]
"""Shift, mask and sign bit of a signal in the frame read as one integer."""


@dataclass(frozen=True)
class MessageSpec:
    """A message as the database describes it.

    Attributes:
        frame_id: 11 bits, or 29 bits where `is_extended`.
        cycle_time_us: `GenMsgCycleTime` in whole microseconds; None where it is not cyclic.
        start_delay_us: `GenMsgStartDelayTime`: phase of the first transmission.
        send_type: `GenMsgSendType`, None where the database gives none.
        senders, receivers: node names.
        signals: name to signal, in the order of their position.
        e2e: end-to-end protection, None where there is none.
        payload: the signals that are neither counter nor CRC, in the order of `signals`; `pack` and
            `unpack` take and give values in this order.
    """

    name: str
    frame_id: int
    is_extended: bool
    length_bytes: int
    signals: Mapping[str, SignalSpec]
    cycle_time_us: int | None = None
    start_delay_us: int = 0
    send_type: str | None = None
    senders: tuple[str, ...] = ()
    receivers: tuple[str, ...] = ()
    e2e: E2EProtection | None = None
    comment: str = ""
    is_fd: bool = False

    payload: tuple[SignalSpec, ...] = field(init=False, repr=False, compare=False)
    is_plain: bool = field(init=False, repr=False, compare=False)
    """All signals are little-endian integers that are always present."""
    pack_fields: tuple[PackField, ...] = field(init=False, repr=False, compare=False)
    unpack_fields: tuple[UnpackField, ...] = field(init=False, repr=False, compare=False)
    """Of a plain message: the payload for the fast codec; otherwise empty."""
    is_protected: bool = field(init=False, repr=False, compare=False)
    """Its end-to-end protection is one that can be computed and checked here."""
    crc_start: int = field(init=False, repr=False, compare=False)
    """CRC register after the data ID."""

    def __post_init__(self) -> None:
        """Precompute shifts and masks."""
        e2e = self.e2e
        own = () if e2e is None else (e2e.crc_signal, e2e.counter_signal)
        payload = tuple(s for s in self.signals.values() if s.name not in own)
        is_plain = all(
            s.byte_order == "little_endian" and not s.is_float and s.multiplexer is None
            for s in self.signals.values()
        )
        derive = object.__setattr__
        derive(self, "payload", payload)
        derive(self, "is_plain", is_plain)
        fast = payload if is_plain else ()
        derive(self, "pack_fields", tuple(map(_pack_field, fast)))
        derive(self, "unpack_fields", tuple(map(_unpack_field, fast)))
        derive(self, "is_protected", e2e is not None and e2e.profile == PROFILE_1A)
        derive(self, "crc_start", 0 if e2e is None else crc8_start(e2e.data_id))

    def signal(self, name: str) -> SignalSpec:
        """Return a signal by name. Raises CanBusError with the names there are."""
        try:
            return self.signals[name]
        except KeyError:
            raise CanBusError(
                f"{self.name} has no signal {name!r}: it has {', '.join(self.signals)}"
            ) from None

    def pack(self, values: Sequence[int], counter: int | None = None) -> bytearray:
        """Return a frame of raw values, one per payload signal in order: the fast path.

        With `counter` the frame is protected as well. Bits of no signal are 0. Raises CanBusError
        for a wrong number of values, a value that its bits cannot hold, a counter outside 0 … 14,
        or a message that only `encode_raw` can write (multiplexed, big endian or float).
        """
        if not self.is_plain:
            raise CanBusError(
                f"{self.name} is multiplexed, big endian or float: use encode_raw with names"
            )
        fields = self.pack_fields
        if len(values) != len(fields):
            raise CanBusError(
                f"{self.name}: {len(values)} values for {len(fields)} signals "
                f"({', '.join(signal.name for signal in self.payload)})"
            )
        word = 0
        for value, (shift, mask, low, high) in zip(values, fields, strict=False):
            code = index(value)
            if not low <= code <= high:
                raise self._does_not_fit(values)
            word |= (code & mask) << shift
        length = self.length_bytes
        if counter is None:
            return bytearray(word.to_bytes(length, "little"))
        if not self.is_protected or not 0 <= counter < COUNTER_MODULO:
            raise self._cannot_protect(counter)
        body = (word >> 8 | counter).to_bytes(length - 1, "little")
        frame = bytearray((crc8(body, self.crc_start),))
        frame += body
        return frame

    def unpack(self, data: bytes | bytearray) -> tuple[int, ...]:
        """Return the raw values of the payload signals in order: the fast path.

        Raises CanBusError for a wrong length or a message that only `decode_raw` can read.
        """
        if not self.is_plain:
            raise CanBusError(f"{self.name} is multiplexed, big endian or float: use decode_raw")
        if len(data) != self.length_bytes:
            raise self._wrong_length(data)
        word = int.from_bytes(data, "little")
        return tuple(
            [((word >> shift & mask) ^ sign) - sign for shift, mask, sign in self.unpack_fields]
        )

    def encode_raw(self, raw: Mapping[str, Raw]) -> bytearray:
        """Return a frame of raw values by name; signals left out take their initial value.

        Counter and CRC are signals like any other here: `protect` writes them afterwards. Of a
        multiplexed message only the signals that the multiplexer selects are written. Raises
        CanBusError for an unknown name, a value that the bits cannot hold, or a signal that is not
        selected.
        """
        for name in raw:
            self.signal(name)
        little = big = 0
        length = self.length_bytes
        for signal in self.signals.values():
            if not self._is_present(signal, raw):
                if signal.name in raw:
                    raise CanBusError(
                        f"{signal.path} is not in the frame: {signal.multiplexer} must be "
                        f"one of {sorted(signal.multiplexer_values)}"
                    )
                continue
            bits = signal.to_bits(raw.get(signal.name, signal.initial_raw))
            if signal.byte_order == "little_endian":
                little |= bits << signal.shift_in(length)
            else:
                big |= bits << signal.shift_in(length)
        frame = little.to_bytes(length, "little")
        if big:
            frame = bytes(a | b for a, b in zip(frame, big.to_bytes(length, "big"), strict=True))
        return bytearray(frame)

    def decode_raw(self, data: bytes | bytearray) -> dict[str, Raw]:
        """Return the raw value of each signal that is present in the frame.

        Raises CanBusError for a wrong length.
        """
        if len(data) != self.length_bytes:
            raise self._wrong_length(data)
        little = int.from_bytes(data, "little")
        big = int.from_bytes(data, "big")
        values: dict[str, Raw] = {}
        for signal in self.signals.values():
            word = little if signal.byte_order == "little_endian" else big
            bits = word >> signal.shift_in(self.length_bytes) & ((1 << signal.length_bits) - 1)
            values[signal.name] = signal.from_bits(bits)
        return {
            name: value
            for name, value in values.items()
            if self._is_present(self.signals[name], values)
        }

    def encode_scaled(self, scaled: Mapping[str, float | str]) -> bytearray:
        """Return a frame of scaled values by name, in each signal's unit, or of value-table names.

        `"SNA"` marks a signal as not available. Signals left out take their initial value. Raises
        CanBusError for unknown names and values outside the described range.
        """
        return self.encode_raw(
            {
                name: self.signal(name).raw_of_choice(value)
                if isinstance(value, str)
                else self.signal(name).to_raw(value)
                for name, value in scaled.items()
            }
        )

    def decode_scaled(self, data: bytes | bytearray) -> dict[str, float | None]:
        """Return the scaled value of each signal in the frame, None where it is not available."""
        return {
            name: None
            if self.signals[name].invalid_raw == raw
            else self.signals[name].to_scaled(raw)
            for name, raw in self.decode_raw(data).items()
        }

    def _is_present(self, signal: SignalSpec, raw: Mapping[str, Raw]) -> bool:
        if signal.multiplexer is None:
            return True
        selector = self.signals[signal.multiplexer]
        if not self._is_present(selector, raw):
            return False
        return raw.get(selector.name, selector.initial_raw) in signal.multiplexer_values

    def _wrong_length(self, data: bytes | bytearray) -> CanBusError:
        return CanBusError(f"{self.name}: a frame of {len(data)} bytes, not {self.length_bytes}")

    def _does_not_fit(self, values: Sequence[int]) -> CanBusError:
        for signal, value in zip(self.payload, values, strict=True):
            try:
                signal.to_bits(index(value))
            except CanBusError as error:
                return error
        raise AssertionError("all values fit")

    def _cannot_protect(self, counter: int) -> CanBusError:
        if self.e2e is None:
            return CanBusError(f"{self.name} has no E2E protection: it takes no counter")
        if not self.is_protected:
            return unsupported_profile(self.name, self.e2e)
        return CanBusError(
            f"{self.name}: counter {counter}: Profile 1 counts from 0 to {COUNTER_MODULO - 1}"
        )


def protect(spec: MessageSpec, data: bytearray, counter: int) -> None:
    """Write the alive counter and the CRC into a frame of `spec`, in place.

    Raises CanBusError for a message without (supported) protection, a wrong length, or a counter
    outside 0 … 14.
    """
    if not spec.is_protected or not 0 <= counter < COUNTER_MODULO:
        raise spec._cannot_protect(counter)
    if len(data) != spec.length_bytes:
        raise spec._wrong_length(data)
    data[1] = data[1] & 0xF0 | counter
    data[0] = crc8(data[1:], spec.crc_start)


def _pack_field(signal: SignalSpec) -> PackField:
    mask = (1 << signal.length_bits) - 1
    return signal.start_bit, mask, signal.low_code, signal.high_code


def _unpack_field(signal: SignalSpec) -> UnpackField:
    return signal.start_bit, (1 << signal.length_bits) - 1, signal.sign_bit
