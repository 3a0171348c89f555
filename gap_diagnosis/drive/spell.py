"""When a drive does otherwise than described: from which block on, and up to which."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import combinations, pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive import prior
from gap_diagnosis.drive.data import DriveData, Spell
from gap_diagnosis.drive.likelihood import Setting
from gap_diagnosis.drive.noise import Levels, marginal, whitened
from gap_diagnosis.drive.shapes import Shapes, masked
from gap_diagnosis.drive.unlisted import Null
from gap_diagnosis.hypothesis import Estimate
from hil_harness.robot import Robot

Floats = NDArray[np.float64]

_PARTS: Final = 12
"""A spell is sought whose ends lie on this many equal parts of the log,"""
_CLEARLY: Final = 20.0
"""and taken up where it explains more than acting all along by so much beyond its prior [nat]."""
_PLACES: Final = 4 * _PARTS
"""Of an end so many places are looked at, all over the log,"""
_AS_LIKELY: Final = 10.0
"""and, about those that are less likely than the best by no more [nat],"""
_CLOSE: Final = 150
"""so many once more."""
_NOTHING: Final = 1e-300
_DRAWS: Final = 2000


@dataclass(frozen=True)
class End:
    """Where a spell begins or ends: blocks, and how likely each is."""

    blocks: NDArray[np.int64]
    weights: Floats

    def estimate(self, data: DriveData) -> Estimate:
        """Return it as a time of the log [s]."""
        random = np.random.default_rng(0)
        blocks = random.choice(self.blocks, size=_DRAWS, p=self.weights)
        apart = float(self.blocks[1] - self.blocks[0]) if len(self.blocks) > 1 else 1.0
        blocks = blocks + apart * random.uniform(-0.5, 0.5, _DRAWS)
        samples = data.time_s[0] + data.block_s * blocks
        return Estimate(float(samples.mean()), float(samples.std()), samples)


@dataclass(frozen=True)
class Ends:
    """Where a spell begins and ends.

    Attributes:
        spell: the likeliest blocks.
        log_width: log of how many other ends are as likely, for both.
        told: of `start_s` and `stop_s`, those that are not the log's own.
    """

    spell: Spell
    log_width: float
    told: Mapping[str, End]


def sought(null: Null, robot: Robot) -> Spell | None:
    """Return the spell in which answers of another drive explain clearly more than all along; None
    where they do in none."""
    data = null.data
    lags, late, gains, bent, _ = Shapes(data, robot).foreign()
    edges = np.linspace(0, data.angle.shape[1], _PARTS + 1).astype(int)
    parts = [(int(a), int(b)) for a, b in pairwise(edges)]
    residual = null.setting.columns({})[:1]
    gained: dict[tuple[int, int], float] = {}
    for columns in (lags, late, bent):
        # Beside a gain of each wheel all along, which would make up for a part in the others.
        stacked = [residual, gains, *(masked(columns, part) for part in parts)]
        white, _ = whitened(data, np.concatenate(stacked), Levels.of(null.levels, data.tick_rad))
        always, by_part = white[1 : 1 + len(gains)], white[1 + len(gains) :]
        by_part = by_part.reshape(_PARTS, len(columns), -1)
        until = np.concatenate((np.zeros((1, *by_part.shape[1:])), np.cumsum(by_part, axis=0)))
        for first, last in combinations(range(_PARTS + 1), 2):
            one = np.concatenate((always, until[last] - until[first]))
            pull = one @ white[0]
            gain = 0.5 * float(pull @ np.linalg.lstsq(one @ one.T, pull)[0])
            gained[first, last] = max(gained.get((first, last), 0.0), gain)
    best = max(gained, key=lambda one: gained[one])
    if gained[best] < gained[0, _PARTS] - prior.log_of_spell(data.angle.shape[1]) + _CLEARLY:
        return None
    return int(edges[best[0]]), int(edges[best[1]])


def ends(
    setting: Setting, values: Mapping[str, float], logs: Floats, robot: Robot, spell: Spell
) -> Ends:
    """Return where effects of these values begin and end; *spell*: about where they do.

    What may as well go on to the log's own end has no other.
    """
    blocks = setting.variant.data.angle.shape[1]
    own = (0, blocks)
    everywhere = np.linspace(0, blocks, _PLACES + 1).astype(np.int64)
    step = int(np.diff(everywhere).max())
    likely: dict[int, NDArray[np.int64]] = {}
    told: dict[str, End] = {}
    log_width = 0.0

    def moved(place: int, at: NDArray[np.int64]) -> Iterator[tuple[Setting, Floats]]:
        for block in at.tolist():
            one = (block, spell[1]) if place == 0 else (spell[0], block)
            yield _acting(setting, values, robot, one)

    within = [place for place in range(2) if spell[place] != own[place]]
    # Of two ends each is led to by where the other is about.
    for place in (*within[:-1], *reversed(within)):
        at = everywhere[everywhere < spell[1] if place == 0 else everywhere > spell[0]]
        rough = np.array([_fits(*one) for one in moved(place, at)])
        best = int(at[np.argmax(rough)])
        spell = (best, spell[1]) if place == 0 else (spell[0], best)
        likely[place] = at[rough > rough.max() - _AS_LIKELY]
    for place in within:
        first = max(likely[place].min() - step, 0 if place == 0 else spell[0] + 1)
        last = min(likely[place].max() + step, spell[1] - 1 if place == 0 else blocks)
        apart = max(1, (last - first) // _CLOSE)
        at = np.arange(first, last + 1, apart)
        found = np.array([_likelihood(*one, logs) for one in moved(place, at)])
        best, top = int(at[np.argmax(found)]), float(found.max())
        weights = np.exp(found - top)
        width = math.log(apart * float(weights.sum()))
        (at_the_end,) = moved(place, np.array([own[place]]))
        if top + width - math.log(blocks) < _likelihood(*at_the_end, logs):
            best = own[place]
        else:
            log_width += width
            told[("start_s", "stop_s")[place]] = End(at, weights / weights.sum())
        spell = (best, spell[1]) if place == 0 else (spell[0], best)
    return Ends(spell, log_width, told)


def _acting(
    setting: Setting, values: Mapping[str, float], robot: Robot, spell: Spell
) -> tuple[Setting, Floats]:
    """Return a setting whose effects act in a spell alone, and its columns float64[c, 2, m]: the
    residual, then all that is free."""
    data = replace(setting.variant.data, acting=spell, miscounting=spell)
    variant = replace(setting.variant, data=data)
    own = replace(setting, variant=variant, shapes=Shapes(data, robot))
    return own, np.concatenate((own.columns(values), own.fixed))


def _fits(setting: Setting, columns: Floats) -> float:
    """Return how well rates are met, as the log likelihood of errors that are as large everywhere.

    It leads to an end from anywhere. The likelihood does not: rates that are off cost it where they
    begin to be and where they cease, however long that lasts.
    """
    seen = setting.variant.data.seen
    both = seen[:, 1:] & seen[:, :-1]
    steps = np.diff(columns, axis=2)[:, both]
    sizes = np.linalg.lstsq(steps[1:].T, steps[0])[0]
    left = steps[0] - sizes @ steps[1:]
    return -0.5 * len(left) * math.log(max(float(left @ left), _NOTHING))


def _likelihood(setting: Setting, columns: Floats, logs: Floats) -> float:
    """Return the log likelihood at these noise levels."""
    data = setting.variant.data
    white, _ = whitened(data, columns, Levels.of(logs, data.tick_rad))
    sd = np.concatenate(([one.high for one in setting.linear_sizes], setting.nuisance_sd))
    residual, free = white[0], white[1:]
    power = float(residual @ residual)
    return float(marginal(free @ free.T, free @ residual, power, sd[np.newaxis])[0])
