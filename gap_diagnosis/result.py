"""What a diagnosis says: the model of ``OUT.json``, docs/design.md section 7.

Names, parameters, units and signs are those of the effect catalogue: real against described. The
schema is printed by ``chiplog schema diagnosis``. Equal inputs give equal bytes but for `seconds`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any, Final, Literal, Self, TypeAlias

from pydantic import Field, model_validator

from gap_diagnosis.result_parts import (
    STAGES,
    Advice,
    Candidate,
    Gap,
    InputFile,
    KnownEffect,
    LogFacts,
    Part,
    Probability,
    StageOrNone,
    Structure,
    Unknown,
    Waterfall,
    Where,
    total_is_one,
)

DIAGNOSIS_SCHEMA: Final = 1
NO_GAP: Final = "no_gap"
UNKNOWN: Final = "unknown"
DIGITS: Final = 12
"""Significant digits of the numbers in OUT.json: beyond them lies the order of summation."""

EffectSet: TypeAlias = tuple[str, ...]


class Diagnosis(Part):
    """One diagnosis: where the gap lies, which effect causes it, how far it shrinks."""

    schema_: Literal[1] = Field(default=1, alias="schema", description="version of this format")
    verdict: str = Field(
        description="effects of which[0] joined by + in alphabetical order, no_gap or unknown"
    )
    stage: StageOrNone = Field(description="the most probable stage; none for no_gap")
    stage_probabilities: dict[StageOrNone, Probability]
    which: tuple[Candidate, ...] = Field(
        description='most probable first; ["no_gap"] and ["unknown"] are always there'
    )
    other: Probability = Field(
        default=0.0, description="probability of all that is not listed in which"
    )
    where: Where
    unknown: Unknown | None = Field(
        default=None, description="what the leftover looks like, where the verdict is unknown"
    )
    gap: Gap | None = Field(description="null where nothing was held out to measure it on")
    waterfall: Waterfall | None = Field(
        default=None, description="from nominal to explained, a step per effect (Shapley values)"
    )
    structure: Structure
    advice: tuple[Advice, ...] = ()
    assumptions: tuple[str, ...] = Field(default=(), description="what was taken for granted")
    notes: tuple[str, ...] = Field(
        default=(), description="what this data cannot tell, and what was odd about it"
    )
    doubts: tuple[str, ...] = Field(
        default=(),
        description="where a log and the robot's description contradict each other, and which was "
        "believed",
    )
    contradicting: tuple[str, ...] = Field(
        default=(),
        description="parameters that logs given together know differently: verdict and "
        "probabilities are those of one robot, which these logs are hardly of",
    )
    granted: tuple[KnownEffect, ...] = Field(
        default=(),
        description="effects known beside the description: all else is beyond them, gap and "
        "parameters too",
    )
    logs: tuple[LogFacts, ...] = ()
    inputs: tuple[InputFile, ...] = ()
    version: str = Field(description="version of Chiplog")
    seconds: float = Field(ge=0, description="how long it took [s]")

    @model_validator(mode="after")
    def _hangs_together(self) -> Self:
        _check_which(self.which, self.other)
        best = self.which[0]
        if self.verdict != "+".join(best.effects):
            raise ValueError(f"verdict {self.verdict!r} is not which[0]: {'+'.join(best.effects)}")
        if (self.stage == "none") != (self.verdict == NO_GAP):
            raise ValueError(f"stage {self.stage!r} does not go with verdict {self.verdict!r}")
        if not total_is_one(self.stage_probabilities.values()):
            raise ValueError("stage_probabilities do not sum to 1")
        return self

    @property
    def group(self) -> tuple[EffectSet, ...]:
        """The winning set of effects and all sets that this data cannot tell from it."""
        best = self.which[0]
        return (best.effects, *best.ambiguous_with)

    def to_json(self) -> str:
        """Return OUT.json as text: indented, UTF-8, numbers of `DIGITS` significant digits."""
        content = _rounded(self.model_dump(mode="json", by_alias=True))
        return json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n"

    @classmethod
    def from_json(cls, text: str) -> Diagnosis:
        """Return the diagnosis in `text`; raises pydantic.ValidationError if it is none."""
        return cls.model_validate_json(text)


def diagnosis_schema() -> dict[str, Any]:
    """Return the JSON schema of OUT.json."""
    schema = Diagnosis.model_json_schema(by_alias=True, mode="serialization")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def sort_candidates(candidates: Sequence[Candidate]) -> tuple[Candidate, ...]:
    """Return `candidates` as `which` wants them: most probable first, equals by name."""
    return tuple(sorted(candidates, key=lambda one: (-one.probability, one.effects)))


def sort_stages(probabilities: dict[StageOrNone, float]) -> dict[StageOrNone, float]:
    """Return `probabilities` in the order in which data flows."""
    return {stage: probabilities[stage] for stage in STAGES if stage in probabilities}


def _check_which(which: tuple[Candidate, ...], other: float) -> None:
    names = [candidate.effects for candidate in which]
    for needed in ((NO_GAP,), (UNKNOWN,)):
        if needed not in names:
            raise ValueError(f'which has no entry for ["{needed[0]}"]')
    if len(set(names)) != len(names):
        raise ValueError("which names a set of effects twice")
    probabilities = [candidate.probability for candidate in which]
    if probabilities != sorted(probabilities, reverse=True):
        raise ValueError("which is not sorted: expected the most probable first")
    if not total_is_one([*probabilities, other]):
        raise ValueError(
            f"probabilities of which and other sum to {math.fsum([*probabilities, other]):g}, not 1"
        )


def _rounded(value: Any) -> Any:
    """Return `value` with every float rounded to `DIGITS` significant digits; -0.0 becomes 0.0."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS - 1}e}") + 0.0
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return value
