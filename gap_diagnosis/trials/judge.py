"""One case held against its answer."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from gap_diagnosis.hypothesis import FORM
from gap_diagnosis.trials.case import Case
from gap_diagnosis.trials.sizes import UNLISTED
from gap_diagnosis.trials.truth import UNKNOWN, Answer, can_be_said, canonical, stages_of
from gap_diagnosis.trials.yardsticks import brier, rank_bin

LIMIT: Final = 2.0
"""At or above so many detection limits an effect must be told (docs: what must be reached)."""
_LEAST: Final = 1e-12
_CONFIDENT: Final = 0.8


@dataclass(frozen=True)
class Parameter:
    """A parameter of the effect that was named, against its true value.

    Attributes:
        key: ``effect.parameter``.
        error_sd: estimate less truth, in posterior standard deviations.
        inside: whether the 50, 80 and 95 % interval hold the truth.
        rank: which of the seven ranks.
        over_bound: error over the Cramér-Rao bound; None where there is no bound.
    """

    key: str
    error_sd: float
    inside: tuple[bool, bool, bool]
    rank: int
    over_bound: float | None = None


@dataclass(frozen=True)
class Judged:
    """A case with its scores.

    Attributes:
        case: what was sealed.
        over_limit: the smallest of its effects' magnitudes over their limits; None: none has one.
        truth: the right answer, in canonical names; ``unknown`` where it was withheld.
        oracle: the answers that nobody could tell from the truth, the truth among them.
        verdict: as reported; ``error`` for a crash.
        group: the reported answers.
        in_top3: whether the truth is among the three most probable answers.
        overlap: of the true window with the reported one, over both; None where there is none.
        has_own_name: whether the truth is in the reported group under its own name, twins apart.
        stage: as reported.
        true_probability: on the truth, twins together.
        group_probability: of the reported group.
        unknown_probability: of an unlisted cause.
        brier, log_score: of the whole forecast.
        wrong_name: the most probable single answer outside the oracle group.
        wrong_probability: its probability.
        parameters: of the effects, if which[0] names exactly those, and their sides or constants.
        seconds: how long it took.
        gap: before, after and floor; None where not measured.
        error: what went wrong, if anything did.
        leftover: what an unlisted cause goes with, the likeliest first; None without one.
        leftover_closes: share of the held-out gap that a model of the first closes; None where that
            was not measured.
    """

    case: Case
    over_limit: float | None
    truth: Answer
    oracle: frozenset[Answer]
    verdict: str
    group: frozenset[Answer]
    stage: str
    true_probability: float
    group_probability: float
    unknown_probability: float
    brier: float
    log_score: float
    wrong_name: str
    wrong_probability: float
    parameters: tuple[Parameter, ...]
    seconds: float
    gap: tuple[float, float, float] | None
    error: str | None = None
    has_own_name: bool = False
    in_top3: bool = False
    overlap: float | None = None
    leftover: tuple[str, ...] | None = None
    leftover_closes: float | None = None

    @property
    def is_null(self) -> bool:
        """Nothing beyond tolerance was at work."""
        return not self.truth

    @property
    def is_imitable(self) -> bool:
        """Of an unlisted cause: the library has a name that nobody could tell from it."""
        return self.truth == UNKNOWN and len(self.oracle) > 1

    @property
    def is_clear(self) -> bool:
        """At or above twice the detection limit."""
        return not self.is_null and (self.over_limit is None or self.over_limit >= LIMIT)

    @property
    def is_lost(self) -> bool:
        """Its cause is clear to see, and the library has no name for it."""
        return self.truth == UNKNOWN and self.is_clear

    @property
    def is_withheld(self) -> bool:
        """It has a name that the library was not given."""
        return self.is_lost and self.case.kind == "withheld"

    @property
    def top1(self) -> bool:
        """which[0] is the truth or its twin."""
        return self.verdict != "error" and canonical(self.verdict.split("+")) == self.truth

    @property
    def in_group(self) -> bool:
        """The truth is in the reported group; of an imitable cause, what imitates it will do."""
        if self.is_imitable:
            return not self.group.isdisjoint(self.oracle)
        return self.truth in self.group

    @property
    def names_imitator(self) -> bool:
        """Of an imitable cause, a name that nobody could tell from it is in the reported group."""
        return self.is_imitable and not self.group.isdisjoint(self.oracle - {UNKNOWN})

    @property
    def has_one_stage(self) -> bool:
        """The oracle group lies in one stage, an unlisted cause in that of what was at work."""
        return len({self._stages_of(one) for one in self.oracle}) == 1

    @property
    def stage_right(self) -> bool:
        """The reported stage is one in which the truth acts."""
        return self.stage in self._stages_of(self.truth)

    def _stages_of(self, answer: Answer) -> frozenset[str]:
        return stages_of(self.withheld if answer == UNKNOWN else answer)

    @property
    def withheld(self) -> Answer:
        """What was at work, whether withheld from the library or not."""
        return canonical(self.case.true_effects)

    @property
    def confident_wrong(self) -> bool:
        """A name outside the oracle group has a probability of 0.8 or more."""
        return self.wrong_probability >= _CONFIDENT


def judge(
    case: Case,
    found: Mapping[str, Any],
    oracle: frozenset[Answer],
    over_limit: float | None,
    bounds: Mapping[str, float] = MappingProxyType({}),
) -> Judged:
    """Score one result; a crash scores as badly as can be."""
    truth = canonical(case.true_effects)
    gone = frozenset(case.true_effects & (UNLISTED | frozenset(case.without)))
    if gone:
        truth = UNKNOWN
        oracle = frozenset(one for one in oracle if can_be_said(one, gone)) | {UNKNOWN}
    if "error" in found:
        return Judged(
            case, over_limit, truth, oracle, "error", frozenset(), "", 0.0, 0.0, 0.0, 2.0,
            -math.log(_LEAST), "", 0.0, (), float(found.get("seconds", 0.0)), None,
            str(found.get("traceback", found["error"])),
        )  # fmt: skip
    which: Sequence[Mapping[str, Any]] = found["which"]
    best = which[0]
    pooled: dict[Answer, float] = {}
    for entry in which:
        answer = canonical(entry["effects"])
        pooled[answer] = pooled.get(answer, 0.0) + entry["probability"]
    on_truth = pooled.get(truth, 0.0)
    others = [p for answer, p in pooled.items() if answer != truth]
    wrong = {
        answer: p for answer, p in pooled.items() if answer not in oracle and answer != UNKNOWN
    }
    worst = max(wrong, key=lambda answer: wrong[answer], default=frozenset[str]())
    unlisted: Mapping[str, Any] | None = found.get("unknown")
    goes_with = None if unlisted is None else unlisted.get("depends_on", ())
    return Judged(
        case=case,
        over_limit=over_limit,
        truth=truth,
        oracle=oracle,
        verdict=found["verdict"],
        group=frozenset(
            canonical(one) for one in (best["effects"], *best.get("ambiguous_with", ()))
        ),
        stage=found["stage"],
        true_probability=on_truth,
        group_probability=best["group_probability"],
        unknown_probability=pooled.get(UNKNOWN, 0.0),
        brier=brier(others, on_truth),
        log_score=-math.log(max(on_truth, _LEAST)),
        wrong_name="+".join(sorted(worst)) if wrong else "",
        wrong_probability=wrong.get(worst, 0.0) if worst else 0.0,
        parameters=_parameters(case, best, bounds),
        seconds=found["seconds"],
        gap=_gap(found.get("gap")),
        has_own_name=any(
            frozenset(one) - {"no_gap"} == case.true_effects
            for one in (best["effects"], *best.get("ambiguous_with", ()))
        ),
        in_top3=truth in sorted(pooled, key=lambda answer: -pooled[answer])[:3],
        overlap=_overlap(case, best),
        leftover=None if goes_with is None else tuple(one["variable"] for one in goes_with),
        leftover_closes=None if unlisted is None else unlisted.get("closes"),
    )


def _overlap(case: Case, best: Mapping[str, Any]) -> float | None:
    """Return the intersection of true and reported window over their union."""
    true = [
        (float(values["start_s"]), float(values["stop_s"]))
        for values in case.effects.values()
        if "start_s" in values and "stop_s" in values
    ]
    if len(true) != 1 or canonical(best["effects"]) != canonical(case.true_effects):
        return None
    (start, stop), shares = true[0], [0.0]
    for low, high in best.get("windows", ()):
        both = max(0.0, min(stop, high) - max(start, low))
        shares.append(both / (stop - start + high - low - both))
    return max(shares)


def _parameters(
    case: Case, best: Mapping[str, Any], bounds: Mapping[str, float]
) -> tuple[Parameter, ...]:
    if frozenset(best["effects"]) != case.true_effects:
        return ()
    found = []
    told = best.get("parameters", {})
    for key, estimate in told.items():
        effect, _, name = key.partition(".")
        true = case.effects[effect].get(name)
        # The size of a constant that counts up is none of one that counts down.
        if not _is_chosen_right(effect, case.effects[effect], told):
            continue
        if "sd" not in estimate or isinstance(true, str) or true is None or estimate["sd"] <= 0:
            continue
        value = _nearest_turn(float(true), estimate["estimate"], name)
        intervals = [tuple(estimate[ci]) for ci in ("ci95", "ci80", "ci50")]
        inside = [low <= value <= high for low, high in intervals]
        found.append(
            Parameter(
                key,
                (estimate["estimate"] - value) / estimate["sd"],
                (inside[2], inside[1], inside[0]),
                rank_bin(value, [(low, high) for low, high in intervals]),
                (estimate["estimate"] - value) / bounds[key] if key in bounds else None,
            )
        )
    return tuple(found)


def _is_chosen_right(effect: str, true: Mapping[str, Any], told: Mapping[str, Any]) -> bool:
    """Tell whether the side, the constant and whatever else an effect has by name is the true
    one, and its form."""
    form = told.get(f"{effect}.{FORM}")
    if form is not None and form["estimate"] != true.get(FORM, 0):
        return False
    keys = {name: f"{effect}.{name}" for name, value in true.items() if isinstance(value, str)}
    return all(told[key]["estimate"] == true[name] for name, key in keys.items() if key in told)


def _nearest_turn(value: float, near: float, name: str) -> float:
    """Return an angle in the turn of its estimate."""
    if name not in ("phase", "direction"):
        return value
    return value + math.tau * round((near - value) / math.tau)


def _gap(gap: Mapping[str, Any] | None) -> tuple[float, float, float] | None:
    if gap is None or gap.get("after") is None or gap.get("floor") is None:
        return None
    return float(gap["before"]), float(gap["after"]), float(gap["floor"])
