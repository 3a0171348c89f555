"""Writes the reference pages that repeat what stands elsewhere, and the pictures.

    .venv/bin/python docs/generate.py              the pages
    .venv/bin/python docs/generate.py --pictures   the pictures too, by running the lesson

A test holds the pages against `pages()`, so none can be out of date.
"""

from __future__ import annotations

import math
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import typer
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from can_bus import MessageSpec, SignalSpec, load_database
from chiplog.cli import app
from firmware_model import FirmwareDescription
from hil_harness.devices import include_dir
from hil_harness.effects import Effect, EffectParameter, catalogue
from hil_harness.laws import LAWS
from hil_harness.scenarios.named import NAMED
from hil_harness.scenarios.scenario_file import ScenarioTable, SegmentTable
from hil_harness.signal_map import REQUIRED, SHIPPED
from hil_harness.signal_roles import COUNT_UNITS, QUANTITIES, RAW_KIND, ROLES, UNITS
from sim_plant import PlantDescription

DOCS: Final = Path(__file__).parent
REFERENCE: Final = DOCS / "reference"
LESSON_PICTURE: Final = DOCS / "images" / "lesson.svg"
_NOTE: Final = "<!-- Written by docs/generate.py; edit what it reads, not this page. -->"


def pages() -> dict[Path, str]:
    """Return path and text of every generated page."""
    made = {
        "command-line.md": command_line(),
        "robot.md": robot(),
        "scenarios.md": scenarios(),
        "map.md": signal_map(),
        "effects.md": effects(),
        "dbc.md": dbc(),
        "laws.md": laws(),
        "c-abi.md": c_abi(),
    }
    return {REFERENCE / name: f"{_NOTE}\n\n{text.strip()}\n" for name, text in made.items()}


def table(header: Iterable[str], rows: Iterable[Iterable[object]]) -> str:
    """Return a Markdown table; bars inside cells are escaped."""
    header = list(header)
    lines = [header, ["---"] * len(header)]
    lines += [[str(cell).replace("|", "\\|").replace("\n", " ") for cell in row] for row in rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def number(value: float) -> str:
    """Return a number as short as it is exact; powers of two as such."""
    if value != 0 and math.isfinite(value):
        mantissa, exponent = math.frexp(abs(value))
        if mantissa == 0.5 and exponent - 1 <= -4:
            return f"2^{exponent - 1}"
    return "∞" if value == math.inf else f"{value:.10g}"


# --- the command line ---------------------------------------------------------------------------


def command_line() -> str:
    """Return the page of commands and options, from the program's own help."""
    program = typer.main.get_command(app)
    context = program.make_context("chiplog", [], resilient_parsing=True)
    commands = {name: program.get_command(context, name) for name in program.list_commands(context)}
    parts = [
        "# Command line",
        table(
            ["command", "what it does"],
            [[f"[`{n}`](#chiplog-{n})", c.get_short_help_str(120)] for n, c in commands.items()],
        ),
        "`chiplog --version` prints the version. `--debug`, anywhere, adds the traceback to an "
        "error.",
        "## Exit status",
        table(
            ["status", "meaning"],
            [
                [0, "done"],
                [1, "done, and the answer is no: a replay that differs, a law violated"],
                [2, "bad usage or bad input: one line on stderr says what, where and what to do"],
                [130, "Ctrl-C; what was recorded so far is complete and readable"],
            ],
        ),
        "The lines of status 2 are listed under [errors](errors.md).",
    ]
    for name, command in commands.items():
        parts += [f"## chiplog {name}", _plain(command.help or "")]
        rows = [_option(parameter, context) for parameter in command.params]
        parts.append(table(["argument", "meaning", "default"], [row for row in rows if row]))
    return "\n\n".join(part.strip() for part in parts)


def _option(parameter: Any, context: Any) -> list[str] | None:
    if parameter.name == "help":
        return None
    record = parameter.get_help_record(context)
    if record is None:
        words = getattr(parameter, "help", "") or ""
        return [f"`{parameter.make_metavar(context)}`", _plain(words), ""]
    return [
        f"`{record[0]}`",
        _plain(getattr(parameter, "help", "") or ""),
        f"`{parameter.default}`" if isinstance(parameter.default, str | int | float) else "",
    ]


def _plain(text: str) -> str:
    return " ".join(text.split())


# --- files --------------------------------------------------------------------------------------


def robot() -> str:
    """Return the page of robot.toml, from the models that validate it."""
    parts = [
        "# robot.toml",
        "Everything that is true of the robot and not of the wire. Every table and every key may "
        "be left out; what is not there is the lesson's robot, which `chiplog init` writes with "
        "comments. `chiplog schema robot` prints the JSON schema. How to fill it in: "
        "[Describe my robot](../how-to/my-robot.md).",
        "## The robot as its owner describes it",
    ]
    parts += list(_tables(PlantDescription))
    parts += ["## The firmware", "How the kernel computes.", *_tables_of_firmware()]
    return "\n\n".join(part.strip() for part in parts)


def _tables(model: type[BaseModel]) -> Iterator[str]:
    for name, field in model.model_fields.items():
        yield f"### [{name}]"
        yield _fields(_model_of(field))


def _tables_of_firmware() -> Iterator[str]:
    plain = {n: f for n, f in FirmwareDescription.model_fields.items() if not _is_table(f)}
    yield "### [firmware]"
    yield _rows(plain)
    for name, field in FirmwareDescription.model_fields.items():
        if _is_table(field):
            yield f"### [firmware.{name}]"
            yield _fields(_model_of(field), field.default)


def _is_table(field: FieldInfo) -> bool:
    return isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel)


def _model_of(field: FieldInfo) -> type[BaseModel]:
    assert isinstance(field.annotation, type)
    assert issubclass(field.annotation, BaseModel)
    return field.annotation


def _fields(model: type[BaseModel], defaults: BaseModel | None = None) -> str:
    return _rows(model.model_fields, defaults)


def _rows(fields: dict[str, FieldInfo], defaults: BaseModel | None = None) -> str:
    rows = []
    for name, field in fields.items():
        default = getattr(defaults, name) if isinstance(defaults, BaseModel) else field.default
        shown = "required" if field.is_required() else f"`{_toml(default)}`"
        rows.append([f"`{name}`", field.description or "", _allowed(field), shown])
    return table(["key", "meaning", "allowed", "default"], rows)


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return number(value) if value == int(value) else f"{value:.7g}"
    return f'"{value}"' if isinstance(value, str) else str(value)


def _allowed(field: FieldInfo) -> str:
    choices = getattr(field.annotation, "__args__", ())
    if choices and all(isinstance(choice, str) for choice in choices):
        return ", ".join(f'`"{choice}"`' for choice in choices)
    if field.annotation is bool:
        return "`true`, `false`"
    words = (("ge", "from"), ("gt", "above"), ("le", "to"), ("lt", "below"))
    return " ".join(
        f"{word} {getattr(rule, key):g}"
        for key, word in words
        for rule in field.metadata
        if getattr(rule, key, None) is not None
    )


def scenarios() -> str:
    """Return the page of scenarios and scenario files."""
    shipped = [make() for make in NAMED.values()]
    own_effects = ", ".join(f"`{effect}`" for effect in NAMED["lesson"]().effects)
    return "\n\n".join(
        (
            "# Scenarios",
            "`--scenario` takes one of these names or a file.",
            table(
                ["name", "drive", "duration [s]"],
                [[f"`{s.name}`", s.description, number(round(s.duration_s, 2))] for s in shipped],
            ),
            "Every one but `lesson` has motor dynamics and a real counter. `lesson` switches its "
            f"own effects on: {own_effects}.",
            "## Scenario files",
            _fields(ScenarioTable),
            "One table `[[segments]]` for each stretch, from rest:",
            _fields(SegmentTable),
            "Effects of the scenario stand in tables named after them, as in "
            "`[effects.gyro_bias]`. `chiplog init` writes a scenario file with comments.",
        )
    )


def signal_map() -> str:
    """Return the page of map.toml."""
    rows = []
    for role in ROLES:
        raw = {"counts": "whole counts", "adc_code": "converter codes"}.get(RAW_KIND.get(role, ""))
        units = [word for word, unit in UNITS.items() if unit.quantity in QUANTITIES[role]]
        shipped = ".".join(SHIPPED[role])
        needed = "yes" if role in REQUIRED else ""
        rows.append(
            [f"`{role}`", needed, "; ".join(filter(None, (raw, ", ".join(units)))), shipped]
        )
    return "\n\n".join(
        (
            "# map.toml",
            "Says which signal of a DBC plays which part; layout, scale, range and unit stay in "
            "the DBC. Needed with `--dbc` where the DBC has names of its own. How to write one: "
            "[Use my DBC](../how-to/my-dbc.md).",
            'The table `[signals]` has one line a role, `role = "MESSAGE.signal"`. The cycle time '
            "of "
            "the message with `left_count` is the tick period.",
            table(["role", "required", "may be", "in chiplog.dbc"], rows),
            "The unit is the DBC's. A signal without unit ("
            + ", ".join(f"`{unit}`" for unit in sorted(COUNT_UNITS) if unit)
            + ", or nothing) is a count or a code. Where the DBC leaves out the unit of a "
            "quantity, say "
            'it here: `gyro = { signal = "IMU.yaw_rate", unit = "deg/s" }`.',
        )
    )


# --- the catalogue, the wire, the laws, the header ----------------------------------------------


def effects() -> str:
    """Return the page of effects, from the catalogue."""
    parts = [
        "# Effects",
        "An effect is one cause by which a real robot differs from the simulated one. Switch it "
        "on with `--effect NAME.PARAM=VALUE`, in a file for `--effects` (`[gyro_bias]`, `bias = "
        "0.005`), in a scenario file or in a test's marker. Every parameter says how the *real* "
        "robot differs from `robot.toml`: ratios are real / described − 1, differences are real − "
        "described. At its neutral value an effect changes nothing, bit for bit. Effects combine "
        "freely.",
        "*Typical* is the size seen in real robots, without sign, and *twins* leave the same "
        "data, so that no log can tell them apart.",
    ]
    by_stage: dict[str, list[Effect]] = {}
    for effect in catalogue().values():
        by_stage.setdefault(effect.stage, []).append(effect)
    for stage, members in by_stage.items():
        parts.append(f"## Stage {stage}")
        for effect in members:
            parts += [f"### {effect.name}", effect.signature]
            rows = [_parameter_row(parameter) for parameter in effect.parameters]
            parts.append(table(["parameter", "unit", "meaning", "neutral", "typical"], rows))
            for twins in effect.twins:
                names = ", ".join(f"`{name}`" for name in twins.effects)
                condition = f", if {twins.condition}" if twins.condition else ""
                parts.append(f"Twins: {names}{condition}.")
    return "\n\n".join(part.strip() for part in parts)


def _parameter_row(parameter: EffectParameter) -> list[str]:
    neutral = parameter.neutral
    typical = ""
    if parameter.choices:
        typical = ", ".join(f"`{choice}`" for choice in parameter.choices)
    elif parameter.typical is not None:
        low, high = number(parameter.typical.low), number(parameter.typical.high)
        typical = f"{low} to {high} ({parameter.typical.source})"
    return [
        f"`{parameter.name}`",
        parameter.unit,
        parameter.meaning,
        number(neutral) if isinstance(neutral, float | int) else f"`{neutral}`",
        typical,
    ]


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
        f"{signal.start_bit}…{signal.start_bit + signal.length_bits - 1}, {sign}",
        number(signal.factor),
        f"{low} to {high}",
        signal.unit,
        number(signal.to_scaled(signal.initial_raw)),
        "" if signal.invalid_raw is None else signal.invalid_raw,
        signal.comment.replace(
            " A flag of the sender's own state is never unknown, so there is no SNA.", ""
        ),
    ]


def _choices(signal: SignalSpec) -> str:
    named = [(raw, word) for raw, word in signal.choices.items() if word != "SNA"]
    if {word.lower() for _, word in named} <= {"no", "yes", "off", "on", "inactive", "active"}:
        return ""
    return ", ".join(f"{raw} {word}" for raw, word in sorted(named))


def laws() -> str:
    """Return the page of the laws and their checks."""
    parts = [
        "# The laws that `chiplog laws` checks",
        "Each law with its formula, where it holds, and its source; the [explanation]"
        "(../explanation/laws.md) tells the story. `chiplog laws NAME` checks one.",
        table(
            ["law", "formula", "holds", "source"],
            [[f"`{law.name}`: {law.title}", law.formula, law.validity, law.source] for law in LAWS],
        ),
    ]
    return "\n\n".join(parts)


def c_abi() -> str:
    """Return the page of the C interface: the header itself."""
    header = (Path(include_dir()) / "chiplog_device.h").read_text(encoding="utf-8").strip()
    return "\n\n".join(
        (
            "# The C interface",
            "A firmware under test that is a shared library exports three functions. This is "
            "`chiplog_device.h`; `python -m hil_harness.devices` prints the folder it is in. A "
            "page on how to use it: [My firmware](../how-to/my-firmware.md#a-c-library).",
            f"```text\n{header}\n```",
        )
    )


# --- pictures -----------------------------------------------------------------------------------


def draw_lesson() -> None:
    """Run the lesson and take the picture of its three trajectories from the report."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "chiplog", "run", "--scenario", "lesson", "--out", folder]
        subprocess.run(command, check=True)
        page = (Path(folder) / "report.html").read_text(encoding="utf-8")
    start = page.index("<svg")
    LESSON_PICTURE.write_text(page[start : page.index("</svg>") + len("</svg>")] + "\n")


def main() -> None:
    """Write the pages, and with --pictures the pictures."""
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
    if "--pictures" in sys.argv[1:]:
        draw_lesson()


if __name__ == "__main__":
    main()
