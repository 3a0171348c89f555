"""Stage gyro: from the true turn rate to what the gyro reads."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter
from scipy.special import ndtr

from gap_diagnosis.explanations.reference import (
    detailed_turn_rate,
    seen,
    sharp_turn_rate_by_wheels,
    turn_rate_with_details,
    wheels_turn_rate,
)
from gap_diagnosis.prediction import USUAL_CONTACT_M_PER_SQRT_M, Motion, Prediction, told_once
from gap_diagnosis.recording import Floats

_LEAST_RAD_S: Final = 1e-9


def gyro_lag(p: Prediction, *, time_constant: float) -> None:
    """Trail the true rate: a first-order filter, and of what it shows the mean over each tick.

    The rate is a smooth one: in the fine details of counted turns, counting errors pass for a lag.
    """
    _trail(p, time_constant, p.motion.turn_rate_rad_s)


def exact_gyro_lag(p: Prediction, *, time_constant: float) -> None:
    """Trail the turn that the wheels make, as sharply as it begins."""
    _trail(p, time_constant, wheels_turn_rate(p))


def long_gyro_lag(p: Prediction, *, time_constant: float) -> None:
    """Trail the true rate by so much that every detail of a turn shows it."""
    _trail(p, time_constant, detailed_turn_rate(p.motion))


def _trail(p: Prediction, time_constant: float, rate: Floats) -> None:
    if time_constant <= 0:
        return
    rate = seen(p, rate)
    step = p.motion.tick_s
    share = -np.expm1(-step / time_constant)
    filtered = lfilter([share], [1, share - 1], rate, zi=rate[:1] * (1 - share))[0]
    # The filter's exact mean over a tick in which the rate is constant.
    gap = np.append(rate[0], filtered[:-1]) - rate
    p.gyro_rad_s = p.gyro_rad_s + share * time_constant / step * gap


def little_gyro_lag(p: Prediction, *, time_constant: float) -> None:
    """Trail the true rate by so little that only the mean delay shows.

    As sharply as turns begin: what smoothing rounds off there looks like wheels that slip as they
    speed up, and a lag within tolerance like one that is news. Not in a table, whose rows are means
    or moments: what may be a whole row there would be told from a delay by its sharpness.
    """
    m = p.motion
    # What an encoder makes up no body turns, nor a gyro trails: it is the turn explained, and as
    # sharp as without. (Sharper beside a play alone, a row's delay was a play of next to nothing.)
    if not m.has_counters:
        rate = p.turned_rad_s
    elif np.any(p.turned_rad_s != m.turn_rate_rad_s):
        rate = p.turn_rad / m.tick_s
    else:
        rate = sharp_turn_rate_by_wheels(p)
    p.gyro_rad_s = p.gyro_rad_s - time_constant * np.gradient(rate, m.t_s)


def gyro_nonlinearity(p: Prediction, *, quadratic: float, cubic: float) -> None:
    """Bend the scale with the rate's size."""
    _bend(p, rate_of_columns(p), quadratic, cubic)


def exact_gyro_nonlinearity(p: Prediction, *, quadratic: float, cubic: float) -> None:
    """Bend the scale with the size of the rate as sharp as it is."""
    _bend(p, rate_with_details(p), quadratic, cubic)


def _bend(p: Prediction, rate: Floats, quadratic: float, cubic: float) -> None:
    p.gyro_rad_s = p.gyro_rad_s + quadratic * rate * np.abs(rate) + cubic * rate**3


def rate_with_details(p: Prediction) -> Floats:
    """Return the rate as the gyro has it so far, with what smoothing rounded off.

    Counters tell that by themselves, sharper than the estimated heading, which a reference bends.
    """
    if _counters_tell(p.motion):
        return rate_of_columns(p)
    return seen(p, turn_rate_with_details(p.motion))


def rate_of_columns(p: Prediction) -> Floats:
    """Return the rate as the gyro has it so far, as smooth as the counters are, if there are any.

    Smoother, the scale of a gyro would not be that of the turns by the wheels: where turns are
    short the one would be told from the other.
    """
    return np.asarray(p.gyro_rad_s + rounded_off(p.motion))


def sharp_turn_rate(m: Motion) -> Floats:
    """Return the estimated turn rate with what smoothing rounded off, float64[n].

    Details of an estimate that a reference bends are not the wheels' own: along a slip of 0.15 s
    they cost 28 nats, for an unlisted cause to take.
    """
    if _counters_tell(m):
        return np.asarray(m.turn_rate_rad_s + rounded_off(m))
    return turn_rate_with_details(m)


@told_once
def rounded_off(m: Motion) -> Floats:
    """Return by how much the counters tell a turn rate from the smooth one, float64[n]; nothing
    where there are none."""
    if not _counters_tell(m):
        return np.zeros_like(m.turn_rate_rad_s)
    wheels = m.radius_m * (m.right_step_rad - m.left_step_rad) / (m.wheelbase_m * m.tick_s)
    return np.asarray(wheels - gaussian_filter1d(wheels, m.turning_s / m.tick_s, mode="nearest"))


def _counters_tell(m: Motion) -> bool:
    return m.has_counters and m.sharp_s < np.inf


def gyro_asymmetry(p: Prediction, *, asymmetry: float) -> None:
    """Scale left turns unlike right turns."""
    p.gyro_rad_s = p.gyro_rad_s + 0.5 * asymmetry * np.abs(rate_of_columns(p))


def exact_gyro_asymmetry(
    p: Prediction, *, asymmetry: float, contact_m_per_sqrt_m: float = USUAL_CONTACT_M_PER_SQRT_M
) -> None:
    """Scale turns as sharp as they are by their sense, and those that contact makes with them.

    Of noise about a straight way the gyro shows each half otherwise: its mean is that of the size
    of a normal value (folded normal, Leone, Nelson and Nottingham 1961), as large as a bias where
    wheels slip to and fro by milliradians a tick.
    """
    rate = rate_with_details(p)
    sd = np.maximum(contact_m_per_sqrt_m * _per_contact_rad_s(p.motion), _LEAST_RAD_S)
    size = rate + 2.0 * sd * _mean_beyond(-rate / sd)
    p.gyro_rad_s = p.gyro_rad_s + 0.5 * asymmetry * size


def gyro_scale(p: Prediction, *, scale: float) -> None:
    """Read every rate too large."""
    p.gyro_rad_s = p.gyro_rad_s + scale * rate_of_columns(p)


def exact_gyro_scale(p: Prediction, *, scale: float) -> None:
    """Read every rate, as sharp as it is, too large."""
    p.gyro_rad_s = p.gyro_rad_s + scale * rate_with_details(p)


def gyro_temperature_scale(p: Prediction, *, slope: float) -> None:
    """Let the scale follow the temperature."""
    if p.motion.warm_k is not None:
        p.gyro_rad_s = p.gyro_rad_s + slope * p.motion.warm_k * rate_of_columns(p)


def exact_gyro_temperature_scale(p: Prediction, *, slope: float) -> None:
    """Let the scale of a rate as sharp as it is follow the temperature."""
    if p.motion.warm_k is not None:
        p.gyro_rad_s = p.gyro_rad_s + slope * p.motion.warm_k * rate_with_details(p)


def supply_ratio(p: Prediction, *, coefficient: float) -> None:
    """Let the scale follow the supply."""
    if p.motion.supply_error is not None:
        p.gyro_rad_s = p.gyro_rad_s * (1 + coefficient * p.motion.supply_error)


def exact_supply_ratio(p: Prediction, *, coefficient: float) -> None:
    """Let the scale of a rate as sharp as it is follow the supply."""
    if p.motion.supply_error is not None:
        p.gyro_rad_s = p.gyro_rad_s + coefficient * p.motion.supply_error * rate_with_details(p)


def gyro_bias(p: Prediction, *, bias: float) -> None:
    """Read a rate at rest."""
    p.gyro_rad_s = p.gyro_rad_s + bias


def gyro_temperature_bias(p: Prediction, *, slope: float) -> None:
    """Let the bias follow the temperature."""
    if p.motion.warm_k is not None:
        p.gyro_rad_s = p.gyro_rad_s + slope * p.motion.warm_k


def gyro_vibration(p: Prediction, *, coefficient: float) -> None:
    """Let the bias grow with the square of the wheels' speed."""
    squares = p.motion.left_rate_rad_s**2 + p.motion.right_rate_rad_s**2
    p.gyro_rad_s = p.gyro_rad_s + coefficient * 0.5 * squares


def gyro_g_sensitivity(p: Prediction, *, x: float, y: float) -> None:
    """Read a rate while the body accelerates."""
    lateral = p.motion.speed_m_s * p.motion.turn_rate_rad_s
    p.gyro_rad_s = p.gyro_rad_s + x * p.motion.acceleration_m_s2 + y * lateral


def gyro_saturation(
    p: Prediction,
    *,
    limit: float,
    contact_m_per_sqrt_m: float = 0.0,
    start_s: float = -math.inf,
    stop_s: float = math.inf,
) -> None:
    """Clip each sample: near the limit its noise is cut off on one side, and so is what contact
    adds to the rate that the wheels tell.

    A smooth rate would reach the limit too early and too late.
    """
    m = p.motion
    noise_rad_s = m.gyro_noise_lsb / m.gyro_sensitivity_lsb_per_rad_s
    sd = np.maximum(np.hypot(noise_rad_s, contact_m_per_sqrt_m * _per_contact_rad_s(m)), 1e-12)
    rate = rate_with_details(p)
    unseen = sd * (_mean_beyond((rate - limit) / sd) - _mean_beyond((-limit - rate) / sd))
    p.gyro_rad_s = p.gyro_rad_s - np.where(_between(m, start_s, stop_s), unseen, 0.0)


def _between(m: Motion, start_s: float, stop_s: float) -> NDArray[np.bool_]:
    return (m.t_s >= start_s) & (m.t_s <= stop_s)


def unseen_beyond(
    m: Motion,
    *,
    limit: float,
    contact_m_per_sqrt_m: float,
    start_s: float = -math.inf,
    stop_s: float = math.inf,
) -> Floats:
    """Return by how much of a tick's turn that contact makes a clipped gyro sees nothing, as its
    variance, rad², float64[n]."""
    sd = np.maximum(contact_m_per_sqrt_m * _per_contact_rad_s(m), 1e-12)
    away = (np.abs(m.turn_rate_rad_s) - limit) / sd
    mean = _mean_beyond(away)
    square = (1.0 + away**2) * ndtr(away) + away * np.exp(-0.5 * away**2) / np.sqrt(2 * np.pi)
    unseen = (sd * m.tick_s) ** 2 * np.maximum(square - mean**2, 0.0)
    return np.where(_between(m, start_s, stop_s), unseen, 0.0)


def _mean_beyond(away: Floats) -> Floats:
    """Return the mean of the positive part of a normal value of mean *away* and deviation 1."""
    density = np.exp(-0.5 * away**2) / np.sqrt(2 * np.pi)
    return np.asarray(density + away * ndtr(away), dtype=np.float64)


def adc_inl(p: Prediction, *, peak: float) -> None:
    """Bend the converter: code += peak * sin(pi * code / full scale)."""
    m = p.motion
    code = m.gyro_zero_rate_code + m.gyro_sensitivity_lsb_per_rad_s * p.gyro_rad_s
    bend = peak * np.sin(np.pi * code / m.adc_max_code)
    p.gyro_rad_s = p.gyro_rad_s + bend / m.gyro_sensitivity_lsb_per_rad_s


def adc_stuck_bit(
    p: Prediction,
    *,
    bit: int,
    value: int,
    contact_m_per_sqrt_m: float,
    start_s: float = -math.inf,
    stop_s: float = math.inf,
) -> None:
    """Hold one bit of the code: what that adds on average over what the wheels do not tell of it,
    the noise of a sample and the rate that their contact leaves to chance.

    The rate is as sharp as the counters where it changes, and smooth where it does not.
    """
    m = p.motion
    rate_rad_s = _changing_rate(m, p.gyro_rad_s)
    code = m.gyro_zero_rate_code + m.gyro_sensitivity_lsb_per_rad_s * rate_rad_s
    chance = _chance_held(m, code, bit, contact_m_per_sqrt_m)
    added = (1 << bit) * ((1.0 - chance) if value else -chance)
    held = np.where(_between(m, start_s, stop_s), added, 0.0)
    p.gyro_rad_s = p.gyro_rad_s + held / m.gyro_sensitivity_lsb_per_rad_s


def jumps_of_stuck_bit(
    m: Motion,
    *,
    bit: int,
    value: int,
    contact_m_per_sqrt_m: float,
    start_s: float = -math.inf,
    stop_s: float = math.inf,
) -> Floats:
    """Return by how much more a tick's turn varies as a held bit comes and goes, rad², float64[n].

    Whether it is held set or clear, it is there or not, and goes with the noise that makes it so:
    of a normal value x, cov(f(x), x) is var(x) times the slope of f's mean (Stein 1981).
    """
    rate_rad_s = _changing_rate(m, m.turn_rate_rad_s)
    mean = m.gyro_zero_rate_code + m.gyro_sensitivity_lsb_per_rad_s * rate_rad_s
    code, noise_lsb = np.clip(mean, 0, m.adc_max_code), _noise_lsb(m, contact_m_per_sqrt_m)
    chance = chance_of_bit(code, noise_lsb, bit)
    height = float(1 << bit)
    with_noise = -height * noise_lsb**2 * slope_of_chance(code, noise_lsb, bit)
    more_lsb2 = np.maximum(height**2 * chance * (1.0 - chance) + 2.0 * with_noise, 0.0)
    jumps = more_lsb2 * (m.tick_s / m.gyro_sensitivity_lsb_per_rad_s) ** 2
    return np.where(_between(m, start_s, stop_s), jumps, 0.0)


def _changing_rate(m: Motion, smooth_rad_s: Floats) -> Floats:
    """Return a smooth rate with what smoothing rounded off of it, as far as it changes by more from
    tick to tick than counters usually tremble, at rest and on a straight too (Wiener's weight)."""
    more_rad_s = rounded_off(m)
    usual_rad_s = 1.4826 * float(np.median(np.abs(more_rad_s)))
    changed2 = gaussian_filter1d(np.gradient(m.turn_rate_rad_s) ** 2, m.turning_s / m.tick_s)
    share = changed2 / np.maximum(changed2 + usual_rad_s**2, 1e-18)
    return np.asarray(smooth_rad_s + share * more_rad_s, dtype=np.float64)


def _chance_held(m: Motion, code: Floats, bit: int, contact_m_per_sqrt_m: float) -> Floats:
    noise_lsb = _noise_lsb(m, contact_m_per_sqrt_m)
    return chance_of_bit(np.clip(code, 0, m.adc_max_code), noise_lsb, bit)


def _noise_lsb(m: Motion, contact_m_per_sqrt_m: float) -> Floats:
    """Return how far a sample is off what the wheels say of it, float64[n]: it is taken at some
    time of its tick, in which the rate may change."""
    rolled_rad_s = contact_m_per_sqrt_m * _per_contact_rad_s(m)
    changed_rad_s = np.gradient(m.turn_rate_rad_s) / np.sqrt(12.0)
    off_lsb = m.gyro_sensitivity_lsb_per_rad_s * np.hypot(rolled_rad_s, changed_rad_s)
    return np.asarray(np.hypot(m.gyro_noise_lsb, off_lsb), dtype=np.float64)


def chance_of_bit(code: Floats, noise_lsb: Floats, bit: int) -> Floats:
    """Return how often rounding a normal value of this mean and deviation sets a bit, float64[n].

    A quadrature of the jumps between a bit's two values would miss some of them.
    """
    sd = np.maximum(noise_lsb, 1e-9)
    chance = np.zeros(len(code))
    for first, end in _cells(code, bit):
        chance += ndtr(end / sd) - ndtr(first / sd)
    # Beyond that as often as not, to 1 in 10^8.
    return np.where(noise_lsb >= float(2 << bit), 0.5, chance)


def slope_of_chance(code: Floats, noise_lsb: Floats, bit: int) -> Floats:
    """Return by how much `chance_of_bit` grows with the mean, per code, float64[n]."""
    sd = np.maximum(noise_lsb, 1e-9)
    slope = np.zeros(len(code))
    for first, end in _cells(code, bit):
        slope += np.exp(-0.5 * (first / sd) ** 2) - np.exp(-0.5 * (end / sd) ** 2)
    slope = np.where(noise_lsb >= float(2 << bit), 0.0, slope)
    return np.asarray(slope / (sd * np.sqrt(2 * np.pi)))


def _cells(code: Floats, bit: int) -> Iterator[tuple[Floats, Floats]]:
    """Return where values begin and end, seen from *code*, that are rounded to codes with the bit,
    more than six deviations of up to their distance either way."""
    period = float(2 << bit)
    at = np.mod(code + 0.5, period)
    for cell in range(-7, 8):
        end = (cell + 1) * period - at
        yield end - period / 2, end


def _per_contact_rad_s(motion: Motion) -> Floats:
    """Return the standard deviation of a tick's mean turn rate beyond what the wheels say, for
    contact noise of 1 m/sqrt(m), float64[n].

    Their contact is a random walk over the way, of which a reference sees none in a tick.
    """
    way_m_s = motion.radius_m * (np.abs(motion.left_rate_rad_s) + np.abs(motion.right_rate_rad_s))
    return np.asarray(np.sqrt(way_m_s / motion.tick_s) / motion.wheelbase_m)


def gyro_frozen(p: Prediction, *, start_s: float, stop_s: float) -> None:
    """Repeat one code in a window."""
    m = p.motion
    inside = (m.t_s > start_s) & (m.t_s <= stop_s)
    if m.gyro_code is None or not inside.any():
        return
    code = float(m.gyro_code[np.flatnonzero(inside)[0]])
    held = (code - m.gyro_zero_rate_code) / m.gyro_sensitivity_lsb_per_rad_s
    p.gyro_rad_s = np.where(inside, held, p.gyro_rad_s)


def gyro_factor(p: Prediction, *, factor: float) -> None:
    """Read the rate wrong by a factor: so gross that the unsmoothed turn is multiplied."""
    m = p.motion
    turn = np.diff(m.heading_rad, prepend=m.heading_rad[0])
    p.gyro_rad_s = p.gyro_rad_s + (factor - 1) * turn / np.maximum(m.dt_s, 1e-9)
