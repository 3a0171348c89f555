"""The lesson, law by law: each predicted, measured on our plant and firmware, and judged.

``check_laws()`` measures every law; ``to_json`` gives the list that ``chiplog laws --json`` writes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from hil_harness.laws import (
    accelerometer,
    allan,
    contact,
    covariance,
    gyro,
    printed,
    quantisation,
    random_walk,
    recursion,
    wheels,
)
from hil_harness.laws.bench import Bench, Size, default_bench
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, Series
from hil_harness.laws.statistics import Interval, Split, split_error

__all__ = [
    "LAWS",
    "Bench",
    "Check",
    "Evidence",
    "Finding",
    "Interval",
    "Law",
    "Panel",
    "Series",
    "Size",
    "Split",
    "check_laws",
    "default_bench",
    "split_error",
    "to_json",
]

LAWS: tuple[Law, ...] = (
    *printed.LAWS,
    *wheels.LAWS,
    *contact.LAWS,
    *quantisation.LAWS,
    *random_walk.LAWS,
    *gyro.LAWS,
    *accelerometer.LAWS,
    *recursion.LAWS,
    *covariance.LAWS,
    *allan.LAWS,
)
"""Every law, in the order in which errors enter: numbers, wheels, contact, readings, gyro, pose."""


@dataclass(frozen=True)
class Finding:
    """A law and the evidence for or against it."""

    law: Law
    evidence: Evidence

    @property
    def passed(self) -> bool:
        """True when every number of the law agrees."""
        return all(check.passed for check in self.evidence.checks)


def check_laws(
    bench: Bench,
    laws: Sequence[Law] = LAWS,
    *,
    progress: Callable[[int], None] | None = None,
) -> list[Finding]:
    """Measure *laws* on *bench* and return one finding per law.

    Args:
        bench: plant and firmware, see `default_bench`.
        laws: which ones; all by default.
        progress: called with the number of laws done, after each.
    """
    findings = []
    for done, law in enumerate(laws, start=1):
        findings.append(Finding(law, law.measure(bench)))
        if progress is not None:
            progress(done)
    return findings


def to_json(findings: Sequence[Finding]) -> list[dict[str, Any]]:
    """Return one JSON object per number: ``law, predicted, measured, tolerance, pass`` and more."""
    return list(_objects(findings))


def _objects(findings: Sequence[Finding]) -> Iterator[dict[str, Any]]:
    for finding in findings:
        for check in finding.evidence.checks:
            interval = check.interval
            yield {
                "law": check.law,
                "predicted": check.predicted,
                # JSON has no NaN: a measurement that is none is null, and does not pass.
                "measured": check.measured if math.isfinite(check.measured) else None,
                "tolerance": check.tolerance,
                "pass": check.passed,
                "unit": check.unit,
                "interval": None
                if interval is None
                else {"low": interval.low, "high": interval.high, "level": interval.level},
                "false_alarm": check.false_alarm,
                "derivation": check.derivation,
                "family": finding.law.name,
                "validity": finding.law.validity,
                "source": finding.law.source,
            }
