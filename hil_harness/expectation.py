"""What a test expects of a frame, and what to say when something else came."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from can_bus import Database
from hil_harness.decoding import DecodedFrame

_SHOWN_FRAMES = 3
_SHOWN_MESSAGES = 8


@dataclass(frozen=True)
class Expectation:
    """A message, and for some of its signals what they should be.

    What a signal should be is a number, `pytest.approx(…)`, a word of its value table, None for
    marked invalid, or a function of the scaled value that returns whether it will do.
    """

    message: str
    signals: Mapping[str, object]

    def check_names(self, database: Database) -> None:
        """Raise CanBusError for a message, a signal or a word that the DBC does not have."""
        spec = database.message(self.message)
        for name, expected in self.signals.items():
            signal = spec.signal(name)
            if isinstance(expected, str):
                signal.raw_of_choice(expected)

    def matches(self, frame: DecodedFrame) -> bool:
        """Tell whether a frame of the message is as expected."""
        return all(_matches(frame, name, expected) for name, expected in self.signals.items())

    def __str__(self) -> str:
        """Return the expectation in words."""
        if not self.signals:
            return self.message
        wanted = ", ".join(_words(name, expected) for name, expected in self.signals.items())
        return f"{self.message} with {wanted}"

    def was_not_met(
        self, span_us: tuple[int, int], came: Sequence[DecodedFrame], bus: Mapping[str, int]
    ) -> str:
        """Say that no such frame came, and what came instead.

        *came* are the frames of the message in that time; *bus* counts the frames of each message.
        """
        text = f"no {self} {_span(*span_us)}: "
        if not came:
            busiest = sorted(bus.items(), key=lambda item: -item[1])[:_SHOWN_MESSAGES]
            others = ", ".join(f"{name} ({count})" for name, count in busiest)
            return f"{text}it never came; on the bus in that time: {others or 'nothing'}"
        lines = [f"{text}{len(came)} came, none of them so"]
        shown = [came[0]] if len(came) > _SHOWN_FRAMES else []
        shown += came[-_SHOWN_FRAMES:]
        signals = tuple(self.signals)
        lines += [f"  {_one(frame, signals)}" for frame in shown]
        if len(came) > len(shown):
            lines.insert(2, "  …")
        return "\n".join(lines)

    def was_met(self, span_us: tuple[int, int], frame: DecodedFrame) -> str:
        """Say that a frame came that should not have come."""
        return (
            f"expected no {self} {_span(*span_us)}, but it came:\n"
            f"  {_one(frame, tuple(self.signals))}"
        )


def _matches(frame: DecodedFrame, name: str, expected: object) -> bool:
    if name not in frame:
        return False  # of a multiplexed message, and not in this frame
    if isinstance(expected, str):
        return frame.label(name) == expected
    value = frame[name]
    if value is None or expected is None:
        return value is expected
    if callable(expected):
        return bool(expected(value))
    return bool(value == expected)


def _words(name: str, expected: object) -> str:
    if expected is None:
        return f"{name} invalid"
    if callable(expected):
        return f"{name} such that {getattr(expected, '__name__', repr(expected))}"
    return f"{name} = {expected}"


def _span(start_us: int, stop_us: int) -> str:
    return (
        f"within {(stop_us - start_us) * 1e-6:g} s "
        f"({start_us * 1e-6:.6f} s to {stop_us * 1e-6:.6f} s)"
    )


def _one(frame: DecodedFrame, signals: tuple[str, ...]) -> str:
    present = tuple(name for name in signals if name in frame)
    return f"{frame.time_s:.6f} s  {frame.show(present or None)}"
