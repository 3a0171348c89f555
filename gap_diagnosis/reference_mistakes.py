"""A reference connected wrongly: degrees for radians, millimetres for metres, axes mirrored.

Wheels and gyro agree and the reference alone is off by a known factor. Nothing else of it can be
looked at before that is put right; what it says then is as good as any.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.hypothesis import Estimate, Fit
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.offset import turns_of
from gap_diagnosis.motion.seen import is_seen
from gap_diagnosis.prediction import Motion
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats, Recording, Reference
from gap_diagnosis.setup_mistakes import COUNT_FACTORS
from hil_harness.robot import Robot

Complex = NDArray[np.complex128]

_STEP_S: Final = 2.0
"""So long that half a second between two clocks matters little."""
_LEAST_STEPS: Final = 8
_ALIKE: Final = 0.8
_SAME: Final = math.log(1.2)
"""Effects of the robot change a way or a turn by less."""
_LEAST_TURN_RAD: Final = 0.05
_LEAST_WAY_M: Final = 0.01
_LEAST_ASIDE_M: Final = 0.001
_LITTLE: Final = 0.1
"""A step so many times the usual one leads nowhere."""
_CLEAR: Final = 20.0
"""A factor or a sign gains hundreds of nats in seconds: what gains less [nat] may be noise (a metre
of it was km/h for m/s by 4)."""
_QUARTER_RAD: Final = math.pi / 2
_FINE_RAD: Final = 0.1
"""A frame so far off a quarter turn is another one; up to there it is the effect reference_yaw's,
by its prior."""


@dataclass(frozen=True)
class Mistake:
    """A signal of the reference that reads *factor* times what it should.

    Attributes:
        signal: reference_position, reference_heading, or reference where all of it is mirrored.
        factor: a known one; -1 for a mirror image.
        quarter_turns: by which the heading, once one of both is mirrored, was ahead of the
            positions' frame (0 to 3): a compass counts clockwise from north, positions from east.
        log_evidence: of the log without it, less that with it.
    """

    signal: str
    factor: float
    log_evidence: float
    quarter_turns: int = 0

    @property
    def effect(self) -> str:
        """Its name."""
        return "setup_sign" if self.factor < 0 else "setup_unit"


class MistakeBlock:
    """What the reference shows of a mistake that was put right (a `Block`)."""

    name = "reference"

    def __init__(self, mistake: Mistake) -> None:
        self._mistake = mistake

    @property
    def effects(self) -> frozenset[str]:
        """The mistake."""
        return frozenset({self._mistake.effect})

    def fit(self, effects: frozenset[str]) -> Fit:
        """Return the mistake's fit."""
        if not effects:
            return Fit((), 0.0, 0.0)
        one = self._mistake
        told: dict[str, float | str] = {"signal": one.signal}
        if one.effect == "setup_unit":
            told["factor"] = one.factor
        parameters = {
            f"{one.effect}.{name}": Estimate(value, probabilities={str(value): 1.0})
            for name, value in told.items()
        }
        return Fit((one.effect,), one.log_evidence, one.log_evidence, parameters)


def with_reference_put_right(
    recording: Recording, robot: Robot, without: frozenset[str] = frozenset()
) -> tuple[Recording, Mistake | None]:
    """Return the recording without its reference's mistake, and the mistake if there is one.

    *without* are effects that are not to be named.
    """
    reference, prior = recording.reference, default_prior()
    candidates = _candidates(recording, robot)
    if reference is None or not candidates:
        return recording, None
    before = _log_evidence(MotionModel(recording, robot, prior))
    tried = []
    for signal, factor in candidates:
        right = replace(recording, reference=_divided(reference, signal, factor))
        quarters = 0
        if factor < 0 and signal != "reference":
            quarters = _quarter_turns(right, robot)
            right = _with_heading_turned(right, -quarters)
        after = MotionModel(right, robot, prior)
        # The same numbers in a larger unit are less likely each, by as much.
        residuals = [(0, 1), (2,)][signal == "reference_heading"]
        values = np.isfinite(after.columns.values[residuals, :, 0]).sum()
        gain = _log_evidence(after) - before - float(values) * math.log(abs(factor))
        tried.append((right, Mistake(signal, factor, gain, quarters)))
    right, mistake = max(tried, key=lambda one: one[1].log_evidence)
    if mistake.effect in without or mistake.log_evidence < _CLEAR:
        return recording, None
    return right, mistake


def _candidates(recording: Recording, robot: Robot) -> list[tuple[str, float]]:
    """Return signals that alone may be off by a known factor, and the factor."""
    reference = recording.reference
    if reference is None or len(reference.t_s) < _LEAST_STEPS:
        return []
    motion = estimate_motion(replace(recording, reference=None), robot)
    grid_s = _grid(motion, reference)
    seen = is_seen(grid_s, reference.t_s, 0.0, _STEP_S)
    if np.count_nonzero(seen) < _LEAST_STEPS:
        return []

    def steps(t_s: Floats, values: Floats) -> Floats:
        return np.asarray(np.diff(np.interp(grid_s, t_s, values))[seen])

    turns = [steps(motion.t_s, turn) for turn in turns_of(motion)]
    gyro = _ratio(turns[0], turns[1], _LEAST_TURN_RAD) if len(turns) > 1 else None
    ours = steps(motion.t_s, motion.x_m) + 1j * steps(motion.t_s, motion.y_m)
    theirs = steps(reference.t_s, reference.x_m) + 1j * steps(reference.t_s, reference.y_m)
    hand = _hand(ours, theirs)
    # Without a gyro positions that bend as the wheels do say that these are right.
    wheels_are_right = _is_same(gyro) if len(turns) > 1 else hand > 0
    heading = None
    if reference.heading_rad is not None:
        heading = _ratio(turns[0], steps(reference.t_s, reference.heading_rad), _LEAST_TURN_RAD)
    if wheels_are_right and (factor := _known(heading)) is not None:
        # Where positions are noisy, only the evidence tells whether they are mirrored too.
        return [("reference_heading", factor)] + [("reference", factor)] * (factor < 0)
    if _is_same(heading) and hand < 0 and (wheels_are_right or len(turns) == 1):
        return [("reference_position", -1.0)]
    # Wheels and gyro must agree which way the robot turned, not how far: tracks turn it less than
    # their wheelbase says. Without gyro and commands it may as well be the wheels that are swapped.
    other = gyro
    if other is None and recording.w_command_rad_s is not None:
        told_rad = np.cumsum(np.nan_to_num(recording.w_command_rad_s)) * recording.tick_s
        other = _ratio(turns[0], steps(recording.t_s, told_rad), _LEAST_TURN_RAD)
    if _is_positive(other) and not _is_positive(heading) and hand < 0:
        return [("reference", -1.0)]
    factor = _known(_ratio(np.abs(ours), np.abs(theirs), _LEAST_WAY_M))
    if factor is not None and factor > 0 and (wheels_are_right or _is_same(heading)):
        return [("reference_position", factor)]
    return []


def _hand(ours: Complex, theirs: Complex) -> int:
    """Return 1 where steps of a course lead to the left of the ones before as ours do, -1 where
    they lead to the right; 0 where too little leads aside to tell."""
    way_m = np.abs(ours)
    # Where it turns on the spot, what leads aside is the next step that goes anywhere.
    moved = way_m > max(_LEAST_WAY_M, _LITTLE * math.sqrt(float(np.mean(way_m**2))))
    if np.count_nonzero(moved) <= _LEAST_STEPS:
        return 0
    # By our own lengths: in metres aside a reference's noise is the same at any speed.
    longer_m = np.maximum(way_m[moved][1:], way_m[moved][:-1])
    aside = [
        (steps[moved][1:] * np.conj(steps[moved][:-1])).imag / longer_m for steps in (ours, theirs)
    ]
    ratio = _ratio(aside[0], aside[1], _LEAST_ASIDE_M)
    return 0 if ratio is None else round(math.copysign(1.0, ratio))


def _ratio(ours: Floats, theirs: Floats, least: float) -> float | None:
    """Return how many times *ours* *theirs* are; None where too little moves or they differ."""
    power = float(np.mean(ours**2)), float(np.mean(theirs**2))
    if power[0] < least**2 or power[1] <= 0.0:
        return None
    alike = float(np.mean(ours * theirs)) / math.sqrt(power[0] * power[1])
    if abs(alike) < _ALIKE:
        return None
    return math.copysign(math.sqrt(power[1] / power[0]), alike)


def _is_positive(ratio: float | None) -> bool:
    return ratio is not None and ratio > 0


def _is_same(ratio: float | None) -> bool:
    return ratio is not None and ratio > 0 and abs(math.log(ratio)) < _SAME


def _known(ratio: float | None) -> float | None:
    """Return the known factor other than 1 that a ratio is; None where it is none."""
    if ratio is None:
        return None
    factors = [-1.0, *(value for factor in COUNT_FACTORS for value in (factor, 1 / factor))]
    same = [one for one in factors if _is_same(ratio / one)]
    return min(same, key=lambda one: abs(math.log(ratio / one)), default=None)


def _divided(reference: Reference, signal: str, factor: float) -> Reference:
    right, heading = reference, reference.heading_rad
    if signal == "reference_position" and factor > 0:
        right = replace(right, x_m=reference.x_m / factor)
    if signal != "reference_heading":
        # About whichever axis it is mirrored, the rest is a turn of the frame, which is free.
        right = replace(right, y_m=reference.y_m / factor)
    if signal != "reference_position" and heading is not None:
        right = replace(right, heading_rad=heading / factor)
    return right


def _quarter_turns(recording: Recording, robot: Robot) -> int:
    """Return how many quarter turns (0 to 3) the reference's heading is ahead of its positions'
    frame; 0 where it is ahead by none that is known."""
    reference = recording.reference
    if reference is None or reference.heading_rad is None:
        return 0
    motion = estimate_motion(replace(recording, reference=None), robot)
    grid_s = _grid(motion, reference)
    ahead_rad = np.interp(grid_s, reference.t_s, reference.heading_rad) - np.interp(
        grid_s, motion.t_s, motion.heading_rad
    )
    ours, theirs = (
        np.diff(np.interp(grid_s, one.t_s, one.x_m) + 1j * np.interp(grid_s, one.t_s, one.y_m))
        for one in (motion, reference)
    )
    # Steps as the body takes them, not courses: a robot in reverse moves against its heading.
    seen = is_seen(grid_s, reference.t_s, 0.0, _STEP_S)
    turn = np.sum((ours * np.exp(1j * ahead_rad[:-1]) * np.conj(theirs))[seen])
    quarters = round(float(np.angle(turn)) / _QUARTER_RAD)
    left_rad = float(np.angle(turn)) - quarters * _QUARTER_RAD
    return quarters % 4 if abs(left_rad) < _FINE_RAD else 0


def _with_heading_turned(recording: Recording, quarters: int) -> Recording:
    reference = recording.reference
    if reference is None or reference.heading_rad is None or not quarters:
        return recording
    turned_rad = reference.heading_rad + quarters * _QUARTER_RAD
    return replace(recording, reference=replace(reference, heading_rad=turned_rad))


def _grid(motion: Motion, reference: Reference) -> Floats:
    """Return the ends of steps [s] over the time that both have."""
    first, last = (f(motion.t_s[place], reference.t_s[place]) for f, place in ((max, 0), (min, -1)))
    return np.arange(first, last, _STEP_S)


def _log_evidence(model: MotionModel) -> float:
    """Return the log evidence of the motion without any effect."""
    levels = model.no_effect_levels
    return model.evidence_at((), levels) + model.level_prior.log_density(np.log(levels))
