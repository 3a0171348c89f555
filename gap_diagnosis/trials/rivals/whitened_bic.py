"""Rival 2: the diagnosis's own whitened likelihood with plain BIC and softmax.

What is left out, so that it can be seen what it adds: the integral over a prior of sizes, the prior
over effects, unlisted causes, non-linear refits. Schwarz, *Estimating the dimension of a model*
(Annals of Statistics 6, 1978). A fit within its tolerance counts as no gap.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, Final

import numpy as np

from gap_diagnosis.bus import bus_block
from gap_diagnosis.codes import codes_block
from gap_diagnosis.drive import drive_block
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.firmware import firmware_block
from gap_diagnosis.hypothesis import Block
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.evidence import Gram, Scored, score
from gap_diagnosis.motion.gross import looks_gross
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats
from gap_diagnosis.trials.rivals.door import Effects, Job, answer, job_of, named, softmax

_LEVELS_TRIED: Final = 3
_PAIRED: Final = 6


def diagnose(log: Path, robot: Path, reference: Path, without: Sequence[str]) -> dict[str, Any]:
    """Return OUT.json; probabilities are exp(−BIC/2), normalised, of single effects and pairs."""
    job = job_of(log, robot, reference, without)
    likelihoods = _Likelihoods(job)
    ranked = likelihoods.ranked()
    best = likelihoods.moving(ranked[0][0])
    if best is None:
        return answer(job, ranked)
    parameters = {}
    for term, values, sds in _split(best):
        pairs = zip(values, sds, strict=True)
        estimates = dict(zip(term.variant.coefficients, pairs, strict=True))
        if term.variant.polar is None:
            parameters.update(named(term.variant.effect, estimates))
    return answer(job, ranked, likelihoods.settings(best), parameters)


class _Likelihoods:
    """The best log likelihood of each set of effects, with the number of what was fitted."""

    def __init__(self, job: Job) -> None:
        self._job = job
        recording, robot = job.recording, job.robot
        gross = looks_gross(recording, robot)
        prior = default_prior()
        self._model = MotionModel(recording, robot, prior, gross=gross, without=job.without)
        self._count = int(np.isfinite(self._model.columns.values[..., 0]).sum())
        self._blocks: list[Block] = [
            block
            for block in (
                bus_block(recording, job.robot, job.wire) if recording.frames else None,
                drive_block(recording, robot, frozenset()),
                codes_block(recording, robot),
                firmware_block(recording, robot, job.wire),
            )
            if block is not None
        ]
        self._best: dict[Effects, tuple[float, Scored]] = {}
        self._nothing = -math.inf
        levels = self._model.no_effect_levels
        for _ in range(_LEVELS_TRIED):
            self._try(self._model.gram(levels))
            leader = max(self._best.values(), key=lambda one: one[0])[1]
            levels = self._model.levels_for(leader.terms, levels)

    def _try(self, gram: Gram) -> None:
        """Score every variant of every effect, and the best in pairs, at these levels."""
        self._nothing = max(self._nothing, gram.log_nothing)
        for term in self._model.columns.terms:
            self._offer(gram, [term])
        singles = sorted(
            (one for one in self._best.items() if len(one[0]) == 1), key=lambda one: -one[1][0]
        )[:_PAIRED]
        for (_, (_, first)), (_, (_, second)) in combinations(singles, 2):
            self._offer(gram, [*first.terms, *second.terms])

    def _offer(self, gram: Gram, terms: Sequence[Term]) -> None:
        scored = score(gram, terms, self._model.prior)
        effects = tuple(sorted(term.variant.effect for term in terms))
        value = gram.log_nothing + scored.log_likelihood
        if effects not in self._best or value > self._best[effects][0]:
            self._best[effects] = value, scored

    def ranked(self) -> list[tuple[Effects, float]]:
        """Return the answers with their probabilities; what lies within tolerance is no gap."""
        owned = {e for block in self._blocks for e in block.effects if not e.startswith("setup_")}
        owned -= self._job.without
        sets: set[Effects] = {(), *self._best, *((effect,) for effect in owned)}
        ranked = softmax({effects: self._schwarz(effects) for effects in sets})
        news = {effects for effects, _ in ranked if effects and self._is_news(effects)}
        nothing = math.fsum(p for effects, p in ranked if effects not in news)
        answers: list[tuple[Effects, float]] = [((), nothing)]
        answers += [one for one in ranked if one[0] in news]
        return sorted(answers, key=lambda one: -one[1])

    def _schwarz(self, effects: Effects) -> float:
        """Return log likelihood less half of log n for each parameter."""
        total, free = 0.0, 0
        if effects in self._best:
            value, scored = self._best[effects]
            total += value - self._nothing
            free += sum(len(t.variant.coefficients) + len(t.variant.report) for t in scored.terms)
        for block in self._blocks:
            own = frozenset(one for one in effects if not one.startswith("setup_")) & block.effects
            if own:
                fit = block.fit(own)
                total += fit.log_likelihood
                free += 0 if effects in self._best else max(len(fit.parameters), 1)
        return total - 0.5 * free * math.log(self._count)

    def _is_news(self, effects: Effects) -> bool:
        best = self.moving(effects)
        if best is None:
            return True
        return all(
            not values or any(abs(v) > t for v, t in zip(values, term.tolerances, strict=True))
            for term, values, _ in _split(best)
        )

    def moving(self, effects: Effects) -> Scored | None:
        """Return the fit of effects that the motion shows; None where it shows none of them."""
        return self._best[effects][1] if effects in self._best else None

    def settings(self, best: Scored) -> list[Setting]:
        """Return the winner's values, fitted on what is not held out."""
        if self._job.sides.why_not is not None:
            return []
        apart = MotionModel(
            self._job.recording, self._job.robot, self._model.prior, keep=self._job.sides.fit
        )
        terms = [apart.add(term.variant, term) for term in best.terms]
        again = score(apart.gram(self._model.no_effect_levels), terms, apart.prior)
        return [(term.variant, values) for term, values, _ in _split(again)]


def _split(scored: Scored) -> Iterator[tuple[Term, tuple[float, ...], tuple[float, ...]]]:
    """Yield each term with its coefficients and their standard deviations."""
    top = int(np.argmax(scored.weights))
    means: Floats = scored.means[top]
    sds: Floats = np.sqrt(np.maximum(np.diag(scored.covariances[top]), 0.0))
    place = 0
    for term in scored.terms:
        width = 0 if term.is_fixed else len(term.weights)
        own = slice(place, place + width)
        yield term, tuple(means[own].tolist()), tuple(sds[own].tolist())
        place += width
