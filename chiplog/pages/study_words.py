"""What a study says, in words: the answer, and each configuration as a row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from chiplog.pages.quantities import angle, count, length
from precision_study.study import Outcome, Requirement, Study, high_words, pareto_front

DEFAULT_KIND: Final = "arithmetic position"
OVERFLOW_HEAD: Final = ("configuration", "overflows", "runs")
FRONT_HEAD: Final = ("configuration", "error", "proved", "instructions/s", "table", "state")


def kind_of(requirement: Requirement | None) -> str:
    """Return which error is looked at, as in "arithmetic position"."""
    if requirement is None:
        return DEFAULT_KIND
    return f"{requirement.kind} {requirement.quantity}"


def front(found: Sequence[Outcome], requirement: Requirement | None) -> list[Outcome]:
    """Return the Pareto front for the error that is looked at."""
    return pareto_front(found, kind_of(requirement))


def said_error(value: float, kind: str) -> str:
    """Return an error with its unit."""
    return angle(value, 3) if kind.endswith("heading") else length(value, 3)


def front_row(one: Outcome, requirement: Requirement | None, study: Study) -> list[str]:
    """Return a configuration: values, error, proved bound, cost; only what is swept is named."""
    kind = kind_of(requirement)
    bound = one.bound(kind.split()[1]) if kind.startswith("arithmetic") else None
    return [
        short_words(one, study),
        said_error(one.error(kind), kind),
        "–" if bound is None else said_error(bound, kind),
        count(round(one.cost.instructions_per_s)),
        f"{count(one.cost.table_bytes)} B",
        f"{one.cost.state_bytes} B",
    ]


def overflow_rows(found: Sequence[Outcome], study: Study) -> list[list[str]]:
    """Return each configuration that overflows: how often, in how many runs; the most first."""
    overflowing = sorted(
        (one for one in found if one.overflows > 0), key=lambda one: one.overflows, reverse=True
    )
    return [
        [
            short_words(one, study),
            count(one.overflows),
            count(sum(part.runs for part in one.scenarios)),
        ]
        for one in overflowing
    ]


def short_words(one: Outcome, study: Study) -> str:
    """Return the values of the axes that are swept; of a field swept alone its last word."""
    swept = {
        axis
        for axis, _ in one.point.values
        if len({dict(point.values)[axis] for point in study.points}) > 1
    }
    return ", ".join(
        word
        for word, (axis, _) in zip(one.point.words.split(", "), one.point.values, strict=True)
        if axis in swept or not swept
    )


def answer(
    study: Study,
    found: Sequence[Outcome],
    requirement: Requirement | None,
    chosen: Outcome | None,
    margin: float,
) -> list[str]:
    """Return the answer in a few sentences."""
    kind = kind_of(requirement)
    lines = []
    if requirement is not None and chosen is not None:
        error = chosen.error(kind)
        lines.append(f"Cheapest that holds “{requirement.text}”: {chosen.point.words}.")
        factor = requirement.limit / error if error > 0 else float("inf")
        lines.append(
            f"It stays {factor:.3g}× below the limit: {said_error(error, kind)} on "
            f"{chosen.worst(kind).scenario}, the worst of {len(study.scenarios)} scenarios; "
            f"{_quantile_words(study)}."
        )
        lines.append(_proof(chosen, requirement))
        cost = chosen.cost
        lines.append(
            f"It takes {cost.instructions:.0f} instructions a tick on a Cortex-M3 (not cycles), "
            f"{count(cost.table_bytes)} bytes of table and {cost.state_bytes} of state."
        )
    elif requirement is not None:
        sound = [one for one in found if one.is_sound]
        least = min(sound, key=lambda one: one.error(kind), default=None)
        wanted = f"“{requirement.text}”" + (f" {margin:g} times over" if margin > 1 else "")
        lines.append(f"None of {len(found)} configurations holds {wanted}.")
        if least is not None:
            lines.append(
                f"Nearest: {least.point.words}, {said_error(least.error(kind), kind)} on "
                f"{least.worst(kind).scenario}; {_quantile_words(study)}."
            )
    else:
        best = front(found, requirement)
        lines.append(
            f"{len(best)} of {len(found)} configurations are on the front of {kind} error "
            f"against cost after {study.course.words}; {_quantile_words(study)}."
        )
    overflowing = [one for one in found if one.overflows > 0]
    if overflowing:
        times = sum(one.overflows for one in overflowing)
        lines.append(
            f"{len(overflowing)} of {len(found)} configurations overflow, {count(times)} times in "
            "all; none of them is chosen."
        )
    beyond = sum(not one.in_c for one in found)
    if beyond:
        lines.append(
            f"C cannot hold {beyond} of {len(found)} configurations: these ran in Python, the cost "
            "is that of C's widest words, and none of them is chosen."
        )
    return lines


def _quantile_words(study: Study) -> str:
    words = f"the {high_words(len(study.seeds))}"
    return words if "percentile" in words else f"{words} (100 would show the 99th percentile)"


def _proof(chosen: Outcome, requirement: Requirement) -> str:
    bound = chosen.bound(requirement.quantity)
    kind = f"arithmetic {requirement.quantity}"
    said = said_error(bound, kind)
    if requirement.kind == "total":
        return f"Of it the arithmetic is proved to be at most {said}: no format changes the rest."
    if bound <= requirement.limit:
        return f"Proved: at most {said} on each of these drives, so the limit holds."
    return f"Proved is at most {said}: what was measured holds, a worst case might not."
