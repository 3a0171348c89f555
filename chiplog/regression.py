"""A log as a regression test of the simulator: its gap stays below what a person allows."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gap_diagnosis.result import Diagnosis


def assert_gap_below(
    log: str | Path | Sequence[str | Path],
    *,
    robot: str | Path | None = None,
    reference: str | Path | Sequence[str | Path] | None = None,
    dbc: str | Path | None = None,
    signals: str | Path | None = None,
    effects: str | Path | None = None,
    effect_library: str | Path | None = None,
    **bounds: str,
) -> Diagnosis:
    """Assert that the gap between a log and the robot as it is known stays within bounds.

    Args:
        log: one recorded log or table, or several.
        robot: the description; None is the lesson's robot.
        reference: a trajectory measured from outside, one per log.
        dbc, signals: a DBC other than the shipped one, and its map.
        effects: what is known beside the description, as ``chiplog diagnose --write-effects``
            writes it: the gap is measured beside it.
        effect_library: effects of your own (a Python file, which is run).
        **bounds: one or more of position, heading, drive, firmware, turn, timing, each with the
            largest gap allowed, as in ``position="5 mm per 10 m"``.

    Returns the diagnosis. Raises AssertionError that says by how much which bound is exceeded and
    what the cause is; DiagnosisError, CanBusError or HarnessError for bad input.
    """
    __tracebackhide__ = True  # a failure shows the test's own line
    from chiplog.pages.diagnosis_words import headline, judgement_sentence
    from gap_diagnosis.criterion import METRICS, judge, parse_bound
    from gap_diagnosis.diagnose import diagnose
    from gap_diagnosis.errors import DiagnosisError

    if not bounds:
        raise DiagnosisError(
            f'no bound: expected one of {", ".join(METRICS)}, as in position="5 mm per 10 m"'
        )
    asked = [parse_bound(metric, text) for metric, text in bounds.items()]
    found = diagnose(
        _paths(log),
        robot=_path(robot),
        dbc=_path(dbc),
        signals=_path(signals),
        references=_paths(reference),
        effects=_path(effects),
        effect_library=_path(effect_library),
    ).diagnosis
    exceeded = [one for one in (judge(bound, found) for bound in asked) if not one.holds]
    if exceeded:
        lines = [judgement_sentence(one) for one in exceeded]
        raise AssertionError("\n".join([*lines, f"diagnosis: {headline(found)}"]))
    return found


def _paths(given: str | Path | Sequence[str | Path] | None) -> list[Path]:
    if given is None:
        return []
    return [Path(given)] if isinstance(given, str | Path) else [Path(one) for one in given]


def _path(given: str | Path | None) -> Path | None:
    return None if given is None else Path(given)
