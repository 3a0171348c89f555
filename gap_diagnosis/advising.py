"""What to drive next: the manoeuvre that tells apart what these logs cannot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.contest import Contest, Hypothesis, contest_of
from gap_diagnosis.drivable import drivable
from gap_diagnosis.explanations.twins import twins_of
from gap_diagnosis.log_questions import imitations, unseen
from gap_diagnosis.manoeuvres import Described, Equipment, Manoeuvre, equipment_of, sights
from gap_diagnosis.motion.block import MotionBlock, aliased
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.recording import Floats
from gap_diagnosis.result import NO_GAP, UNKNOWN
from gap_diagnosis.result_parts import About, Advice, Candidate, EffectSet, Structure
from gap_diagnosis.structure import sights_of, twins_on
from hil_harness.assembly import Wire
from hil_harness.effects import catalogue
from hil_harness.robot import Robot

_MOST_RIVALS: Final = 8
_MOST_ADVICE: Final = 3
_LEAST_PROBABILITY: Final = 0.05
"""Another candidate's group is worth a drive from here on."""
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
_WITH_REFERENCE: Final = "With a reference (motion capture, or marks on the floor): "
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
_VARIES: Final = {
    "the supply is constant": "drive with a full battery and with a low one, its voltage recorded",
    "the temperature is constant": "drive from cold to warm, the gyro's temperature recorded",
}
"""What tells effects apart that are twins under a condition of the catalogue."""


@dataclass(frozen=True)
class Question:
    """What one group of explanations leaves open.

    Attributes:
        about: whose group it is.
        contests: what a drive may tell, the most important first.
        alike: sets that leave the same data whatever is driven.
        elsewhere: what the motion does not tell from the first of them.
        is_ranked: whether the first contests matter more; else all matter as much, and only the
            best drive is named.
    """

    about: About
    contests: tuple[Contest, ...] = ()
    alike: tuple[tuple[EffectSet, ...], ...] = ()
    elsewhere: tuple[EffectSet, ...] = ()
    is_ranked: bool = True


@dataclass(frozen=True)
class Menu:
    """All manoeuvres, and what each is worth.

    Attributes:
        drives: the manoeuvres.
        contests: what is to be told.
        gains: float64[d, c] of each contest [bit].
        has_reference_more: whether they were to be driven with a reference that was not there.
    """

    drives: tuple[Manoeuvre, ...]
    contests: tuple[Contest, ...]
    gains: Floats
    has_reference_more: bool = False

    def answers(self, question: Question, first: Mapping[EffectSet, EffectSet]) -> Iterator[Advice]:
        """Yield the drives that answer a question, the most telling first.

        Of sets that no drive tells apart the *first* stands for all.
        """
        columns = [place for place, one in enumerate(self.contests) if one in question.contests]
        if not columns:
            return
        table = self.gains[:, columns]
        weights = 1.0 / (1.0 + np.arange(len(columns)) * question.is_ranked)
        lengths = np.array([one.scenario.duration_s for one in self.drives])
        still = table.max(axis=0) >= _WORTH_BITS
        for _ in range(_MOST_ADVICE if question.is_ranked else 1):
            if not np.any(still):
                return
            best = int(np.argmax((table * weights * still).sum(axis=1) - _PER_S * lengths))
            told = np.flatnonzero(still & (table[best] >= _WORTH_BITS))
            chosen = [self.contests[columns[index]] for index in told.tolist()]
            sets = [first.get(each, each) for one in chosen for each in (one.truth, one.rival)]
            still[told] = False
            separates = tuple(dict.fromkeys(sets))
            if len(separates) < 2:  # what it tells apart is alike to a third
                continue
            drive = self.drives[best]
            sentence = drive.scenario.description
            if self.has_reference_more:
                sentence = f"{_WITH_REFERENCE}{sentence[0].lower()}{sentence[1:]}"
            yield Advice(
                separates=separates,
                scenario_file=drive.file,
                sentence=sentence,
                expected_gain=float(table[best, told].mean()),
                scenario=drive.text,
                about=question.about,
            )

    @property
    def left(self) -> tuple[Contest, ...]:
        """The contests that no manoeuvre answers."""
        most = self.gains.max(axis=0, initial=0.0)
        return tuple(
            one for one, gain in zip(self.contests, most, strict=True) if gain < _WORTH_BITS
        )


def advice_for(
    which: Sequence[Candidate],
    robot: Robot,
    wire: Wire,
    analyses: Sequence[Analysis],
    structure: Structure | None = None,
) -> tuple[Advice, ...]:
    """Return what to drive to tell the winner, which[0], from its group, the most telling first.

    With *structure*, then also what tells other candidates of some probability from theirs and from
    the winner, and what these logs cannot tell apart, or see, whatever is at work.

    Raises HarnessError and its relatives where this robot on this bus cannot be simulated.
    """
    recordings = [one.recording for one in analyses]
    motions = [one.motion for one in analyses if one.motion is not None]
    twins = twins_on(recordings, with_reference=True)
    questions = [
        _of_candidate(about, one, others, motions, twins)
        for about, one, others in _groups(which, with_others=structure is not None)
    ]
    if structure is not None and motions:
        questions += [
            Question("log", contests, _always_alike(group), is_ranked=False)
            for group, contests in imitations(motions, structure)
        ]
        questions.append(Question("log", unseen(motions, structure)))
    contests = tuple(one for each in questions for one in each.contests)
    menus: list[Menu] = []
    if contests:
        menus = _menus(contests, Described(robot, drivable(wire), motions[0].model.prior), motions)
    return tuple(advice for one in questions for advice in _answers(one, menus))


def _groups(
    which: Sequence[Candidate], *, with_others: bool
) -> Iterator[tuple[About, Candidate, tuple[EffectSet, ...]]]:
    """Yield the winner with its group, then other probable candidates that are in no group yet.

    A larger set's group holds all smaller ones that do as well: what is in a group already does not
    make it probable.
    """
    winner = which[0]
    none = {(NO_GAP,), (UNKNOWN,)}
    if winner.effects not in none:
        yield "verdict", winner, winner.ambiguous_with
    done = {winner.effects, *winner.ambiguous_with, *none}
    listed = {one.effects: one.probability for one in which}
    for one in which[1:] if with_others else ():
        known = sum(listed.get(each, 0.0) for each in one.ambiguous_with if each in done)
        if one.effects not in done and one.group_probability - known >= _LEAST_PROBABILITY:
            beside = () if winner.effects in none else (winner.effects,)
            yield "candidate", one, tuple(dict.fromkeys((*beside, *one.ambiguous_with)))
            done |= {one.effects, *one.ambiguous_with}


def _of_candidate(
    about: About,
    candidate: Candidate,
    others: Sequence[EffectSet],
    motions: Sequence[MotionBlock],
    twins: Sequence[frozenset[str]],
) -> Question:
    """Return what is open between a candidate, as large as found, and other sets."""
    effects = candidate.effects
    hopeless = [one for one in others if _are_twins(effects, one, twins)]
    named = [one for one in others if one not in hopeless]
    truth = _truth(effects, motions[0]) if motions and others else None
    # What the motion cannot speak of, no drive is planned for.
    apart = [] if truth is None else [one for one in named if _is_seen(one, effects, motions[0])]
    contests: tuple[Contest, ...] = ()
    if truth is not None and apart:
        logs = sights_of([(one.model, one.levels) for one in motions]).logs
        scan = motions[0].scan
        for one in apart[:_MOST_RIVALS]:
            terms = scan.found[_on_motion(one, motions[0])].terms
            account = Hypothesis(tuple(term.variant for term in terms))
            contests += (contest_of(logs, effects, truth, one, account),)
    return Question(
        about,
        contests,
        ((effects, *hopeless),) if hopeless else (),
        (effects, *(one for one in named if one not in apart)),
    )


def _menus(
    contests: tuple[Contest, ...], described: Described, motions: Sequence[MotionBlock]
) -> list[Menu]:
    """Return what each manoeuvre is worth; without a reference, then what with one."""
    levels = motions[0].levels
    equipment = equipment_of(motions[0].model.recording)
    menus = [_menu(contests, described, equipment, levels)]
    left = menus[0].left
    if left and equipment.reference_hz is None:
        assumed = levels.copy()
        for name, level in _CAMERA.items():
            assumed[LEVELS.index(name)] = level
        fitted = replace(_REFERENCE, has_gyro=equipment.has_gyro)
        more = _menu(left, described, fitted, assumed)
        menus.append(replace(more, has_reference_more=True))
    return menus


def _menu(
    contests: tuple[Contest, ...], described: Described, equipment: Equipment, levels: Floats
) -> Menu:
    needed = frozenset[str]().union(
        *(each.effects for one in contests for each in (one.acts, one.account))
    )
    found = [
        (manoeuvre, [one.gain(sight) for one in contests])
        for manoeuvre, sight in sights(described, equipment, levels, needed)
    ]
    gains = np.array([gain for _, gain in found]).reshape(len(found), len(contests))
    return Menu(tuple(manoeuvre for manoeuvre, _ in found), contests, gains)


def _answers(question: Question, menus: Sequence[Menu]) -> Iterator[Advice]:
    """Yield drives, then what no drive tells, then where else to look."""
    left = [one for one in question.contests if menus and one in menus[-1].left]
    told = {(one.rival, one.truth) for one in question.contests if one not in left}
    # What does not show at all in any drive is nobody's double.
    pairs = [
        (one.truth, one.rival)
        for one in left
        if one.rival != (NO_GAP,) and (one.truth, one.rival) not in told
    ]
    alike = _joined([*pairs, *question.alike])
    asked = {one.truth for one in question.contests}
    first: dict[EffectSet, EffectSet] = {}
    for sets in () if question.is_ranked else alike:
        first |= dict.fromkeys(sets, next((one for one in sets if one in asked), sets[0]))
    for menu in menus:
        yield from menu.answers(question, first)
    for sets in alike:
        yield _in_vain(question.about, sets[0], sets[1:])
    if len(question.elsewhere) > 1:
        yield _elsewhere(question.about, question.elsewhere[0], question.elsewhere[1:])


def _joined(groups: Sequence[tuple[EffectSet, ...]]) -> list[tuple[EffectSet, ...]]:
    """Return groups that have no member in common, each in the order in which it was named."""
    joined: list[tuple[EffectSet, ...]] = []
    for group in groups:
        same = [one for one in joined if set(one) & set(group)]
        members = dict.fromkeys(each for one in (*same, group) for each in one)
        joined = [*(one for one in joined if one not in same), tuple(members)]
    return joined


def _always_alike(group: EffectSet) -> tuple[tuple[EffectSet, ...], ...]:
    """Return pairs of a group that leave the same data in any log."""
    return tuple(
        ((effect,), (twin,))
        for effect in group
        for twin in twins_of(effect)
        if effect < twin and twin in group
    )


def _truth(effects: EffectSet, motion: MotionBlock) -> Hypothesis | None:
    """Return the winner's effects on the motion as they were found; None without any."""
    own = _on_motion(effects, motion)
    if not own or own not in motion.scan.found:
        return None
    found = motion.scan.found[own]
    fitted = found.refitted or motion.model.refit(found.terms, found.levels, free_levels=False)
    return Hypothesis(tuple(term.variant for term in found.terms), fitted.coefficients)


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


def _are_twins(winner: EffectSet, rival: EffectSet, twins: Sequence[frozenset[str]]) -> bool:
    """Tell whether two sets differ by effects only that leave the same data."""
    ours, theirs = set(winner) - set(rival), set(rival) - set(winner)
    if len(ours) != 1 or len(theirs) != 1:
        return False
    known: set[str] = set(ours)
    while True:
        more = known.union(*(twin for twin in twins if twin & known))
        if more == known:
            return bool(theirs <= known)
        known = more


def _in_vain(about: About, winner: EffectSet, rivals: Sequence[EffectSet]) -> Advice:
    """Return what to do where what is driven makes no difference."""
    ways = dict.fromkeys(way for one in rivals for way in _varied(set(winner) ^ set(one)))
    return Advice(
        separates=(winner, *rivals),
        scenario_file=None,
        sentence=(
            f"No manoeuvre tells {_apart(winner, rivals)} with these signals: "
            f"{'; '.join((*ways, 'measure the part itself, or record more'))}."
        ),
        expected_gain=0.0,
        scenario=None,
        about=about,
    )


def _apart(winner: EffectSet, rivals: Sequence[EffectSet]) -> str:
    """Return a set and what it is not told from: by name where a reader still takes that in, else
    how many and in what they differ."""
    if len(rivals) <= _NAMED:
        common = set(winner).intersection(*rivals)
        if len(common) < _COMMON or any(common.issuperset(one) for one in (winner, *rivals)):
            return f"{'+'.join(winner)} from {', '.join('+'.join(one) for one in rivals)}"
        ours, *theirs = (
            "+".join(name for name in one if name not in common) for one in (winner, *rivals)
        )
        beside = "+".join(name for name in winner if name in common)
        return f"{ours} from {', '.join(theirs)} beside {beside}"
    differing = dict.fromkeys(name for one in rivals for name in sorted(set(winner) ^ set(one)))
    return (
        f"{'+'.join(winner)} from {len(rivals)} other sets, which differ in {', '.join(differing)}"
    )


_NAMED: Final = 3
_COMMON: Final = 2
"""So many effects that all of the sets have are named once."""


def _varied(apart: AbstractSet[str]) -> list[str]:
    """Return what must vary for effects to part that are twins as long as it is constant."""
    known = catalogue()
    return [
        _VARIES[twins.condition]
        for effect in sorted(apart & known.keys())
        for twins in known[effect].twins
        if twins.condition in _VARIES and apart & set(twins.effects)
    ]


def _elsewhere(about: About, winner: EffectSet, rivals: Sequence[EffectSet]) -> Advice:
    """Return where to look for what wheels, gyro and reference do not tell apart."""
    known = catalogue()
    apart = {effect for rival in rivals for effect in set(winner) ^ set(rival)}
    stages = {known[effect].stage for effect in apart if effect in known}
    looks = [look for stage, look in _LOOKS.items() if stage in stages]
    return Advice(
        separates=(winner, *rivals),
        scenario_file=None,
        sentence=(
            f"No manoeuvre is planned to tell {_apart(winner, rivals)}: "
            f"{'; '.join(looks or ['measure the part itself'])}."
        ),
        expected_gain=0.0,
        scenario=None,
        about=about,
    )
