"""The database: everything that is true of the wire, read from a DBC file.

cantools does the parsing; the result is a set of frozen specs that know nothing of it.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, lru_cache
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

from can_bus.e2e import PROFILE_1A, E2EProtection
from can_bus.errors import CanBusError, one_line, quiet
from can_bus.faulty import EXTENDED, what_is_wrong, with_free_identifiers, without_unused
from can_bus.signals import SignalSpec
from can_bus.specs import MessageSpec

if TYPE_CHECKING:
    import cantools.database.can

DBC_NAME = "chiplog.dbc"
SNA = "SNA"
"""Value-table entry that marks a signal as not available: DBC has no attribute for it."""

_MICROSECONDS_PER_MS = 1000
_NO_NODE = "Vector__XXX"
# cantools accepts a file that breaks off within its last statement, and drops that statement. An
# empty bit-timing section after it makes the break an error.
_END = "\nBS_:\n"
# The largest DBC files of vehicles have 1 to 2 MB; cantools takes some 100 times the file's size.
_MAX_FILE_BYTES = 4 * 1024 * 1024
# cantools makes a list entry for each bit of a message and for each value in a multiplexer range.
_MAX_MESSAGE_BYTES = 64
_MAX_SIGNAL_BITS = 64
_MAX_MULTIPLEXER_VALUES = 1 << 16
_MAX_DIGITS = 18
# Tokens as in cantools, which allows any gap (or none) between them. No quantifier gives back what
# it took, so that a scan stays linear in the file's size.
_STRING_OR_COMMENT = re.compile(r'"(?:\\"|[^"])*?"|//[^\n]*')
_MESSAGE_LENGTH = re.compile(r"BO_\s*+[-+]?\d++\s*+(\w++)\s*+:\s*+[-+]?(\d++)")
_SIGNAL_PLACE = re.compile(r"SG_\s*+(\w++)\s*+(?:\w++\s*+)?:\s*+[-+]?(\d++)\s*+\|\s*+[-+]?(\d++)")
_MULTIPLEXER_RANGES = re.compile(r"SG_MUL_VAL_\s*+[-+]?\d++\s*+(\w++)\s++\w++([^;]*+)")
_RANGE = re.compile(r"([-+]?\d++)\s*+[-+]?(\d++)")
_EXCERPT_CHARACTERS = 80


@dataclass(frozen=True)
class Database:
    """The messages of one DBC file.

    Attributes:
        path: the file it was read from.
        messages: name to message, in order of priority (identifier).
        nodes: names of the nodes.
        bitrate: network attribute `Baudrate` in bit/s, None where the file gives none.
        faulty: name to what is wrong, `file:line: …`, of messages that were left out.
    """

    path: Path
    messages: Mapping[str, MessageSpec]
    nodes: tuple[str, ...] = ()
    bitrate: int | None = None
    faulty: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    _by_key: Mapping[int, MessageSpec] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        """Index the messages by identifier."""
        by_key = {identifier_key(m.frame_id, m.is_extended): m for m in self.messages.values()}
        object.__setattr__(self, "_by_key", by_key)

    def message(self, name: str) -> MessageSpec:
        """Return a message by name.

        Raises CanBusError with what is wrong with it, or with the names there are.
        """
        try:
            return self.messages[name]
        except KeyError:
            if name in self.faulty:
                raise CanBusError(self.faulty[name]) from None
            raise CanBusError(
                f"{self.path.name} has no message {name!r}: it has {', '.join(self.messages)}"
            ) from None

    def by_id(self, frame_id: int, is_extended: bool = False) -> MessageSpec | None:
        """Return the message of an identifier, None where the database has none."""
        return self._by_key.get(identifier_key(frame_id, is_extended))

    def senders(self) -> tuple[str, ...]:
        """Return the nodes that send at least one message, in alphabetical order."""
        return tuple(sorted({s for m in self.messages.values() for s in m.senders}))

    def sent_by(self, *nodes: str) -> tuple[MessageSpec, ...]:
        """Return the messages of these nodes by priority.

        Raises CanBusError for an unknown node.
        """
        for node in nodes:
            if node not in self.nodes and node not in self.senders():
                raise CanBusError(
                    f"{self.path.name} has no node {node!r}: it has {', '.join(self.nodes)}"
                )
        return tuple(m for m in self.messages.values() if not set(nodes).isdisjoint(m.senders))


def identifier_key(frame_id: int, is_extended: bool) -> int:
    """Return one integer for an identifier: bit 31 tells 29-bit ones from 11-bit ones."""
    return frame_id | EXTENDED if is_extended else frame_id


def load_database(path: str | Path | None = None, *, leave_out_faulty: bool = False) -> Database:
    """Read a DBC file; without a path the one that Chiplog ships.

    *leave_out_faulty*: messages that cannot be right (signals that overlap or lie outside, an
    identifier of too many bits) are in `Database.faulty` instead of an error, and values of no
    signal are passed over. To read what others send, never to send.

    Raises CanBusError `file:line: what is wrong` for a file that is missing, truncated or corrupt.
    """
    if path is None:
        return _shipped()
    return parse_database(_read(Path(path)), Path(path), leave_out_faulty=leave_out_faulty)


@cache
def _shipped() -> Database:
    return load_database(shipped_path())


def shipped_path() -> Path:
    """Return where the shipped DBC lies: in the wheel's can_bus/dbc, or beside it in a checkout."""
    package = Path(str(files("can_bus")))
    candidates = (package / "dbc" / DBC_NAME, package.parent / "dbc" / DBC_NAME)
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    raise CanBusError(f"{DBC_NAME} is missing: looked at {' and '.join(map(str, candidates))}")


def parse_database(text: str, path: Path, *, leave_out_faulty: bool = False) -> Database:
    """Return the database in the text of a DBC file; `path` is named in errors.

    Raises CanBusError as `load_database` does.
    """
    _refuse_bomb(path, text)
    readable, wrong = with_free_identifiers(text) if leave_out_faulty else (text, {})
    parsed = _parsed(path, readable, is_strict=not leave_out_faulty)
    messages: list[MessageSpec] = []
    faulty: dict[str, str] = {}
    for message in parsed.messages:
        if message.is_extended_frame and message.frame_id in wrong:
            line, problem = wrong[message.frame_id]
            faulty[message.name] = f"{path}:{line}: {problem}"
            continue
        refused = what_is_wrong(message) if leave_out_faulty else None
        try:
            if refused is not None:
                raise CanBusError(f"{message.name}: {refused}")
            messages.append(_message(message))
        except CanBusError as error:
            located = _located(path, text, str(error))
            if not leave_out_faulty:
                raise located from error
            faulty[message.name] = str(located)
    try:
        _require_distinct(messages)
    except CanBusError as error:
        raise _located(path, text, str(error)) from error
    if not messages:
        if faulty:
            raise CanBusError(next(iter(faulty.values())))
        raise CanBusError(f"{path}:1: no message (BO_) in this DBC file: is it truncated?")
    messages.sort(key=_priority)
    bitrate = _attribute(parsed, "Baudrate", None)
    return Database(
        path=path,
        messages=MappingProxyType({m.name: m for m in messages}),
        nodes=tuple(node.name for node in parsed.nodes),
        bitrate=None if bitrate is None else int(bitrate),
        faulty=MappingProxyType(faulty),
    )


def _parsed(path: Path, text: str, *, is_strict: bool) -> cantools.database.can.Database:
    # cantools takes 0.2 s to import: only who reads a DBC pays for it.
    from cantools.database import load_string  # noqa: PLC0415

    def load(some: str) -> cantools.database.can.Database:
        with quiet("cantools"):
            return cast(
                "cantools.database.can.Database",
                load_string(some + _END, database_format="dbc", strict=is_strict),
            )

    try:
        try:
            return load(text)
        except Exception as error:
            readable = text if is_strict else without_unused(text, str(error))
            if readable == text:
                raise
            return load(readable)
    except Exception as error:  # cantools lets KeyError, ValueError and others of corrupt files out
        # cantools wraps what went wrong in one of its own, also what has no text of its own.
        cause = getattr(error, "e_dbc", None) or error
        raise _located(path, text, one_line(cause)) from error


def _read(path: Path) -> str:
    try:
        if path.stat().st_size > _MAX_FILE_BYTES:
            raise CanBusError(f"{path}: over {_MAX_FILE_BYTES >> 20} MiB: this is no DBC file")
        data = path.read_bytes()
    except OSError as error:
        raise CanBusError(f"{path}: cannot read this DBC file: {error.strerror}") from error
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("cp1252", errors="replace")  # the encoding of CANdb++


def _refuse_bomb(path: Path, text: str) -> None:
    """Raise CanBusError for a number that would make cantools fill the memory.

    Whatever else is wrong is left to cantools.
    """
    code = _STRING_OR_COMMENT.sub(lambda match: "\n" * match[0].count("\n") or " ", text)

    def refusal(match: re.Match[str], problem: str) -> CanBusError:
        return CanBusError(f"{path}:{code.count(chr(10), 0, match.start()) + 1}: {problem}")

    for match in _MESSAGE_LENGTH.finditer(code):
        if _number(match[2]) > _MAX_MESSAGE_BYTES:
            raise refusal(
                match,
                f"{_excerpt(match[1])}: a length of {_excerpt(match[2])} bytes: "
                f"expected 0 to {_MAX_MESSAGE_BYTES}",
            )
    for match in _SIGNAL_PLACE.finditer(code):
        if _number(match[2]) >= 8 * _MAX_MESSAGE_BYTES:
            raise refusal(
                match,
                f"{_excerpt(match[1])}: start bit {_excerpt(match[2])}: "
                f"expected 0 to {8 * _MAX_MESSAGE_BYTES - 1}",
            )
        if _number(match[3]) > _MAX_SIGNAL_BITS:
            raise refusal(
                match,
                f"{_excerpt(match[1])}: a length of {_excerpt(match[3])} bits: "
                f"expected 1 to {_MAX_SIGNAL_BITS}",
            )
    values = 0
    for match in _MULTIPLEXER_RANGES.finditer(code):
        for low, high in _RANGE.findall(match[2]):
            values += max(0, _number(high) - _number(low) + 1)
        if values > _MAX_MULTIPLEXER_VALUES:
            raise refusal(
                match,
                f"{_excerpt(match[1])}: with this the multiplexer ranges (SG_MUL_VAL_) of the file "
                f"have {values} values: expected {_MAX_MULTIPLEXER_VALUES} at most",
            )


def _number(digits: str) -> int:
    """Return the integer, or one too large for anything where Python might refuse to read it."""
    if len(digits) <= _MAX_DIGITS:
        return int(digits)
    huge: int = 10**_MAX_DIGITS
    return -huge if digits.startswith("-") else huge


def _excerpt(text: str) -> str:
    return text if len(text) <= _EXCERPT_CHARACTERS else text[:_EXCERPT_CHARACTERS] + "…"


def _located(path: Path, text: str, problem: str) -> CanBusError:
    """Return the error with the line it speaks of: as stated, or that of the name it quotes."""
    match = re.search(r"[Ii]nvalid syntax at line (\d+), column (\d+): (.*)", problem)
    named_at, last = _lines_of_names(text)
    if match:
        line, column, excerpt = int(match[1]), match[2], match[3].strip('"')
        if line > last:
            return CanBusError(f"{path}:{last}: this DBC file breaks off within a statement")
        return CanBusError(
            f"{path}:{line}: invalid DBC syntax at column {column}: {_excerpt(excerpt)}"
        )
    for name in re.findall(r"\w+\.\w+|\w+", problem):
        if name in named_at:
            return CanBusError(f"{path}:{named_at[name]}: {problem}")
    return CanBusError(f"{path}:{last}: {problem}")


@lru_cache(maxsize=1)
def _lines_of_names(text: str) -> tuple[dict[str, int], int]:
    """Return in which line messages and signals (``MESSAGE.signal`` too) first stand, and the last
    line."""
    named_at: dict[str, int] = {}
    message = ""
    lines = text.splitlines()
    for number, content in enumerate(lines, start=1):
        declared = re.match(r"\s*(BO_\s+\d+|SG_)\s+(\w+)", content)
        if declared is None:
            continue
        name = declared[2]
        if declared[1] == "SG_":
            named_at.setdefault(f"{message}.{name}", number)
        else:
            message = name
        named_at.setdefault(name, number)
    return named_at, max(1, len(lines))


def _require_distinct(messages: list[MessageSpec]) -> None:
    names: set[str] = set()
    identifiers: dict[int, str] = {}
    for message in messages:
        if message.name in names:
            raise CanBusError(f"{message.name} stands twice in this file: each message once")
        names.add(message.name)
        key = identifier_key(message.frame_id, message.is_extended)
        if key in identifiers:
            raise CanBusError(
                f"{message.name} has the identifier of {identifiers[key]}: each needs its own"
            )
        identifiers[key] = message.name


def _message(message: cantools.database.can.Message) -> MessageSpec:
    name = message.name
    signals = {
        signal.name: _signal(name, message.length, signal)
        for signal in sorted(message.signals, key=lambda signal: signal.start)
    }
    cycle_ms = message.cycle_time
    send_type = message.send_type
    return MessageSpec(
        name=name,
        frame_id=message.frame_id,
        is_extended=message.is_extended_frame,
        length_bytes=message.length,
        signals=MappingProxyType(signals),
        cycle_time_us=int(cycle_ms) * _MICROSECONDS_PER_MS if cycle_ms else None,
        start_delay_us=int(_attribute(message, "GenMsgStartDelayTime", 0)) * _MICROSECONDS_PER_MS,
        send_type=None if send_type is None else str(send_type),
        senders=tuple(message.senders),
        receivers=tuple(sorted(message.receivers - {_NO_NODE})),
        e2e=_protection(message, signals),
        comment=message.comment or "",
        is_fd=message.is_fd,
    )


def _signal(message: str, length_bytes: int, signal: cantools.database.can.Signal) -> SignalSpec:
    choices = {int(raw): str(name) for raw, name in (signal.choices or {}).items()}
    initial = signal.raw_initial if signal.raw_initial is not None else 0
    is_float = bool(signal.is_float)
    return SignalSpec(
        message=message,
        name=signal.name,
        start_bit=signal.start,
        length_bits=signal.length,
        byte_order=signal.byte_order,
        is_signed=signal.is_signed,
        is_float=is_float,
        factor=float(signal.scale),
        offset=float(signal.offset),
        minimum=None if signal.minimum is None else float(signal.minimum),
        maximum=None if signal.maximum is None else float(signal.maximum),
        unit=signal.unit or "",
        comment=signal.comment or "",
        initial_raw=float(initial) if is_float else int(initial),
        invalid_raw=next((raw for raw, choice in choices.items() if choice == SNA), None),
        choices=MappingProxyType(choices),
        receivers=tuple(receiver for receiver in signal.receivers if receiver != _NO_NODE),
        multiplexer=signal.multiplexer_signal,
        multiplexer_values=frozenset(signal.multiplexer_ids or ()),
    )


def _protection(
    message: cantools.database.can.Message, signals: Mapping[str, SignalSpec]
) -> E2EProtection | None:
    """Return the protection that the attributes describe.

    Variant 1A fixes where counter and CRC lie, so they are found by position, whatever their names.
    """
    profile = _choice_attribute(message, "E2EProfile")
    if profile is None or profile.lower() in ("", "none"):
        return None
    by_bits = {_bits(signal, message.length): signal.name for signal in signals.values()}
    crc_signal = by_bits.get(frozenset(range(8)))
    counter_signal = by_bits.get(frozenset(range(8, 12)))
    if profile == PROFILE_1A and (crc_signal is None or counter_signal is None):
        raise CanBusError(
            f"{message.name}: E2EProfile {profile!r} wants an 8-bit CRC signal in byte 0 "
            "and a 4-bit counter signal in the low half of byte 1"
        )
    data_id = int(_attribute(message, "E2EDataId", 0))
    if not 0 <= data_id < 1 << 16:
        raise CanBusError(f"{message.name}: E2EDataId = {data_id}: expected 0 to {(1 << 16) - 1}")
    default = E2EProtection(profile, data_id, counter_signal or "", crc_signal or "")
    return E2EProtection(
        profile=profile,
        data_id=data_id,
        counter_signal=default.counter_signal,
        crc_signal=default.crc_signal,
        max_delta_counter=int(
            _attribute(message, "E2EMaxDeltaCounterInit", default.max_delta_counter)
        ),
        max_no_new_or_repeated=int(
            _attribute(message, "E2EMaxNoNewOrRepeatedData", default.max_no_new_or_repeated)
        ),
        sync_counter=int(_attribute(message, "E2ESyncCounterInit", default.sync_counter)),
    )


def _bits(signal: SignalSpec, length_bytes: int) -> frozenset[int]:
    """Return the bit numbers (DBC numbering) that a signal covers."""
    if signal.byte_order == "little_endian":
        return frozenset(range(signal.start_bit, signal.start_bit + signal.length_bits))
    shift = signal.shift_in(length_bytes)
    return frozenset(
        8 * (length_bytes - 1 - bit // 8) + bit % 8
        for bit in range(shift, shift + signal.length_bits)
    )


def _attribute(owner: Any, name: str, fallback: Any) -> Any:
    """Return a DBC attribute of a message or the network: its value, its default, the fallback."""
    specifics = owner.dbc
    if specifics is None:
        return fallback
    if name in specifics.attributes:
        return specifics.attributes[name].value
    definition = specifics.attribute_definitions.get(name)
    default = None if definition is None else definition.default_value
    return fallback if default is None else default


def _choice_attribute(message: cantools.database.can.Message, name: str) -> str | None:
    """Return the name that an ENUM attribute (or the text that a STRING attribute) has."""
    value = _attribute(message, name, None)
    if value is None:
        return None
    definition = message.dbc.attribute_definitions.get(name) if message.dbc else None
    choices = None if definition is None else definition.choices
    return str(choices[value]) if choices and isinstance(value, int) else str(value)


def _priority(message: MessageSpec) -> tuple[int, bool, int]:
    """Order as arbitration does: the leading 11 bits, standard before extended, then the rest."""
    leading = message.frame_id >> 18 if message.is_extended else message.frame_id
    return leading, message.is_extended, message.frame_id
