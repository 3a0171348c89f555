"""What a rig remembers of the bus: the last frames, and what a wait for one has seen."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple

import can

from can_bus import Database
from hil_harness.decoding import DecodedFrame, decode
from hil_harness.expectation import Expectation

HISTORY_FRAMES: Final = 4096
"""How many frames are remembered for reports; a log file keeps all."""

FrameKey = tuple[int, bool]
"""A frame's identifier, and whether it is a 29-bit one."""


class SeenFrame(NamedTuple):
    """A frame on the bus, and when."""

    time_us: int
    message: can.Message


class Wait:
    """A wait for one expectation: what came meanwhile, and the frame that met it."""

    def __init__(self, expectation: Expectation, database: Database) -> None:
        """Start with nothing seen. Raises CanBusError for names that the DBC does not have."""
        expectation.check_names(database)
        spec = database.message(expectation.message)
        self.came: list[DecodedFrame] = []
        self.found: DecodedFrame | None = None
        self.expectation = expectation
        self._database = database
        self._key: FrameKey = (spec.frame_id, spec.is_extended)
        self._counts: Counter[FrameKey] = Counter()

    def see(self, key: FrameKey, seen: SeenFrame) -> None:
        """Compare one frame, unless the wait is over."""
        if self.found is not None:
            return
        self._counts[key] += 1
        frame = decode(self._database, seen.message, seen.time_us) if key == self._key else None
        if frame is not None:
            self.came.append(frame)
            if self.expectation.matches(frame):
                self.found = frame

    def counts(self) -> Mapping[str, int]:
        """Return how many frames of each message there were, in all."""
        counts: dict[str, int] = {}
        for (frame_id, is_extended), count in self._counts.items():
            spec = self._database.by_id(frame_id, is_extended)
            counts[f"{frame_id:#x}" if spec is None else spec.name] = count
        return counts


class FrameRecorder:
    """Takes note of every frame on the bus, decoding only what is asked for."""

    def __init__(self, database: Database) -> None:
        """Start with an empty memory."""
        self._database = database
        self._latest: dict[FrameKey, SeenFrame] = {}
        self._history: deque[SeenFrame] = deque(maxlen=HISTORY_FRAMES)
        self._wait: Wait | None = None

    def see(self, time_us: int, message: can.Message) -> None:
        """Take note of a frame; called once for each, in the order of the bus."""
        seen = SeenFrame(time_us, message)
        key = (message.arbitration_id, message.is_extended_id)
        self._history.append(seen)
        self._latest[key] = seen
        if self._wait is not None:
            self._wait.see(key, seen)

    def wait(self, wait: Wait, let_time_pass: Callable[[Callable[[], bool]], None]) -> None:
        """Let time pass until the wait is over, as *let_time_pass* does it."""
        self._wait = wait
        try:
            let_time_pass(lambda: wait.found is not None)
        finally:
            self._wait = None

    def latest(self, message: str) -> DecodedFrame | None:
        """Return a message's last frame, None if there is none yet."""
        spec = self._database.message(message)
        seen = self._latest.get((spec.frame_id, spec.is_extended))
        return None if seen is None else decode(self._database, seen.message, seen.time_us)

    def history(self) -> list[SeenFrame]:
        """Return the frames remembered, as of now: in real time the bus goes on."""
        return list(self._history)

    def lines(self, frames: Iterable[SeenFrame]) -> list[str]:
        """Return frames decoded, one line each."""
        return [self._line(seen) for seen in frames]

    def _line(self, seen: SeenFrame) -> str:
        frame = decode(self._database, seen.message, seen.time_us)
        if frame is not None:
            return str(frame)
        data = bytes(seen.message.data).hex(" ")
        identifier = f"{seen.message.arbitration_id:#x}"
        return f"{seen.time_us * 1e-6:.6f} s  {identifier} [{data}] is not as the DBC says"
