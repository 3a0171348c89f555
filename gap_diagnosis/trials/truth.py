"""What counts as the same answer: twins of the catalogue are one name."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Final

from gap_diagnosis.priors import WHEELS
from hil_harness.effects import catalogue

Answer = frozenset[str]
"""Canonical names; empty for no gap."""

UNKNOWN: Final = frozenset({"unknown"})
_NO_GAP: Final = "no_gap"
_PREFERRED: Final = ("radius_scale", "gyro_bias", "gyro_scale", "reference_yaw")
_WHENEVER: Final = frozenset({"", "scale < 0", "the lever arm is unknown"})


@cache
def twin_classes() -> tuple[frozenset[str], ...]:
    """Return the classes of effects that leave the same data in every log of a trial.

    Trials do not tell the lever arm, so a toe and a reference's yaw are one.
    """
    classes: list[set[str]] = [{"wheel_toe", "reference_yaw"}]
    for name, effect in catalogue().items():
        for twins in effect.twins:
            if twins.condition in _WHENEVER and len(twins.effects) == 1:
                pair = {name, *twins.effects}
                touched = [one for one in classes if one & pair]
                classes = [one for one in classes if not one & pair]
                classes.append(pair.union(*touched))
    return tuple(frozenset(one) for one in classes)


def class_of(effect: str) -> frozenset[str]:
    """Return an effect with all its twins."""
    return next((one for one in twin_classes() if effect in one), frozenset({effect}))


def canonical_name(effect: str) -> str:
    """Return the name that stands for a twin class."""
    own = class_of(effect)
    return next((one for one in _PREFERRED if one in own), min(own))


def canonical(effects: Iterable[str]) -> Answer:
    """Return an answer in canonical names; ``no_gap`` is the empty one.

    A payload is a radius scale with a mismatch.
    """
    names = {canonical_name(one) for one in effects if one != _NO_GAP}
    if "payload" in names and not names & WHEELS:
        names = (names - {"payload"}) | WHEELS
    return frozenset(names)


def can_be_said(answer: Answer, without: Iterable[str]) -> bool:
    """Tell whether an answer has names left in a library *without* some effects.

    A payload is told by itself, or as a radius scale with a mismatch.
    """
    gone = frozenset(without)
    if answer == WHEELS and "payload" not in gone:
        return True
    return not answer & {canonical_name(one) for one in gone}


def stages_of(answer: Answer) -> frozenset[str]:
    """Return the stages in which an answer's names or their twins act; ``none`` for no gap."""
    known = catalogue()
    if not answer:
        return frozenset({"none"})
    if answer == WHEELS:
        return frozenset({"wheel"})
    return frozenset(
        known[twin].stage for name in answer for twin in class_of(name) if twin in known
    )
