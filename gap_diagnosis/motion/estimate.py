"""A smooth estimate of the true motion, about which everything else is linear."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import gaussian_filter1d

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.explanations.choices import frozen_runs
from gap_diagnosis.explanations.reference import (
    SHARP_S,
    USUAL_S,
    counting_slope,
    with_details,
)
from gap_diagnosis.prediction import Motion
from gap_diagnosis.recording import Floats, Recording, Reference
from gap_diagnosis.standing import standing
from hil_harness.robot import Robot

_REFERENCE_K: Final = 298.15
_SILENCE_S: Final = 0.1
_USUAL_TIMES: Final = 5.0
"""What is missing for longer than this, and so many times the usual, cannot be interpolated."""
_SLOW_S: Final = 1.0
_NOISE_COUNTS_PER_S: Final = 25.0
"""A rate below this is hardly more than the noise of counting."""
_COURSE_S: Final = 1.5
_TOLD: Final = 0.02
"""Where the way is less than this share of the longest, the course says nothing."""
_BENDS_S: Final = 0.5
_BENT_ROWS: Final = 2.0
_FINE_RAD: Final = math.tau / 65_536
"""Wheels that say how fast they are do not round what they went to counts."""
_NOTHING_SAID_RAD2: Final = 1.0
"""Variance of a tick's turn by a gyro that repeats its code. What it holds is predicted to the bit:
taken for a measurement, that would say that the wheels never slipped meanwhile."""
_CONTACT_M_PER_SQRT_M: Final = 5e-4
"""As levels of noise have it before a log is seen."""
_NOISY: Final = 0.07
_MOST_SMOOTHING_S: Final = 0.3
_ASLANT: Final = (0.03, 0.8)
"""About headings off by so much [rad], a way is short by half of its square. Less is within the
tolerance of a room's scale and may be a wander of the reference; more, eight times the end of its
prior, is none's."""
_LEAP: Final = 2.0
"""A step so many times the wheels' is no step of the robot's alone."""
_FOLLOW_S: Final = 0.4
"""Faster deviations of the reference from dead reckoning are taken for its noise."""


def estimate_motion(
    recording: Recording, robot: Robot, *, reference_delay_s: float = 0.0
) -> Motion:
    """Return the motion of a recording: dead reckoning, bent slowly onto the reference.

    *reference_delay_s* is taken off the reference's stamps first. Only a linearisation point: the
    reference is smoothed here and nowhere else.

    Raises DiagnosisError when there are no wheel counts in the log, or fewer than three ticks.
    """
    t_s = recording.t_s
    if len(t_s) < 3 or not np.isfinite(recording.left_ticks).any():
        raise DiagnosisError(
            f"{recording.name}: no wheel counts to follow: expected at least three ticks with "
            "left and right counts"
        )
    plant = robot.plant
    rad_per_count = math.tau / plant.encoder.ticks_per_rev
    dt_s = np.diff(t_s, prepend=t_s[0])
    step_s = float(np.median(dt_s[1:]))
    bits, jumps = _jumps(recording, robot)
    left, right = (
        _between(ticks - np.cumsum(jump), t_s) * rad_per_count
        for ticks, jump in zip((recording.left_ticks, recording.right_ticks), jumps, strict=True)
    )
    left, right = left - left[0], right - right[0]
    width = max(USUAL_S / step_s, 0.5)
    rates = [gaussian_filter1d(_slope(angle, t_s), width) for angle in (left, right)]
    accelerations = [gaussian_filter1d(np.gradient(rate, t_s), width) for rate in rates]
    radius_m, wheelbase_m = plant.wheels.radius_m, plant.wheels.wheelbase_m
    left_step, right_step = np.diff(left, prepend=0.0), np.diff(right, prepend=0.0)
    rounding_rad = _FINE_RAD if recording.speed_cycle_s > 0 else rad_per_count
    steady = [
        np.where(standing(angle, step_s, rounding_rad), 0.0, step)
        for angle, step in ((left, left_step), (right, right_step))
    ]
    forward_m = 0.5 * radius_m * (left_step + right_step)
    heading = radius_m * (right - left) / wheelbase_m
    gyro_turn = _gyro_turn(recording, dt_s, heading)
    has_counters = any(one.modulo for one in recording.frames.values())
    gyro_rate = recording.gyro_rate_rad_s
    gyro_unsure = _variance_of_filled(gyro_rate, t_s) * dt_s**2
    if gyro_rate is not None and not has_counters:
        density = plant.gyro.noise_density_rad_per_sqrt_s
        gyro_unsure += _variance_of_moments(gyro_rate, t_s, density**2 / step_s) * dt_s**2
    reference = recording.reference
    if reference is None:
        x_m, y_m = dead_reckoned(forward_m, heading)
    else:
        stamps = reference.t_s - reference_delay_s
        heading = _heading_of(heading, t_s, stamps, reference, forward_m, step_s)
        x_m, y_m = dead_reckoned(forward_m, heading)
        x_m = x_m + _slow(stamps, reference.x_m - np.interp(stamps, t_s, x_m), t_s, step_s)
        y_m = y_m + _slow(stamps, reference.y_m - np.interp(stamps, t_s, y_m), t_s, step_s)
    turning_s = turn_smoothing_s(heading, np.abs(rates) * radius_m, wheelbase_m, step_s)
    turn_rate = gaussian_filter1d(_slope(heading, t_s), max(turning_s / step_s, 0.5))
    middle = heading - 0.5 * np.diff(heading, prepend=heading[0])
    along = _slope(x_m, t_s) * np.cos(middle) + _slope(y_m, t_s) * np.sin(middle)
    temperature, supply = recording.temperature_k, recording.supply_v
    low_code, high_code = 0, plant.adc.max_code
    return Motion(
        t_s=t_s,
        dt_s=dt_s,
        left_step_rad=left_step,
        right_step_rad=right_step,
        left_jump_rad=jumps[0] * rad_per_count,
        right_jump_rad=jumps[1] * rad_per_count,
        wrap_bits=bits,
        left_angle_rad=left,
        right_angle_rad=right,
        left_steady_rad=steady[0],
        right_steady_rad=steady[1],
        left_rate_rad_s=rates[0],
        right_rate_rad_s=rates[1],
        left_acceleration_rad_s2=accelerations[0],
        right_acceleration_rad_s2=accelerations[1],
        x_m=x_m,
        y_m=y_m,
        heading_rad=heading,
        speed_m_s=gaussian_filter1d(along, width),
        turn_rate_rad_s=turn_rate,
        acceleration_m_s2=0.5 * radius_m * (accelerations[0] + accelerations[1]),
        gyro_turn_rad=gyro_turn,
        wheel_unsure_rad2=np.zeros((2, len(t_s)))
        if recording.unsure_ticks2 is None
        else recording.unsure_ticks2 * rad_per_count**2,
        gyro_unsure_rad2=gyro_unsure,
        gyro_code=None
        if recording.gyro_code is None or gyro_turn is None
        else np.clip(_filled(recording.gyro_code, t_s), low_code, high_code),
        gyro_sensitivity_lsb_per_rad_s=plant.gyro.sensitivity_lsb_per_rad_s,
        gyro_zero_rate_code=plant.gyro.zero_rate_code,
        gyro_noise_lsb=plant.gyro.noise_density_rad_per_sqrt_s
        / math.sqrt(step_s)
        * plant.gyro.sensitivity_lsb_per_rad_s,
        adc_max_code=high_code,
        warm_k=None if temperature is None else _unheld(temperature, t_s) - _REFERENCE_K,
        supply_error=None
        if supply is None
        else _unheld(supply, t_s) / plant.supply.nominal_v - 1.0,
        radius_m=radius_m,
        wheelbase_m=wheelbase_m,
        rad_per_count=rad_per_count,
        rounding_rad=rounding_rad,
        turning_s=turning_s,
        sharp_s=_sharp_s(turning_s),
        has_counters=has_counters,
    )


def _slope(values: Floats, t_s: Floats) -> Floats:
    """Return the mean slope over each tick, of which t_s is the end; the first is the second's."""
    slope = np.diff(values) / np.diff(t_s)
    return np.concatenate([slope[:1], slope])


def turn_smoothing_s(
    heading: Floats, speeds_m_s: Floats, wheelbase_m: float, step_s: float
) -> float:
    """Return over how long a turn rate is averaged, so that its change is that of the body.

    Wheels on a road slip to and fro, a random walk over the way, and a heavy body turns smoothly:
    where the slope of what they say is mostly their own noise, a late or lagging gyro would be
    told from it. It is a Gaussian that leaves of the noise 7 % of the slope. *speeds_m_s*:
    float64[2, n], each wheel's.
    """
    walk_rad2_per_s = _CONTACT_M_PER_SQRT_M**2 * float(speeds_m_s.sum(axis=0).mean())
    walk_rad2_per_s /= wheelbase_m**2
    turn_rate = np.diff(heading, prepend=heading[0]) / step_s
    width_s = USUAL_S
    while width_s < _MOST_SMOOTHING_S:
        bends = np.gradient(gaussian_filter1d(turn_rate, max(width_s / step_s, 0.5)), step_s)
        noise = math.sqrt(walk_rad2_per_s / (4.0 * math.sqrt(math.pi) * width_s**3))
        if noise <= _NOISY * float(bends.std()):
            break
        width_s *= 1.1
    return width_s


def _sharp_s(turning_s: float) -> float:
    """Return what details of a turn rate are smoothed by, the more the more noise there is."""
    sharp_s = SHARP_S * (turning_s / USUAL_S) ** 2
    return sharp_s if sharp_s < turning_s else math.inf


def _denoised(step_rad: Floats, tick_s: float, rad_per_count: float, least_s: float) -> Floats:
    """Smooth steps a little where they are large, and much where they are hardly more than noise.

    On a straight the difference of two counts is nothing but their noise.
    """

    def smooth(width_s: float, values: Floats = step_rad) -> Floats:
        return np.asarray(gaussian_filter1d(values, max(width_s / tick_s, 0.5), mode="nearest"))

    rate = smooth(3 * USUAL_S) / tick_s
    noise = _NOISE_COUNTS_PER_S * rad_per_count
    calm = np.exp(-((rate / noise) ** 2))
    # A mean over what is calm as well: a turn on the spot must not leak into the straight before.
    slow = smooth(_SLOW_S, calm * step_rad) / np.maximum(smooth(_SLOW_S, calm), 1e-9)
    return np.asarray((1 - calm) * smooth(least_s) + calm * slow)


def unwrapped(recording: Recording, robot: Robot) -> Recording:
    """Return the recording without the jumps of a counter narrower than described."""
    bits, (left, right) = _jumps(recording, robot)
    if not bits:
        return recording
    return replace(
        recording,
        left_ticks=recording.left_ticks - np.cumsum(left),
        right_ticks=recording.right_ticks - np.cumsum(right),
    )


def _jumps(recording: Recording, robot: Robot) -> tuple[int, list[Floats]]:
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


def smoothed(motion: Motion) -> Motion:
    """Return the motion with smooth wheel turns: what effects are computed from.

    A column made of raw counts would carry the same quantisation noise as the data that it is
    compared with (errors in variables), and large amplitudes could cancel that noise.
    """
    tick_s = motion.tick_s
    left, right = motion.left_steady_rad, motion.right_steady_rad
    # Counts that are hardly more than noise are smoothed more anyway; speeds have none. Both sums
    # by as much: of a wheel that stands nothing must be left.
    is_speed = motion.rounding_rad == _FINE_RAD
    least_s = motion.turning_s if is_speed else USUAL_S
    ahead, turning = (
        _denoised(steps, tick_s, motion.rounding_rad, least_s)
        for steps in (right + left, right - left)
    )
    left, right = 0.5 * (ahead - turning), 0.5 * (ahead + turning)
    left[0] = right[0] = 0.0
    x_m, y_m = dead_reckoned(0.5 * motion.radius_m * (left + right), motion.heading_rad)
    geometry = motion.radius_m / motion.wheelbase_m
    turn = motion.turn_rate_rad_s * tick_s / geometry
    turn = _denoised(turn, tick_s, motion.rounding_rad, USUAL_S)
    return replace(
        motion,
        x_m=x_m,
        y_m=y_m,
        turn_rate_rad_s=turn * geometry / tick_s,
        left_step_rad=left,
        right_step_rad=right,
        left_angle_rad=np.cumsum(left),
        right_angle_rad=np.cumsum(right),
    )


def sharpened(smooth: Motion) -> Motion:
    """Return smoothed wheel turns with as much of what smoothing rounded off as is no counting
    error: what large effects make of them is compared with counts that begin a turn more sharply.
    """
    if smooth.rounding_rad == _FINE_RAD:
        return smooth
    tick_s = smooth.tick_s
    left, right = smooth.left_step_rad, smooth.right_step_rad
    width = USUAL_S / tick_s
    # Of the sum of two counters.
    noise = 2.0 * counting_slope(width) * smooth.rounding_rad**2
    ahead, turning = (
        with_details(steps, width, noise, tick_s) for steps in (right + left, right - left)
    )
    left, right = 0.5 * (ahead - turning), 0.5 * (ahead + turning)
    left[0] = right[0] = 0.0
    return replace(smooth, left_step_rad=left, right_step_rad=right)


def _filled(values: Floats, t_s: Floats) -> Floats:
    """Return values with what is missing interpolated (counts and codes of lost frames)."""
    known = np.isfinite(values)
    if known.all():
        return np.asarray(values, dtype=np.float64)
    if not known.any():
        return np.zeros(len(values))
    return np.interp(t_s, t_s[known], values[known])


def _unheld(values: Floats, t_s: Floats) -> Floats:
    """Return what a slow sensor measures between its frames: a held reading is late.

    Straight from the last row of a reading that was held to the next reading, over no more than
    the time between two of them.
    """
    known = _filled(values, t_s)
    changes = np.flatnonzero(np.diff(known)) + 1
    if len(changes) < 2:
        return known
    held = int(np.diff(changes).min())
    before = np.maximum(changes - held, 0)
    rows = np.concatenate([[0], before, changes, [len(known) - 1]])
    readings = np.concatenate([known[:1], known[changes - 1], known[changes], known[-1:]])
    order = np.lexsort((np.arange(len(rows)), rows))
    rows, readings = rows[order], readings[order]
    last = np.append(np.diff(rows) > 0, True)
    return np.asarray(np.interp(t_s, t_s[rows[last]], readings[last]))


def _between(counts: Floats, t_s: Floats) -> Floats:
    """Return counts with those of lost rows where a wheel that changes its speed was."""
    known = np.isfinite(counts)
    if known.all() or known.sum() < 2:
        return _filled(counts, t_s)
    inside = np.clip(t_s, *t_s[known][[0, -1]])
    return np.where(known, counts, PchipInterpolator(t_s[known], counts[known])(inside))


def unsure_where_frozen(motion: Motion) -> Motion:
    """Return the motion with a gyro that says nothing where it repeats its code."""
    unsure_rad2 = motion.gyro_unsure_rad2.copy()
    for first, last in frozen_runs(motion):
        unsure_rad2[first : last + 1] = _NOTHING_SAID_RAD2
    return replace(motion, gyro_unsure_rad2=unsure_rad2)


def _variance_of_filled(rate: Floats | None, t_s: Floats) -> Floats:
    """Return the variance [rad²/s²], float64[n], of rates that were interpolated; 0 where known.

    The rates around say how well a straight line over so many ticks tells those between.
    """
    found = np.zeros(len(t_s))
    if rate is None:
        return found
    missing = ~np.isfinite(rate)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(np.int8), [0]])))
    firsts, counts = edges[::2], np.diff(edges)[::2]
    for count in np.unique(counts):
        half = int(count) // 2 + 1
        if 2 * half >= len(rate):
            continue
        bend = np.full(len(rate), np.nan)
        bend[half:-half] = rate[half:-half] - 0.5 * (rate[: -2 * half] + rate[2 * half :])
        told = np.isfinite(bend)
        width = _BENDS_S / float(np.median(np.diff(t_s)))
        square = gaussian_filter1d(np.where(told, bend, 0.0) ** 2, width)
        share = gaussian_filter1d(told.astype(np.float64), width)
        local = square / np.maximum(share, 1e-3)
        for first in firsts[counts == count]:
            # They are off together: of *count* rates the sum is off by so many times one.
            found[first : first + count] = count * local[first : first + count]
    return found


def _variance_of_moments(rate: Floats, t_s: Floats, noise2: float) -> Floats:
    """Return the variance [rad²/s²], float64[n], of a tick's mean rate if samples are of a moment.

    A row of a table does not say. Where the rate bends within a tick (beyond its noise of variance
    *noise2*), the mean is off the straight line between samples by up to a quarter of the bend.
    """
    filled = _filled(rate, t_s)
    bend = np.zeros(len(rate))
    bend[1:-1] = filled[1:-1] - 0.5 * (filled[:-2] + filled[2:])
    around = gaussian_filter1d(bend**2, _BENT_ROWS) - 1.5 * noise2
    return np.asarray(np.maximum(around, 0.0) / 16.0)


def _gyro_turn(recording: Recording, dt_s: Floats, heading: Floats) -> Floats | None:
    """Return the turn by the gyro [rad], float64[n]; in a silence the wheels' own, *heading*.

    Counts go on while nobody hears of them, but what the gyro said is lost.
    """
    rate = recording.gyro_rate_rad_s
    if rate is None or np.isfinite(rate).sum() < 3:
        return None
    steps = _filled(rate, recording.t_s) * dt_s
    silent = silences(rate, recording.t_s)
    steps[silent] = np.diff(heading, prepend=heading[0])[silent]
    return np.asarray(np.cumsum(steps) - steps[0])


def silences(values: Floats, t_s: Floats) -> NDArray[np.bool_]:
    """Mark, bool[n], what is missing for so long that it cannot be interpolated."""
    missing = ~np.isfinite(values)
    usual_s = np.diff(t_s[~missing])
    if not missing.any() or len(usual_s) == 0:
        return np.zeros(len(values), dtype=np.bool_)
    longest_s = max(_SILENCE_S, _USUAL_TIMES * float(np.median(usual_s)))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], missing.astype(np.int8), [0]])))
    silent = np.zeros(len(values), dtype=np.bool_)
    for first, stop in edges.reshape(-1, 2):
        last = min(stop, len(t_s) - 1)
        silent[first:stop] = t_s[last] - t_s[max(first - 1, 0)] > longest_s
    return silent


def dead_reckoned(forward_m: Floats, heading: Floats) -> tuple[Floats, Floats]:
    """Return x and y [m], float64[n], of steps forward that end at these headings."""
    middle = heading - 0.5 * np.diff(heading, prepend=heading[0])
    return np.cumsum(forward_m * np.cos(middle)), np.cumsum(forward_m * np.sin(middle))


def _slow(stamps: Floats, residual: Floats, t_s: Floats, step_s: float) -> Floats:
    """Return the residual at the ticks, without its fast part."""
    at_ticks = np.interp(t_s, stamps, residual)
    return np.asarray(gaussian_filter1d(at_ticks, _FOLLOW_S / step_s, mode="nearest"))


def _heading_of(
    heading: Floats,
    t_s: Floats,
    stamps: Floats,
    reference: Reference,
    forward_m: Floats,
    step_s: float,
) -> Floats:
    """Return the encoders' heading bent onto the reference's heading, or onto its course."""
    if reference.heading_rad is not None:
        residual = reference.heading_rad - np.interp(stamps, t_s, heading)
        bent = heading + _slow(stamps, residual, t_s, step_s)
        return bent + _aslant(bent, t_s, stamps, reference, forward_m)
    return heading + _course_correction(heading, t_s, stamps, reference, forward_m)


def _aslant(
    heading: Floats, t_s: Floats, stamps: Floats, reference: Reference, forward_m: Floats
) -> float:
    """Return the one angle by which the reference's way lies to the left of its headings [rad], if
    it matters."""
    measured, reckoned = _measured_and_reckoned(heading, t_s, stamps, reference, forward_m)
    # Where a reference leaps, a single step would outweigh all others.
    most_m = _LEAP * np.abs(reckoned)
    measured = measured * np.minimum(1.0, most_m / np.maximum(np.abs(measured), 1e-12))
    angle = float(np.angle(np.sum(measured * np.conj(reckoned))))
    least, most = _ASLANT
    return angle if least < abs(angle) < most else 0.0


def _measured_and_reckoned(
    heading: Floats, t_s: Floats, stamps: Floats, reference: Reference, forward_m: Floats
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return steps between stamps, by the reference and by the wheels along these headings."""
    x_m, y_m = dead_reckoned(forward_m, heading)
    reckoned = np.diff(np.interp(stamps, t_s, x_m) + 1j * np.interp(stamps, t_s, y_m))
    return np.diff(reference.x_m + 1j * reference.y_m), reckoned


def _course_correction(
    heading: Floats, t_s: Floats, stamps: Floats, reference: Reference, forward_m: Floats
) -> Floats:
    """Return what turns the dead-reckoned course onto the reference's, where there is no heading.

    Steps between stamps are complex numbers; the angle of a moving sum of measured times conjugate
    reckoned steps is the turn between them, weighted by the way, backwards or forwards.
    """
    measured, reckoned = _measured_and_reckoned(heading, t_s, stamps, reference, forward_m)
    product = measured * np.conj(reckoned)
    width = max(_COURSE_S / float(np.median(np.diff(stamps))), 1.0)
    summed = gaussian_filter1d(product.real, width) + 1j * gaussian_filter1d(product.imag, width)
    middle = 0.5 * (stamps[1:] + stamps[:-1])
    told = np.abs(summed) > _TOLD * float(np.abs(summed).max())
    if told.sum() < 3:
        return np.zeros(len(t_s))
    return np.asarray(np.interp(t_s, middle[told], np.unwrap(np.angle(summed[told]))))
