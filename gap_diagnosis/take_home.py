"""What a diagnosis gives to take home: found effects as a file, and the description corrected.

Both are text that a person reads: intervals and origins stand as comments, and of the user's own
``robot.toml`` only the lines of corrected constants change.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from typing import Final

from gap_diagnosis.corrections import Correction, corrections
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.result import NO_GAP, UNKNOWN, Diagnosis
from gap_diagnosis.result_parts import (
    Candidate,
    ChoiceEstimate,
    KnownEffect,
    ParameterEstimate,
)
from hil_harness.effects import (
    INTERVAL,
    Effect,
    EffectParameter,
    catalogue,
    effects_from_toml,
)
from hil_harness.robot import Robot, RobotFile, default_robot_text
from hil_harness.toml_model import validate
from hil_harness.toml_source import TomlSource, parse_toml, shorten

_VALUE: Final = r"[-+0-9._eExXobA-Fa-f]+"
_DIGITS: Final = 9
_AT_THE_END_S: Final = 0.1
"""A time so near to the logs' own beginning or end [s] is that: a row or a few."""
_MOST_DIGITS: Final = 17
_RIVALS: Final = 3
"""So many other explanations are named on a changed line; explained.toml names all."""


def effects_text(
    diagnosis: Diagnosis,
    *,
    without: Collection[str] = (),
    known: Mapping[str, Effect] | None = None,
) -> str:
    """Return the winning effects as ``chiplog run --effects`` and the pytest fixtures take them.

    Effects that were known beforehand stand there too: the robot has both.

    Args:
        without: effects that the description has taken up (see `robot_text`).
        known: the catalogue with a user's effects in it; None is Chiplog's.

    Raises DiagnosisError for an effect that the simulator does not have, and for one that was known
    and is found to be another size: what the log says of it is a change.
    """
    best = diagnosis.which[0]
    changed = [one for one in diagnosis.granted if one.effect in {*best.effects} - {*without}]
    if changed:
        raise DiagnosisError(
            f"{changed[0].effect}: {changed[0].file} states another size than this log shows: "
            "expected it without this effect, which is then found as a whole"
        )
    known = catalogue() if known is None else known
    lines = [f"# {line}" for line in _origin(diagnosis)]
    if without:
        lines.append(f"# For the corrected description; it has taken up {', '.join(without)}.")
    for effect in best.effects:
        if effect not in (NO_GAP, UNKNOWN) and effect not in without:
            lines += ["", *_effect_table(effect, best, known, _ends_of(diagnosis))]
    for one in diagnosis.granted:
        lines += ["", f"# Known before, by {shorten(one.file)}.", *_known_table(one)]
    text = "\n".join(lines) + "\n"
    # What we write, we can read.
    effects_from_toml(parse_toml(text, name="explained.toml"), known=known)
    return text


def robot_text(diagnosis: Diagnosis, robot: Robot) -> str:
    """Return the file of `robot` with its correctable constants corrected, all else as it was.

    Each changed line says from, to, ± and from which log; and from what the data cannot tell the
    effect that it corrects, if there is any other explanation.
    """
    source = _source_of(robot)
    lines = _text_of(source).split("\n")
    added: dict[str, list[str]] = {}
    for correction in corrections(diagnosis, robot):
        words = _history(correction, diagnosis)
        number = source.lines.get((correction.table, correction.key))
        if number is None:
            line = f"{correction.key} = {_number(correction.after)}  # {words}"
            added.setdefault(correction.table, []).append(line)
        else:
            lines[number - 1] = _changed(lines[number - 1], correction, words, source.name)
    for table, new in added.items():
        header = _header_line(lines, table)
        if header is None:
            lines = [*lines, f"[{table}]", *new, ""]
        else:
            lines[header + 1 : header + 1] = new
    text = "\n".join(lines)
    _check_readable(text, source.name)
    return text


def corrected_effects(diagnosis: Diagnosis, robot: Robot) -> tuple[str, ...]:
    """Return the winning effects that `robot_text` takes up."""
    return tuple(sorted({correction.effect for correction in corrections(diagnosis, robot)}))


def _origin(diagnosis: Diagnosis) -> Iterator[str]:
    best = diagnosis.which[0]
    yield f"Found by chiplog diagnose {diagnosis.version} in {_logs(diagnosis)}."
    yield f"Verdict: {diagnosis.verdict}, probability {best.probability:.3f}."
    for other in best.ambiguous_with:
        yield f"This data cannot tell it from {' + '.join(other)}."
    if best.effects in ((NO_GAP,), (UNKNOWN,)):
        yield "There is no effect to switch on."


def _ends_of(diagnosis: Diagnosis) -> dict[str, float]:
    """Return when the logs begin and end [s, log time]: what acts up to there is not known to
    end there."""
    if not diagnosis.logs:
        return {}
    return {
        "start_s": min(one.start_s for one in diagnosis.logs),
        "stop_s": max(one.start_s + one.duration_s for one in diagnosis.logs),
    }


def _effect_table(
    name: str, candidate: Candidate, known: Mapping[str, Effect], ends_s: Mapping[str, float]
) -> Iterator[str]:
    effect = known.get(name)
    if effect is None:
        raise DiagnosisError(
            f"{name}: the simulator has no effect of this name, so it cannot be written to a file "
            "for `chiplog run --effects`"
        )
    yield f"[{name}]"
    estimates = {
        key.partition(".")[2]: estimate
        for key, estimate in candidate.parameters.items()
        if key.partition(".")[0] == name
    }
    for parameter in effect.settable:
        estimate = estimates.get(parameter.name)
        end_s = None if parameter in effect.parameters else ends_s.get(parameter.name)
        if estimate is not None and not _is_an_end(estimate, end_s):
            yield from _parameter_lines(parameter, estimate)


def _is_an_end(estimate: ParameterEstimate, end_s: float | None) -> bool:
    """Tell whether a time may well be that at which the logs begin or end."""
    if end_s is None or isinstance(estimate, ChoiceEstimate):
        return False
    low, high = estimate.ci95
    return low - _AT_THE_END_S < end_s < high + _AT_THE_END_S


def _known_table(one: KnownEffect) -> Iterator[str]:
    yield f"[{one.effect}]"
    for name, value in one.values.items():
        yield f"{name} = {_quoted(value) if isinstance(value, str) else repr(value)}"
        if name in one.ci95:
            low, high = one.ci95[name]
            yield f"{name}{INTERVAL} = [{low!r}, {high!r}]"


def _parameter_lines(parameter: EffectParameter, estimate: ParameterEstimate) -> Iterator[str]:
    if isinstance(estimate, ChoiceEstimate):
        sure = estimate.probabilities[str(estimate.estimate)]
        named = parameter.kind in ("choice", "message")
        value = _quoted(f"{estimate.estimate}") if named else f"{estimate.estimate}"
        yield f"{parameter.name} = {value}  # probability {sure:.2f}"
        return
    number = min(max(estimate.estimate, parameter.minimum), parameter.maximum)
    value = _number(round(number) if parameter.kind == "whole" else float(number), estimate.sd)
    unit = "" if estimate.unit == "1" else f"  # {estimate.unit}"
    yield f"{parameter.name} = {value}{unit}"
    # An estimate at the edge of what can be lies at the interval's, and a rounded one may.
    low, high = estimate.ci95
    ends = (min(low, float(value)), max(high, float(value)))
    low_text, high_text = (_number(end, estimate.sd) for end in ends)
    yield f"{parameter.name}{INTERVAL} = [{low_text}, {high_text}]"


def _source_of(robot: Robot) -> TomlSource:
    return robot.source or parse_toml(default_robot_text(), name="robot.toml")


def _text_of(source: TomlSource) -> str:
    if source.path is None:
        return default_robot_text()
    return source.path.read_bytes().decode("utf-8-sig")  # line ends stay as they are


def _history(correction: Correction, diagnosis: Diagnosis) -> str:
    after, before = _number(correction.after), _number(correction.before)
    words = f"from {before} to {after} ± {correction.sd:.2g}, diagnosed from {_logs(diagnosis)}"
    group = diagnosis.which[0].ambiguous_with
    rivals = [" + ".join(one) for one in group if correction.effect not in one]
    if not rivals:
        return words
    more = f" and {len(rivals) - _RIVALS} more" if len(rivals) > _RIVALS else ""
    return (
        f"{words}; this data cannot tell {diagnosis.verdict.replace('+', ' + ')} from "
        f"{', '.join(rivals[:_RIVALS])}{more}"
    )


def _logs(diagnosis: Diagnosis) -> str:
    names = [shorten(one.name) for one in diagnosis.inputs if one.role == "log"]
    return ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")


def _changed(line: str, correction: Correction, words: str, name: str) -> str:
    """Return `line` with the new value, its old comment kept and the change told after it.

    What the comment says of the old value in another unit ("this is 131 LSB per °/s") was so.
    """
    pattern = rf"(?P<key>[\"']?\b{correction.key}[\"']?\s*=\s*){_VALUE}"
    changed, found = re.subn(pattern, lambda m: m["key"] + _number(correction.after), line, count=1)
    if not found:
        raise DiagnosisError(
            f"{name}: {correction.table}.{correction.key} does not stand on one line with its "
            "value: expected `key = value`"
        )
    return_mark = "\r" if changed.endswith("\r") else ""
    value, mark, comment = changed.rstrip().partition("#")
    changed = value + mark + re.sub(r"\bthis is\b", "this was", comment)
    separator = "; " if "#" in changed else "  # "
    return f"{changed}{separator}{words}{return_mark}"


def _header_line(lines: list[str], table: str) -> int | None:
    pattern = re.compile(rf"\s*\[\s*{table}\s*\]\s*(#.*)?$")
    return next((place for place, line in enumerate(lines) if pattern.match(line)), None)


def _quoted(value: str) -> str:
    return f'"{value}"'


def _number(value: float | int, sd: float = math.inf) -> str:
    """Return `value` as TOML, no coarser than a hundredth of what it is known to: a replay tells a
    constant to twelve digits. A float always has a point or an exponent."""
    if isinstance(value, int):
        return str(value)
    needed = math.log10(max(abs(value) / sd, 1.0)) + 3 if sd > 0.0 else _MOST_DIGITS
    text = f"{value:.{min(max(math.ceil(needed), _DIGITS), _MOST_DIGITS)}g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _check_readable(text: str, name: str) -> None:
    """Read the corrected description as any command would; an error names the line."""
    validate(parse_toml(text, name=name), RobotFile)
