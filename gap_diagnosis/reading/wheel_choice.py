"""Which signals are the wheels: by unit, name, wraps and side, and without sides by a gyro."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.evidence import (
    CLEAR,
    ENOUGH,
    REFERENCE_WORDS,
    SAME,
    WORDS,
    Guess,
    Search,
    best_of,
    difference,
    is_whole,
    likeness_of,
    unit_score,
)
from gap_diagnosis.reading.signal_names import COMMAND_WORDS, is_named, words_of
from gap_diagnosis.reading.signals_found import FoundSignal
from gap_diagnosis.reading.unit_names import unit_of_signal
from hil_harness.signal_roles import COUNT_UNITS, Role, unit_of, units_for

_WHEEL_WORDS: Final = ("wheel", "encoder", "enc", "tick", "count", "pulse", "odo", "wheels")
_WAY_WORDS: Final = frozenset({"dist", "distance", "travel", "way"})
"""With a side, these are a wheel's; without, a range finder may say them."""
_REAR_AND_FRONT: Final[Mapping[Role, tuple[str, ...]]] = {
    "left_count": ("rl", "fl", "lr", "lf", "hl", "vl", "links"),
    "right_count": ("rr", "fr", "rf", "hr", "vr", "rechts"),
}
"""How cars spell the sides: rear left, front left, also in German."""
_REAR_WORDS: Final = frozenset({"rear", "back", "rl", "lr", "hl", "rr", "hr", "hinten"})


def choose_wheels(search: Search) -> None:
    """Give the wheels to the signals with the most evidence; raise DiagnosisError where none has
    enough, or where nothing tells two apart."""
    if "left_count" in search.guesses and "right_count" in search.guesses:
        return
    by_side: dict[Role, list[tuple[float, Guess]]] = {"left_count": [], "right_count": []}
    unnamed: list[tuple[float, Guess]] = []
    for signal in search.free:
        score, guess = _wheel_evidence(search, signal)
        if score < ENOUGH:
            continue
        words = set(words_of(signal))
        sides = [side for side in by_side if words & {*WORDS[side], *_REAR_AND_FRONT[side]}]
        if len(sides) == 1:
            named = Guess(
                sides[0], signal, guess.unit, wrap=guess.wrap, reasons=("name", *guess.reasons)
            )
            by_side[sides[0]].append((score, named))
        else:
            unnamed.append((score, guess))
    _prefer_rear(by_side)
    for role, scored in by_side.items():
        if role not in search.guesses and (best := best_of(scored, role)) is not None:
            search.guesses[role] = best
    missing = [role for role in by_side if role not in search.guesses]
    if len(missing) == 2 and len(unnamed) >= 2:
        _sides_by_gyro(search, unnamed)
    elif missing:
        bare = next((one for one in search.free if _is_bare_wheel(search, one)), None)
        if bare is not None:
            key = "column" if search.is_table else "signal"
            raise DiagnosisError(
                f"{bare.path} has the name of a wheel, and no unit: expected it in a map.toml, "
                f'below [{key}s], as in {missing[0]} = {{ {key} = "{bare.path}", unit = "km/h" }}'
            )
        odd = next((one for one in search.free if _is_odd_wheel(search, one, missing)), None)
        if odd is not None:
            raise DiagnosisError(
                f"{odd.path} has the name of a wheel, and its unit, {odd.unit}, is not understood: "
                f"expected {units_for(missing[0])}"
            )
        still = next((one for one in search.free if _is_still_wheel(one, missing)), None)
        if still is not None:
            raise DiagnosisError(
                f"{still.path} has the name of a wheel, and never changes ({still.low:g}): "
                "expected a log in which the robot drives"
            )
        seen = ", ".join(search.found) if len(search.found) < 30 else f"{len(search.found)} signals"
        raise DiagnosisError(
            f"no signal looks like {' or '.join(missing)}: expected a wheel's counts, angle, "
            f"distance or speed among {seen}; --is {missing[0]}=SIGNAL says which"
        )


def _prefer_rear(by_side: dict[Role, list[tuple[float, Guess]]]) -> None:
    """Raise the evidence of a whole rear axle beside other wheels: a car's front ones are steered,
    and run farther in a turn than wheels that stay behind each other."""
    rear = {
        role: [bool(_REAR_WORDS & set(words_of(guess.signal))) for _, guess in scored]
        for role, scored in by_side.items()
    }
    is_axle = all(any(flags) for flags in rear.values())
    if not is_axle or all(all(flags) for flags in rear.values()):
        return
    for role, scored in by_side.items():
        for place, (score, guess) in enumerate(scored):
            if rear[role][place]:
                reasons = (*guess.reasons, "the rear wheels, as the front ones may be steered")
                scored[place] = (score + 2 * SAME, replace(guess, reasons=reasons))


def _is_bare_wheel(search: Search, signal: FoundSignal) -> bool:
    """Tell a wheel by its name whose values are no counts and whose unit nobody says."""
    return (
        is_named(signal, _WHEEL_WORDS)
        and unit_of_signal(signal, search.is_table).strip().lower() in COUNT_UNITS
        and not signal.is_constant
        and not is_whole(signal)
    )


def _is_still_wheel(signal: FoundSignal, missing: list[Role]) -> bool:
    """Tell a wheel, by its name and side, that did not turn in this log."""
    sides = {word for role in missing for word in (*WORDS[role], *_REAR_AND_FRONT[role])}
    return (
        signal.is_constant
        and is_named(signal, _WHEEL_WORDS)
        and not is_named(signal, COMMAND_WORDS)
        and bool(sides & set(words_of(signal)))
    )


def _is_odd_wheel(search: Search, signal: FoundSignal, missing: list[Role]) -> bool:
    """Tell a wheel, by its name and side, whose unit nobody understands; steering has no side."""
    unit = unit_of_signal(signal, search.is_table).strip()
    if unit.lower() in COUNT_UNITS or unit_of(unit) is not None or signal.is_constant:
        return False
    sides = {word for role in missing for word in (*WORDS[role], *_REAR_AND_FRONT[role])}
    return is_named(signal, _WHEEL_WORDS) and bool(sides & set(words_of(signal)))


def _wheel_evidence(search: Search, signal: FoundSignal) -> tuple[float, Guess]:
    guess = Guess("left_count", signal)
    if signal.is_constant or is_named(signal, COMMAND_WORDS + REFERENCE_WORDS):
        return -9.0, guess
    score, said = unit_score(signal, "left_count", search.is_table)
    reasons = [] if said is None else [said]
    words = words_of(signal)
    sides = {word for role in _REAR_AND_FRONT for word in (*WORDS[role], *_REAR_AND_FRONT[role])}
    if any(hint in word for word in words for hint in _WHEEL_WORDS) or (
        _WAY_WORDS & set(words) and sides & set(words)
    ):
        score += 2.0
        reasons.append("name of a wheel")
    elif {"left", "right", *_REAR_AND_FRONT["left_count"], *_REAR_AND_FRONT["right_count"]} & set(
        words
    ):
        score += 1.0
    if signal.wraps:
        score += 1.0
        reasons.append(f"wraps at {signal.wrap:g}")
    if "pwm" in words or "current" in words or "cliff" in words:
        score -= 4.0
    unit = unit_of_signal(signal, True) if search.is_table else None
    wrap = signal.wrap if search.is_table and signal.wraps else None
    return score, Guess("left_count", signal, unit or None, wrap=wrap, reasons=tuple(reasons))


def _sides_by_gyro(search: Search, unnamed: list[tuple[float, Guess]]) -> None:
    """Tell two wheels without sides in their names apart by a gyro."""
    (_, one), (_, other) = sorted(unnamed, key=lambda entry: -entry[0])[:2]
    gyros = [s for s in search.free if is_named(s, WORDS["gyro"]) and not s.is_constant]
    for gyro in gyros:
        turn = difference(search, one.signal, other.signal)
        likeness = likeness_of(gyro, turn, is_rate=True)
        if abs(likeness) > CLEAR:
            left, right = (one, other) if likeness > 0 else (other, one)
            why = f"sides by {gyro.path} ({abs(likeness):.2f})"
            for role, guess in (("left_count", left), ("right_count", right)):
                search.guesses[role] = Guess(
                    role, guess.signal, guess.unit, wrap=guess.wrap, reasons=(*guess.reasons, why)
                )
            return
    raise DiagnosisError(
        f"left_count could be {one.signal.path} as well as {other.signal.path}: neither name says "
        f"left or right: expected --is left_count={one.signal.path} or "
        f"--is left_count={other.signal.path}"
    )
