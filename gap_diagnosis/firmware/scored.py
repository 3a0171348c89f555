"""Candidates with their probabilities, and what they say together of each parameter."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

import numpy as np

from gap_diagnosis.firmware.candidates import Candidate, Value
from gap_diagnosis.hypothesis import Estimate

_DRAWS: Final = 400
_ALIKE_NATS: Final = 2.0


@dataclass(frozen=True)
class Scored:
    """A candidate with its logarithms of prior (with that of its program) and likelihood.

    `log_changed` is the likelihood of its program with a further change that nobody listed.
    """

    candidate: Candidate
    log_prior: float
    log_likelihood: float
    log_changed: float = -math.inf

    @property
    def total(self) -> float:
        """The logarithm of prior times likelihood."""
        return self.log_prior + self.log_likelihood


def log_sum(terms: Iterable[float]) -> float:
    """Return the logarithm of the sum of exponentials."""
    known = list(terms)
    return float(np.logaddexp.reduce(np.array(known))) if known else -math.inf


def estimates_of(found: list[Scored]) -> dict[str, Estimate]:
    """Return what the candidates say of each parameter, weighted by their probabilities."""
    totals = np.array([one.total for one in found])
    weights = np.exp(totals - np.max(totals))
    weights /= np.sum(weights)
    # Of values that serve alike the first listed is shown.
    best = found[int(np.argmax(totals >= np.max(totals) - _ALIKE_NATS))].candidate
    rng = np.random.default_rng(np.random.Philox(key=len(found)))
    # Numbers speak of the most probable choice: a scale of another constant is another number.
    choices = {name: value for name, value in best.values.items() if isinstance(value, str)}
    alike = np.array(
        [all(one.candidate.values.get(n) == v for n, v in choices.items()) for one in found]
    )
    drawn = rng.choice(len(found), _DRAWS, p=weights * alike / np.sum(weights * alike))
    estimates: dict[str, Estimate] = {}
    for name, value in best.values.items():
        values: list[Value] = [one.candidate.values[name] for one in found]
        if isinstance(value, str):
            shares: dict[str, float] = {}
            for one, weight in zip(values, weights.tolist(), strict=True):
                shares[str(one)] = shares.get(str(one), 0.0) + weight
            estimates[name] = Estimate(value, probabilities=shares)
            continue
        numbers = np.array([float(one) for one in values])
        widths = np.array([one.candidate.widths.get(name, 0.0) for one in found])
        samples = numbers[drawn] + widths[drawn] * rng.uniform(-1.0, 1.0, _DRAWS)
        middle = value if isinstance(value, int) else float(np.mean(samples))
        estimates[name] = Estimate(middle, float(np.std(samples)), samples)
    return estimates
