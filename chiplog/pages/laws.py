"""The page of the laws: each law's numbers, picture, range of validity and error splits."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import Any

from markupsafe import Markup, escape

from chiplog.pages.law_pictures import law_picture
from chiplog.pages.quantities import MINUS, SUPERSCRIPTS, UNKNOWN
from chiplog.pages.rendering import render
from hil_harness.laws import Check, Finding, Split
from hil_harness.lesson import lesson_choices

CHECK_HEAD = ("number", "predicted", "measured", "tolerance", "unit")
SPLIT_HEAD = ("error", "runs", "systematic: mean", "random: spread")
CHOICE_HEAD = (
    "encoder",
    "rounding",
    "heading",
    "wheel only [m]",
    "heading [°]",
    "gyro heading [m]",
)


def laws_page(findings: Sequence[Finding], *, runs: int) -> str:
    """Return the self-contained page of *findings*, each statistical law over *runs* runs."""
    checks = [check for finding in findings for check in finding.evidence.checks]
    return render(
        "laws.html.j2",
        {
            "answer": answer(checks).split(" agree", 1),
            "runs": runs,
            "false_alarm_percent": f"{100 * sum(check.false_alarm for check in checks):.2g}",
            "check_head": CHECK_HEAD,
            "split_head": SPLIT_HEAD,
            "choice_head": CHOICE_HEAD,
            "choice_rows": choice_rows(),
            "laws": [_law(finding) for finding in findings],
        },
    )


def answer(checks: Sequence[Check]) -> str:
    """Return the verdict on all *checks* in one sentence."""
    broken = [check.law for check in checks if not check.passed]
    if not broken:
        return f"All {len(checks)} numbers agree with the laws that predict them."
    return f"{len(broken)} of {len(checks)} numbers disagree: {', '.join(broken)}."


def check_row(check: Check) -> list[str]:
    """Return name, predicted, measured, tolerance, unit and verdict of *check* as text.

    Numbers below a thousandth or above a hundred thousand share a power of ten, which stands with
    the unit; decimals reach three digits into the tolerance.
    """
    power = _power_of_ten(max(abs(check.predicted), abs(check.measured), check.tolerance))
    scale = 10.0**power
    decimals = _decimals(check.tolerance / scale, max(abs(check.predicted), 1e-300) / scale)
    numbers = (check.predicted, check.measured, check.tolerance)
    return [
        check.law,
        *(_fixed(number / scale, decimals) for number in numbers),
        _unit(check.unit, power),
        "agrees" if check.passed else "DISAGREES",
    ]


def split_row(split: Split) -> list[str]:
    """Return quantity with unit, runs, and both parts with 95 % intervals of *split* as text."""
    power = _power_of_ten(max(abs(split.systematic), split.random))
    scale = 10.0**power
    half = (split.systematic_interval.high - split.systematic) / scale
    decimals = _decimals(half, 1.0) - 1
    middle, plus_minus, spread, low, high = (
        _fixed(number, decimals)
        for number in (
            split.systematic / scale,
            half,
            split.random / scale,
            split.random_interval.low / scale,
            split.random_interval.high / scale,
        )
    )
    return [
        f"{split.quantity} [{_unit(split.unit, power)}]",
        str(split.runs),
        f"{middle} ± {plus_minus}",
        f"{spread} [{low}, {high}]",
    ]


def choice_rows() -> list[list[str]]:
    """Return the lesson's final errors for each encoder, rounding and heading as text."""
    return [
        [
            row.encoder,
            row.rounding,
            row.heading,
            f"{row.wheel_position_m:.6f}",
            f"{row.wheel_heading_deg:.4f}".replace("-", MINUS),
            f"{row.gyro_position_m:.6f}",
        ]
        for row in lesson_choices()
    ]


def with_subscripts(text: str) -> Markup:
    """Return *text* as markup in which ``ε_r`` and ``e_{k+1}`` have subscripts."""
    return Markup(
        re.sub(
            r"_(?:\{([^}]+)\}|([A-Za-zα-ω]+))", lambda m: f"<sub>{m[1] or m[2]}</sub>", escape(text)
        )
    )


def _law(finding: Finding) -> dict[str, Any]:
    law, evidence = finding.law, finding.evidence
    return {
        "name": law.name,
        "passed": finding.passed,
        "formula": with_subscripts(law.formula),
        "validity": with_subscripts(law.validity),
        "source": law.source,
        "picture": law_picture(finding),
        "caption": with_subscripts(evidence.caption),
        "checks": [_marked_row(check) for check in evidence.checks],
        "derivations": [
            (check.law, with_subscripts(_derivation(check))) for check in evidence.checks
        ],
        "splits": [split_row(split) for split in evidence.splits],
    }


def _marked_row(check: Check) -> list[str]:
    """Return the row with the verdict as a mark before the name: a phone shows the first column."""
    name, *numbers, _ = check_row(check)
    return [f"{'✓' if check.passed else '✗'} {name}", *numbers]


def _derivation(check: Check) -> str:
    parts = [check.derivation]
    if check.interval is not None:
        interval = check.interval
        percent = f"{100 * interval.level:g}"
        parts.append(f"measured {interval.low:.5g} to {interval.high:.5g} at {percent} %")
    if check.false_alarm > 0:
        parts.append(f"fails a correct implementation once in {1 / check.false_alarm:,.0f}")
    return "; ".join(parts).replace("-", MINUS) + "."


def _unit(unit: str, power: int) -> str:
    plain = "" if unit == "1" else unit
    if power == 0:
        return plain
    return f"10{str(power).translate(SUPERSCRIPTS)} {plain}".rstrip()


def _power_of_ten(largest: float) -> int:
    if largest == 0 or 1e-3 <= largest < 1e5:
        return 0
    return 3 * math.floor(math.log10(largest) / 3)


def _decimals(tolerance: float, value: float) -> int:
    """Return decimals that show three digits of the tolerance, or four of an exact value."""
    if tolerance <= 0:
        return 0 if value < 1e-12 or value == round(value) else 4
    return min(max(0, 2 - math.floor(math.log10(tolerance))), 12)


def _fixed(value: float, decimals: int) -> str:
    if not math.isfinite(value):
        return UNKNOWN
    text = f"{value:.{decimals}f}"
    return text.lstrip("-") if float(text) == 0 else text.replace("-", MINUS)
