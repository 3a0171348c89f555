"""The rest of the bus: frames of nodes that are not there, from any DBC."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import can

from can_bus import COUNTER_MODULO, Database, Raw, SignalSpec, make_message, protect
from can_bus.e2e import unsupported_profile
from hil_harness.errors import HarnessError
from hil_harness.nearest import did_you_mean

SignalValue = float | int | str | None
"""A scaled value, a word of the signal's value table, or None for the invalid value."""


class FrameBuilder:
    """Builds valid frames of a DBC from scaled values.

    Signals that are not given take the DBC's initial value. Where the message has an E2E profile,
    the counter goes up by one from frame to frame of that message and the CRC is right; the first
    counter is that of the tick, so that frames of one tick agree.
    """

    def __init__(self, database: Database, tick_period_us: int) -> None:
        """Build frames of *database*; the first counter of a message is the tick's number."""
        self.database = database
        self._tick_period_us = tick_period_us
        self._counters: dict[str, int] = {}

    def raw_values(self, name: str, values: Mapping[str, SignalValue]) -> dict[str, Raw]:
        """Return the raw numbers of scaled values.

        Raises HarnessError or CanBusError for a signal that the message does not have, a value out
        of its range or not in its value table, or a signal of the frame's own protection.
        """
        spec = self.database.message(name)
        protection = () if spec.e2e is None else (spec.e2e.counter_signal, spec.e2e.crc_signal)
        raw: dict[str, Raw] = {}
        for signal_name, value in values.items():
            signal = spec.signal(signal_name)
            if signal_name in protection:
                raise HarnessError(
                    f"{signal.path} is the frame's own protection and is always right; "
                    'rig.fault("corrupt", …) sends wrong ones'
                )
            raw[signal_name] = raw_value(signal, value)
        return raw

    def build(self, name: str, raw: Mapping[str, Raw], now_us: int) -> can.Message:
        """Return the message's next frame, stamped *now_us*."""
        spec = self.database.message(name)
        data = spec.encode_raw(raw)
        if spec.e2e is not None:
            last = self._counters.get(name)
            counter = now_us // self._tick_period_us if last is None else last + 1
            self._counters[name] = counter % COUNTER_MODULO
            protect(spec, data, self._counters[name])
        return make_message(spec, data, now_us)


class RestBus:
    """Sends every cyclic message of named senders at its cycle time, from its start delay on.

    Each signal starts at the DBC's initial value and can be overridden at any time. A message whose
    send type ends in "IfActive" is sent once one of its signals is overridden.
    """

    def __init__(
        self,
        builder: FrameBuilder,
        senders: Sequence[str],
        overrides: Mapping[str, Mapping[str, SignalValue]] | None = None,
        *,
        without: Collection[str] = (),
        start_us: int = 0,
    ) -> None:
        """Start at *start_us*, leaving out the messages named in *without*.

        Raises HarnessError for a sender that the DBC does not have or that sends nothing
        cyclically, and for an override that does not fit.
        """
        self._builder = builder
        self._raw: dict[str, dict[str, Raw]] = {}
        self._due_us: dict[str, int] = {}
        self._active: set[str] = set()
        self._stopped = False
        database = builder.database
        for spec in database.sent_by(*senders):
            if not spec.cycle_time_us or spec.name in without:
                continue
            if spec.e2e is not None and not spec.is_protected:
                raise unsupported_profile(spec.name, spec.e2e)
            self._raw[spec.name] = {}
            self._due_us[spec.name] = start_us + spec.start_delay_us
            if not (spec.send_type or "").lower().endswith("ifactive"):
                self._active.add(spec.name)
        if not self._raw:
            raise HarnessError(
                f"nothing is left for a rest bus of {', '.join(senders)}: in {database.path.name} "
                "no further message of theirs has a cycle time (GenMsgCycleTime)"
            )
        for name, values in (overrides or {}).items():
            self.set(name, **values)

    @property
    def messages(self) -> tuple[str, ...]:
        """Names of the messages that are being sent."""
        return tuple(name for name in self._raw if name in self._active)

    def set(self, message: str, **signals: SignalValue) -> None:
        """Override signals of a message from its next frame on; its others stay as they are.

        Raises HarnessError or CanBusError if the rest bus does not have the message or a value does
        not fit.
        """
        if message not in self._raw:
            raise HarnessError(
                f"the rest bus does not send {message!r}; {did_you_mean(message, self._raw)}"
            )
        self._raw[message].update(self._builder.raw_values(message, signals))
        self._active.add(message)

    def stop(self) -> None:
        """Send nothing any more."""
        self._stopped = True

    def due(self, now_us: int) -> list[can.Message]:
        """Return the frames that became due since the last call, in the order of their time.

        Frames due at the same time come in the order of arbitration: lowest identifier first.
        """
        if self._stopped:
            return []
        due: list[tuple[int, str]] = []
        for name, first_us in self._due_us.items():
            cycle_us = self._builder.database.message(name).cycle_time_us
            assert cycle_us is not None
            next_us = first_us
            while next_us <= now_us:
                if name in self._active:
                    due.append((next_us, name))
                next_us += cycle_us
            self._due_us[name] = next_us
        # The database lists messages by priority, and sorting keeps the order of equals.
        due.sort(key=lambda at_and_name: at_and_name[0])
        return [self._builder.build(name, self._raw[name], at_us) for at_us, name in due]


def raw_value(signal: SignalSpec, value: SignalValue) -> Raw:
    """Return the raw number of a scaled value, a value-table word, or None for invalid.

    Raises HarnessError for None where the DBC has no invalid value, CanBusError for a value out of
    range or a word that the table does not have.
    """
    if value is None:
        if signal.invalid_raw is None:
            raise HarnessError(f"{signal.path} = None: has no invalid value (SNA) in the DBC")
        return signal.invalid_raw
    return signal.raw_of_choice(value) if isinstance(value, str) else signal.to_raw(value)
