"""The expected firmware − float at the end of a drive, split by cause.

What fixed-point arithmetic drops follows from what it is given. So every narrowing is followed
along the float twin's path of a drive, with the values that the firmware has there, and what each
cause makes adds up as a vector, to first order. All together have besides what that leaves out: the
firmware's directions are known, and so where the twin's steps would end along them. Only the float
twin's own rounding is noise. What is left to chance is which drive it is: the root of the mean
square over some drives.

A drive comes some ticks at a time. What is kept of it are sums over its ticks, for turns with the
moments that make the lever of each when the end is known (`levered_m`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from firmware_model import KernelConfig
from precision_study.budget.bound import relative_errors
from precision_study.budget.causes import CAUSES, Share
from precision_study.budget.heading import FirmwareHeading
from precision_study.budget.parts import Part
from precision_study.budget.path import Path
from precision_study.budget.steps import Steps
from precision_study.budget.turns import Constants, Direction, Turns


@dataclass(frozen=True)
class Expected:
    """The expected error: each cause alone, and all together (root of the mean square)."""

    shares: dict[str, Share]
    together: Share


class Expectation:
    """The expected error of a configuration at the end of drives of a kind."""

    def __init__(self, config: KernelConfig, drives: int) -> None:
        """Begin; what the drives differ by is averaged over them, in squares."""
        self._each = [_Along(config) for _ in range(drives)]

    def add(self, drive: int, path: Path) -> None:
        """Go on along a drive, by its next ticks from a `Tracer` of the same mode and rules."""
        self._each[drive].add(path)

    def result(self) -> Expected:
        """Return the expected error where the drives are now."""
        each = [one.result() for one in self._each]
        shares = {name: _mean([one.shares[name] for one in each]) for name in CAUSES}
        return Expected(shares, _mean([one.together for one in each]))


def expected_error(config: KernelConfig, paths: Sequence[Path]) -> Expected:
    """Return the expected error of a configuration at the end of drives like *paths*, whole ones.

    Args:
        config: of the firmware.
        paths: some drives of the kind, from `trace` with the same mode and integration rule.
    """
    expectation = Expectation(config, len(paths))
    for drive, path in enumerate(paths):
        expectation.add(drive, path)
    return expectation.result()


def _mean(shares: Sequence[Share]) -> Share:
    """Return the root of the mean of the squares."""
    count = len(shares)
    return Share(
        math.sqrt(math.fsum(one.position_m**2 for one in shares) / count),
        math.sqrt(math.fsum(one.heading_rad**2 for one in shares) / count),
    )


class _Along:
    """What is expected along one drive."""

    def __init__(self, config: KernelConfig) -> None:
        self._step_off, *_ = relative_errors(config)
        self._heading = FirmwareHeading(config)
        self._constants, self._direction = Constants(config), Direction(config)
        self._turns, self._steps = Turns(config), Steps(config)
        self._end_m = np.zeros(2)

    def add(self, path: Path) -> None:
        headings = self._heading.add(path)
        self._constants.add(path)
        self._turns.add(path, headings)
        self._steps.add(path, self._direction.add(path, headings))
        self._end_m = path.reach[-1, 1:].copy()

    def result(self) -> Expected:
        parts = {name: Part() for name in CAUSES}
        for term in (self._constants, self._direction, self._turns):
            term.close(parts, self._end_m)
        off_m = self._direction.off_m
        off_m = off_m + self._step_off * (self._end_m + off_m)
        higher_m = off_m - np.sum([one.shift_m for one in parts.values()], axis=0)
        self._steps.close(parts, self._end_m)
        shift = higher_m + np.sum([one.shift_m for one in parts.values()], axis=0)
        noise = sum(one.noise_m2 for one in parts.values())
        # A heading is an angle: more than half a turn is measured short by whole ones.
        turn = math.remainder(sum(one.turn_rad for one in parts.values()), 2.0 * math.pi)
        turn_noise = sum(one.noise_rad2 for one in parts.values())
        return Expected(
            {name: one.share for name, one in parts.items()},
            Share(math.hypot(*shift, math.sqrt(noise)), math.hypot(turn, math.sqrt(turn_noise))),
        )
