"""Blocks whose fits are written down: what ranking and answers are tested with."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.hypothesis import Estimate, Fit
from gap_diagnosis.priors import Prior
from gap_diagnosis.ranking import Ranking, rank
from gap_diagnosis.recording import Recording

PRIOR = Prior(
    effects=(0.4, 0.4, 0.15, 0.045, 0.005), unknown=0.02, misdescribed=0.04, parameters={}
)
STAGE = {
    "drive_gain": "actuation",
    "drive_lag": "actuation",
    "radius_scale": "wheel",
    "radius_mismatch": "wheel",
    "lateral_slip": "wheel",
    "wheelbase_scale": "wheel",
    "encoder_dead": "encoder",
    "encoder_wrap": "encoder",
    "missed_ticks": "encoder",
    "ticks_per_rev": "encoder",
    "gyro_bias": "gyro",
    "gyro_scale": "gyro",
    "adc_missing_code": "gyro",
    "setup_swapped": "setup",
    "blend_weight": "firmware",
    "coarse_trig_table": "firmware",
    "frame_loss": "bus",
    "frame_reordering": "bus",
}


@dataclass(frozen=True)
class FakeBlock:
    """A block in which each effect gains so many nats alone, and pairs the sum unless said.

    `likelihood` is the best fit's gain; where nothing is said, 3 nats above the evidence.
    `silent` is what values without a trace have of an effect's gain, `counting` how large an effect
    is that another block tells as well.
    """

    gains: Mapping[str, float]
    pairs: Mapping[frozenset[str], float] = field(default_factory=dict)
    name: str = "motion"
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    likelihood: Mapping[str, float] = field(default_factory=dict)
    silent: Mapping[str, float] = field(default_factory=dict)
    counting: Mapping[str, float] = field(default_factory=dict)

    @property
    def effects(self) -> frozenset[str]:
        return frozenset(self.gains)

    def fit(self, effects: frozenset[str]) -> Fit:
        assert effects <= self.effects, "a block is asked of its own effects only"
        evidence = self.pairs.get(effects, math.fsum(self.gains[one] for one in effects))
        told = [self.likelihood.get(one, self.gains[one] + 3.0) for one in effects]
        likelihood = evidence + 3.0 if effects in self.pairs else math.fsum(told)
        own = {key: value for key, value in self.parameters.items() if key.split(".")[0] in effects}
        silent = self.silent.get(min(effects), -math.inf) if len(effects) == 1 else -math.inf
        sizes = {key: value for key, value in self.counting.items() if key in effects}
        return Fit(
            tuple(sorted(effects)), evidence, likelihood, own, log_silent=silent, counting=sizes
        )


def ranked(
    *blocks: FakeBlock, unknown: Mapping[str, float] | None = None, logs: int = 1
) -> Ranking:
    """Return the ranking of so many logs that say the same."""
    return rank([blocks] * logs, PRIOR, STAGE, unknown or {})


def analysis(recording: Recording, *blocks: FakeBlock) -> Analysis:
    """Return the analysis of a log of which these blocks speak."""
    return Analysis(recording, None, tuple(blocks), (), {})


def odds(ranking: Ranking, first: Sequence[str], second: Sequence[str]) -> float:
    """Return how many times likelier the first set is than the second."""
    return ranking.of(frozenset(first)).probability / ranking.of(frozenset(second)).probability
