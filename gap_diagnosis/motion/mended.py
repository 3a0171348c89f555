"""What a log is like once a mistake of the set-up is put right, and what that is worth."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gap_diagnosis.hypothesis import Fit
from gap_diagnosis.motion.estimate import NOTHING_SAID_RAD2
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.whitening import LEVELS, whiten
from gap_diagnosis.recording import Floats


class Mended(NamedTuple):
    """A mistake of the set-up: its fit, and once it is put right what is likeliest besides, with
    the noise levels then, what that explains, and how much the log scatters about it."""

    fit: Fit
    beside: frozenset[str]
    levels: Floats
    explained: float
    dispersion: float

    def dispersed(self, times: float) -> Mended:
        """Return it as it is worth in a log whose likelihoods are so many times too large, or, of
        one of which they are not, where only what is besides scatters."""
        explained, by = self.fit.log_likelihood, times
        if times == 1.0:
            explained, by = self.explained, self.dispersion
        less = (1 - 1 / by) * explained
        evidence, likelihood = self.fit.log_evidence - less, self.fit.log_likelihood - less
        fit = replace(self.fit, log_evidence=evidence, log_likelihood=likelihood)
        return self._replace(fit=fit)


def in_its_own_unit(
    right: MotionModel, levels: Floats, log_scale: float, counts_per_step: tuple[float, float]
) -> float:
    """Return what the log likelihood of a log put right is more [nat] because gyro and counts are
    compared in other units: *log_scale* for each row that is as unsure as the gyro is, and as much
    for each as unsure as the counts, which stepped by *counts_per_step* before.

    Two likelihoods are of the same log only if what is unsure of it is: a gyro read half as large
    has half the noise, and counts that are many times too many round off many times less.
    """
    gyro = math.exp(-log_scale)
    counts = np.array(counts_per_step) / right.recording.counts_per_step
    if gyro == 1.0 and np.all(counts == 1.0):
        return 0.0
    own = np.array([gyro if name.startswith("gyro_") else 1.0 for name in LEVELS])
    unsure = right.course.gyro_unsure_rad2
    course = replace(
        right.course.longer(counts),
        gyro_floor_rad=gyro * right.course.gyro_floor_rad,
        # A gyro that says nothing says nothing in any unit.
        gyro_unsure_rad2=np.where(unsure < NOTHING_SAID_RAD2, gyro**2 * unsure, unsure),
    )
    data = np.ascontiguousarray(right.columns.values[..., :1])
    _, log_variance = whiten(data, right.course, levels, right.nodes.ticks)
    _, as_it_was = whiten(data, course, own * levels, right.nodes.ticks)
    return 0.5 * float(log_variance.sum() - as_it_was.sum())
