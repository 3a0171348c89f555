"""Where steps forward lead, and how a reference bends what the wheels say of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import oaconvolve

from gap_diagnosis.bends import noise_by_bends
from gap_diagnosis.recording import Floats, Reference

_COURSE_S: Final = 1.5
_TURNED_RAD: Final = 0.05
"""By so much may wheels turn away from a course while it is told: those of a car with one tyre 2 %
larger do by 0.1 rad/s, and over 1.5 s left the heading 0.2 rad off as it sped up."""
_TOLD: Final = 0.02
"""Where the way is less than this share of the longest, the course says nothing."""
_ASLANT: Final = (0.03, math.pi)
"""About headings off by so much [rad], a way is short by half of its square. Less is within the
tolerance of a room's scale and may be a wander of the reference; a tracker may be mounted any way
round."""
_AS_LONG: Final = 2.0
"""Of a robot that turns on the spot the reference's noise is its way: ten times as long as that of
the wheels."""
_LEAP: Final = 2.0
"""A step so many times the wheels' is no step of the robot's alone."""
_NOISY: Final = 6.0
"""Nor is one off by so many times the median of what steps are off by."""
_SURE: Final = 4.0
"""An angle that is less of its standard deviations may be none."""
_LONGEST_ARM_M: Final = 1.0
"""From the wheels' axis to the tracked point."""
_FOLLOW_S: Final = 0.4
"""Faster deviations of the reference from dead reckoning are taken for its noise."""
_STEADY_RAD: Final = 0.02
"""So much of it may be left in a heading about which ways are told to first order: that leaves them
wrong by half of its square."""
_SD_OF_MEDIAN: Final = 1.4826
_LONGEST_S: Final = 10.0
"""Over longer, a description's own turns drift as far."""


def dead_reckoned(forward_m: Floats, heading: Floats) -> tuple[Floats, Floats]:
    """Return x and y [m], float64[n], of steps forward that end at these headings."""
    middle = heading - 0.5 * np.diff(heading, prepend=heading[0])
    return np.cumsum(forward_m * np.cos(middle)), np.cumsum(forward_m * np.sin(middle))


def bent_heading(
    heading: Floats,
    t_s: Floats,
    stamps: Floats,
    reference: Reference,
    forward_m: Floats,
    step_s: float,
) -> tuple[Floats, float]:
    """Return the encoders' heading bent onto the reference's heading, or onto its course, and over
    how long [s]: what lasts longer is the reference's own."""
    if reference.heading_rad is not None:
        over_s = _heading_over_s(reference)
        residual = reference.heading_rad - np.interp(stamps, t_s, heading)
        bent = heading + slow(stamps, residual, t_s, step_s, over_s)
        return bent + _aslant(bent, t_s, stamps, reference, forward_m), over_s
    over_s = _course_over_s(heading, t_s, stamps, reference, forward_m)
    turned = _course_correction(heading, t_s, stamps, reference, forward_m, over_s)
    return heading + turned, over_s


def _heading_over_s(reference: Reference) -> float:
    if reference.heading_rad is None or len(reference.t_s) < 3:
        return _FOLLOW_S
    averaged = 2.0 * math.sqrt(math.pi) * _FOLLOW_S / float(np.median(np.diff(reference.t_s)))
    left_rad = noise_by_bends(np.diff(reference.heading_rad, 2)) / math.sqrt(max(averaged, 1.0))
    return min(_FOLLOW_S * max(left_rad / _STEADY_RAD, 1.0) ** 2, _LONGEST_S)


def slow(
    stamps: Floats,
    residual: Floats,
    t_s: Floats,
    step_s: float,
    over_s: float = _FOLLOW_S,
    lost: Sequence[tuple[int, int]] = (),
) -> Floats:
    """Return the residual at the ticks, without what is faster than *over_s*.

    From the first to the last tick of what was *lost* it may grow by any size, which says nothing
    of the ticks around.
    """
    at_ticks = np.interp(t_s, stamps, residual)
    grown = np.zeros(len(t_s))
    for first, last in lost:
        begins = max(first - 1, 0)
        share = (t_s - t_s[begins]) / max(float(t_s[last] - t_s[begins]), 1e-9)
        grown += (at_ticks[last] - at_ticks[begins]) * np.clip(share, 0.0, 1.0)
    return np.asarray(grown + gaussian_filter1d(at_ticks - grown, over_s / step_s))


def _aslant(
    heading: Floats, t_s: Floats, stamps: Floats, reference: Reference, forward_m: Floats
) -> float:
    """Return the one angle by which the reference's way lies to the left of its headings [rad], if
    it matters."""
    measured, reckoned = _measured_and_reckoned(heading, t_s, stamps, reference, forward_m)
    at_stamps = np.exp(1j * np.interp(stamps, t_s, heading))
    # A tracked point off the wheels' middle goes aslant as well, as the robot turns; and a floor
    # that slopes pulls aslant, but one way in the room however the robot is turned.
    swung = np.diff(at_stamps)
    facing = at_stamps[1:]
    aside = 1j * facing * np.abs(reckoned)
    # Where a reference leaps, a single step would outweigh all others.
    usual_m = _NOISY * float(np.median(np.abs(measured - reckoned)))
    most_m = _LEAP * (np.abs(reckoned) + _LONGEST_ARM_M * np.abs(swung)) + usual_m
    measured = measured * np.minimum(1.0, most_m / np.maximum(np.abs(measured), 1e-12))
    ways = [reckoned, 1j * reckoned, swung, 1j * swung, aside * facing.real, aside * facing.imag]
    # Steps are short and a reference's noise may be long: over a while it averages out.
    width = _COURSE_S / float(np.median(np.diff(stamps)))
    measured, *ways = (_averaged(one, width) for one in (measured, *ways))
    both = np.stack(ways, axis=1)
    inner = (both.conj().T @ both).real
    # On a lasting circle an arm goes as an angle does, on a straight a slope: there they are none.
    inner[np.diag_indices(len(inner))] *= 1.0 + np.repeat([0.0, 1.0, 1.0], 2) * _TOLD
    inverse = np.linalg.pinv(inner, hermitian=True)
    turn = inverse @ (both.conj().T @ measured).real
    angle = float(np.arctan2(turn[1], turn[0]))
    together = max(2.0 * math.sqrt(math.pi) * width, 1.0)
    left = 0.5 * float(np.mean(np.abs(measured - both @ turn) ** 2))
    size = float(np.hypot(*turn[:2]))
    sd = math.sqrt(together * left * float(inverse[1, 1])) / max(size, 1e-12)
    least, most = _ASLANT
    is_way = 1.0 / _AS_LONG < size < _AS_LONG
    return angle if is_way and max(least, _SURE * sd) < abs(angle) < most else 0.0


def _averaged(steps: NDArray[np.complex128], width: float) -> NDArray[np.complex128]:
    """Return a Gaussian mean over *width* steps, mirrored at the ends as SciPy's own filter does,
    which takes a multiplication per step and step of its reach."""
    reach = int(4.0 * width + 0.5)
    bell = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    mirrored = np.pad(steps, reach, mode="symmetric")
    return np.asarray(oaconvolve(mirrored, bell / bell.sum(), mode="valid"))


def _measured_and_reckoned(
    heading: Floats, t_s: Floats, stamps: Floats, reference: Reference, forward_m: Floats
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return steps between stamps, by the reference and by the wheels along these headings."""
    x_m, y_m = dead_reckoned(forward_m, heading)
    reckoned = np.diff(np.interp(stamps, t_s, x_m) + 1j * np.interp(stamps, t_s, y_m))
    return np.diff(reference.x_m + 1j * reference.y_m), reckoned


def _course_over_s(
    heading: Floats, t_s: Floats, stamps: Floats, reference: Reference, forward_m: Floats
) -> float:
    """Return over how long a course is told [s]: no longer than wheels take to turn away from it,
    and as long as it must be for positions this noisy to leave its angle within `_STEADY_RAD`: by a
    GPS, once a second, each step is off by a third of a radian.

    White noise of sd sigma, averaged as by `_averaged` over s steps of length d, leaves an angle of
    sigma / (d sqrt(4 sqrt(pi) s^3)).
    """
    measured, reckoned = _measured_and_reckoned(heading, t_s, stamps, reference, forward_m)
    way = np.abs(reckoned)
    if len(way) < 3 or not way.any():
        return _COURSE_S
    between_s = float(np.median(np.diff(stamps)))
    turn = _course_correction(heading, t_s, stamps, reference, forward_m, _COURSE_S)
    there = np.exp(1j * np.interp(0.5 * (stamps[1:] + stamps[:-1]), t_s, turn))
    off = measured - reckoned * there
    usual_m = 0.5 * float(np.median(np.abs(off.real)) + np.median(np.abs(off.imag)))
    noise_m = _SD_OF_MEDIAN * usual_m / math.sqrt(2.0)
    step_m = float(np.sum(way**2) / np.sum(way))
    cube = (noise_m / (_STEADY_RAD * step_m)) ** 2 / (4.0 * math.sqrt(math.pi))
    away_rad_s = np.average(np.abs(np.gradient(turn, t_s)), weights=np.abs(forward_m))
    steady_s = min(_COURSE_S, _TURNED_RAD / max(float(away_rad_s), 1e-9))
    return min(max(float(np.cbrt(cube)) * between_s, steady_s), _LONGEST_S)


def _course_correction(
    heading: Floats,
    t_s: Floats,
    stamps: Floats,
    reference: Reference,
    forward_m: Floats,
    over_s: float,
) -> Floats:
    """Return what turns the dead-reckoned course onto the reference's, where there is no heading.

    Steps between stamps are complex numbers; the angle of a moving sum of measured times conjugate
    reckoned steps is the turn between them, weighted by the way, backwards or forwards.
    """
    measured, reckoned = _measured_and_reckoned(heading, t_s, stamps, reference, forward_m)
    product = measured * np.conj(reckoned)
    width = max(over_s / float(np.median(np.diff(stamps))), 1.0)
    summed = _averaged(product, width)
    middle = 0.5 * (stamps[1:] + stamps[:-1])
    told = np.abs(summed) > _TOLD * float(np.abs(summed).max())
    if told.sum() < 3:
        return np.zeros(len(t_s))
    return np.asarray(np.interp(t_s, middle[told], np.unwrap(np.angle(summed[told]))))
