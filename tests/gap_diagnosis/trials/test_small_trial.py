"""A sealed trial small enough for every change, which each of five spoilt methods fails.

Nine cases: three of a minute without an effect, three of 20 s whose reference is late or early,
three of 20 s whose effect goes by another name than the one that is told first; sizes are 2 to 10
detection limits. Of each kind at least one must be right, under the score that the kind is there
for.

A method that misses a case of a kind with a chance of 6 % fails that kind with a chance of 0.06³ =
2.2e-4, and one of three kinds less than once in 1,000 trials. That it misses no more is what the
full size tests on fresh seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pytest
from sabotage import (
    Diagnosed,
    Told,
    diagnosed,
    shuffled,
    told,
    white_noise,
    without_prior,
    without_twins,
)
from scipy.stats import binom

from gap_diagnosis.trials import drives
from gap_diagnosis.trials.case import Case
from gap_diagnosis.trials.judge import Judged, judge
from gap_diagnosis.trials.layout import CASES
from gap_diagnosis.trials.make import make_trial
from gap_diagnosis.trials.plan import Counts, Planned
from gap_diagnosis.trials.seal import unseal
from gap_diagnosis.trials.secret import Secret, fresh_secret
from gap_diagnosis.trials.truth import canonical

COUNTS: Final = Counts(1, nulls=0, pairs=0, strata=("limit",), factor=(2.0, 10.0), new_share=0)
SECRET: Final = Secret(bytes(range(16, 32)))
TWINS: Final = ("adc_offset", "adc_gain", "wheel_toe")
pytestmark = pytest.mark.xdist_group("small trial")  # made once
KINDS: Final = ("null", "offset", "twin")
MISSED: Final = 0.06
"""A method that misses a case with this chance fails less than one small trial in 1,000."""


@dataclass(frozen=True)
class Trial:
    """Cases and what the present method made of them."""

    folder: Path
    cases: tuple[Case, ...]
    found: tuple[Diagnosed, ...]

    def home(self, case: Case) -> Path:
        return self.folder / CASES / case.name


def kind_of(case: Case) -> str:
    if not case.effects:
        return "null"
    return "offset" if "reference_time_offset" in case.effects else "twin"


def plan(each: int) -> list[Planned]:
    effects = [(), ("reference_time_offset",)] * each
    effects += [(TWINS[place % len(TWINS)],) for place in range(each)]
    return [
        Planned("limit", "single", names, drive=drives.SHORT)
        if names
        else Planned("limit", "null", drive="tour")  # drift takes its time, and turns
        for names in effects
    ]


def made(folder: Path, each: int, secret: Secret) -> Trial:
    key = folder.with_name("trial.key")
    make_trial(COUNTS, folder, key, secret, plan=plan(each))
    homes = sorted((folder / CASES).iterdir())
    found = tuple(diagnosed(home) for home in homes)
    cases = tuple(Case.from_json(one) for one in unseal(folder, key)["cases"])
    return Trial(folder, cases, found)


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Trial:
    return made(tmp_path_factory.mktemp("small") / "trial", 3, SECRET)


def judged(cases: Sequence[Case], found: Sequence[Told]) -> list[Judged]:
    return [
        judge(case, one, frozenset({canonical(case.true_effects)}), None)
        for case, one in zip(cases, found, strict=True)
    ]


def hits(kind: str, scored: Sequence[Judged]) -> list[bool]:
    """Return of each case of a kind whether it is right under the score it is there for."""
    own = [one for one in scored if kind_of(one.case) == kind]
    score: dict[str, Callable[[Judged], bool]] = {
        "null": lambda one: one.verdict == "no_gap",
        "offset": lambda one: one.in_group,
        "twin": lambda one: one.has_own_name,
    }
    return [score[kind](one) for one in own]


def diagnosed_anew(trial: Trial, kind: str, size: str) -> list[Case]:
    """Return the cases of a kind of which a spoilt method makes diagnoses of its own: some that the
    present method gets right."""
    own = [one for one in trial.cases if kind_of(one) == kind]
    right = hits(kind, judged(trial.cases, [told(one) for one in trial.found]))
    return [one for one, is_right in zip(own, right, strict=True) if is_right][
        : 3 if size == "full" else 1
    ]


def test_the_present_method_passes(trial: Trial) -> None:
    scored = judged(trial.cases, [told(one) for one in trial.found])
    for kind in KINDS:
        assert any(hits(kind, scored)), [(one.case.name, one.verdict) for one in scored]


def test_a_method_that_takes_noise_to_be_white_fails(trial: Trial, size: str) -> None:
    nulls = diagnosed_anew(trial, "null", size)
    with white_noise():
        found = [told(diagnosed(trial.home(one))) for one in nulls]
    assert nulls
    assert not any(hits("null", judged(nulls, found)))


def test_a_method_without_a_time_offset_fails(trial: Trial, size: str) -> None:
    late = frozenset({"reference_time_offset", "frame_latency"})
    cases = diagnosed_anew(trial, "offset", size)
    found = [told(diagnosed(trial.home(one), late)) for one in cases]
    assert cases
    assert not any(hits("offset", judged(cases, found)))


def test_a_method_without_twins_fails(trial: Trial) -> None:
    found = [without_twins(told(one)) for one in trial.found]
    assert not any(hits("twin", judged(trial.cases, found)))


def test_a_method_that_ignores_the_prior_fails(trial: Trial) -> None:
    found = [told(without_prior(one)) for one in trial.found]
    assert not any(hits("null", judged(trial.cases, found)))


def test_answers_to_other_cases_fail(trial: Trial) -> None:
    found = [told(one) for one in trial.found]
    scored = judged(shuffled(trial.cases), found)
    assert not any(hits(kind, scored)[place] for kind in KINDS for place in range(3))


def test_the_present_method_misses_as_few_as_the_thresholds_take_it_to(
    trial: Trial, tmp_path: Path, size: str
) -> None:
    """At full size on sixty fresh cases of each kind: so many misses must be believable."""
    fresh = made(tmp_path / "trial", 60, fresh_secret()) if size == "full" else trial
    scored = judged(fresh.cases, [told(one) for one in fresh.found])
    for kind in KINDS:
        right = hits(kind, scored)
        missed = len(right) - sum(right)
        assert binom.sf(missed - 1, len(right), MISSED) > 1e-3 / len(KINDS), (kind, missed)
