"""Coefficients that the angles are linear in: their inner products, and draws of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.drive.noise import marginal

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Grams:
    """Whitened inner products at points: of linear columns, then nuisances."""

    gram: Floats
    pull: Floats
    power: Floats

    @property
    def by_point(self) -> Iterator[tuple[Floats, Floats, float]]:
        """Those of one point after the other."""
        return zip(self.gram, self.pull, self.power.tolist(), strict=True)


def explained_by(columns: Floats, residual: Floats, sd: Floats) -> float:
    """Return by how much columns float64[c, n] lessen the square of a residual float64[n].

    Their coefficients are near 0 by prior standard deviations *sd*, infinite where they are free.
    """
    pull = columns @ residual
    return float(pull @ np.linalg.lstsq(columns @ columns.T + np.diag(sd**-2.0), pull)[0])


def draw_linear(
    grams: Grams, sd: Floats, place: NDArray[np.intp], random: np.random.Generator
) -> Floats:
    """Draw linear coefficients given each sample's grid point: float64[samples, c]."""
    draws = np.zeros((len(place), sd.shape[1]))
    for i, products in enumerate(grams.by_point):
        rows = np.flatnonzero(place == i)
        logs = marginal(*products, sd)
        weight = np.exp(logs - logs.max())
        scale = random.choice(len(sd), size=len(rows), p=weight / weight.sum())
        for number in np.unique(scale):
            mine = rows[scale == number]
            precision = grams.gram[i] + np.diag(1 / sd[number] ** 2)
            factor = np.linalg.cholesky(precision)
            mean = np.linalg.solve(precision, grams.pull[i])
            noise = np.linalg.solve(factor.T, random.standard_normal((len(factor), len(mine))))
            draws[mine] = mean + noise.T
    return draws
