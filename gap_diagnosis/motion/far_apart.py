"""Wheels that stand far apart: what errors of counting turn a robot by, and what that is worth.

They make all that wheels tremble turn it by less. That is no news of a robot that hardly turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.stats import linregress

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.details import turns_less
from gap_diagnosis.motion.offset import turns_of
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats

if TYPE_CHECKING:
    from gap_diagnosis.motion.model import MotionModel

Sizes = Sequence[tuple[float, ...]]

BORNE_OUT: Final = 29.0
"""Turns that are likelier by so much [nat] tell of wheels that stand far apart."""
_SEEN: Final = 4.5
"""So much likelier [nat], three standard deviations, must wheels far apart be by what wheels turn
where the gyro turns."""
_TURN_S: Final = 2.0
"""Turns are compared over so long: a gyro that is late by tenths of a second is none that reads
less."""
_FEW: Final = 5
"""A line through fewer turns tells nothing."""
_SUREST: Final = 1e-6


class FarApart:
    """What one log's wheels do if they stand far apart."""

    def __init__(self, model: MotionModel) -> None:
        """Begin without any that are borne out."""
        self._model = model
        self._borne_out: set[frozenset[str]] = set()

    def course(
        self, terms: Sequence[Term], coefficients: Sizes, levels: Floats, course: Course
    ) -> Course:
        """Return the course of these effects, to be compared with others at these levels: as it is,
        unless they are wheels that stand far apart."""
        for term, sizes in zip(terms, coefficients, strict=True):
            if turns_less(term.variant, sizes):
                wider = self._wider(course, sizes[0], levels)
                is_seen = self._gained_by_wheels(terms, coefficients, sizes[0]) > _SEEN
                return self._as_turns_tell(
                    terms, coefficients, levels, course, wider, is_seen=is_seen
                )
        return course

    def _wider(self, course: Course, scale: float, levels: Floats) -> Course:
        """Return the course of wheels that stand farther apart, with a likelihood to be compared
        with that of others, whatever turn a count stands for.

        At louder levels than the log's own, what counts round off seems to matter less, and wheels
        far apart would be likelier for nothing.
        """
        wider, ticks = course.wider(scale), self._model.nodes.ticks
        data = np.ascontiguousarray(self._model.columns.values[..., :1])
        variances = [whiten(data, one, levels, ticks)[1] for one in (course, wider)]
        before, after = (float(one.mean()) for one in variances)
        return replace(wider, log_more=course.log_more + before - after)

    def _as_turns_tell(
        self,
        terms: Sequence[Term],
        coefficients: Sizes,
        levels: Floats,
        course: Course,
        wider: Course,
        *,
        is_seen: bool,
    ) -> Course:
        """Return the wider course, along which effects are no likelier than along *course* unless
        turns bear out wheels that stand far apart, and no likelier than wheels as described where
        these do not turn by more wherever the gyro turns (*is_seen*).

        What wheels tremble beyond what is described turns a robot by less then, too: a car's, on a
        straight road, stood 27 % farther apart by 240 nats. Once a step of a fit bears wheels out
        they are in every later one: what is compared must be so by one rule.
        """
        effects = frozenset(term.variant.effect for term in terms)
        if effects in self._borne_out:
            return wider
        as_described = _as_described(terms, coefficients)
        likelihood = self._model.likelihood
        turned, straight = (
            likelihood(terms, sizes, levels, course, is_sharp=True)
            for sizes in (coefficients, as_described)
        )
        if is_seen and turned - straight > BORNE_OUT:
            self._borne_out.add(effects)
            return wider
        most = turned if is_seen else min(turned, straight)
        more = max(likelihood(terms, coefficients, levels, wider) - most, 0.0)
        rows = np.count_nonzero(np.isfinite(self._model.columns.values[..., 0]))
        return replace(wider, log_more=wider.log_more + 2.0 * more / rows)

    def _gained_by_wheels(self, terms: Sequence[Term], coefficients: Sizes, scale: float) -> float:
        """Return how much likelier wheels that stand by *scale* farther apart than described make
        what wheels turn, given the gyro [nat].

        What a gyro reads, given wheels that tremble, is too little by itself, and so is what wheels
        turn, given a gyro in coarse steps: noise of what is given flattens a line (Fuller 1987,
        Measurement Error Models, section 1.1). Wheels that stand far apart do so on both lines.
        """
        if self._wheels_on_gyro is None:
            return math.inf
        slope, deviation = self._wheels_on_gyro
        described = self._foreseen(terms, _as_described(terms, coefficients))
        apart = described * (1.0 + scale)
        return 0.5 * ((described - slope) ** 2 - (apart - slope) ** 2) / deviation**2

    def _foreseen(self, terms: Sequence[Term], coefficients: Sizes) -> float:
        """Return by how much wheels that stand as described turn for what the gyro reads with these
        effects."""
        motion = self._model.nodes.smooth
        settings = [(t.variant, sizes) for t, sizes in zip(terms, coefficients, strict=True)]
        wheels, gyro = (
            np.cumsum(predict(motion, some).gyro_rad_s * motion.dt_s) for some in ((), settings)
        )
        line = _line(wheels, gyro, motion.tick_s)
        return 1.0 if line is None else line[0]

    @cached_property
    def _wheels_on_gyro(self) -> tuple[float, float] | None:
        """Return by how much wheels turn for what the gyro reads, or without one a reference with
        headings, and how sure that is; by their counts alone: the motion's headings are bent onto
        the reference."""
        nodes, motion = self._model.nodes, self._model.nodes.motion
        wheels, *gyro = turns_of(motion)
        if not gyro and nodes.has_heading:
            gyro = [motion.heading_rad]
        return _line(wheels, gyro[0], motion.tick_s) if gyro else None


def _as_described(terms: Sequence[Term], coefficients: Sizes) -> list[tuple[float, ...]]:
    """Return the sizes of these effects beside wheels that stand as described."""
    return [
        (0.0,) * len(sizes) if turns_less(term.variant, sizes) else sizes
        for term, sizes in zip(terms, coefficients, strict=True)
    ]


def _line(wheels: Floats, gyro: Floats, tick_s: float) -> tuple[float, float] | None:
    """Return the slope of turns by the wheels on those by the gyro [rad], float64[n] each from the
    start, and its standard deviation; None where there are few, or the gyro stands still."""
    every = max(round(_TURN_S / tick_s), 1)
    turned, read = (np.diff(one[::every]) for one in (wheels, gyro))
    if len(read) < _FEW or np.ptp(read) == 0.0:
        return None
    line = linregress(read, turned)
    return float(line.slope), max(float(line.stderr), _SUREST)
