"""Each explanation undoes what the simulator's mechanism of that name did."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from motion_cases import (
    EXACT,
    ROBOT,
    WIRE,
    Floats,
    misfit,
    nodes_of,
    setting_of,
    without_noise,
)
from scipy.special import ndtr

from gap_diagnosis.explanations.gyro import (
    chance_of_bit,
    gyro_saturation,
    jumps_of_stuck_bit,
    rate_with_details,
)
from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.explanations.variant import Value
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.prediction import Prediction
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import synthetic_recording, synthetic_recordings
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

Values = Mapping[str, Value]

WARM = (EffectSetting("warm_up", (("offset", 0.0), ("rise", 20.0), ("time_constant", 40.0))),)
SAGGING = (EffectSetting("supply_change", (("offset", -0.2), ("rate", -0.002))),)

SIZED: dict[str, Values] = {
    "radius_scale": {"scale": 0.02},
    "radius_mismatch": {"mismatch": 0.01},
    "payload": {"compression_left": 0.01, "compression_right": 0.02},
    "wheelbase_scale": {"scale": 0.02},
    "turn_scrub": {"scrub": 0.05},
    "longitudinal_slip": {"compliance": 0.03},
    "one_sided_slip": {"side": "left", "ratio": 0.05, "start_s": 40.0, "stop_s": 60.0},
    "lateral_slip": {"compliance": 0.05},
    "cross_slope_drift": {"ratio": 0.02, "direction": 0.7},
    "grade_slip": {"ratio": 0.02, "direction": 0.7},
    "wheel_eccentricity": {"side": "right", "amplitude": 0.02, "phase": 0.6},
    "encoder_eccentricity": {"side": "left", "amplitude": 0.03, "phase": 0.6},
    "backlash": {"side": "right", "width": 0.03},
    "missed_ticks": {"side": "right", "probability": 0.02, "threshold": 0.0},
    "extra_ticks": {"side": "left", "rate": 20.0},
    "gyro_nonlinearity": {"quadratic": 0.02, "cubic": 0.01},
    "gyro_scale": {"scale": 0.02},
    "gyro_asymmetry": {"asymmetry": 0.02},
    "tyre_drift": {"rate": 2e-4},
    "gyro_bias": {"bias": 0.01},
    "gyro_g_sensitivity": {"x": 0.005, "y": 0.005},
    "gyro_vibration": {"coefficient": 1e-4},
    "gyro_lag": {"time_constant": 0.05},
    "adc_inl": {"peak": 60.0},
    "reference_yaw": {"angle": 0.02},
    "reference_lever_arm": {"x": 0.05, "y": -0.03},
    "reference_time_offset": {"offset": 0.02},
    "reference_clock_skew": {"skew": 0.0005},
    "reference_scale": {"scale": 0.01},
    "gyro_temperature_bias": {"slope": 2e-4},
    "gyro_temperature_scale": {"slope": 1e-3},
    "supply_ratio": {"coefficient": 1.0},
}
"""Effects with a size."""

WHOLE: dict[str, Values] = {
    "gyro_saturation": {"limit": 1.5},
    "adc_stuck_bit": {"bit": 7, "value": 1},
    "encoder_dead": {"side": "left", "start_s": 100.0},
    "encoder_wrap": {"bits": 12},
    "gyro_frozen": {"start_s": 30.0, "stop_s": 33.0},
    "setup_wheels_swapped": {},
    "setup_sign": {"signal": "gyro"},
    "setup_unit": {"signal": "gyro", "factor": 0.25},
}
"""Effects that are there or not."""

NO_COLUMN = {"ticks_per_rev", "frame_latency"}
"""Told by another's name, or only where rows are put together by stamps (test_latency)."""

LEFT: dict[str, float] = {
    "longitudinal_slip": 0.12,
    "missed_ticks": 0.2,
    "extra_ticks": 0.2,
}
"""Share of the misfit that may be left where counts come at random, codes have no noise, or a
smoothed acceleration rounds off what the drive's first moments are like."""

DRIVE = replace(scenario("calibration"), seed=3)


def surroundings(effect: str) -> tuple[EffectSetting, ...]:
    if effect.startswith("gyro_temperature"):
        return WARM
    return SAGGING if effect == "supply_ratio" else ()


LAGS_S = (0.005, 0.02, 0.05, 0.1)


@cache
def recordings() -> dict[str, tuple[Recording, Recording]]:
    """Return by effect the recording with it and the same drive without it."""
    chosen = {**SIZED, **WHOLE}
    around = ((), WARM, SAGGING)
    cases = [
        ((*surroundings(name), EffectSetting(name, tuple(values.items()))), 3)
        for name, values in chosen.items()
    ]
    runs = synthetic_recordings(
        without_noise(ROBOT),
        WIRE,
        DRIVE,
        [*cases, *((one, 3) for one in around)],
        reference=EXACT,
    )
    plain = dict(zip(around, runs[len(cases) :], strict=True))
    return {name: (run, plain[surroundings(name)]) for name, run in zip(chosen, runs, strict=False)}


@cache
def as_it_is(effect: str) -> Floats:
    """Return what the description leaves of the recording with an effect; worked out once."""
    return misfit(recordings()[effect][0])


@cache
def undone(effect: str, sign: float = 1.0) -> Floats:
    """Return what is left of it with the effect, or its opposite, taken into account."""
    return explained(recordings()[effect][0], effect, {**SIZED, **WHOLE}[effect], sign)


@cache
def floor_of(around: tuple[EffectSetting, ...]) -> float:
    """Return the energy of what is left of the drive without any effect."""
    plain = next(plain for name, (_, plain) in recordings().items() if surroundings(name) == around)
    return energy(misfit(plain))


def explained(recording: Recording, effect: str, values: Values, sign: float = 1.0) -> Floats:
    def settings(motion):  # type: ignore[no-untyped-def]
        return [
            (variant, tuple(sign * one for one in sizes))
            for variant, sizes in setting_of(motion, effect, values)
        ]

    return misfit(recording, settings, without_noise(ROBOT))


def energy(white: Floats) -> float:
    return float(white @ white)


def test_every_effect_that_is_explained_is_tried_here():
    assert set(EXPLAINED) == SIZED.keys() | WHOLE.keys() | NO_COLUMN


@pytest.mark.parametrize("effect", [*SIZED, *WHOLE])
def test_the_effect_explained_leaves_what_the_drive_without_it_leaves(effect):
    floor = floor_of(surroundings(effect))
    gap = energy(as_it_is(effect)) - floor
    left = energy(undone(effect)) - floor
    assert gap > 100.0
    assert left < LEFT.get(effect, 0.08) * gap


@pytest.mark.parametrize("effect", [name for name in SIZED if name != "gyro_lag"])
def test_the_opposite_effect_makes_it_worse_or_at_least_no_better(effect):
    gap = energy(as_it_is(effect))
    opposite = energy(undone(effect, -1.0))
    assert opposite > 0.8 * gap


@pytest.mark.parametrize("effect", SIZED)
def test_the_size_that_fits_best_is_the_size_that_was_simulated(effect):
    """Least squares along the effect: within a fifth of what noise of the usual level would do.

    Two percent more are allowed for rounding, smoothing and lost counts' chance; spurious counts
    are as many as expected but for a root of their number, of which four are allowed.
    """
    nominal = as_it_is(effect)
    column = nominal - undone(effect)
    best = float(nominal @ column / (column @ column))
    by_chance = 0.0
    if effect == "extra_ticks":
        lasts_s = recordings()[effect][0].duration_s
        by_chance = 4.0 / np.sqrt(SIZED[effect]["rate"] * lasts_s)
    assert abs(best - 1.0) < 0.02 + by_chance + 0.2 / np.sqrt(energy(column))


def test_a_lag_is_read_to_a_hundredth_of_its_size():
    """The tick is 10 ms: a filter taken for its value at the tick's end reads 5 ms off."""
    cases = [((EffectSetting("gyro_lag", (("time_constant", lag),)),), 3) for lag in LAGS_S]
    runs = synthetic_recordings(without_noise(ROBOT), WIRE, DRIVE, cases, reference=EXACT)
    for lag_s, run in zip(LAGS_S, runs, strict=True):
        low, middle, high = (
            energy(explained(run, "gyro_lag", {"time_constant": one}))
            for one in (lag_s - 0.002, lag_s, lag_s + 0.002)
        )
        best = lag_s + 0.001 * (low - high) / (low - 2 * middle + high)
        assert abs(best - lag_s) < 0.01 * lag_s + 1e-4


def test_a_reference_clock_that_runs_far_off_is_read_to_a_thousandth():
    skew = 0.007
    setting = EffectSetting("reference_clock_skew", (("skew", skew),))
    (run,) = synthetic_recordings(
        without_noise(ROBOT), WIRE, DRIVE, [((setting,), 3)], reference=EXACT, duration_s=60.0
    )
    low, middle, high = (
        energy(explained(run, "reference_clock_skew", {"skew": one}))
        for one in (0.99 * skew, skew, 1.01 * skew)
    )
    best = skew + 0.005 * skew * (low - high) / (low - 2 * middle + high)
    assert abs(best - skew) < 1e-3 * skew


def test_a_way_is_no_shorter_where_the_reported_heading_is_far_off():
    """Steps along headings that are 0.15 rad off would be 1.1 % short: a room's scale."""
    values = {"angle": 0.15}
    setting = EffectSetting("reference_yaw", tuple(values.items()))
    runs = [((setting,), 3), ((), 3)]
    aslant, plain = synthetic_recordings(
        without_noise(ROBOT), WIRE, DRIVE, runs, reference=EXACT, duration_s=40.0
    )
    assert energy(explained(aslant, "reference_yaw", values)) < 1.1 * energy(misfit(plain))


def test_lost_counts_at_rest_are_told_from_spurious_ones():
    floor = floor_of(())
    gap = energy(as_it_is("extra_ticks")) - floor
    backwards = energy(undone("extra_ticks", -1.0)) - floor
    assert backwards > 2.0 * gap


@pytest.mark.parametrize("bit", [0, 3, 6])
@pytest.mark.parametrize("noise_lsb", [0.0, 0.4, 7.5, 40.0])
def test_a_stuck_bit_adds_what_its_codes_lose_on_average(bit: int, noise_lsb: float) -> None:
    mean = np.linspace(32760.3, 32790.7, 23)
    whole = np.arange(32768 - 400, 32768 + 400)
    sd = max(noise_lsb, 1e-9)
    share = np.diff(ndtr((np.append(whole, whole[-1] + 1) - 0.5 - mean[:, None]) / sd), axis=1)
    brute = share @ (whole >> bit & 1)
    noise = np.full(len(mean), noise_lsb)
    assert chance_of_bit(mean, noise, bit) == pytest.approx(brute, abs=1e-7)


@pytest.mark.parametrize("away_rad_s", [-0.01, 0.0, 0.02])
def test_near_its_limit_a_gyro_is_clipped_by_what_contact_adds_to_the_wheels_rate(
    away_rad_s: float,
) -> None:
    """Without it a clipped gyro was told to be bent and uneven as well, by 0.997."""
    log = synthetic_recording(ROBOT, WIRE, scenario("spin"), (), 3, duration_s=6.0)
    motion, contact = nodes_of(log).sharp, 5e-4
    row = int(np.argmax(np.abs(motion.turn_rate_rad_s)))
    limit = abs(float(rate_with_details(Prediction(motion))[row])) - away_rad_s
    told = Prediction(motion)
    gyro_saturation(told, limit=limit, contact_m_per_sqrt_m=contact)
    wheels = motion.radius_m * (
        abs(motion.left_rate_rad_s[row]) + abs(motion.right_rate_rad_s[row])
    )
    rolled = contact * np.sqrt(wheels / motion.tick_s) / motion.wheelbase_m
    noise = motion.gyro_noise_lsb / motion.gyro_sensitivity_lsb_per_rad_s
    draws = np.random.default_rng(1).normal(limit + away_rad_s, np.hypot(rolled, noise), 200_000)
    clipped = float(np.clip(draws, -limit, limit).mean())
    cut = abs(float(rate_with_details(Prediction(motion))[row])) - clipped
    change = abs(float(told.gyro_rad_s[row] - motion.turn_rate_rad_s[row]))
    assert change == pytest.approx(cut, abs=4 * np.hypot(rolled, noise) / np.sqrt(200_000))


@pytest.mark.parametrize("value", [0, 1])
@pytest.mark.parametrize("contact_m_per_sqrt_m", [0.0, 3e-4])
def test_a_stuck_bit_makes_codes_vary_with_the_noise_that_brings_it_to_and_fro(
    value: int, contact_m_per_sqrt_m: float
) -> None:
    """By a fifth to a half of their deviation; without that a gyro with a stuck bit was told to
    have another effect besides, and another noise."""
    log = synthetic_recording(ROBOT, WIRE, scenario("straight"), (), 3, duration_s=4.0)
    motion = replace(estimate_motion(log, ROBOT), gyro_noise_lsb=9.0)
    told = jumps_of_stuck_bit(motion, bit=6, value=value, contact_m_per_sqrt_m=contact_m_per_sqrt_m)
    per_code = motion.tick_s / motion.gyro_sensitivity_lsb_per_rad_s
    row = 300
    way_m_s = 2 * motion.speed_m_s[row]
    rolled_rad_s = contact_m_per_sqrt_m * np.sqrt(way_m_s / motion.tick_s) / motion.wheelbase_m
    sd = np.hypot(9.0, rolled_rad_s * motion.gyro_sensitivity_lsb_per_rad_s)
    mean = motion.gyro_zero_rate_code
    mean += motion.gyro_sensitivity_lsb_per_rad_s * motion.turn_rate_rad_s[row]
    true = mean + sd * np.random.default_rng(1).standard_normal(400_000)
    code = np.round(true).astype(int)
    held = code | 64 if value else code & ~64
    more = np.var(true + (held - code)) - np.var(true)
    assert told[row] / per_code**2 == pytest.approx(max(more, 0.0), rel=0.03, abs=0.02 * sd**2)


def test_a_motor_that_hardly_turns_back_has_no_play_to_tell_of() -> None:
    """Of a play that it never crosses no size could be told: the fit's column would be nothing."""
    log = synthetic_recording(ROBOT, WIRE, scenario("straight"), (), 3, duration_s=10.0)
    motion = nodes_of(log, ROBOT).motion
    there = motion.left_steady_rad.copy()
    there[600:604] = -0.02
    back = replace(motion, left_steady_rad=there)
    assert not list(EXPLAINED["backlash"].variants(back))
    there[600:604] = -0.06
    assert list(EXPLAINED["backlash"].variants(replace(motion, left_steady_rad=there)))
