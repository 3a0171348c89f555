"""How the real robot differs from its description: one number per physical cause.

Names, units and signs follow the effect catalogue: a ratio is real/described − 1, a difference is
real − described, a limit is the smaller of described and given, a noise level is the larger of
described and given. Every field is neutral by default, and neutral changes nothing, bit for bit.
"""

from __future__ import annotations

import math
import reprlib
from dataclasses import dataclass, field, fields
from numbers import Integral, Real
from typing import Any

from sim_plant.errors import PlantError

INF = math.inf


def _mechanism(
    unit: str, meaning: str, *, neutral: float = 0.0, low: float = -INF, high: float = INF
) -> Any:
    """Return a field with its neutral value, unit and admitted closed range [low, high]."""
    metadata = {"unit": unit, "meaning": meaning, "low": low, "high": high}
    return field(default=neutral, metadata=metadata)


def _ratio(meaning: str) -> Any:
    return _mechanism("1", meaning, low=-0.9, high=9.0)


def _level(unit: str, meaning: str, high: float = 1e3) -> Any:
    return _mechanism(unit, meaning, low=0.0, high=high)


def _signed(unit: str, meaning: str, limit: float = 1e3) -> Any:
    return _mechanism(unit, meaning, low=-limit, high=limit)


def _limit(unit: str, meaning: str) -> Any:
    return _mechanism(unit, meaning, neutral=INF, low=1e-9)


def _from_time(meaning: str, *, neutral: float) -> Any:
    return _mechanism("s", meaning, neutral=neutral, low=-INF, high=INF)


@dataclass(frozen=True, kw_only=True)
class Mechanisms:
    """Every physical deviation the plant knows, in SI units; all neutral by default.

    Raises:
        PlantError: a value that is not a number or out of range; one line naming the field, the
            value and what would be right.
    """

    # actuation: commanded wheel rate to wheel rate
    drive_gain_left: float = _ratio("steady left wheel rate over commanded − 1")
    drive_gain_right: float = _ratio("steady right wheel rate over commanded − 1")
    drive_deadband_rad_s: float = _level("rad/s", "smaller commanded wheel rates give no motion")
    drive_saturation_rad_s: float = _limit("rad/s", "largest wheel rate reached")
    drive_acceleration_limit_rad_s2: float = _limit("rad/s²", "largest wheel acceleration")
    drive_lag_s: float = _level("s", "first-order lag beyond the described one", 10.0)
    drive_delay_s: float = _level("s", "pure delay beyond the described one", 1.0)
    drive_cogging_left: float = _level("1", "left wheel rate × (1 + A·sin(order·φ + phase))", 0.9)
    drive_cogging_right: float = _level("1", "right wheel rate × (1 + A·sin(order·φ + phase))", 0.9)
    drive_cogging_order: int = _mechanism(
        "1", "waves per wheel turn", neutral=1, low=1, high=10_000
    )
    drive_cogging_phase_rad: float = _signed("rad", "its phase", 1e3)
    backlash_left_rad: float = _level(
        "rad", "left encoder turns this far after a reversal before the wheel follows", 3.2
    )
    backlash_right_rad: float = _level(
        "rad", "right encoder turns this far after a reversal before the wheel follows", 3.2
    )

    # wheel: geometry
    radius_scale: float = _ratio("both rolling radii; + is a larger wheel")
    radius_mismatch: float = _mechanism(
        "1", "(r_right − r_left)/mean; + turns left when both wheels turn alike", low=-1.0, high=1.0
    )
    wheelbase_scale: float = _ratio("+ turns less than counted")
    payload_left: float = _mechanism("1", "left radius × (1 − compression)", low=0.0, high=0.9)
    payload_right: float = _mechanism("1", "right radius × (1 − compression)", low=0.0, high=0.9)
    tyre_drift_per_s: float = _signed("1/s", "both radii × (1 + rate·t), at least × 0.1", 1e-3)
    turn_scrub: float = _mechanism(
        "1", "wheelbase × (1 + scrub·|ω|b/(|ω|b + 2|v|)): full in a spin", low=-0.9, high=9.0
    )

    # wheel: contact
    slip_ratio_left: float = _mechanism(
        "1", "left ground step = wheel step·(1 − ratio) inside the window", low=-9.0, high=1.0
    )
    slip_ratio_right: float = _mechanism(
        "1", "right ground step = wheel step·(1 − ratio) inside the window", low=-9.0, high=1.0
    )
    slip_start_s: float = _from_time("start of the slip ratios' window", neutral=-INF)
    slip_stop_s: float = _from_time("end of the slip ratios' window", neutral=INF)
    contact_offset_left_m: float = _signed(
        "m", "added to the left ground step of each tick in which the wheel turns", 1.0
    )
    contact_offset_right_m: float = _signed(
        "m", "added to the right ground step of each tick in which the wheel turns", 1.0
    )
    micro_slip_step_left_m: float = _level(
        "m", "standard deviation of the left contact noise per tick in which the wheel turns", 1.0
    )
    micro_slip_step_right_m: float = _level(
        "m", "standard deviation of the right contact noise per tick in which the wheel turns", 1.0
    )
    micro_slip_left_m_per_sqrt_m: float = _level(
        "m/√m", "left contact noise as a random walk over distance", 1.0
    )
    micro_slip_right_m_per_sqrt_m: float = _level(
        "m/√m", "right contact noise as a random walk over distance", 1.0
    )
    slip_wander_left: float = _level(
        "1",
        "standard deviation of the share by which the left wheel slips, now more, now less",
        1.0,
    )
    slip_wander_right: float = _level(
        "1",
        "standard deviation of the share by which the right wheel slips, now more, now less",
        1.0,
    )
    longitudinal_slip_s2_per_m: float = _level(
        "s²/m", "ground step = wheel step·(1 − c·a_wheel·sign v_wheel)", 1.0
    )
    lateral_slip_s: float = _level("s", "v_y = −c·v·ω, outward", 10.0)
    lateral_slip_speed_m_s: float = _level(
        "m/s",
        "where c holds, to grow with the speed as a tyre's slip angle does; 0: at any speed",
        100.0,
    )
    cross_slope_ratio: float = _level("1", "v_y = ratio·|v|·sin(direction − θ)", 1.0)
    cross_slope_direction_rad: float = _signed("rad", "downhill, in the world", 1e3)
    grade_slip_ratio: float = _level(
        "1", "ground step = wheel step·(1 + ratio·sign(v)·cos(direction − θ))", 1.0
    )
    grade_slip_direction_rad: float = _signed("rad", "downhill, in the world", 1e3)
    wheel_toe_rad: float = _signed("rad", "v_y = v·tan(angle): rolls to the left of body x", 1.0)
    wheel_eccentricity_left: float = _level(
        "1", "left rolling radius × (1 + A·cos(φ + phase))", 0.9
    )
    wheel_eccentricity_right: float = _level(
        "1", "right rolling radius × (1 + A·cos(φ + phase))", 0.9
    )
    wheel_eccentricity_phase_left_rad: float = _signed("rad", "phase of the left one", 1e3)
    wheel_eccentricity_phase_right_rad: float = _signed("rad", "phase of the right one", 1e3)
    caster_kick_rad: float = _signed(
        "rad", "yaw added after each reversal, in the sense of the last turn before it", 1.0
    )
    caster_kick_length_m: float = _mechanism(
        "m", "distance over which the kick is spread", neutral=0.1, low=1e-3, high=10.0
    )
    floor_bump_s: float = _from_time("when the pose is bumped", neutral=INF)
    floor_bump_yaw_rad: float = _signed("rad", "yaw that no encoder sees", 10.0)
    floor_bump_forward_m: float = _signed("m", "forward step that no encoder sees", 10.0)

    # encoder
    ticks_scale: float = _ratio("counts per turn; + counts more than described")
    encoder_eccentricity_left_rad: float = _level("rad", "measured = φ + A·sin(φ + phase)", 3.2)
    encoder_eccentricity_right_rad: float = _level("rad", "measured = φ + A·sin(φ + phase)", 3.2)
    encoder_eccentricity_phase_left_rad: float = _signed("rad", "phase of the left one", 1e3)
    encoder_eccentricity_phase_right_rad: float = _signed("rad", "phase of the right one", 1e3)
    encoder_dead_left_s: float = _from_time("left count frozen from then on", neutral=INF)
    encoder_dead_right_s: float = _from_time("right count frozen from then on", neutral=INF)

    missed_ticks_left: float = _level("1", "left ticks are lost with this probability", 1.0)
    missed_ticks_right: float = _level("1", "right ticks are lost with this probability", 1.0)
    missed_ticks_threshold_rad_s: float = _level("rad/s", "at faster wheel rates only", 1e4)
    extra_ticks_left_per_s: float = _signed("1/s", "spurious left counts, + counts up", 1e5)
    extra_ticks_right_per_s: float = _signed("1/s", "spurious right counts, + counts up", 1e5)
    quadrature_left_rad: float = _signed(
        "rad", "left channel B off its 90° (electrical angle)", 1.5
    )
    quadrature_right_rad: float = _signed(
        "rad", "right channel B off its 90° (electrical angle)", 1.5
    )
    encoder_wrap_bits: int = _mechanism(
        "1", "the counters wrap at this width, 0: as described", neutral=0, low=0, high=16
    )

    # gyro
    gyro_bias_rad_s: float = _signed("rad/s", "added to the measured rate")
    gyro_bias_walk_rad_s_per_sqrt_s: float = _level("rad/s/√s", "random walk of the bias", 1.0)
    gyro_noise_rad_per_sqrt_s: float = _level("rad/√s", "angle random walk", 10.0)
    gyro_scale: float = _ratio("measured = (1 + scale)·true")
    gyro_quadratic_s_per_rad: float = _signed("s/rad", "measured = ω + q·ω·|ω|", 10.0)
    gyro_cubic_s2_per_rad2: float = _signed("s²/rad²", "measured = ω + c·ω³", 10.0)
    gyro_asymmetry: float = _signed("1", "scale +a/2 for ω > 0, −a/2 for ω < 0", 1.0)
    gyro_g_sensitivity_x_s_per_m: float = _signed("rad/s per m/s²", "measured = ω + x·a_x", 10.0)
    gyro_g_sensitivity_y_s_per_m: float = _signed("rad/s per m/s²", "measured = ω + y·a_y", 10.0)
    gyro_roll_rad: float = _signed("rad", "tilt of the sensor: scale cos(roll)", 1.5)
    gyro_pitch_rad: float = _signed("rad", "tilt of the sensor: scale cos(pitch)", 1.5)
    gyro_temperature_bias_rad_s_per_k: float = _signed("rad/s/K", "bias slope about 298.15 K", 1.0)
    gyro_temperature_scale_per_k: float = _signed("1/K", "scale slope about 298.15 K", 0.1)
    gyro_saturation_rad_s: float = _limit("rad/s", "the measured rate clips here")
    gyro_lag_s: float = _level("s", "first-order filter of the rate", 10.0)
    gyro_vibration_s_per_rad: float = _signed(
        "s/rad", "bias += coefficient·mean(φ̇_left², φ̇_right²)", 1.0
    )
    gyro_frozen_start_s: float = _from_time("from here the code repeats", neutral=INF)
    gyro_frozen_stop_s: float = _from_time("until here", neutral=INF)
    supply_ratio: float = _signed("1", "gyro scale = coefficient·(supply/described − 1)", 10.0)

    # adc of the gyro
    adc_offset_lsb: float = _signed("LSB", "added to the code", 65535.0)
    adc_gain: float = _ratio("about the described zero-rate code")
    adc_inl_lsb: float = _signed("LSB", "code += peak·sin(π·code/full scale)", 65535.0)
    adc_missing_code: int = _mechanism(
        "LSB", "never appears, the next higher one stands for it", neutral=-1, low=-1, high=65535
    )
    adc_stuck_bit: int = _mechanism(
        "1", "bit that never changes, 0 = least, −1 = none", neutral=-1, low=-1, high=15
    )
    adc_stuck_value: int = _mechanism("1", "value of the stuck bit", neutral=0, low=0, high=1)

    # accelerometer
    accel_bias_x_m_s2: float = _signed("m/s²", "added to the measured x specific force")
    accel_bias_y_m_s2: float = _signed("m/s²", "added to the measured y specific force")
    accel_noise_m_s2_per_sqrt_hz: float = _level("m/s²/√Hz", "white noise of both axes")

    # environment: what the thermometer and voltmeter see, and what the gyro feels
    temperature_offset_k: float = _signed("K", "real − described temperature at the start", 300.0)
    temperature_rise_k: float = _signed("K", "warming by self-heating, in the end", 300.0)
    temperature_time_constant_s: float = _mechanism(
        "s", "time constant of the warming", neutral=300.0, low=1e-3, high=1e6
    )
    supply_offset_v: float = _signed("V", "real − described supply at the start")
    supply_drift_v_per_s: float = _signed("V/s", "linear drift of the supply", 10.0)

    # the clock that all of this is sampled by
    clock_skew: float = _signed("1", "ECU clock rate over true clock rate − 1; + is fast", 0.05)

    def __post_init__(self) -> None:
        """Refuse what is not a number of the field's kind within the field's range."""
        for item in fields(self):
            value = getattr(self, item.name)
            low, high = item.metadata["low"], item.metadata["high"]
            whole = isinstance(item.default, int)
            kind = Integral if whole else Real
            if isinstance(value, bool) or not isinstance(value, kind) or not low <= value <= high:
                unit = item.metadata["unit"]
                raise PlantError(
                    f"{item.name} = {reprlib.repr(value)}: expected "
                    f"{_expected(whole, low, high)}{'' if unit == '1' else ' ' + unit}, "
                    f"neutral {item.default:g}"
                )


@dataclass(frozen=True)
class MechanismSchedule:
    """Mechanisms that change with time.

    A tick is moved and read under what holds at its middle. Counts go on from where they are.

    Attributes:
        pieces: (from_s, mechanisms) in ascending order; the first holds from the start.
    """

    pieces: tuple[tuple[float, Mechanisms], ...]

    def __post_init__(self) -> None:
        """Refuse what is no schedule."""
        times = [start_s for start_s, _ in self.pieces[1:]]
        if not self.pieces or times != sorted(times):
            raise PlantError("schedule: expected pieces (from_s, mechanisms) in ascending order")
        if len({item.clock_skew for _, item in self.pieces}) > 1:
            raise PlantError("schedule: clock_skew changes: expected one clock rate for the run")


def _expected(whole: bool, low: float, high: float) -> str:
    kind = "a whole number" if whole else "a number"
    if low == -INF and high == INF:
        return kind
    if high == INF:
        return f"{kind} of at least {low:g}"
    return f"{kind} from {low:g} to {high:g}"
