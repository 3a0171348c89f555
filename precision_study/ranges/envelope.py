"""What a robot can do in a mission, in the kernel's own units."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Final

from firmware_model import KernelConfig
from firmware_model.build_scales import PI, exact
from firmware_model.counting import NOISE_DEVIATIONS
from firmware_model.reach import counts_of
from hil_harness.robot import LONGEST_MISSION_S, Robot
from precision_study.errors import StudyError

_RATE_STEPS: Final = 10_000
"""Rates are rounded up to this part of a count per tick: a drive is then told in short numbers."""


@dataclass(frozen=True)
class Envelope:
    """The inputs that are asked about: of a robot that rests at power-on, and of its sensors.

    The way is that of the wheels. A counter gains the way of a stretch rounded down or up, and what
    the noise of two readings adds: a wheel that rests on an edge counts to and fro. Frames may be
    lost for as long as one likes, but none comes late: then the next would tell of the way of two
    ticks in one. The gyro reads any believed code in any tick, whatever the wheels do. Edges that
    are missed, counted twice or spaced unevenly are not asked about, nor is noise that adds up from
    reading to reading (encoder model `lesson_counter`).

    Attributes:
        rate: of the fastest wheel [encoder ticks a tick].
        ramp_ticks: in which the fastest wheel comes from rest to that, whole ones.
        turn_rate: fastest right minus left [encoder ticks a tick].
        gap_ticks: longest stretch without encoder frames that is bridged [ticks].
        mission_ticks: length of the mission [ticks].
        way_ticks: the mission's way, Σ|left + right| of what the wheels go [encoder ticks].
        noise_ticks: by how much the noise of two readings of a counter may differ, and what a
            signal with steps of its own adds [encoder ticks].
        believed_ticks: largest increment of a wheel in a tick that is believed [encoder ticks].
        code_low, code_high: smallest and largest code of the gyro that is believed [LSB].
        offset_low_q, offset_high_q: range of the zero-rate offset, as it may be learnt at rest.
    """

    rate: Fraction
    ramp_ticks: int
    turn_rate: Fraction
    gap_ticks: int
    mission_ticks: int
    way_ticks: int
    noise_ticks: Fraction
    believed_ticks: int
    code_low: int
    code_high: int
    offset_low_q: int
    offset_high_q: int

    @property
    def jitter(self) -> Fraction:
        """By how much both wheels' increments, added or subtracted, may differ from their way."""
        return 2 * (1 + self.noise_ticks)

    @property
    def trembling_ticks(self) -> int:
        """By how many counts of both wheels together wheels at rest may count to and fro."""
        return 2 * max(math.ceil(self.noise_ticks), 1)

    def wheel_ticks(self, ticks: int) -> int:
        """Return the largest increment of a wheel in so many ticks."""
        return min(math.ceil(self.rate * ticks + self.noise_ticks), self.believed_ticks * ticks)

    def turn_ticks(self, ticks: int) -> int:
        """Return the largest right minus left in so many ticks; each may be one off its way."""
        turned = math.ceil(self.turn_rate * ticks + 2 * self.noise_ticks) + 1
        return min(2 * self.wheel_ticks(ticks), turned)

    def ramp_to(self, rate: Fraction) -> int:
        """Return how many ticks a wheel takes from rest to a rate."""
        return math.floor(self.ramp_ticks * rate / self.rate)

    def twice_as_long(self) -> Envelope:
        """Return the same robot in a mission of twice as many ticks."""
        farther = self.way_ticks + 2 * math.ceil(self.rate * self.mission_ticks)
        return replace(self, mission_ticks=2 * self.mission_ticks, way_ticks=farther)

    def as_believed(self) -> Envelope:
        """Return what the kernel believes, whichever way its counters take the wheels to go."""
        fastest = self.believed_ticks
        return replace(
            self,
            rate=Fraction(fastest),
            turn_rate=Fraction(2 * fastest),
            way_ticks=2 * fastest * self.mission_ticks,
            noise_ticks=Fraction(0),
        )

    @classmethod
    def of(
        cls,
        config: KernelConfig,
        *,
        mission_s: float = 3600.0,
        speed_m_s: float | None = None,
        acceleration_rad_s2: float | None = None,
        turn_rate_rad_s: float | None = None,
        distance_m: float | None = None,
        noise_ticks: float = 0.0,
        gyro_noise_rad_s: float = 0.0,
        rounding_ticks: float = 0.0,
    ) -> Envelope:
        """Return the envelope of the configured robot.

        Args:
            config: from `build_config`.
            mission_s: length of the mission [s].
            speed_m_s: fastest ground speed of a wheel [m/s]; None: the described one.
            acceleration_rad_s2: of a wheel [rad/s²]; None: it is at its rate within a tick.
            turn_rate_rad_s: fastest turn of the robot [rad/s]; None: whatever its wheels can do
                and its gyro can tell.
            distance_m: longest way in a mission, to and fro as the wheels go [m]; None: at top
                speed all along.
            noise_ticks: standard deviation of a reading of an encoder [encoder ticks]; six of them
                either way are asked about.
            gyro_noise_rad_s: standard deviation of a reading of the gyro [rad/s]; likewise.
            rounding_ticks: by how much more than a count a reading may be beside the way, where a
                signal has steps of its own [encoder ticks].

        Raises:
            StudyError: a mission, a speed, a rate or a way that is none.
        """
        known, scales = config.constants, exact(config.constants)
        if not 0.0 < mission_s <= LONGEST_MISSION_S:
            raise StudyError(f"mission = {mission_s:g} s: expected more than 0, at most a year")
        fastest_m_s = known.max_wheel_rate_rad_s * known.wheel_radius_m
        speed = fastest_m_s if speed_m_s is None else speed_m_s
        if not 0.0 < speed <= fastest_m_s * (1.0 + 1e-12):
            raise StudyError(
                f"speed = {speed:g} m/s: expected more than 0, at most {fastest_m_s:.6g} m/s, "
                "what drive.max_wheel_rate_rad_s and the radius give"
            )
        for name, given, unit in (
            ("acceleration", acceleration_rad_s2, "rad/s²"),
            ("turn rate", turn_rate_rad_s, "rad/s"),
            ("distance", distance_m, "m"),
        ):
            if given is not None and not 0.0 < given < math.inf:
                raise StudyError(f"{name} = {given:g} {unit}: expected a number above 0")
        tick_s = Fraction(known.tick_period_s)
        mission_ticks = math.ceil(Fraction(mission_s) / tick_s)
        rate = Fraction(speed) * tick_s / (2 * scales.half_tick_m)
        ramp_ticks = 0
        if acceleration_rad_s2 is not None:
            per_tick = Fraction(acceleration_rad_s2) * tick_s**2 * known.ticks_per_rev / (2 * PI)
            rate = min(rate, per_tick * mission_ticks)
            ramp_ticks = math.floor(rate / per_tick)
        rate = min(_rounded_up(rate), Fraction(config.max_step_ticks))
        turn_rate = 2 * rate
        if turn_rate_rad_s is not None:
            turn = Fraction(turn_rate_rad_s) * tick_s / (2 * PI * scales.tick_turn)
            turn_rate = min(turn_rate, _rounded_up(turn))
        way_ticks = 2 * math.ceil(rate * mission_ticks - rate * min(ramp_ticks, mission_ticks) / 2)
        if distance_m is not None:
            way_ticks = min(way_ticks, counts_of(config, distance_m))
        low, high = _believed_codes(config, turn_rate_rad_s, NOISE_DEVIATIONS * gyro_noise_rad_s)
        shift = config.offset_frac_bits
        rest, zero = config.rest_max_rate_q, config.zero_rate_code_q
        # An offset is a mean of codes at rest: it lies between the extreme ones of those.
        low_at_rest = max(-((rest - zero) >> shift), config.gyro_min_code + 1)
        high_at_rest = min((zero + rest) >> shift, config.gyro_max_code - 1)
        can_learn = learning_ticks(config) <= mission_ticks and low_at_rest <= high_at_rest
        return cls(
            rate=rate,
            ramp_ticks=min(ramp_ticks, mission_ticks),
            turn_rate=turn_rate,
            gap_ticks=min(config.gap_limit_ticks, mission_ticks),
            mission_ticks=mission_ticks,
            way_ticks=way_ticks,
            noise_ticks=2 * NOISE_DEVIATIONS * Fraction(noise_ticks) + Fraction(rounding_ticks),
            believed_ticks=config.max_step_ticks,
            code_low=low,
            code_high=high,
            offset_low_q=min(zero, low_at_rest << shift) if can_learn else zero,
            offset_high_q=max(zero, high_at_rest << shift) if can_learn else zero,
        )


def envelope_of(
    robot: Robot,
    config: KernelConfig,
    *,
    mission_s: float | None = None,
    speed_m_s: float | None = None,
    rounding_ticks: float = 0.0,
) -> Envelope:
    """Return the envelope that robot.toml describes in [drive] and [design], or part of it.

    Args:
        robot: described.
        config: from `build_config`.
        mission_s, speed_m_s: other than described.
        rounding_ticks: as in `Envelope.of`; of the bus that the counts come over.

    Raises:
        StudyError: a mission or a speed that is none.
    """
    design, gyro = robot.design, robot.plant.gyro
    return Envelope.of(
        config,
        mission_s=design.mission_s if mission_s is None else mission_s,
        speed_m_s=design.speed_m_s if speed_m_s is None else speed_m_s,
        acceleration_rad_s2=robot.plant.drive.max_wheel_acceleration_rad_s2,
        turn_rate_rad_s=design.turn_rate_rad_s,
        distance_m=design.distance_m,
        noise_ticks=robot.plant.encoder.noise_ticks,
        gyro_noise_rad_s=gyro.noise_density_rad_per_sqrt_s / config.constants.tick_period_s**0.5,
        rounding_ticks=rounding_ticks,
    )


def way(config: KernelConfig, envelope: Envelope) -> str:
    """Return the mission's way and its length, in words."""
    way_m = float(envelope.way_ticks * exact(config.constants).half_tick_m)
    mission_s = envelope.mission_ticks * config.constants.tick_period_s
    return f"{way_m:.4g} m in a mission of {mission_s:g} s"


def trembling(robot: Robot, envelope: Envelope) -> str:
    """Return what encoders may count beyond the way, in words."""
    noise_ticks = robot.plant.encoder.noise_ticks
    rounding = float(envelope.noise_ticks - 2 * NOISE_DEVIATIONS * Fraction(noise_ticks))
    step = f" and rounded by the bus to {rounding:.3g} counts" if rounding > 0.0 else ""
    return (
        "and wheels that tremble on a count's edge, with readings "
        f"{NOISE_DEVIATIONS} × {noise_ticks:g} counts off{step}"
    )


def learning_ticks(config: KernelConfig) -> int:
    """Return how long a rest lasts after which its first estimate is in use [ticks]."""
    return config.still_ticks + 2 * config.settle_ticks + (1 << config.offset_block_log2)


def _rounded_up(rate: Fraction) -> Fraction:
    return Fraction(math.ceil(rate * _RATE_STEPS), _RATE_STEPS)


def _believed_codes(
    config: KernelConfig, turn_rate_rad_s: float | None, noise_rad_s: float
) -> tuple[int, int]:
    """Return the smallest and the largest code that the kernel believes and the robot turns by.

    At rest the gyro may read as much beside its nominal zero as a standstill allows, and a reading
    is off by its noise.
    """
    low, high = config.gyro_min_code + 1, config.gyro_max_code - 1
    if turn_rate_rad_s is None:
        return low, high
    turn = Fraction(turn_rate_rad_s) + Fraction(noise_rad_s)
    turn /= exact(config.constants).sensitivity_rad_s
    span = turn + Fraction(config.rest_max_rate_q, 1 << config.offset_frac_bits)
    zero = Fraction(config.zero_rate_code_q, 1 << config.offset_frac_bits)
    return max(low, math.floor(zero - span)), min(high, math.ceil(zero + span))
