"""The words in which causes are compared: fits of a set of effects, and estimates of parameters.

The likelihood of a log falls into independent parts, one `Block` each: *motion* (wheels, gyro,
reference), *drive* (commands to wheels), *bus* (stamps and counters), *codes* (the converter's
histogram), *firmware* (odometry frames against replay). A set of effects is fitted in each block by
those of its effects that the block owns; its log evidence is the sum over blocks.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

EVERYTHING: Final = (-math.inf, math.inf)
REPLAYED_TOGETHER: Final = 2
"""So many effects of the firmware a replay tells of at most."""
NEVER: Final = 1e6
"""More than any evidence [nat]: what speaks against sizes that no effect has."""
FORM: Final = "speed"
"""A choice of the form of an effect, at which speed its size holds: in another form it is another
size."""


@dataclass(frozen=True)
class Estimate:
    """What a fit says of one parameter.

    Attributes:
        value: posterior mean (for a choice: the most probable one).
        sd: posterior standard deviation; 0 for a choice.
        samples: float64[s] draws from the posterior, for intervals; None for a choice.
        probabilities: for a choice, the probability of each.
        news: the least and the largest value that does more in this log than is no news.
        is_either: the draws take turns between two ways to read a log, which no log tells apart and
            all have alike.
    """

    value: float | int | str
    sd: float = 0.0
    samples: NDArray[np.float64] | None = None
    probabilities: Mapping[str, float] | None = None
    news: tuple[float, float] = EVERYTHING
    is_either: bool = False


@dataclass(frozen=True)
class Fit:
    """A set of effects fitted to one block.

    Attributes:
        effects: their names, sorted.
        log_evidence: natural logarithm of the marginal likelihood, less that of no effect.
        log_likelihood: at the best parameters, less that of no effect; 2x this is the separation.
        parameters: by ``effect.parameter``.
        windows: [start_s, stop_s] of effects that act in part of the log.
        pareto_k: of the importance sampling; None where the integral is exact or by quadrature.
        log_silent: of a single effect, what values that leave no trace in this log have of
            `log_evidence`; -inf where every value would show.
        counting: of effects that another block tells as well, about how large they are here.
    """

    effects: tuple[str, ...]
    log_evidence: float
    log_likelihood: float
    parameters: Mapping[str, Estimate] = field(default_factory=dict)
    windows: tuple[tuple[float, float], ...] = ()
    pareto_k: float | None = None
    log_silent: float = -math.inf
    counting: Mapping[str, float] = field(default_factory=dict)


def generator_of(effects: Iterable[str]) -> np.random.Generator:
    """Return the randomness of what is told of a set of effects: the same in whatever order and
    however often they are asked for, so that a log has one diagnosis."""
    return np.random.default_rng(zlib.crc32("+".join(sorted(effects)).encode()))


class Block(Protocol):
    """One independent part of the log's likelihood."""

    @property
    def name(self) -> str:
        """motion, drive, bus, codes or firmware."""

    @property
    def effects(self) -> frozenset[str]:
        """The effects this block can tell on this log; it is blind to all others."""

    def fit(self, effects: frozenset[str]) -> Fit:
        """Fit these effects (all owned by this block); the empty set is no effect."""


class Remembering:
    """A block whose search has ended, so that each set is asked of it once (a `Block`)."""

    def __init__(self, block: Block) -> None:
        """Take a block."""
        self._block = block
        self.name, self.effects = block.name, block.effects
        self._fits: dict[frozenset[str], Fit] = {}

    def fit(self, effects: frozenset[str]) -> Fit:
        """Return what the block says of these effects."""
        if effects not in self._fits:
            self._fits[effects] = self._block.fit(effects)
        return self._fits[effects]
