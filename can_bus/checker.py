"""What a receiver checks before it believes a frame: length, CRC, counter, range, age."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import Final, Literal, NamedTuple, get_args

import can

from can_bus.database import Database, identifier_key
from can_bus.e2e import CounterCheck, E2EStatus, crc8, unsupported_profile
from can_bus.e2e_state import E2EState, E2EStateMachine, ProfileStatus
from can_bus.errors import CanBusError
from can_bus.frames import MICROSECONDS_PER_S
from can_bus.signals import Raw, SignalSpec
from can_bus.specs import MessageSpec

Reason = Literal["length", "crc", "counter", "range", "age", "unknown_id"]
REASONS: Final[tuple[Reason, ...]] = get_args(Reason)
"""Why a frame can be rejected, in the order in which the checks are made (unknown_id first)."""

# Stamps are whole microseconds kept in a float: they are that exact after rounding.
_ROUNDING_US: Final = 0.5
_OK: Final = E2EStatus.OK
_INVALID: Final = E2EState.INVALID

_log = logging.getLogger(__name__)


class Accepted(NamedTuple):
    """A frame whose content may be used.

    Attributes:
        spec: its message.
        raw: raw value of each signal in it but counter and CRC, invalid ones included.
        invalid: names of the signals that their sender marked as not available (SNA).
        timestamp_us: its stamp.
        counter: its alive counter, 0 to 14; None for an unprotected message.
        is_trusted: False while AUTOSAR's state machine calls the message's stream INVALID: this
            frame passed its checks, but too few of the last ones did.
    """

    spec: MessageSpec
    raw: dict[str, Raw]
    invalid: tuple[str, ...]
    timestamp_us: int
    counter: int | None
    is_trusted: bool = True


class _Reception:
    """What the checker knows and remembers of one accepted message."""

    __slots__ = ("counter", "crc_start", "fields", "last_us", "length_bytes", "machine", "spec")

    def __init__(self, spec: MessageSpec) -> None:
        self.spec = spec
        self.length_bytes = spec.length_bytes
        self.counter = None if spec.e2e is None else CounterCheck(spec.e2e)
        self.machine = E2EStateMachine()
        self.crc_start = spec.crc_start
        self.last_us: int | None = None
        self.fields = (
            tuple(_ranged(spec, signal) for signal in spec.payload) if spec.is_plain else None
        )


class FrameChecker:
    """Checks each received frame and counts what it rejects.

    `accepted` names the messages this receiver wants. Each frame passes, in this order: its
    identifier (`unknown_id`: the database has no such message), its length (`length`: also remote
    and CAN FD frames), for a protected message its CRC (`crc`) and its counter (`counter`: the rule
    of `CounterCheck`, with one cycle without data for each GenMsgCycleTime that went by without a
    frame), the described range of every signal (`range`; a value marked SNA is not out of range: it
    is delivered as invalid), and its stamp (`age`: older than `max_age_us` before `now_us`, or in
    the future). Whatever the bytes, nothing raises. Messages that the database has and this
    receiver does not want are none of its business: neither accepted nor rejected.

    Raises CanBusError for an unknown message name or a protection that cannot be checked here.
    """

    def __init__(self, database: Database, accepted: Iterable[str], *, max_age_us: int) -> None:
        """Start with no frame seen; `rejected` counts by reason from here on."""
        self.rejected: dict[Reason, int] = dict.fromkeys(REASONS, 0)
        self._max_age_us = max_age_us
        self._receptions: dict[int, _Reception] = {}
        for name in accepted:
            spec = database.message(name)
            if spec.e2e is not None and not spec.is_protected:
                raise unsupported_profile(spec.name, spec.e2e)
            key = identifier_key(spec.frame_id, spec.is_extended)
            self._receptions[key] = _Reception(spec)
        known = (identifier_key(m.frame_id, m.is_extended) for m in database.messages.values())
        self._unwanted = frozenset(known).difference(self._receptions)

    def check(self, message: can.Message, now_us: int) -> Accepted | None:
        """Return the frame's content if it may be used, None if not (see `rejected`)."""
        key = message.arbitration_id
        if message.is_extended_id:
            key = identifier_key(key, True)
        reception = self._receptions.get(key)
        if reception is None or message.is_error_frame:
            if key not in self._unwanted or message.is_error_frame:
                self._reject("unknown_id", message)
            return None
        data = message.data
        if (
            len(data) != reception.length_bytes
            or message.is_remote_frame
            or (message.is_fd and not reception.spec.is_fd)
        ):
            self._reject("length", message)
            return None
        alive: int | None = None
        is_trusted = True
        counter = reception.counter
        if counter is not None:
            last_us = reception.last_us
            reception.last_us = now_us
            cycle_us = reception.spec.cycle_time_us
            if last_us is not None and cycle_us is not None:
                missed_cycles = (2 * (now_us - last_us) + cycle_us) // (2 * cycle_us) - 1
                if missed_cycles > 0:
                    counter.pass_cycles(missed_cycles)
                    reception.machine.pass_cycles(missed_cycles)
            if crc8(data[1:], reception.crc_start) != data[0]:
                reception.machine.add(counter.reject_crc())
                self._reject("crc", message)
                return None
            alive = data[1] & 0x0F
            status = counter.check(alive)
            is_trusted = reception.machine.add(status) is not _INVALID
            if status is not _OK and not status.is_accepted:
                self._reject("counter", message)
                return None
        invalid: tuple[str, ...] = ()
        raw: dict[str, Raw]
        fields = reception.fields
        if fields is None:
            general = _check_ranges(reception.spec, data)
            if general is None:
                self._reject("range", message)
                return None
            raw, invalid = general
        else:
            word = int.from_bytes(data, "little")
            raw = {}
            for name, shift, mask, sign, low, high, sna in fields:
                value = ((word >> shift & mask) ^ sign) - sign
                if value == sna:
                    invalid += (name,)
                elif value < low or value > high:
                    self._reject("range", message)
                    return None
                raw[name] = value
        stamp = message.timestamp * MICROSECONDS_PER_S
        # Compared as floats: a stamp that is no number cannot be rounded.
        if not -_ROUNDING_US <= now_us - stamp <= self._max_age_us + _ROUNDING_US:
            self._reject("age", message)
            return None
        return Accepted(reception.spec, raw, invalid, round(stamp), alive, is_trusted)

    def e2e(self, name: str) -> tuple[ProfileStatus, E2EState]:
        """Return the result of a protected message's last cycle, and the state of its stream.

        Cycles without a frame count when the next frame comes. Raises CanBusError for a message
        that this receiver does not accept.
        """
        for reception in self._receptions.values():
            if reception.spec.name == name:
                return reception.machine.status, reception.machine.state
        raise CanBusError(f"this receiver does not accept {name!r}")

    def _reject(self, reason: Reason, message: can.Message) -> None:
        self.rejected[reason] += 1
        _log.debug("rejected (%s): id %X, %d bytes", reason, message.arbitration_id, message.dlc)


def _ranged(
    spec: MessageSpec, signal: SignalSpec
) -> tuple[str, int, int, int, int, int, int | None]:
    mask = (1 << signal.length_bits) - 1
    return (
        signal.name,
        signal.shift_in(spec.length_bytes),
        mask,
        signal.sign_bit,
        signal.low_raw,
        signal.high_raw,
        signal.invalid_raw,
    )


def _check_ranges(
    spec: MessageSpec, data: bytearray
) -> tuple[dict[str, Raw], tuple[str, ...]] | None:
    """Decode any layout; None when a signal is out of range. The slow twin of the loop in check."""
    own = () if spec.e2e is None else (spec.e2e.crc_signal, spec.e2e.counter_signal)
    raw = {name: value for name, value in spec.decode_raw(data).items() if name not in own}
    invalid = tuple(n for n, value in raw.items() if value == spec.signals[n].invalid_raw)
    if all(n in invalid or spec.signals[n].in_range(value) for n, value in raw.items()):
        return raw, invalid
    return None
