"""Detection limits of what commands, frames, codes and odometry show: simple bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final

from gap_diagnosis.bus import prior as bus
from gap_diagnosis.drive import prior as drive
from gap_diagnosis.hypothesis import Block
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot

Limit = Callable[[Sequence[Recording]], float]

_FEW: Final = 2.0
"""So many frames amiss are no chance."""


def limits_elsewhere(
    recordings: Sequence[Recording], blocks: Sequence[Block]
) -> dict[str, float | None]:
    """Return a limit for every effect that is not the motion's.

    None: no block of these logs can show it. 0: any amount shows, because a replay is exact to the
    last digit, or because the effect is there or not.
    """
    owned = {effect for block in blocks for effect in block.effects}
    return {
        effect: limit(recordings) if effect in owned else None for effect, limit in _LIMITS.items()
    }


def limits_of_twins(limits: Mapping[str, float | None], robot: Robot) -> dict[str, float | None]:
    """Return the limits of effects that are told by another's name, in their own units."""
    found = {
        name: None if (limit := limits.get(known)) is None else convert(limit, robot)
        for name, (known, convert) in _TWINS.items()
        if known in limits
    }
    return {name: limit for name, limit in found.items() if limits.get(name) is None}


def _at(value: float) -> Limit:
    return lambda recordings: value


def _of_frames(least: float) -> Limit:
    def limit(recordings: Sequence[Recording]) -> float:
        frames = max((len(f.t_s) for one in recordings for f in one.frames.values()), default=0)
        return max(least, _FEW / max(frames, 1))

    return limit


def _clock_skew(recordings: Sequence[Recording]) -> float:
    weights = [
        one.clock_skew_sd**-2
        for one in recordings
        if math.isfinite(one.clock_skew_sd) and one.clock_skew_sd > 0
    ]
    sd = math.fsum(weights) ** -0.5 if weights else 0.0
    return max(bus.SKEW.tolerance, math.sqrt(THRESHOLD) * sd)


_ANY: Final = _at(0.0)

_LIMITS: Final[Mapping[str, Limit]] = {
    "drive_gain": _at(drive.GAIN.tolerance),
    "drive_lag": _at(drive.LAG_S.tolerance),
    "drive_delay": _at(drive.DELAY_S.tolerance),
    "drive_deadband": _ANY,
    "drive_saturation": _ANY,
    "drive_acceleration_limit": _ANY,
    "encoder_dead": _ANY,
    "gyro_frozen": _ANY,
    "adc_missing_code": _ANY,
    "adc_stuck_bit": _ANY,
    "frame_loss": _of_frames(bus.present("frame_loss")[0]),
    "frame_duplication": _of_frames(bus.present("frame_duplication")[0]),
    "frame_reordering": _of_frames(bus.present("frame_reordering")[0]),
    "stale_producer": _of_frames(bus.present("stale_producer")[0]),
    "frame_jitter": _at(bus.JITTER_PRESENT_S[0]),
    "frame_latency": _at(bus.LATENCY.tolerance),
    "reception_stamp": _at(bus.POLL_PERIOD_S[0]),
    "bus_gap": _ANY,
    "clock_skew": _clock_skew,
    "firmware_truncation": _ANY,
    "firmware_resolution": _ANY,
    "coarse_trig_table": _ANY,
    "euler_integration": _ANY,
    "stale_heading": _ANY,
    "firmware_constant": _ANY,
    "firmware_overflow": _ANY,
    "moving_calibration": _ANY,
    "auto_zero": _ANY,
    "fixed_tick_period": _ANY,
    "blend_weight": _ANY,
    "missed_deadline": _ANY,
}


def _same(limit: float, robot: Robot) -> float:
    del robot
    return limit


def _code(limit: float, robot: Robot) -> float:
    return limit * robot.plant.gyro.sensitivity_lsb_per_rad_s


def _tilt(limit: float, robot: Robot) -> float:
    """Return the angle whose cosine is 1 - limit."""
    del robot
    return math.acos(max(1.0 - limit, -1.0))


_TWINS: Final[Mapping[str, tuple[str, Callable[[float, Robot], float]]]] = {
    "ticks_per_rev": ("radius_scale", _same),
    "adc_offset": ("gyro_bias", _code),
    "adc_gain": ("gyro_scale", _same),
    "gyro_tilt": ("gyro_scale", _tilt),
}
