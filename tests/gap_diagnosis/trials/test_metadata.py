"""What can be read of a case without understanding it says nothing of its answer.

A classifier gets what a file manager and a text editor show: sizes, lines, digits, the order of
keys, names, dates, comments, first stamps. Trained on one half of a trial, it must tell null from
not null, and the stage of an effect, in the other half no better and no worse than by chance.

An effect on the bus, a missed deadline and a dropout of the reference take frames and samples away
or move them, and a signal in a wrong unit has other digits: sizes, lines and stamps of their logs
are their physics. Of such cases only what is not measured is looked at: robot.toml and task.json.
"""

from __future__ import annotations

import re
import tomllib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import binom, rankdata

from gap_diagnosis.trials import drives, make
from gap_diagnosis.trials.case import Case
from gap_diagnosis.trials.layout import CASES, LOG, REFERENCE, ROBOT, TASK
from gap_diagnosis.trials.plan import Counts, Planned, planned
from gap_diagnosis.trials.seal import unseal
from gap_diagnosis.trials.secret import Secret
from gap_diagnosis.trials.sizes import SIZES
from hil_harness.effects import catalogue

Floats = NDArray[np.float64]
Facts = Mapping[str, Any]

SECRET: Final = Secret(bytes(range(32, 48)))
MOVING_STAGES: Final = frozenset({"bus", "setup"})
MOVING: Final = frozenset(
    {"missed_deadline", "reference_dropout", "reference_time_offset", "reference_clock_skew"}
)
"""Effects of other stages that leave other stamps or fewer of them."""

STAGES: Final = sorted({catalogue()[name].stage for name in SIZES})
RIDGE: Final = 30.0
CHANCE: Final = 1e-3
"""Of a fair trial that one of these tests fails."""


@dataclass(frozen=True)
class Seen:
    """A case's answer and what can be read of it: of all its files, and of those not measured.

    *is_besides*: it is there for its stage; such cases withhold nothing, as singles do, and are
    more than a trial has.
    """

    case: Case
    stage: str
    is_besides: bool
    all_files: Facts
    described: Facts

    @property
    def is_as_long(self) -> bool:
        """Its effects leave every stamp where it is."""
        effects = frozenset(self.case.effects)
        return self.stage not in MOVING_STAGES and not effects & MOVING


def plan_of(each: int) -> tuple[list[Planned], list[bool]]:
    """Return cases, half of them nulls, and among them so many of each stage besides; and which
    ones are besides."""
    draw = SECRET.generator("plan of metadata")
    counts = Counts(20 * each, nulls=10 * each, pairs=each, withheld=3 * each, strata=("field",))
    plan = planned(counts, draw)
    for stage in STAGES:
        names = [name for name in SIZES if catalogue()[name].stage == stage]
        for place in range(each):
            plan.append(Planned("field", "single", (names[place % len(names)],)))
    order = draw.permutation(len(plan)).tolist()
    cases = [replace(plan[place], drive=drives.SHORT) for place in order]
    return cases, [place >= counts.cases for place in order]


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> list[Seen]:
    each = 60 if request.config.getoption("--chiplog-size") == "full" else 10
    folder = tmp_path_factory.mktemp("metadata") / "trial"
    key = folder.with_name("key")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(make, "_SAME_DRIVE", 1000)  # a long drive among short ones would say: redrawn
        counts = Counts(1, nulls=0, pairs=0)
        plan, besides = plan_of(each)
        make.make_trial(counts, folder, key, SECRET, plan=plan)
    cases = [Case.from_json(one) for one in unseal(folder, key)["cases"]]
    changed = [(folder / CASES / one.name / LOG).stat().st_ctime for one in cases]
    waits = np.diff(changed, prepend=changed[0])
    return [
        _seen(folder / CASES / one.name, one, float(wait), is_besides=is_besides)
        for one, wait, is_besides in zip(cases, waits, besides, strict=True)
    ]


def _seen(home: Path, case: Case, wait_s: float, *, is_besides: bool) -> Seen:
    stages = {catalogue()[name].stage for name in case.effects}
    described: dict[str, Any] = {"files": tuple(sorted(path.name for path in home.rglob("*")))}
    described["since the last case"] = wait_s
    for name in (ROBOT, TASK, LOG, REFERENCE):
        status = (home / name).stat()
        described |= {f"{name} date": status.st_mtime, f"{name} mode": status.st_mode}
    for name in (ROBOT, TASK):
        text = (home / name).read_text()
        described |= {
            f"{name} {what}": value
            for what, value in {
                "size": len(text),
                "lines": text.count("\n"),
                "digits": sum(one.isdigit() for one in text),
                "words": len(text.split()),
                "quotes": text.count('"'),
                "comments": text.count("#"),
                "keys": tuple(re.findall(r'^(\[?\w+)|"(\w+)":', text, re.M)),
                "decimals": tuple(len(one) for one in re.findall(r"\.(\d+)", text)),
            }.items()
        }
    tables = tomllib.loads((home / ROBOT).read_text())
    described["neutral values"] = sum(
        value in (0, 1) for table in tables.values() if isinstance(table, dict)
        for value in table.values()
    )  # fmt: skip
    found = dict(described)
    for name in (LOG, REFERENCE):
        text = (home / name).read_text()
        lines = text.splitlines()
        stamps = [float(re.sub(r"[()]", "", line.split()[0])) for line in (lines[0], lines[1])]
        found |= {
            f"{name} size": len(text),
            f"{name} lines": len(lines),
            f"{name} comments": sum(line.startswith("#") for line in lines),
            f"{name} first stamp": stamps[0],
            f"{name} first step": round(stamps[1] - stamps[0], 6),
            f"{name} length less signs": len(re.sub(r"-|\d+\.", "", text)),
        }
    return Seen(case, "+".join(sorted(stages)), is_besides, found, described)


def columns(facts: Sequence[Facts]) -> Floats:
    """Return float64[cases, features]: ranks of what is a number, and of every value that some
    cases share and some do not whether it is there."""
    found: list[Floats] = []
    for name in facts[0]:
        values = [one[name] for one in facts]
        if all(isinstance(value, int | float) for value in values):
            found.append((rankdata(values) - 0.5) / len(values) - 0.5)
        for value, count in Counter(values).items():
            if 0.03 < count / len(values) < 0.97:
                found.append(np.array([one == value for one in values], dtype=np.float64) - 0.5)
    return np.column_stack(found) if found else np.zeros((len(facts), 1))


def told_right(
    facts: Sequence[Facts], labels: Sequence[str], draw: np.random.Generator
) -> list[int]:
    """Return how many labels of either half are told by ridge regression on the other half.

    A half has as many cases of each label (the first of each are taken), so that the most frequent
    one is no better a guess than any other.
    """
    names = sorted(set(labels))
    each = each_label(labels)
    chosen = [np.flatnonzero(np.array(labels) == name)[: 2 * each] for name in names]
    features = columns([facts[place] for place in np.concatenate(chosen)])
    half = np.concatenate([draw.permutation(2 * each) < each for _ in names])
    truth = np.repeat(np.arange(len(names)), 2 * each)
    told = np.eye(len(names))[truth]
    found = []
    for test in (half, ~half):
        x, y = features[~test], told[~test]
        middle = x.mean(0)
        gram = (x - middle).T @ (x - middle) + RIDGE * np.eye(x.shape[1])
        weights = np.linalg.solve(gram, (x - middle).T @ y)
        guess = np.argmax((features[test] - middle) @ weights, axis=1)
        found.append(int((guess == truth[test]).sum()))
    return found


def each_label(labels: Sequence[str]) -> int:
    """Return how many cases of each label a half has."""
    return min(Counter(labels).values()) // 2


def by_chance(labels: Sequence[str]) -> tuple[float, float]:
    """Return the fewest and the most right guesses of a half that chance admits.

    What was learnt from one half is a fixed rule for the other. Where labels follow from nothing
    that is seen, each of its n guesses is right with chance 1/k, whatever the rule: their number is
    binomial. (Of ten folds together it is not: all learn from the same cases.) On both sides of
    both halves a fourth of `CHANCE`.
    """
    kinds = len(set(labels))
    right = binom(kinds * each_label(labels), 1.0 / kinds)
    return float(right.ppf(CHANCE / 4)), float(right.isf(CHANCE / 4))


def is_null(one: Seen) -> str:
    return "null" if not one.case.effects else "not null"


def stage_of(one: Seen) -> str:
    return one.stage


def learnt(
    seen: Iterable[Seen], label: Callable[[Seen], str], *, measured: bool
) -> tuple[list[Facts], list[str]]:
    """Return what is seen and what is to be told: of all cases, or with logs of as long ones."""
    chosen = [one for one in seen if one.is_as_long or not measured]
    return [one.all_files if measured else one.described for one in chosen], [
        label(one) for one in chosen
    ]


@pytest.mark.parametrize("measured", [False, True])
def test_metadata_does_not_tell_a_null_from_an_effect(seen: list[Seen], *, measured: bool) -> None:
    drawn = [one for one in seen if not one.is_besides]
    assert len(drawn) >= 200
    facts, labels = learnt(drawn, is_null, measured=measured)
    fewest, most = by_chance(labels)
    for right in told_right(facts, labels, np.random.default_rng(1)):
        assert fewest <= right <= most


@pytest.mark.parametrize("measured", [False, True])
def test_metadata_does_not_tell_the_stage_of_an_effect(seen: list[Seen], *, measured: bool) -> None:
    """Of cases with one effect and the whole library: which names are withheld is said openly."""
    alone = [one for one in seen if one.case.kind == "single"]
    facts, labels = learnt(alone, stage_of, measured=measured)
    fewest, most = by_chance(labels)
    for right in told_right(facts, labels, np.random.default_rng(1)):
        assert fewest <= right <= most


def test_a_leak_in_a_part_of_the_cases_is_found(seen: list[Seen]) -> None:
    """Half of what is not null has a file one byte longer."""
    facts, labels = learnt(seen, is_null, measured=True)
    draw = np.random.default_rng(2)
    leaking = [
        {**one, "size of a note": 100 + (label != "null" and draw.random() < 0.5)}
        for one, label in zip(facts, labels, strict=True)
    ]
    _, most = by_chance(labels)
    assert min(told_right(leaking, labels, draw)) > most
