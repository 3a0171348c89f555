"""Wheels that stand far apart: what errors of counting turn a robot by, and what that is worth.

They make all that wheels tremble turn it by less. That is no news of a robot that hardly turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from gap_diagnosis.motion.blocks import Course
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.details import turns_less
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.recording import Floats

if TYPE_CHECKING:
    from gap_diagnosis.motion.model import MotionModel

Sizes = Sequence[tuple[float, ...]]

BORNE_OUT: Final = 29.0
"""Turns that are likelier by so much [nat] tell of wheels that stand far apart."""


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
                return self._as_turns_tell(terms, coefficients, levels, course, wider)
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
    ) -> Course:
        """Return the wider course, along which effects are no likelier than along *course* unless
        turns bear out wheels that stand far apart.

        What wheels tremble beyond what is described turns a robot by less then, too: a car's, on a
        straight road, stood 27 % farther apart by 240 nats. Once a step of a fit bears wheels out
        they are in every later one: what is compared must be so by one rule.
        """
        effects = frozenset(term.variant.effect for term in terms)
        if effects in self._borne_out:
            return wider
        as_described = [
            (0.0,) * len(sizes) if turns_less(term.variant, sizes) else sizes
            for term, sizes in zip(terms, coefficients, strict=True)
        ]
        likelihood = self._model.likelihood
        turned, straight = (
            likelihood(terms, sizes, levels, course, is_sharp=True)
            for sizes in (coefficients, as_described)
        )
        if turned - straight > BORNE_OUT:
            self._borne_out.add(effects)
            return wider
        more = max(likelihood(terms, coefficients, levels, wider) - turned, 0.0)
        rows = np.count_nonzero(np.isfinite(self._model.columns.values[..., 0]))
        return replace(wider, log_more=wider.log_more + 2.0 * more / rows)
