"""Counts that stand still while their wheel turns: where, since when, and what it did meanwhile."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations import encoder
from gap_diagnosis.explanations.choices import of_side, runs
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats

DEAD: Final = "encoder_dead"
_DEAD_S: Final = 1.0
"""A count that stands for less has been at rest, or crept."""
_DEAD_TICKS: Final = 50
"""The other wheel must have turned by more counts meanwhile,"""
_DEAD_SHARE: Final = 0.2
"""and the gyro say that this one did by such a share of that,"""
_LOOSE_SHARE: Final = 0.03
"""or by such a share where a plug is known to be loose,"""
_SURELY_SD: Final = 4.0
"""and by so many standard deviations of the gyro's angle before it is sure to have died."""
_REVIVED: Final = 0.1
"""One dead encoder in ten counts again."""
_USUAL_ROWS: Final = 5
_ROUNDED: Final = 1.5
"""Counts that a row may have more or less than its wheel turned: a half at each end, and noise."""
_GUESSED_RAD: Final = 1.0
"""Standard deviation of a wheel's turn in a tick of which nothing is known."""


@dataclass(frozen=True)
class Standstill:
    """A stretch in which counts stand while their wheel turns.

    Attributes:
        side: whose counts.
        first, last: its rows.
        missed_rad: how far the wheel turned meanwhile, as the gyro tells it.
        by: the row by which the encoder had surely died.
    """

    side: str
    first: int
    last: int
    missed_rad: float
    by: int

    def is_to_the_end(self, motion: Motion) -> bool:
        """Tell whether it never counts again."""
        return self.last == len(motion.t_s) - 1

    def log_share(self, motion: Motion) -> float:
        """Return the log of the share of all stretches that look like this one.

        It may have died at any time of the log, and looks alike wherever it stands anyway; it may
        have come back at any time, too, and seldom does.
        """
        share = math.log((self.last - self.first + 1) / len(motion.t_s))
        return share if self.is_to_the_end(motion) else 2.0 * share + math.log(_REVIVED)

    def variant(self, motion: Motion) -> Variant:
        """Return the encoder that is dead in this stretch."""
        acts = {"left": encoder.encoder_dead_left, "right": encoder.encoder_dead_right}
        window = {
            "start_s": float(motion.t_s[max(self.first - 1, 0)]) - 1e-6,
            # It may have come back within the row in which it counts again.
            "stop_s": float(motion.t_s[min(self.last + 1, len(motion.t_s) - 1)]) + 1e-6,
        }
        return Variant(
            DEAD,
            acts[self.side],
            (),
            window,
            {"side": self.side, "start_s": window["start_s"]},
            {"start_s": _died_s(motion, self.side, self.first, self.by)},
            is_held=True,
            log_share=self.log_share(motion),
            unsure=_unsure_of_dead(self.side, self.first, self.last),
        )


def standstills(motion: Motion, *, is_loose: bool = False) -> list[Standstill]:
    """Return the stretches in which an encoder may count nothing.

    Only while the other side's counts, and where the gyro says that its wheel turned meanwhile, by
    a fifth of what the other one did: a robot that turns about a wheel was not dead, unless its
    plug *is_loose*, for then less will do; and by more than a signal hides that says 0 below its
    least speed. Where only the counts tell, one that stands to the log's end will do.
    """
    steps = {"left": motion.left_step_rad, "right": motion.right_step_rad}
    tick_s = motion.tick_s
    least = max(3, round(_DEAD_S / tick_s))
    noise_rad_s = motion.gyro_noise_lsb / motion.gyro_sensitivity_lsb_per_rad_s
    noise_rad = noise_rad_s * tick_s * motion.wheelbase_m / motion.radius_m
    turned_rad = encoder.turn_by_gyro_rad(motion)
    share = _LOOSE_SHARE if is_loose else _DEAD_SHARE
    found = []
    for side, step in steps.items():
        other, sign = (steps["right"], -1.0) if side == "left" else (steps["left"], 1.0)
        for first, last in runs(step == 0, least):
            inside = slice(first, last + 1)
            rolled_rad = np.abs(other[inside]).sum()
            unseen_rad = np.cumsum(other[inside] + sign * turned_rad[inside])
            missed_rad = float(np.ptp(unseen_rad))
            hidden_rad = _least_told_rad(step, motion) * (last + 1 - first)
            told = missed_rad > max(share * rolled_rad, hidden_rad)
            if motion.gyro_turn_rad is None:
                told = last == len(step) - 1
            if rolled_rad > _DEAD_TICKS * motion.rad_per_count and told:
                # Two counts are rounded off, and the gyro's angle is a random walk.
                walk_rad = noise_rad * np.sqrt(np.arange(1, len(unseen_rad) + 1))
                least_rad = 2.0 * motion.rad_per_count + _SURELY_SD * walk_rad
                if motion.gyro_turn_rad is None:
                    least_rad = np.full(len(walk_rad), _DEAD_TICKS * motion.rad_per_count)
                gone = np.abs(unseen_rad) > least_rad
                if not gone.any():
                    continue
                by = first + int(np.argmax(gone))
                found.append(Standstill(side, first, last, missed_rad, by))
    return found


def _least_told_rad(step: Floats, motion: Motion) -> float:
    """Return the turn in a row below which a wheel's speed may be told as 0; a count misses none.

    Of a row between two speeds one may be 0, not beside a row that turned as well.
    """
    turns = step != 0.0
    told = np.abs(step[1:-1][turns[1:-1] & turns[:-2] & turns[2:]])
    return float(told.min()) if motion.has_speeds and len(told) else 0.0


def dead_ticks(motion: Motion) -> NDArray[np.bool_]:
    """Return, bool[n], the ticks in which only one wheel counts for long."""
    dead = np.zeros(len(motion.t_s), dtype=np.bool_)
    for one in standstills(motion):
        dead[one.first : one.last + 1] = True
    return dead


def told_until_s(motion: Motion) -> float:
    """Return until when wheels or gyro tell turns, log time: without a gyro, one wheel alone does
    not."""
    dead = dead_ticks(motion)
    is_told = motion.gyro_turn_rad is not None or not dead.any()
    return float(motion.t_s[-1 if is_told else np.argmax(dead)])


def _died_s(motion: Motion, side: str, first: int, by: int) -> tuple[float, float]:
    """Return from when to when an encoder may have died that counts nothing from row *first* on.

    The row before tells by what it lacks of the usual: counts are rounded, at both of its ends. If
    it lacks nothing and the wheel stood just then, it may be at any time until that went on.
    """
    step = motion.left_step_rad if side == "left" else motion.right_step_rad
    latest_s = float(motion.t_s[by])
    usual, unsure = 0.0, _ROUNDED
    if first > _USUAL_ROWS:
        around = np.abs(step[first - 1 - _USUAL_ROWS : first - 1]) / motion.rad_per_count
        usual = float(np.median(around))
        # A wheel that speeds up or slows down goes on to.
        unsure += abs(float(around[-2:].mean() - around[:2].mean()))
    if usual < _ROUNDED:
        return float(motion.t_s[max(first - 2, 0)]), latest_s
    lacks = usual - abs(float(step[first - 1])) / motion.rad_per_count
    row_s, ended_s = float(motion.dt_s[first - 1]), float(motion.t_s[first - 1])
    most = min(max((lacks + unsure) / usual, 0.0), 1.0)
    if lacks > unsure:
        return ended_s - row_s * most, ended_s - row_s * (lacks - unsure) / usual
    # That it died so long before the row's end is ever less likely: even over half of it.
    return ended_s - row_s * 0.5 * most, latest_s


def encoder_dead(motion: Motion) -> Iterable[Variant]:
    """Return the sides that stand while the robot moves, from where they do.

    Each to the log's end if it does, else the one stretch in which it misses most.
    """
    ranked = sorted(
        standstills(motion), key=lambda one: (one.is_to_the_end(motion), one.missed_rad)
    )
    for worst in {one.side: one for one in ranked}.values():
        yield worst.variant(motion)


def _unsure_of_dead(side: str, first: int, last: int) -> Callable[[Motion], tuple[Floats, Floats]]:
    """What a dead encoder's wheel did is taken from the gyro and the other wheel: it says nothing
    of either."""

    def unsure(motion: Motion) -> tuple[Floats, Floats]:
        variance = np.zeros(len(motion.t_s))
        variance[first : last + 1] = (_GUESSED_RAD / motion.rad_per_count) ** 2
        return of_side(side, variance)

    return unsure
