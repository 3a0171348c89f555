"""What to drive next: the manoeuvre that tells apart what these logs cannot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.contest import Hypothesis, View, bits, restraint_of, view
from gap_diagnosis.manoeuvres import Described, Equipment, Manoeuvre, equipment_of, sights
from gap_diagnosis.motion.block import MotionBlock, aliased
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.priors import Prior
from gap_diagnosis.recording import Floats
from gap_diagnosis.result import NO_GAP, UNKNOWN
from gap_diagnosis.result_parts import Advice, Candidate, EffectSet
from gap_diagnosis.structure import sights_of, twins_on
from hil_harness.assembly import Wire, load_wire
from hil_harness.effects import catalogue
from hil_harness.robot import Robot

_MOST_RIVALS: Final = 8
_MOST_ADVICE: Final = 3
_WORTH_BITS: Final = 0.5
"""A manoeuvre that is expected to tell less is not worth the drive."""
_PER_S: Final = 1e-4
"""Of two manoeuvres that tell the same, the shorter one [bit/s]."""
_REFERENCE: Final = Equipment(reference_hz=100.0, has_heading=True, has_gyro=True)
_CAMERA: Final = {
    "reference_position_m": 5e-4,
    "reference_heading_rad": 1e-3,
    "reference_slow_position_m": 5e-4,
    "reference_slow_heading_rad": 5e-4,
}
"""Noise of a reference that was not there: of a motion capture room."""
_LOOKS: Final = {
    "actuation": "time the drive's answer to a step of its command",
    "wheel": "measure wheels and axle",
    "encoder": "turn a wheel by hand and count",
    "gyro": "turn the gyro by a known angle",
    "bus": "stamp frames where they are sent as well as where they are received",
    "firmware": "read the firmware's constants and timing",
    "reference": "measure how the reference is mounted and synchronised",
    "setup": "check signs, sides and units",
}
"""By stage, where to look for what no drive is planned for."""


@dataclass(frozen=True)
class Rival:
    """Another account of the logs.

    Attributes:
        effects: its names.
        hypothesis: how it would act.
        known: what the logs see of it.
        restraint: of its sizes.
    """

    effects: EffectSet
    hypothesis: Hypothesis
    known: View
    restraint: Floats


def advice_for(
    winner: Candidate, robot: Robot, wire: Wire, analyses: Sequence[Analysis]
) -> tuple[Advice, ...]:
    """Return what to drive to tell the winner from its group, the most telling first.

    The separation to be expected is that of the winner, as large as found, from the best fit of a
    rival to the logs and to the new drive together, beyond what the logs alone give.
    """
    motions = [one.motion for one in analyses if one.motion is not None]
    if not winner.ambiguous_with or winner.effects[0] in {NO_GAP, UNKNOWN}:
        return ()
    twins = twins_on([one.recording for one in analyses], with_reference=True)
    rivals_named = [one for one in winner.ambiguous_with if not _are_twins(winner, one, twins)]
    hopeless = [one for one in winner.ambiguous_with if _are_twins(winner, one, twins)]
    truth = _truth(winner.effects, motions[0]) if motions else None
    advice: list[Advice] = []
    # What the motion cannot speak of, no drive is planned for.
    unseen = [
        one
        for one in rivals_named
        if truth is None or not _is_seen(one, winner.effects, motions[0])
    ]
    if truth is not None:
        rivals = _rivals(truth, [one for one in rivals_named if one not in unseen], motions)
        levels = motions[0].levels
        equipment = equipment_of(motions[0].model.recording)
        plan = Plan(winner.effects, truth, robot, _drivable(wire), motions[0].model.prior)
        left, advice = plan.against(rivals, equipment, levels)
        if left and equipment.reference_hz is None:
            assumed = levels.copy()
            for name, level in _CAMERA.items():
                assumed[LEVELS.index(name)] = level
            fitted = replace(_REFERENCE, has_gyro=equipment.has_gyro)
            left, more = plan.against(left, fitted, assumed)
            advice += [_with_reference(one) for one in more]
        hopeless = [one.effects for one in left] + hopeless
    if hopeless:
        advice.append(_in_vain(winner.effects, hopeless))
    if unseen:
        advice.append(_elsewhere(winner.effects, unseen))
    return tuple(advice)


def _drivable(wire: Wire) -> Wire:
    """Return a wire that a simulated loop can use: wheels' speeds can only be read from a log."""
    is_speed = wire.signal_map["left_count"].quantity in ("speed", "turn rate")
    return load_wire() if is_speed else wire


@dataclass(frozen=True)
class Plan:
    """What may be driven to tell a truth from its rivals."""

    winner: EffectSet
    truth: Hypothesis
    robot: Robot
    wire: Wire
    prior: Prior

    def against(
        self, rivals: Sequence[Rival], equipment: Equipment, levels: Floats
    ) -> tuple[list[Rival], list[Advice]]:
        """Return the rivals that no manoeuvre tells from the truth, and advice for the others."""
        if not rivals:
            return [], []
        drives: list[Manoeuvre] = []
        gains: list[list[float]] = []
        needed = frozenset(self.truth.effects).union(*(one.hypothesis.effects for one in rivals))
        described = Described(self.robot, self.wire, self.prior)
        for manoeuvre, sight in sights(described, equipment, levels, needed):
            drives.append(manoeuvre)
            gains.append(
                [_gain(rival, view(sight, self.truth, rival.hypothesis)) for rival in rivals]
            )
        table = np.array(gains)
        weights = 1.0 / (1.0 + np.arange(len(rivals)))
        lengths = np.array([one.scenario.duration_s for one in drives])
        still = table.max(axis=0) >= _WORTH_BITS
        beyond = [rival for rival, told in zip(rivals, still, strict=True) if not told]
        advice: list[Advice] = []
        while np.any(still) and len(advice) < _MOST_ADVICE:
            best = int(np.argmax((table * weights * still).sum(axis=1) - _PER_S * lengths))
            told = np.flatnonzero(still & (table[best] >= _WORTH_BITS))
            advice.append(
                Advice(
                    separates=(self.winner, *(rivals[index].effects for index in told.tolist())),
                    scenario_file=drives[best].file,
                    sentence=drives[best].scenario.description,
                    expected_gain=float(table[best, told].mean()),
                    scenario=drives[best].text,
                )
            )
            still[told] = False
        return beyond, advice


def _gain(rival: Rival, new: View) -> float:
    known = rival.known.separation(rival.restraint)
    return bits((rival.known + new).separation(rival.restraint) - known)


def _truth(effects: EffectSet, motion: MotionBlock) -> Hypothesis | None:
    """Return the winner's effects on the motion as they were found; None without any."""
    own = _on_motion(effects, motion)
    if not own or own not in motion.scan.found:
        return None
    found = motion.scan.found[own]
    fitted = found.refitted or motion.model.refit(found.terms, found.levels, free_levels=False)
    return Hypothesis(tuple(term.variant for term in found.terms), fitted.coefficients)


def _rivals(
    truth: Hypothesis, named: Sequence[EffectSet], motions: Sequence[MotionBlock]
) -> list[Rival]:
    """Return the first rivals, all of them seen by the motion."""
    logs = sights_of([(one.model, one.levels) for one in motions]).logs
    scan = motions[0].scan
    found: list[Rival] = []
    for effects in named:
        if len(found) == _MOST_RIVALS:
            break
        own = scan.found[_on_motion(effects, motions[0])]
        hypothesis = Hypothesis(tuple(term.variant for term in own.terms))
        known = view(logs[0], truth, hypothesis)
        for log in logs[1:]:
            known = known + view(log, truth, hypothesis)
        found.append(Rival(effects, hypothesis, known, restraint_of(logs[0], hypothesis)))
    return found


def _on_motion(effects: EffectSet, motion: MotionBlock) -> frozenset[str]:
    """Return what the motion shows of a set, under the names that it knows."""
    return aliased(frozenset(effects)) & motion.scan.effects


def _is_seen(rival: EffectSet, winner: EffectSet, motion: MotionBlock) -> bool:
    """Tell whether a set differs from the winner on the motion alone, and was fitted there."""
    shown = [_on_motion(one, motion) for one in (rival, winner)]
    beside, ours = (
        aliased(frozenset(one)) - own - {NO_GAP}
        for one, own in zip((rival, winner), shown, strict=True)
    )
    return beside == ours and shown[0] in motion.scan.found


def _are_twins(winner: Candidate, rival: EffectSet, twins: Sequence[frozenset[str]]) -> bool:
    """Tell whether two sets differ by effects only that leave the same data."""
    ours, theirs = set(winner.effects) - set(rival), set(rival) - set(winner.effects)
    if len(ours) != 1 or len(theirs) != 1:
        return False
    known: set[str] = set(ours)
    while True:
        more = known.union(*(twin for twin in twins if twin & known))
        if more == known:
            return bool(theirs <= known)
        known = more


def _with_reference(advice: Advice) -> Advice:
    sentence = advice.sentence[0].lower() + advice.sentence[1:]
    return advice.model_copy(
        update={"sentence": f"With a reference (motion capture, or marks on the floor): {sentence}"}
    )


def _in_vain(winner: EffectSet, rivals: Sequence[EffectSet]) -> Advice:
    names = ", ".join("+".join(one) for one in rivals)
    return Advice(
        separates=(winner, *rivals),
        scenario_file=None,
        sentence=(
            f"No manoeuvre tells {'+'.join(winner)} from {names} with these signals: measure the "
            "part itself, or record more."
        ),
        expected_gain=0.0,
        scenario=None,
    )


def _elsewhere(winner: EffectSet, rivals: Sequence[EffectSet]) -> Advice:
    """Return where to look for what wheels, gyro and reference do not tell apart."""
    known = catalogue()
    apart = {effect for rival in rivals for effect in set(winner) ^ set(rival)}
    stages = {known[effect].stage for effect in apart if effect in known}
    looks = [look for stage, look in _LOOKS.items() if stage in stages]
    names = ", ".join("+".join(one) for one in rivals)
    return Advice(
        separates=(winner, *rivals),
        scenario_file=None,
        sentence=(
            f"No manoeuvre is planned to tell {'+'.join(winner)} from {names}: "
            f"{'; '.join(looks or ['measure the part itself'])}."
        ),
        expected_gain=0.0,
        scenario=None,
    )
