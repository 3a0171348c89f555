"""The page of the DBC, from the DBC."""

from __future__ import annotations

from can_bus import MessageSpec, SignalSpec, load_database
from generator.tables import number, table


def dbc() -> str:
    """Return the page of the wire, from the DBC."""
    database = load_database()
    messages = database.messages.values()
    parts = [
        "# The DBC",
        f"`dbc/chiplog.dbc`: classic CAN at {database.bitrate} bit/s, little endian, E2E Profile "
        "1 in every frame ([why and how](../explanation/e2e.md)). *Raw* is the number in the "
        "frame; the value is raw × factor + offset. SNA is the raw value that means *not "
        "available*.",
        table(
            ["ID", "message", "from", "to", "cycle [ms]", "data ID"],
            [_message_row(message) for message in messages],
        ),
    ]
    for message in messages:
        parts += [
            f"## {message.name}",
            message.comment,
            table(
                ["signal", "bits", "factor", "range", "unit", "initial", "SNA", "meaning"],
                [_signal_row(signal) for signal in message.payload],
            ),
        ]
        tables = {s.name: _choices(s) for s in message.payload if _choices(s)}
        parts += [f"`{name}`: {words}." for name, words in tables.items()]
    return "\n\n".join(part.strip() for part in parts)


def _message_row(message: MessageSpec) -> list[object]:
    cycle = "" if message.cycle_time_us is None else number(message.cycle_time_us / 1000)
    data_id = "" if message.e2e is None else f"0x{message.e2e.data_id:04X}"
    link = f"[{message.name}](#{message.name.lower()})"
    receivers = ", ".join(message.receivers)
    senders = ", ".join(message.senders)
    return [f"0x{message.frame_id:03X}", link, senders, receivers, cycle, data_id]


def _signal_row(signal: SignalSpec) -> list[object]:
    low, high = number(signal.minimum or 0), number(signal.maximum or 0)
    sign = "signed" if signal.is_signed else "unsigned"
    return [
        f"`{signal.name}`",
        f"{_bits(signal)}, {sign}",
        number(signal.factor),
        f"{low} to {high}",
        signal.unit,
        "SNA"
        if signal.initial_raw == signal.invalid_raw
        else number(signal.to_scaled(signal.initial_raw)),
        "" if signal.invalid_raw is None else signal.invalid_raw,
        signal.comment.replace(
            " A flag of the sender's own state is never unknown, so there is no SNA.", ""
        ),
    ]


def _bits(signal: SignalSpec) -> str:
    last = signal.start_bit + signal.length_bits - 1
    return str(last) if last == signal.start_bit else f"{signal.start_bit}…{last}"


def _choices(signal: SignalSpec) -> str:
    named = [(raw, word) for raw, word in signal.choices.items() if word != "SNA"]
    if {word.lower() for _, word in named} <= {"no", "yes", "off", "on", "inactive", "active"}:
        return ""
    return ", ".join(f"{raw} {word}" for raw, word in sorted(named))
