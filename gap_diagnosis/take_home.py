"""What a diagnosis gives to take home: found effects as a file, and the description corrected.

Both are text that a person reads: intervals and origins stand as comments, and of the user's own
``robot.toml`` only the lines of corrected constants change.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from typing import Final

from gap_diagnosis.corrections import Correction, corrections
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.result import NO_GAP, UNKNOWN, Diagnosis
from gap_diagnosis.result_parts import Candidate, ChoiceEstimate, ParameterEstimate
from hil_harness.effects import Effect, EffectParameter, catalogue, effects_from_toml
from hil_harness.robot import Robot, RobotFile, default_robot_text
from hil_harness.toml_model import validate
from hil_harness.toml_source import TomlSource, parse_toml, shorten

_VALUE: Final = r"[-+0-9._eExXobA-Fa-f]+"
_DIGITS: Final = 9
_RIVALS: Final = 3
"""So many other explanations are named on a changed line; explained.toml names all."""


def effects_text(
    diagnosis: Diagnosis,
    *,
    without: Collection[str] = (),
    known: Mapping[str, Effect] | None = None,
) -> str:
    """Return the winning effects as ``chiplog run --effects`` and the pytest fixtures take them.

    Args:
        without: effects that the description has taken up (see `robot_text`).
        known: the catalogue with a user's effects in it; None is Chiplog's.

    Raises DiagnosisError for an effect that the simulator does not have.
    """
    best = diagnosis.which[0]
    known = catalogue() if known is None else known
    lines = [f"# {line}" for line in _origin(diagnosis)]
    if without:
        lines.append(f"# For the corrected description; it has taken up {', '.join(without)}.")
    for effect in best.effects:
        if effect not in (NO_GAP, UNKNOWN) and effect not in without:
            lines += ["", *_effect_table(effect, best, known)]
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


def _effect_table(name: str, candidate: Candidate, known: Mapping[str, Effect]) -> Iterator[str]:
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
    for parameter in effect.parameters:
        if parameter.name in estimates:
            yield _parameter_line(parameter, estimates[parameter.name])


def _parameter_line(parameter: EffectParameter, estimate: ParameterEstimate) -> str:
    if isinstance(estimate, ChoiceEstimate):
        sure = estimate.probabilities[str(estimate.estimate)]
        named = parameter.kind in ("choice", "message")
        value = f'"{estimate.estimate}"' if named else f"{estimate.estimate}"
        return f"{parameter.name} = {value}  # probability {sure:.2f}"
    number = min(max(estimate.estimate, parameter.minimum), parameter.maximum)
    low, high = estimate.ci95
    value = _number(round(number) if parameter.kind == "whole" else float(number))
    unit = "" if estimate.unit == "1" else f" {estimate.unit}"
    return f"{parameter.name} = {value}  # 95 %: {low:.4g} to {high:.4g}{unit}"


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


def _number(value: float | int) -> str:
    """Return `value` as TOML: a float always has a point or an exponent."""
    if isinstance(value, int):
        return str(value)
    text = f"{value:.{_DIGITS}g}"
    return text if re.search(r"[.e]", text) else f"{text}.0"


def _check_readable(text: str, name: str) -> None:
    """Read the corrected description as any command would; an error names the line."""
    validate(parse_toml(text, name=name), RobotFile)
