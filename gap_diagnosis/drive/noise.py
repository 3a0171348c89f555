"""The noise of the drive's residuals, and the likelihood of what is left of them.

No drive follows its description exactly: a velocity loop, load, a floor, another engine's motor.
White noise (counting), a random walk of the angle and a rate error with a memory, the last two in
proportion to how fast the wheel turns; and, as no effect is exact, to how far it goes astray from
what the described drive does. All five levels are estimated under every hypothesis.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from gap_diagnosis.drive.data import DriveData
from gap_diagnosis.drive.kernels import gains, innovations, products

Floats = NDArray[np.float64]

# Natural logarithms of typical levels and their spreads: white [ticks], walk [√s], spread [1],
# memory [s], inexact [1].
_CENTRE: Final = np.log([0.5, 0.002, 0.01, 0.3, 0.01])
_WIDTH: Final = np.array([0.7, 1.5, 1.5, 1.2, 0.5])
_LOW: Final = np.log([0.25, 1e-4, 1e-3, 0.05, 1e-3])
_HIGH: Final = np.log([50.0, 0.3, 1.0, 5.0, 0.15])
_ITERATIONS: Final = 100
_SETTLED: Final = 0.03
"""A step that gains less [nat] is the last, whether the log is of a minute or of an hour."""
_STEP: Final = 0.02
"""Of a log level, over which the likelihood's slope is taken."""


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
            data.block_s,
            levels.white,
            levels.walk,
            levels.spread,
            levels.memory_s,
        )
        self.log_determinant = float(log_determinant)

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


def marginal(gram: Floats, pull: Floats, power: Floats, sd: Floats) -> Floats:
    """Return log likelihoods with linear coefficients of prior standard deviation *sd* gone.

    Args:
        gram: float64[..., c, c] of whitened columns.
        pull: float64[..., c], columns against the residual.
        power: float64[...], the residual's square.
        sd: float64[..., c].
    """
    scaled = gram * sd[..., :, np.newaxis] * sd[..., np.newaxis, :]
    matrix = scaled + np.eye(sd.shape[-1])
    aim = pull * sd
    solved = np.linalg.solve(matrix, aim[..., np.newaxis])[..., 0]
    _, log_determinant = np.linalg.slogdet(matrix)
    return np.asarray(-0.5 * (power - np.sum(aim * solved, axis=-1) + log_determinant))


def fit_levels(
    data: DriveData, residual: Floats, columns: Floats, sd: Floats, start: Floats
) -> tuple[Floats, float]:
    """Return the most probable log levels and the log likelihood there, with their prior.

    *residual* is float64[2, m]; *columns* float64[c, 2, m] are nuisances with prior *sd*.
    """
    stacked = np.concatenate((residual[np.newaxis], columns))

    def loss(logs: Floats) -> tuple[float, Floats]:
        steps = np.where(logs + _STEP > _HIGH, -_STEP, _STEP)
        values = _losses(data, stacked, sd, np.vstack((logs, logs + np.diag(steps))))
        return float(values[0]), (values[1:] - values[0]) / steps

    begin = np.clip(start, _LOW, _HIGH)
    size = max(abs(float(_losses(data, stacked, sd, begin[np.newaxis])[0])), 1.0)
    best = minimize(
        loss,
        begin,
        method="L-BFGS-B",
        jac=True,
        bounds=list(zip(_LOW, _HIGH, strict=True)),
        options={"maxiter": _ITERATIONS, "ftol": _SETTLED / size},
    )
    return np.asarray(best.x, dtype=np.float64), -float(best.fun)


def _losses(data: DriveData, stacked: Floats, sd: Floats, logs: Floats) -> Floats:
    """Return the negative log likelihoods with prior of log levels float64[p, 5]: float64[p]."""
    grams, densities = [], []
    for one in logs:
        white, log_determinant = whitened(data, stacked, Levels.of(one, data.tick_rad))
        grams.append(products(white))
        densities.append(log_level_prior(one) - 0.5 * log_determinant)
    gram = np.array(grams)
    likelihoods = marginal(gram[:, 1:, 1:], gram[:, 1:, 0], gram[:, 0, 0], sd[np.newaxis])
    values = likelihoods + densities
    return np.where(np.isfinite(values), -values, 1e300)
