"""Whether a stream of protected frames can be trusted: AUTOSAR's E2E state machine.

AUTOSAR, *PRS_E2EProtocol*, "E2E state machine" (E2E_SMCheck), and *SWS_E2ELibrary*,
E2E_P01MapStatusToSM with profileBehavior = FALSE: a first frame is good, one that only
synchronises is not, as the receiver here uses them.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from enum import Enum, unique
from typing import Final

from can_bus.e2e import E2EStatus
from can_bus.errors import CanBusError


@unique
class ProfileStatus(Enum):
    """Result of one cycle, whatever the profile: E2E_PCheckStatusType."""

    OK = "new and in sequence"
    OKSOMELOST = "new, frames lost but within tolerance"
    REPEATED = "same counter as before"
    WRONGSEQUENCE = "counter step beyond tolerance"
    ERROR = "damaged or not what its identifier says"
    NONEWDATA = "nothing was received"
    NOTAVAILABLE = "no cycle has passed yet"


@unique
class E2EState(Enum):
    """What the last cycles add up to: E2E_SMStateType."""

    NODATA = "no frame that was not damaged yet"
    INIT = "frames have come, not enough good ones yet"
    VALID = "to be trusted"
    INVALID = "not to be trusted"


_PROFILE_STATUS: Final = {
    E2EStatus.OK: ProfileStatus.OK,
    E2EStatus.INITIAL: ProfileStatus.OK,
    E2EStatus.OKSOMELOST: ProfileStatus.OKSOMELOST,
    E2EStatus.WRONGCRC: ProfileStatus.ERROR,
    E2EStatus.REPEATED: ProfileStatus.REPEATED,
    E2EStatus.WRONGSEQUENCE: ProfileStatus.WRONGSEQUENCE,
    E2EStatus.SYNC: ProfileStatus.WRONGSEQUENCE,
    E2EStatus.NONEWDATA: ProfileStatus.NONEWDATA,
}
_GOOD: Final = frozenset((ProfileStatus.OK, ProfileStatus.OKSOMELOST))


@dataclass(frozen=True, slots=True, kw_only=True)
class StateLimits:
    """How many good and damaged cycles in the window make and keep a stream valid.

    Attributes:
        window: how many of the last cycles count.
        min_ok_init, max_error_init: from INIT to VALID.
        min_ok_valid, max_error_valid: to stay VALID.
        min_ok_invalid, max_error_invalid: from INVALID back to VALID.

    Raises CanBusError for limits that the standard does not allow.
    """

    window: int = 4
    min_ok_init: int = 1
    max_error_init: int = 1
    min_ok_valid: int = 1
    max_error_valid: int = 2
    min_ok_invalid: int = 2
    max_error_invalid: int = 1

    def __post_init__(self) -> None:
        """Check what the standard asks for."""
        counts = (self.min_ok_init, self.min_ok_valid, self.min_ok_invalid)
        errors = (self.max_error_init, self.max_error_valid, self.max_error_invalid)
        if self.window < 1 or min(*counts, *errors) < 0 or max(*counts, *errors) > self.window:
            raise CanBusError(f"E2E state machine: {self}: expected counts from 0 to the window")
        if not (errors[1] >= errors[0] and errors[1] >= errors[2]):
            raise CanBusError(
                f"E2E state machine: {self}: expected max_error_valid to be the largest"
            )


DEFAULT_LIMITS: Final = StateLimits()


class E2EStateMachine:
    """The state of one stream of frames.

    Attributes:
        state: the state now.
        status: result of the last cycle.
    """

    __slots__ = ("_is_settled", "_limits", "_window", "state", "status")

    def __init__(self, limits: StateLimits = DEFAULT_LIMITS) -> None:
        """Start with NODATA."""
        self.state = E2EState.NODATA
        self.status = ProfileStatus.NOTAVAILABLE
        self._limits = limits
        self._window = deque([ProfileStatus.NOTAVAILABLE] * limits.window, limits.window)
        self._is_settled = False

    def pass_cycles(self, missed: int) -> None:
        """Let cycles go by without a frame."""
        for _ in range(min(missed, self._limits.window + 1)):
            self.add(E2EStatus.NONEWDATA)

    def add(self, status: E2EStatus) -> E2EState:
        """Take one cycle's result in; return the state after it."""
        if status is E2EStatus.OK and self._is_settled:
            return self.state  # VALID, and nothing but good cycles in the window
        self.status = _PROFILE_STATUS[status]
        self._window.append(self.status)
        good = sum(one in _GOOD for one in self._window)
        bad = self._window.count(ProfileStatus.ERROR)
        self.state = self._next(good, bad)
        self._is_settled = self._window.count(ProfileStatus.OK) == self._limits.window
        return self.state

    def _next(self, good: int, bad: int) -> E2EState:
        limits = self._limits
        if self.state is E2EState.NODATA:
            has_come = self.status not in (ProfileStatus.ERROR, ProfileStatus.NONEWDATA)
            return E2EState.INIT if has_come else E2EState.NODATA
        if self.state is E2EState.INIT:
            if bad > limits.max_error_init:
                return E2EState.INVALID
            return E2EState.VALID if good >= limits.min_ok_init else E2EState.INIT
        if self.state is E2EState.VALID:
            is_good = bad <= limits.max_error_valid and good >= limits.min_ok_valid
        else:
            is_good = bad <= limits.max_error_invalid and good >= limits.min_ok_invalid
        return E2EState.VALID if is_good else E2EState.INVALID
