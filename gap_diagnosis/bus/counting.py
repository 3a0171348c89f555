"""Evidence from counts: how often something happened, against how often it may."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_RATES = 160
_BURSTS = 24


@dataclass(frozen=True)
class Runs:
    """Losses of one message.

    Attributes:
        kept: frames that arrived.
        lengths: int64[r], how many were lost in a row, run by run.
    """

    kept: int
    lengths: NDArray[np.int64]

    @property
    def lost(self) -> int:
        """Frames lost in all."""
        return int(self.lengths.sum())


@dataclass(frozen=True)
class Rate:
    """A probability seen in counts.

    Attributes:
        log_evidence: of the counts, integrated over the range.
        log_best: at the best value within the range.
        value: float64[g], grid of the probability; `weight` its posterior.
        weight: float64[g].
        burst: float64[b] and its posterior weights, where losses come in runs.
    """

    log_evidence: float
    log_best: float
    value: Floats
    weight: Floats
    burst: Floats
    burst_weight: Floats

    def draw(self, random: np.random.Generator, count: int) -> Floats:
        """Return draws of the probability."""
        return _draw(self.value, self.weight, random, count)

    def draw_burst(self, random: np.random.Generator, count: int) -> Floats:
        """Return draws of the mean run."""
        return _draw(self.burst, self.burst_weight, random, count)


def rate_of(events: int, chances: int, span: tuple[float, float]) -> Rate:
    """Return what *events* out of *chances* say of a probability, log-uniform over *span*."""
    value = np.geomspace(*span, _refined(_RATES, chances))
    logs = events * np.log(value) + (chances - events) * np.log1p(-value)
    weight, log_evidence = _normalised(logs - math.log(len(value)))
    one = np.ones(1)
    return Rate(log_evidence, float(logs.max()), value, weight, one, one)


def loss_of(messages: list[Runs], span: tuple[float, float], bursts: tuple[float, float]) -> Rate:
    """Return what the losses of messages with a common rate say (Gilbert's two states).

    Half the prior is on independent losses, half log-uniform over the mean run.
    """
    value = np.geomspace(*span, _RATES)
    burst = np.geomspace(*bursts, _BURSTS)
    logs = np.zeros((_RATES, _BURSTS))
    kept = sum(one.kept for one in messages)
    runs = sum(len(one.lengths) for one in messages)
    lost = sum(one.lost for one in messages)
    p, b = value[:, np.newaxis], burst[np.newaxis]
    begins = np.minimum(p / (b * (1 - p)), 0.999)
    logs = runs * np.log(begins) + np.maximum(kept - runs, 0) * np.log1p(-begins)
    logs = logs + (lost - runs) * np.log(np.maximum(1 - 1 / b, 1e-300)) - runs * np.log(b)
    # Independent losses: a run of one is no more likely than chance has it.
    alone = lost * np.log(value) + kept * np.log1p(-value)
    logs[:, 0] = alone
    prior = np.full(_BURSTS, 0.5 / (_BURSTS - 1))
    prior[0] = 0.5
    joint = logs + np.log(prior) - math.log(_RATES)
    log_evidence = log_sum(joint)
    posterior = np.exp(joint - log_evidence)
    return Rate(
        log_evidence,
        float(logs.max()),
        value,
        posterior.sum(axis=1),
        burst,
        posterior.sum(axis=0),
    )


def log_sum(logarithms: Floats) -> float:
    """Return the logarithm of a sum given by logarithms."""
    top = float(logarithms.max())
    return top + math.log(float(np.exp(logarithms - top).sum()))


def _refined(least: int, chances: int) -> int:
    return least + int(40 * math.log10(max(chances, 10)))


def _normalised(logs: Floats) -> tuple[Floats, float]:
    total = log_sum(logs)
    return np.exp(logs - total), total


def _draw(value: Floats, weight: Floats, random: np.random.Generator, count: int) -> Floats:
    if len(value) == 1:
        return np.full(count, value[0])
    at = random.choice(len(value), size=count, p=weight / weight.sum())
    step = math.log(value[1] / value[0])
    smear = np.exp(random.uniform(-0.5, 0.5, count) * step)
    return np.asarray(np.clip(value[at] * smear, value[0], value[-1]), dtype=np.float64)
