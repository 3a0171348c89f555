"""What a robot can do in a mission, in the kernel's own units."""

from __future__ import annotations

import math
from dataclasses import dataclass

from firmware_model import KernelConfig
from precision_study.errors import StudyError

_LONGEST_MISSION_S = 366 * 86_400.0


@dataclass(frozen=True)
class Envelope:
    """The inputs that are asked about; what lies outside is refused or held by the kernel.

    How fast the robot accelerates enters no intermediate: the kernel takes a step from rest to top
    speed within a tick, so every acceleration is covered.

    Attributes:
        step_ticks: largest increment of a wheel in one tick [encoder ticks].
        gap_ticks: longest stretch without encoder frames that is bridged [ticks].
        mission_ticks: length of the mission [ticks].
        code_low, code_high: smallest and largest code of the gyro that is believed [LSB].
        offset_low_q, offset_high_q: range of the zero-rate offset, as it may be learnt at rest.
    """

    step_ticks: int
    gap_ticks: int
    mission_ticks: int
    code_low: int
    code_high: int
    offset_low_q: int
    offset_high_q: int

    @classmethod
    def of(
        cls, config: KernelConfig, *, mission_s: float = 3600.0, speed_m_s: float | None = None
    ) -> Envelope:
        """Return the envelope of the configured robot.

        Args:
            config: from `build_config`.
            mission_s: length of the mission [s].
            speed_m_s: fastest ground speed of a wheel [m/s]; None: the described one.

        Raises:
            StudyError: a mission or a speed that is none.
        """
        known = config.constants
        if not 0.0 < mission_s <= _LONGEST_MISSION_S:
            raise StudyError(f"mission = {mission_s:g} s: expected more than 0, at most a year")
        fastest_m_s = known.max_wheel_rate_rad_s * known.wheel_radius_m
        speed = fastest_m_s if speed_m_s is None else speed_m_s
        if not 0.0 < speed <= fastest_m_s * (1.0 + 1e-12):
            raise StudyError(
                f"speed = {speed:g} m/s: expected more than 0, at most {fastest_m_s:.6g} m/s, "
                "what drive.max_wheel_rate_rad_s and the radius give"
            )
        tick_m = 2.0 * math.pi * known.wheel_radius_m / known.ticks_per_rev
        # At one speed a counter gains its rate rounded down or up.
        step_ticks = min(math.ceil(speed * known.tick_period_s / tick_m), config.max_step_ticks)
        mission_ticks = math.ceil(mission_s / known.tick_period_s)
        low, high = config.gyro_min_code + 1, config.gyro_max_code - 1
        shift = config.offset_frac_bits
        rest, zero = config.rest_max_rate_q, config.zero_rate_code_q
        # An offset is a mean of codes at rest: it lies between the extreme ones of those.
        low_at_rest = max(-((rest - zero) >> shift), low)
        high_at_rest = min((zero + rest) >> shift, high)
        can_learn = learning_ticks(config) <= mission_ticks and low_at_rest <= high_at_rest
        return cls(
            step_ticks=step_ticks,
            gap_ticks=min(config.gap_limit_ticks, mission_ticks),
            mission_ticks=mission_ticks,
            code_low=low,
            code_high=high,
            offset_low_q=min(zero, low_at_rest << shift) if can_learn else zero,
            offset_high_q=max(zero, high_at_rest << shift) if can_learn else zero,
        )


def learning_ticks(config: KernelConfig) -> int:
    """Return how long a rest lasts after which its first estimate is in use [ticks]."""
    return config.still_ticks + 2 * config.settle_ticks + (1 << config.offset_block_log2)
