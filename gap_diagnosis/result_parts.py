"""The parts of a diagnosis: candidates with intervals, shares, gap, structure, advice."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Annotated, Final, Literal, Self, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, model_validator

SUM_TOLERANCE: Final = 1e-6
CLOSABLE: Final = 1.2
"""Below this many floors there is no gap to close: `closed` is null."""

StageOrNone: TypeAlias = Literal[
    "none", "actuation", "wheel", "encoder", "gyro", "bus", "firmware", "reference", "setup"
]
STAGES: Final[tuple[StageOrNone, ...]] = (
    "none",
    "actuation",
    "wheel",
    "encoder",
    "gyro",
    "bus",
    "firmware",
    "reference",
    "setup",
)
About: TypeAlias = Literal["verdict", "candidate", "log"]
Kind: TypeAlias = Literal["rest", "straight", "arc", "spin", "accelerate", "brake", "reverse"]
Variable: TypeAlias = Literal[
    "speed",
    "acceleration",
    "turn_rate",
    "lateral_acceleration",
    "direction",
    "wheel_angle_left",
    "wheel_angle_right",
    "heading",
    "place",
    "temperature",
    "supply",
    "adc_code",
    "command",
    "distance",
    "time",
]
Probability: TypeAlias = Annotated[float, Field(ge=0, le=1)]
Interval: TypeAlias = tuple[float, float]
EffectSet: TypeAlias = tuple[str, ...]


class Part(BaseModel):
    """Frozen, strict, finite, and without fields that the schema does not know."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, populate_by_name=True
    )


class NumberEstimate(Part):
    """What is known of one number: posterior mean (of a moment the median), spread and equal-tailed
    intervals."""

    estimate: float
    unit: str = Field(description='SI; "1" for a ratio or a count')
    sd: float = Field(ge=0, description="posterior standard deviation")
    ci50: Interval
    ci80: Interval
    ci95: Interval

    @model_validator(mode="after")
    def _ascends(self) -> Self:
        bounds = [self.ci95[0], self.ci80[0], self.ci50[0], self.ci50[1], self.ci80[1]]
        bounds.append(self.ci95[1])
        if bounds != sorted(bounds):
            raise ValueError("intervals are not nested: expected ci50 within ci80 within ci95")
        return self


class ChoiceEstimate(Part):
    """What is known of one choice (a side, a rounding): the most probable, and all of them."""

    estimate: int | str
    probabilities: dict[str, Probability]

    @model_validator(mode="after")
    def _is_one_of_them(self) -> Self:
        if str(self.estimate) not in self.probabilities:
            raise ValueError(f"{self.estimate!r} has no probability")
        return self


ParameterEstimate: TypeAlias = NumberEstimate | ChoiceEstimate


class Candidate(Part):
    """One explanation: a set of effects, how probable it is, and with which values."""

    effects: EffectSet = Field(min_length=1, description='sorted; or ["no_gap"], ["unknown"]')
    probability: Probability
    group_probability: Probability = Field(
        description="of this set and all that this data cannot tell from it"
    )
    parameters: dict[str, ParameterEstimate] = Field(
        default_factory=dict, description="keyed effect.parameter"
    )
    windows: tuple[Interval, ...] = Field(
        default=(), description="[start_s, stop_s] of effects that act in part of the log"
    )
    ambiguous_with: tuple[EffectSet, ...] = ()
    separation: float | None = Field(
        default=None, description="twice the gain in log likelihood over no effect"
    )
    pareto_k: float | None = Field(
        default=None,
        description="of the importance sampling, trusted below 0.7; null where none was needed",
    )

    @model_validator(mode="after")
    def _is_in_order(self) -> Self:
        for names in (self.effects, *self.ambiguous_with):
            if list(names) != sorted(set(names)):
                raise ValueError(f"effects {', '.join(names)}: expected each once, sorted")
        for key in self.parameters:
            if key.partition(".")[0] not in self.effects:
                raise ValueError(f"parameter {key} belongs to none of {', '.join(self.effects)}")
        if self.group_probability < self.probability - SUM_TOLERANCE:
            raise ValueError("group_probability is below probability")
        return self


class Segment(Part):
    """A stretch of the log, what the robot did in it, and which stage's residual it holds."""

    start_s: float
    stop_s: float
    kind: Kind
    stage: StageOrNone = Field(description="the stage with the largest share here")
    share: float = Field(description="of that stage in the error that arises here")


class ResidualRow(Part):
    """When one residual arises."""

    stage: StageOrNone = Field(description="whose data it speaks of")
    touched_by: tuple[StageOrNone, ...] = Field(
        default=(), description="stages whose effects can show in it"
    )
    residual: str
    shares: tuple[float, ...] = Field(
        description="of the residual's own energy, per time window; they sum to 1"
    )


class ResidualTimes(Part):
    """When each residual arises; rows do not compare in size."""

    edges_s: tuple[float, ...] = Field(description="borders of the time windows")
    rows: tuple[ResidualRow, ...] = ()
    missing: tuple[str, ...] = Field(default=(), description="residuals without a row, and why")


class Where(Part):
    """Which stage's data carries the gap, over the log and along it."""

    stages: dict[StageOrNone, float] = Field(
        description="share per stage: they sum to 1 and may be negative; empty without a gap"
    )
    segments: tuple[Segment, ...] = ()
    residuals: ResidualTimes | None = None

    @model_validator(mode="after")
    def _adds_up(self) -> Self:
        if self.stages and not total_is_one(self.stages.values()):
            raise ValueError("shares of the stages do not sum to 1")
        return self


class Dependence(Part):
    """A variable on which an unexplained residual depends."""

    variable: Variable
    share: float = Field(description="of the leftover's energy that it explains")


class Metric(Part):
    """One gap metric on held-out data: an RMS over windows of 5 m, but 5 to 10 s."""

    unit: str
    before: float = Field(ge=0, description="simulation as described")
    after: float | None = Field(default=None, ge=0, description="with the winning effects on")
    floor: float | None = Field(default=None, ge=0, description="what noise alone leaves")
    closed: float | None = Field(
        default=None,
        description="(before − after)/(before − floor); null when before is below 1.2 floors, or "
        "when nothing that was held out lies in the windows in which the effects act",
    )
    ci95: Interval | None = Field(default=None, description="of closed, over windows and values")
    windows: int = Field(default=0, ge=0, description="disjoint windows behind the RMS")
    window_m: float | None = Field(default=None, gt=0, description="their mean length [m]")
    window_s: float | None = Field(default=None, gt=0, description="their mean length [s]")

    @model_validator(mode="after")
    def _closes_only_a_gap(self) -> Self:
        small = self.floor is not None and self.before < CLOSABLE * self.floor
        if small and self.closed is not None:
            raise ValueError("closed is given where before is below 1.2 floors")
        return self


class Modelled(Metric):
    """The gap with a model of what an unlisted cause goes with: a smooth function of one variable,
    fitted on the rest of the log and held against stretches that the fit never saw. Which stage
    and variable, the whole log told."""

    variable: Variable
    metric: str


class Unknown(Part):
    """What no listed effect explains: where, when, and what it goes with."""

    stage: StageOrNone
    windows: tuple[Interval, ...] = ()
    depends_on: tuple[Dependence, ...] = Field(default=(), description="the likeliest first")
    closes: float | None = Field(
        default=None,
        description="share of the gap that modelling this dependence closes on held-out stretches: "
        "closed of `modelled`; null where that was not measured",
    )
    modelled: Modelled | None = Field(default=None, description="the gap before and after")
    why_not: str | None = Field(
        default=None, description="in a few words why `closes` is null; else null"
    )

    @model_validator(mode="after")
    def _closes_what_was_measured(self) -> Self:
        if self.closes != (None if self.modelled is None else self.modelled.closed):
            raise ValueError("closes: expected what `modelled` closed")
        return self


class Gap(Metric):
    """How far the gap shrinks, in the metric in which the winning stage acts."""

    metric: str
    held_out: Literal["log", "stretches"] = Field(
        description="another log, or stretches of the log that the fit never saw"
    )
    all: dict[str, Metric] = Field(default_factory=dict, description="every metric by name")


class WaterfallStep(Part):
    """What switching one effect on takes away (Shapley value); negative where it adds."""

    effect: str
    reduction: float


class Waterfall(Part):
    """From nominal to explained: before − Σ reduction = after."""

    metric: str
    unit: str
    before: float
    steps: tuple[WaterfallStep, ...]
    after: float
    floor: float | None = None

    @model_validator(mode="after")
    def _adds_up(self) -> Self:
        fallen = self.before - math.fsum(step.reduction for step in self.steps)
        if not math.isclose(fallen, self.after, rel_tol=1e-6, abs_tol=1e-9 + 1e-6 * self.before):
            raise ValueError(f"the waterfall ends at {fallen:g}, not at after = {self.after:g}")
        return self


class Foreseen(Part):
    """What a log can tell, before any fit: from its manoeuvres and the noise that its robot is
    described with, or drives usually have."""

    detectable: dict[str, float | None] = Field(
        description="detection limit per effect, in its parameter's unit; null: cannot be seen, "
        "0: shows whenever it acts"
    )
    groups: tuple[EffectSet, ...] = Field(
        default=(), description="effects that such a log cannot tell apart"
    )


class Structure(Part):
    """What this log can tell, whatever is at work: from its manoeuvres and its levels of noise."""

    detectable: dict[str, float | None] = Field(
        default_factory=dict,
        description="detection limit per effect, in its parameter's unit; null: cannot be seen, "
        "0: shows whenever it acts",
    )
    groups: tuple[EffectSet, ...] = Field(
        default=(), description="effects that this log cannot tell apart"
    )
    foreseen: Foreseen | None = Field(
        default=None,
        description="the same before any fit, at the noise described or usual instead of the noise "
        "found; null: nothing to compare the wheels with",
    )


class Advice(Part):
    """The manoeuvre that tells the members of a group apart best."""

    separates: tuple[EffectSet, ...] = Field(description="the sets of effects it tells apart")
    scenario_file: str | None = Field(description="what `chiplog run --scenario` takes")
    sentence: str = Field(description="for a person to drive")
    expected_gain: float = Field(description="expected information on which of them it is [bit]")
    scenario: str | None = Field(default=None, description="content of the scenario file (TOML)")
    about: About = Field(
        default="verdict",
        description="whose group it is: the verdict's, that of another candidate of at least 5 %, "
        "or one that this log could not tell apart or see, whatever is at work",
    )


class LogFacts(Part):
    """What one log holds."""

    name: str
    start_s: float = Field(default=0.0, description="stamp of its first tick, on its own clock")
    duration_s: float
    ticks: int
    distance_m: float | None = None
    turned_rad: float | None = Field(default=None, description="sum of |rotation|")
    has_reference: bool = False
    has_gyro: bool = True
    has_commands: bool = False
    has_odometry: bool = False
    clock_skew: float | None = Field(default=None, description="ECU clock rate over log's − 1")
    lost_ticks: int = 0
    metrics: dict[str, Metric] = Field(
        default_factory=dict,
        description="every gap metric on its held-out stretches, where several logs are given and "
        "none is held out",
    )
    unmeasured: str | None = Field(
        default=None,
        description="why no gap was measured on it; null where one was, and beside another log "
        "that is held out",
    )


class KnownEffect(Part):
    """An effect that was known of the robot beforehand: the gap is measured beside it."""

    effect: str
    values: dict[str, float | int | str] = Field(description="by parameter, as the file states it")
    ci95: dict[str, Interval] = Field(
        default={}, description="95 % intervals by parameter; none of what is taken to be exact"
    )
    file: str = Field(description="the file that states it")


Role = Literal[
    "log",
    "reference",
    "robot",
    "dbc",
    "signals",
    "holdout",
    "holdout_reference",
    "effects",
    "effect_library",
]


class InputFile(Part):
    """One file that the diagnosis read."""

    role: Role
    name: str
    sha256: str = Field(pattern=r"^[0-9a-f]{64}$")


def total_is_one(values: Iterable[float]) -> bool:
    """Whether `values` sum to 1, but for rounding."""
    return abs(math.fsum(values) - 1) <= SUM_TOLERANCE
