"""Counters that are narrower than described: where they wrap, and what they would have said."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from gap_diagnosis.recording import Floats, Recording
from hil_harness.robot import Robot


def unwrapped(recording: Recording, robot: Robot) -> Recording:
    """Return the recording without the jumps of a counter narrower than described."""
    bits, (left, right) = jumps_of(recording, robot)
    if not bits:
        return recording
    return replace(
        recording,
        left_ticks=recording.left_ticks - np.cumsum(left),
        right_ticks=recording.right_ticks - np.cumsum(right),
    )


def jumps_of(recording: Recording, robot: Robot) -> tuple[int, list[Floats]]:
    """Return the width at which narrow counters wrap, and their jumps in counts, float64[n].

    Between the counts that are known: halfway across a jump there is nothing to go by.
    """
    counters = (recording.left_ticks, recording.right_ticks)
    turns_per_s = robot.plant.drive.max_wheel_rate_rad_s / math.tau
    tick_s = float(np.median(np.diff(recording.t_s)))
    fastest = turns_per_s * robot.plant.encoder.ticks_per_rev * tick_s
    known = [np.flatnonzero(np.isfinite(counts)) for counts in counters]
    steps = [
        np.diff(counts[at], prepend=counts[at][:1])
        for counts, at in zip(counters, known, strict=True)
    ]
    rows = [np.diff(at, prepend=at[:1] - 1).astype(np.float64) for at in known]
    bits, found = wraps(steps, rows, fastest)
    jumps = [np.zeros(len(counts)) for counts in counters]
    for jump, at, one in zip(jumps, known, found, strict=True):
        jump[at] = one
    return bits, jumps


def wraps(
    counts: Sequence[Floats], rows: Sequence[Floats], fastest: float
) -> tuple[int, list[Floats]]:
    """Return the width at which narrow counters wrap (0: none does), and their jumps in counts.

    *counts* are steps, float64[n] of each wheel, over so many *rows* each; *fastest* is the most
    that a row can add. A step that no wheel can make, of nearly one power of two every time, is a
    wrap: over rows that are lost, beyond what the wheel did just before and after.
    """
    none = [np.zeros(len(steps)) for steps in counts]
    beyond = [
        steps - _went_on(steps, over, fastest) for steps, over in zip(counts, rows, strict=True)
    ]
    together, reach = np.concatenate(beyond), fastest * np.concatenate(list(rows))
    is_large = np.abs(together) > 2 * reach + 64
    large = np.abs(together[is_large])
    if len(large) == 0:
        return 0, none
    bits = round(math.log2(float(np.median(large))))
    span = 2.0**bits
    if bits < 8 or np.any(np.abs(large - span) > reach[is_large] + 2):
        return 0, none
    if max(np.ptp(np.cumsum(steps)) for steps in counts) >= span:
        return 0, none  # no counter that narrow says so much
    return bits, [span * np.rint(steps / span) for steps in beyond]


def _went_on(steps: Floats, rows: Floats, fastest: float) -> Floats:
    """Return what a wheel adds over lost rows that goes on as around them, float64[n]; else 0."""
    single = (rows == 1) & (np.abs(steps) <= 2 * fastest + 64)
    if single.all() or not single.any():
        return np.zeros(len(steps))
    at = np.arange(len(steps))
    return np.where(rows > 1, rows * np.interp(at, at[single], steps[single]), 0.0)
