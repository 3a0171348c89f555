"""Which constants of ``robot.toml`` a found effect corrects, and to what."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import Candidate, NumberEstimate
from hil_harness.robot import Robot


@dataclass(frozen=True)
class Correction:
    """One constant that a found effect corrects.

    Attributes:
        effect: the effect that thereby is taken up by the description.
        table, key: where the constant stands in ``robot.toml``.
        before, after: its values; whole numbers stay whole.
        sd: standard deviation of `after` (before it was made whole).
    """

    effect: str
    table: str
    key: str
    before: float | int
    after: float | int
    sd: float


Rule = Callable[[Robot, float, float], Correction | None]
"""From the robot, estimate and standard deviation to the correction; None: cannot be expressed."""


def corrections(diagnosis: Diagnosis, robot: Robot) -> tuple[Correction, ...]:
    """Return the constants that the winning effects correct, in the order of the effects.

    An effect with a value that ``robot.toml`` cannot hold (a fraction of a tick) is left out; so is
    one that acts for a while, and a second effect on a constant that the first has corrected.
    """
    known = diagnosis.which[0].parameters
    found: dict[tuple[str, str], Correction] = {}
    for key, (estimate, sd) in _numbers(diagnosis.which[0]).items():
        rule = _RULES.get(key)
        if {f"{key.partition('.')[0]}.{end}" for end in ("start_s", "stop_s")} & known.keys():
            continue
        correction = None if rule is None else rule(robot, estimate, sd)
        if correction is not None:
            found.setdefault((correction.table, correction.key), correction)
    return tuple(found.values())


def _numbers(candidate: Candidate) -> dict[str, tuple[float, float]]:
    return {
        key: (parameter.estimate, parameter.sd)
        for key, parameter in candidate.parameters.items()
        if isinstance(parameter, NumberEstimate)
    }


def _radius(robot: Robot, scale: float, sd: float) -> Correction:
    radius = robot.plant.wheels.radius_m
    return Correction(
        "radius_scale", "wheels", "radius_m", radius, radius * (1 + scale), radius * sd
    )


def _wheelbase(robot: Robot, scale: float, sd: float) -> Correction:
    base = robot.plant.wheels.wheelbase_m
    return Correction(
        "wheelbase_scale", "wheels", "wheelbase_m", base, base * (1 + scale), base * sd
    )


def _ticks(robot: Robot, scale: float, sd: float) -> Correction | None:
    ticks = robot.plant.encoder.ticks_per_rev
    exact = ticks * (1 + scale)
    if abs(round(exact) - exact) > robot.tolerance.radius_scale * exact:
        return None
    return Correction("ticks_per_rev", "encoder", "ticks_per_rev", ticks, round(exact), ticks * sd)


def _wrap(robot: Robot, bits: float, sd: float) -> Correction:
    width = robot.plant.encoder.counter_bits
    return Correction("encoder_wrap", "encoder", "counter_bits", width, round(bits), sd)


def _sensitivity(effect: str) -> Rule:
    def correct(robot: Robot, scale: float, sd: float) -> Correction:
        old = robot.plant.gyro.sensitivity_lsb_per_rad_s
        key = "sensitivity_lsb_per_rad_s"
        return Correction(effect, "gyro", key, old, old * (1 + scale), old * sd)

    return correct


def _zero_code(effect: str, *, in_codes: bool) -> Rule:
    def correct(robot: Robot, offset: float, sd: float) -> Correction | None:
        gyro = robot.plant.gyro
        lsb = 1.0 if in_codes else gyro.sensitivity_lsb_per_rad_s
        exact = gyro.zero_rate_code + offset * lsb
        left_rad_s = abs(round(exact) - exact) / gyro.sensitivity_lsb_per_rad_s
        is_on_scale = 0 <= round(exact) <= robot.plant.adc.max_code
        if left_rad_s > robot.tolerance.gyro_bias_rad_s or not is_on_scale:
            return None
        old = gyro.zero_rate_code
        return Correction(effect, "gyro", "zero_rate_code", old, round(exact), sd * lsb)

    return correct


def _level(effect: str, table: str, key: str, *, added: bool = False) -> Rule:
    """Return the rule of a constant that the effect's value replaces, or is added to."""

    def correct(robot: Robot, value: float, sd: float) -> Correction:
        old = float(getattr(getattr(robot.plant, table), key))
        return Correction(effect, table, key, old, max(0.0, old + value if added else value), sd)

    return correct


_RULES: Final[Mapping[str, Rule]] = MappingProxyType(
    {
        "radius_scale.scale": _radius,
        "wheelbase_scale.scale": _wheelbase,
        "ticks_per_rev.scale": _ticks,
        "encoder_wrap.bits": _wrap,
        "gyro_scale.scale": _sensitivity("gyro_scale"),
        "adc_gain.gain": _sensitivity("adc_gain"),
        "gyro_bias.bias": _zero_code("gyro_bias", in_codes=False),
        "adc_offset.offset": _zero_code("adc_offset", in_codes=True),
        "gyro_saturation.limit": _level("gyro_saturation", "gyro", "range_rad_s"),
        "gyro_noise.density": _level("gyro_noise", "gyro", "noise_density_rad_per_sqrt_s"),
        "gyro_bias_walk.density": _level(
            "gyro_bias_walk", "gyro", "bias_walk_density_rad_s_per_sqrt_s"
        ),
        "drive_lag.time_constant": _level("drive_lag", "drive", "time_constant_s", added=True),
        "drive_delay.delay": _level("drive_delay", "drive", "delay_s", added=True),
        "drive_saturation.limit": _level("drive_saturation", "drive", "max_wheel_rate_rad_s"),
        "drive_acceleration_limit.limit": _level(
            "drive_acceleration_limit", "drive", "max_wheel_acceleration_rad_s2"
        ),
    }
)
