"""End-to-end protection: AUTOSAR E2E Profile 1, variant 1A.

Layout: CRC in byte 0, alive counter (0 to 14; 15 is never sent) in the low nibble of byte 1. The
CRC has the SAE J1850 polynomial x⁸+x⁴+x³+x²+1, effective start value 0 and no final inversion, and
runs over both bytes of the data ID, low byte first, then over all bytes of the frame but its own.

Source: AUTOSAR, *Specification of SW-C End-to-End Communication Protection Library* (E2E Library)
and PRS_E2EProtocol, "E2E Profile 1". Checked in the tests against an independent implementation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum, unique
from typing import Final

import numpy as np
from fastcrc.crc8 import gsm_a
from numpy.typing import NDArray

from can_bus.errors import CanBusError

PROFILE_1A: Final = "P01_1A"
"""Name of the supported profile, as the DBC attribute `E2EProfile` gives it."""

COUNTER_MODULO: Final = 15
"""Profile 1 counts 0 … 14."""

_POLYNOMIAL: Final = 0x1D
_MAX_DELTA_LIMIT: Final = COUNTER_MODULO - 1


@dataclass(frozen=True, slots=True)
class E2EProtection:
    """How a message is protected, as the DBC attributes say.

    Attributes:
        profile: value of `E2EProfile`; only `P01_1A` can be protected and checked.
        data_id: 16-bit identity of the content, part of the CRC and never sent.
        counter_signal, crc_signal: names of the two signals.
        max_delta_counter: `E2EMaxDeltaCounterInit`: at a reception in the very next cycle, counter
            steps from 1 to this plus 1 are accepted; each further cycle accepts one more.
        max_no_new_or_repeated: `E2EMaxNoNewOrRepeatedData`: after more cycles without a new frame
            the sequence has to be synchronised anew.
        sync_counter: `E2ESyncCounterInit`: frames in sequence that a synchronisation takes.
    """

    profile: str
    data_id: int
    counter_signal: str
    crc_signal: str
    max_delta_counter: int = 1
    max_no_new_or_repeated: int = _MAX_DELTA_LIMIT
    sync_counter: int = 0


def crc8_start(data_id: int) -> int:
    """Return the CRC register after the data ID: the start value for the frame's bytes."""
    return crc8(bytes((data_id & 0xFF, data_id >> 8)), 0)


crc8: Final[Callable[[bytes | bytearray, int], int]] = gsm_a
"""Continue the CRC over the data from a register value."""


def crc8_profile1(data_id: int, data: bytes | bytearray) -> int:
    """Return the Profile 1 CRC of a frame; its byte 0, the CRC itself, does not count."""
    return crc8(data[1:], crc8_start(data_id))


def _build_table() -> NDArray[np.uint8]:
    table = np.arange(256, dtype=np.uint8)
    for _ in range(8):
        table = np.where(table & 0x80, table << 1 ^ _POLYNOMIAL, table << 1).astype(np.uint8)
    return table


_TABLE: Final = _build_table()
_TABLE.setflags(write=False)


def crc8_profile1_array(data_id: int, data: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the Profile 1 CRC of each frame of `data` (uint8[frames, bytes]) as uint8[frames]."""
    register = np.full(len(data), crc8_start(data_id), dtype=np.uint8)
    for column in range(1, data.shape[1]):
        register = _TABLE[register ^ data[:, column]]
    return register


def unsupported_profile(message: str, protection: E2EProtection) -> CanBusError:
    """Return the error for a protection that cannot be computed here."""
    return CanBusError(
        f"{message}: E2EProfile {protection.profile!r} cannot be computed here: "
        f"only {PROFILE_1A!r} (AUTOSAR E2E Profile 1, variant 1A)"
    )


@unique
class E2EStatus(Enum):
    """Result of one reception, with the names of AUTOSAR's E2E_P01CheckStatusType."""

    OK = "new, in sequence"
    INITIAL = "first frame since start: its counter is the baseline"
    OKSOMELOST = "new, frames lost but within tolerance"
    WRONGCRC = "damaged or not what its identifier says"
    REPEATED = "same counter as before"
    WRONGSEQUENCE = "counter step beyond tolerance"
    SYNC = "in sequence, but the sequence is not trusted yet"
    NONEWDATA = "nothing was received"

    @property
    def is_accepted(self) -> bool:
        """Tell whether the frame's content may be used."""
        return self in _ACCEPTED


_OK: Final = E2EStatus.OK
_ACCEPTED: Final = frozenset((E2EStatus.OK, E2EStatus.INITIAL, E2EStatus.OKSOMELOST))


class CounterCheck:
    """The receiver's side of the counter: the rule of AUTOSAR's E2E_P01Check.

    One call of `check` is one reception; `missed_cycles` is how many cycles went by without a frame
    since the last call. With Δ = (received − last valid) mod 15:

    - the first frame sets the baseline (INITIAL, accepted);
    - tolerance = `max_delta_counter` + 1 in the next cycle, + 1 for each further cycle, at most 14;
    - Δ = 0: REPEATED, rejected;
    - 1 ≤ Δ ≤ tolerance: accepted (OK for Δ = 1, else OKSOMELOST), tolerance starts anew;
    - Δ > tolerance, or a counter of 15: WRONGSEQUENCE, rejected.

    So after n lost frames the next one is accepted, n up to 13; after more, every Δ but 0 is. After
    a jump of the sender's counter the tolerance has caught up at the latest when the counter has
    gone once round (`sync_counter` = 0), or after `sync_counter` + 1 frames in the new sequence.
    """

    __slots__ = ("_last_valid", "_max_delta", "_no_new_or_repeated", "_protection", "_sync")

    def __init__(self, protection: E2EProtection) -> None:
        """Start before the first frame."""
        self._protection = protection
        self._last_valid: int | None = None
        self._max_delta = protection.max_delta_counter
        self._no_new_or_repeated = 0
        self._sync = 0

    def pass_cycles(self, missed_cycles: int) -> None:
        """Let cycles go by without a usable frame (E2E_P01STATUS_NONEWDATA, once each)."""
        self._max_delta = min(_MAX_DELTA_LIMIT, self._max_delta + missed_cycles)
        self._no_new_or_repeated = min(_MAX_DELTA_LIMIT, self._no_new_or_repeated + missed_cycles)

    def reject_crc(self) -> E2EStatus:
        """Note a frame whose CRC was wrong: the tolerance grows, the sequence stands."""
        self._max_delta = min(_MAX_DELTA_LIMIT, self._max_delta + 1)
        return E2EStatus.WRONGCRC

    def check(self, counter: int) -> E2EStatus:
        """Judge the counter of a frame whose CRC was right."""
        max_delta = self._max_delta
        if max_delta < _MAX_DELTA_LIMIT:
            max_delta += 1
        if counter >= COUNTER_MODULO:
            self._max_delta = max_delta
            return E2EStatus.WRONGSEQUENCE
        if self._last_valid is None:
            self._accept(counter)
            return E2EStatus.INITIAL
        delta = (counter - self._last_valid) % COUNTER_MODULO
        if delta == 0:
            self._max_delta = max_delta
            if self._no_new_or_repeated < _MAX_DELTA_LIMIT:
                self._no_new_or_repeated += 1
            return E2EStatus.REPEATED
        if delta > max_delta:
            self._no_new_or_repeated = 0
            self._sync = self._protection.sync_counter
            if self._sync > 0:
                self._max_delta = self._protection.max_delta_counter
                self._last_valid = counter
            else:
                self._max_delta = max_delta
            return E2EStatus.WRONGSEQUENCE
        is_expected = self._no_new_or_repeated <= self._protection.max_no_new_or_repeated
        self._accept(counter)
        if not is_expected:
            self._sync = self._protection.sync_counter
            return E2EStatus.SYNC
        if self._sync > 0:
            self._sync -= 1
            return E2EStatus.SYNC
        return _OK if delta == 1 else E2EStatus.OKSOMELOST

    def _accept(self, counter: int) -> None:
        self._last_valid = counter
        self._max_delta = self._protection.max_delta_counter
        self._no_new_or_repeated = 0
