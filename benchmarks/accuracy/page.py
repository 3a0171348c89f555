"""The page of measured accuracy, from results."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from datetime import date
from typing import Final

import numpy as np
from scipy.stats import beta

from accuracy.figures import LEVELS, Key, coverage, ranks, ratios, steps, uniformity
from accuracy.fits import Result, is_edge

TARGET: Final = 1.2
_FAMILY: Final = 0.01
_ENOUGH: Final = 40
_ENOUGH_INTERVALS: Final = 5000

_HEAD: Final = """\
<!-- Written by benchmarks/accuracy_motion.py; run that again instead of editing. -->

# Accuracy of the motion's estimates, as measured

How far the estimates of wheel, encoder, gyro and reference effects are off, and whether their
intervals hold what they promise, *given the right name*. Simulated drives of about a minute of
three kinds; micro-slip, gyro noise, bias walk and reference noise are drawn anew for each case, of
the kinds that the likelihood assumes. The diagnosis's own fit is used, with one effect's name.
"""


def page(results: Sequence[Result], day: date | None = None, commit: str = "") -> str:
    """Return the page, in Markdown; *commit* is that of the code that was measured."""
    day = day or date.today()
    code = f", commit {commit}," if commit else ""
    parts = [_HEAD, f"Measured on {day:%Y-%m-%d}{code} with\n\n{_commands(results)}\n"]
    failed = [one for one in results if "failed" in one]
    if failed:
        names = ", ".join(sorted({f"`{one['effect']}`" for one in failed}))
        parts.append(f"Cases that ended with an error and are left out: {len(failed)} ({names}).")
    parts += [_bounds(results), _steps(results), _coverage(results)]
    return "\n".join(part.strip("\n") + "\n" for part in parts if part)


def _commands(results: Sequence[Result]) -> str:
    """Return what was run: as many rounds of most effects, and others of some."""
    lines = []
    for study in ("limit", "exact", "prior"):
        numbers: dict[str, list[int]] = defaultdict(list)
        for one in results:
            if one["study"] == study:
                numbers[one["effect"]].append(one["number"])
        if not numbers:
            continue
        rounds = {name: (min(some), max(some) + 1 - min(some)) for name, some in numbers.items()}
        usual = Counter(rounds.values()).most_common(1)[0][0]
        for effects, (first, count) in [("", usual), *sorted(rounds.items())]:
            if not effects or (first, count) != usual:
                only = f" --effects {effects}" if effects else ""
                lines.append(
                    f"    python benchmarks/accuracy_motion.py {study} --first {first} "
                    f"--rounds {count}{only} --results DIR"
                )
    return "\n".join(lines)


def _bounds(results: Sequence[Result]) -> str:
    known, exact = ratios(results, "limit"), ratios(results, "exact")
    if not known:
        return ""
    total = sum(one.count for one in known.values())
    pooled = math.sqrt(sum(one.count * one.rms**2 for one in known.values()) / total)
    held = [key for key, one in known.items() if one.rms <= TARGET]
    text = f"""\
## Error over the Cramér–Rao bound

Sizes are 2 to 10 times the detection limit (29 in expected separation, or the tolerance if that is
larger). Free in the bound: start pose, time map, noise and contact levels, and the constants of the
description within their tolerances, which are off in these worlds too (half a tolerance is their
standard deviation). *RMS*: root mean square of error over bound, its 95 % interval beside it; it
should be at most {TARGET}; ✗ marks what is surely larger. *Mean*: of error over bound. *Stated*:
median of the stated standard deviation over the bound.
{_exact_note(exact)}
At or below {TARGET}: {len(held)} of {len(known)}. Over all {total} values together: {pooled:.2f}.
{_few(min(one.count for one in known.values()), _ENOUGH)}
"""
    rows = [["effect", "parameter", "cases", "RMS", "95 %", "mean", "stated"]]
    if exact:
        rows[0].append("RMS, exact constants")
    for key, one in known.items():
        mark = " ✗" if one.low > TARGET else ""
        row = [
            f"`{key[0]}`",
            f"`{key[1]}`",
            str(one.count),
            f"{one.rms:.2f}{mark}",
            f"{one.low:.2f} to {one.high:.2f}",
            f"{one.bias:+.2f}",
            f"{one.stated:.2f}",
        ]
        if exact:
            other = exact.get(key)
            row.append("" if other is None else f"{other.rms:.2f} ({other.count})")
        rows.append(row)
    return text + _table(rows)


def _few(count: int, enough: int) -> str:
    """Return a sentence where there are fewer cases than were asked for."""
    if count >= enough:
        return ""
    return f"**Not enough cases yet** ({count} of some, {enough} asked for): read the intervals.\n"


def _exact_note(exact: object) -> str:
    if not exact:
        return ""
    return (
        "*Exact constants*: nothing but the time map is off, and fit and bound know it "
        "(number of cases in brackets).\n"
    )


def _steps(results: Sequence[Result]) -> str:
    found = steps(results, "limit")
    if not found:
        return ""
    text = """\
## Thresholds, whole numbers, windows, sides

*Exact*: the same whole number or name; an edge of a window within 0.1 s, a threshold within
0.2 rad/s, a limit within 0.01 rad/s. *One step*: one whole number off at most; an edge within
2.5 s, a threshold within 1.2 rad/s, a limit within 0.1 rad/s, the steps in which they are sought at
first. *In interval*: the truth lies in the 95 % interval. *Not seen*: the log gave no place to the
effect.

"""
    rows = [["effect", "parameter", "cases", "exact", "one step", "in interval", "not seen"]]
    for (effect, name), one in found.items():
        rows.append(
            [
                f"`{effect}`",
                f"`{name}`",
                str(one.count),
                f"{one.exact:.0%}",
                f"{one.near:.0%}",
                "" if math.isnan(one.inside) else f"{one.inside:.0%}",
                f"{one.missed:.0%}",
            ]
        )
    return text + _table(rows)


def _coverage(results: Sequence[Result]) -> str:
    found = ranks(results, "prior")
    if not found:
        return ""
    pooled = [one for some in found.values() for one in some]
    smooth = [one for key, some in found.items() if not is_edge(key[1]) for one in some]
    worst = min(found, key=lambda key: uniformity(found[key]))
    least = min(uniformity(found[worst]) * len(found), uniformity(pooled))
    verdict = "pass" if least >= _FAMILY else "do not pass"
    text = f"""\
## Intervals and ranks on draws from the prior

Sizes are drawn from `gap_diagnosis/data/prior.toml`, the published prior, and so are the errors
of the description. {len(pooled)} intervals are pooled. Ranks of the truth among the posterior's
samples {verdict} a chi-square test of uniformity at {_FAMILY:.0%} over all parameters together (the
worst is `{worst[0]}.{worst[1]}` with p = {uniformity(found[worst]):.2g}, times {len(found)}
parameters; Talts et al. 2018). For 95 % intervals 94 to 96 % are asked for.
{_few(len(pooled), _ENOUGH_INTERVALS)}
"""
    rows = [["", "intervals", *(f"{level:.0%}" for level in LEVELS), "p of ranks"]]
    rows.append(_covered("all", pooled, with_interval=True))
    rows.append(_covered("without edges of windows and thresholds", smooth, with_interval=True))
    rows += [_covered(_name(key), some) for key, some in found.items()]
    return text + _table(rows)


def _name(key: Key) -> str:
    return f"`{key[0]}.{key[1]}`"


def _covered(name: str, some: Sequence[float], *, with_interval: bool = False) -> list[str]:
    cells = []
    for level in LEVELS:
        share = coverage(some, level)
        cell = f"{share:.1%}"
        if with_interval:
            hits = round(share * len(some))
            low, high = beta.ppf([0.025, 0.975], [hits, hits + 1], [len(some) - hits + 1,
                                                                   len(some) - hits])  # fmt: skip
            cell += f" ({100 * np.nan_to_num(low):.1f} to {100 * np.nan_to_num(high, nan=1.0):.1f})"
        cells.append(cell)
    return [name, str(len(some)), *cells, f"{uniformity(some):.2g}"]


def _table(rows: Sequence[Sequence[str]]) -> str:
    head, *rest = rows
    lines = [head, ["---"] * len(head), *rest]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"
