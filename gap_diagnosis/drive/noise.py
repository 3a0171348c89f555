"""The noise of the drive's residuals, and the likelihood of what is left of them.

No drive follows its description exactly: a velocity loop, load, a floor, another engine's motor.
White noise (counting), a random walk of the angle and a rate error with a memory, the last two in
proportion to how fast the wheel turns; and, as no effect is exact, to how far it goes astray from
what the described drive does. All five levels are estimated under every hypothesis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive.data import DriveData
from gap_diagnosis.drive.kernels import gains, innovations, products
from gap_diagnosis.motion.components import gains as gains_of
from gap_diagnosis.scoring import LevelPrior, best_levels
from gap_diagnosis.slopes import Weighed

Floats = NDArray[np.float64]

# Natural logarithms of typical levels and their spreads: white [ticks], walk [√s], spread [1],
# memory [s], inexact [1].
_CENTRE: Final = np.log([0.5, 0.002, 0.01, 0.3, 0.01])
_WIDTH: Final = np.array([0.7, 1.5, 1.5, 1.2, 0.5])
_LOW: Final = np.log([0.25, 1e-4, 1e-3, 0.05, 1e-3])
_HIGH: Final = np.log([50.0, 0.3, 1.0, 5.0, 0.15])
_PRIOR: Final = LevelPrior(np.exp(_CENTRE), _WIDTH, np.exp(_LOW), np.exp(_HIGH))
_NEVER: Final = -1e300
_SOUGHT_FROM: Final = 2
"""Of 465 fits of trials' logs none was the likeliest that began at a third of four starts; from the
first alone one ended 634 nats below."""


@dataclass(frozen=True)
class Levels:
    """Noise levels: white [rad], walk [√s], spread [1], memory_s, and *inexact*: rate error as a
    share of how far wheels go astray."""

    white: float
    walk: float
    spread: float
    memory_s: float
    inexact: float = 0.0

    @classmethod
    def of(cls, logs: Floats, tick_rad: float) -> Levels:
        """Return the levels of five logarithms, held within their bounds."""
        values = np.exp(np.clip(logs, _LOW, _HIGH))
        return cls(float(values[0]) * tick_rad, *(float(value) for value in values[1:]))


STARTS: Final = (
    _CENTRE,
    np.log([0.5, 2e-4, 1.5e-3, 1.0, 0.01]),
    np.log([0.5, 0.01, 0.1, 0.5, 0.01]),
)
"""Log levels from which those of a log are sought: typical, quiet and rough."""
IDEAL: Final = np.log([0.3, 1e-4, 1e-3, 0.2, 1e-3])
"""Those of wheels that do to the count as they are told."""


def exact(logs: Floats) -> Floats:
    """Return log levels of effects that are exact: what no effect leaves is not theirs."""
    return np.concatenate((logs[:-1], _LOW[-1:]))


def is_inexact(logs: Floats) -> bool:
    """Tell whether log levels say that something goes astray, and not exactly."""
    return bool(logs[-1] > _CENTRE[-1] + _WIDTH[-1])


def activity(data: DriveData, levels: Levels) -> Floats:
    """Return the rates with which errors grow: of wheels, and of how far they go astray."""
    astray = (levels.inexact / levels.spread) * data.astray
    return np.asarray(np.sqrt(data.activity * data.activity + astray * astray))  # 3 × hypot's speed


class Whitening:
    """The filter that whitens columns at noise levels."""

    def __init__(self, data: DriveData, levels: Levels) -> None:
        """Work out its gains."""
        *self._gains, log_determinant = gains(
            data.seen,
            data.count,
            activity(data, levels),
            data.lost,
            data.scatter,
            data.block_s,
            levels.white,
            levels.walk,
            levels.spread,
            levels.memory_s,
        )
        self.log_determinant = float(log_determinant)

    @property
    def log_variance(self) -> Floats:
        """Logarithm of each innovation's variance, 0 where there is none: float64[2m]."""
        scale = self._gains[-1].ravel()
        return np.asarray(-2.0 * np.log(np.where(scale > 0.0, scale, 1.0)))

    def of(self, columns: Floats) -> Floats:
        """Return the innovations of columns float64[c, 2, m]: float64[c, 2m]."""
        white: Floats = innovations(columns, *self._gains)
        return white.reshape(len(columns), -1)


def whitened(data: DriveData, columns: Floats, levels: Levels) -> tuple[Floats, float]:
    """Return the innovations of columns float64[c, 2, m] as float64[c, 2m], and log det."""
    whitening = Whitening(data, levels)
    return whitening.of(columns), whitening.log_determinant


def log_level_prior(logs: Floats) -> float:
    """Return the log prior density of five log levels, up to a constant."""
    return float(-0.5 * np.sum(((logs - _CENTRE) / _WIDTH) ** 2))


def marginal(gram: Floats, pull: Floats, power: float, sd: Floats) -> Floats:
    """Return log likelihoods, float64[s], with linear coefficients gone of which a prior has the
    standard deviations *sd*, float64[s, c].

    Args:
        gram: float64[c, c] of whitened columns.
        pull: float64[c], columns against the residual.
        power: the residual's square.
        sd: of each prior.
    """
    gained, _ = gains_of(np.ascontiguousarray(gram), np.ascontiguousarray(pull), sd)
    return np.asarray(gained - 0.5 * power)


def fit_levels(
    data: DriveData, residual: Floats, columns: Floats, sd: Floats, starts: Sequence[Floats]
) -> list[tuple[Floats, float]]:
    """Return the most probable log levels and the log likelihood there, with their prior, sought
    from each of the likeliest few of *starts*.

    *residual* is float64[2, m]; *columns* float64[c, 2, m] are nuisances with prior *sd*.
    """
    stacked = np.concatenate((residual[np.newaxis], columns))

    def weigh(levels: Floats) -> Weighed:
        white_ticks, *others = levels.tolist()
        # A slope is taken beyond the bounds too.
        whitening = Whitening(data, Levels(white_ticks * data.tick_rad, *others))
        white = whitening.of(stacked)
        gram = products(white)
        inner, pull = gram[1:, 1:], gram[1:, 0]
        likelihood = float(marginal(inner, pull, gram[0, 0], sd[np.newaxis])[0])
        evidence = likelihood - 0.5 * whitening.log_determinant
        evidence = evidence if np.isfinite(evidence) else _NEVER
        return Weighed(evidence, white.T, whitening.log_variance, (inner, pull))

    def height(logs: Floats) -> float:
        return weigh(np.exp(logs)).log_evidence + log_level_prior(logs)

    likely = sorted(starts, key=height, reverse=True)[:_SOUGHT_FROM] if len(starts) > 1 else starts
    found = [np.log(best_levels(weigh, _PRIOR, np.exp(start))) for start in likely]
    return [(logs, height(logs)) for logs in found]
