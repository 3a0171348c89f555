"""Detection limits of what commands, frames, codes and odometry show, whatever is at work.

What comes by chance is told by how often it could have happened, what a drive does by how much it
moves the wheels; a replay is exact to the last digit.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Final

from scipy.optimize import brentq

from gap_diagnosis.analysis import Reduced
from gap_diagnosis.bus import prior as bus
from gap_diagnosis.bus.stamps import MOST_INDEPENDENT
from gap_diagnosis.drive.block import DriveBlock
from gap_diagnosis.drive.limits import limits_of_answers
from gap_diagnosis.firmware import FirmwareBlock
from gap_diagnosis.firmware.candidates import EFFECTS as FIRMWARE
from gap_diagnosis.firmware.limits import UP_TO
from gap_diagnosis.hypothesis import Block
from gap_diagnosis.ranking import THRESHOLD
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot

Limit = Callable[[Sequence[Recording]], float | None]


def limits_elsewhere(
    recordings: Sequence[Recording], blocks: Sequence[Block]
) -> dict[str, float | None]:
    """Return a limit for every effect that is not the motion's.

    None: no block of these logs can show it. 0: it shows whenever it acts, as what is there or not.
    """
    owned = {effect for block in blocks for effect in block.effects}
    found = {
        effect: limit(recordings) if effect in owned else None for effect, limit in _LIMITS.items()
    }
    # What is wrong by a sign or a factor shows wherever anything does.
    found |= dict.fromkeys(_SETUP, 0.0 if owned else None)
    return (
        found
        | _of_replays(blocks, owned)
        | limits_of_answers([one for one in blocks if isinstance(one, DriveBlock)])
    )


def _of_replays(blocks: Sequence[Block], owned: Set[str]) -> dict[str, float | None]:
    """Return the limits of what odometry frames show: of several logs, of the one with the best."""
    whole = [one.block if isinstance(one, Reduced) else one for one in blocks]
    logs = [one.limits() for one in whole if isinstance(one, FirmwareBlock)]
    found: dict[str, float | None] = dict.fromkeys(FIRMWARE)
    for effect in owned & set(FIRMWARE):
        known = [limit for one in logs if (limit := one.get(effect)) is not None]
        if known:
            found[effect] = max(known) if effect in UP_TO else min(known)
    return found


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


def _of_rate(effect: str) -> Limit:
    """Return how often something must happen to a frame to be separated by 29 from as often as it
    may anyway, at the most: expected counts of the message with the most frames."""
    usual = bus.usual(effect)[1]
    low, high = bus.present(effect)

    def surprise(rate: float, frames: int) -> float:
        once = rate * math.log(rate / usual) + (1 - rate) * math.log((1 - rate) / (1 - usual))
        return 2 * frames * once if rate > usual else 0.0

    def limit(recordings: Sequence[Recording]) -> float | None:
        frames = sum(_frames(recordings))
        if surprise(high, frames) < THRESHOLD:
            return None
        if surprise(low, frames) >= THRESHOLD:
            return low
        return float(brentq(lambda rate: surprise(rate, frames) - THRESHOLD, low, high))

    return limit


def _frames(recordings: Sequence[Recording]) -> list[int]:
    """Return how many frames each log has of the message with the most."""
    return [max((len(f.t_s) for f in one.frames.values()), default=0) for one in recordings]


def _jitter(recordings: Sequence[Recording]) -> float | None:
    """Return the spread that separates by 29 from the largest that is usual: of n independent
    normal values 2 n (log(u / s) + ((s / u)² - 1) / 2)."""
    usual = bus.JITTER_USUAL_S[1]
    stamps = sum(min(frames, MOST_INDEPENDENT) for frames in _frames(recordings))
    share = bus.JITTER_PRESENT_S[1] / usual

    def separation(times: float) -> float:
        return stamps * (times**2 - 1 - 2 * math.log(times))

    if separation(share) < THRESHOLD:
        return None
    return usual * float(brentq(lambda times: separation(times) - THRESHOLD, 1.0, share))


def _latency(recordings: Sequence[Recording]) -> float:
    """Return the delay of one sensor's frames against the others' that separates by 29: how long
    they queue is the same for all frames of a log."""
    sd = bus.LATENCY_USUAL_S / math.sqrt(max(len(recordings), 1))
    return max(bus.LATENCY.tolerance, math.sqrt(THRESHOLD) * sd)


def _clock_skew(recordings: Sequence[Recording]) -> float:
    weights = [
        one.clock_skew_sd**-2
        for one in recordings
        if math.isfinite(one.clock_skew_sd) and one.clock_skew_sd > 0
    ]
    sd = math.fsum(weights) ** -0.5 if weights else 0.0
    return max(bus.SKEW.tolerance, math.sqrt(THRESHOLD) * sd)


_SETUP: Final = ("setup_sign", "setup_unit", "setup_wheels_swapped")

_ANY: Final = _at(0.0)

_LIMITS: Final[Mapping[str, Limit]] = {
    "drive_deadband": _ANY,
    "drive_saturation": _ANY,
    "drive_acceleration_limit": _ANY,
    "encoder_dead": _ANY,
    "gyro_frozen": _ANY,
    "adc_missing_code": _ANY,
    "adc_stuck_bit": _ANY,
    "frame_loss": _of_rate("frame_loss"),
    "frame_duplication": _of_rate("frame_duplication"),
    "frame_reordering": _of_rate("frame_reordering"),
    "stale_producer": _of_rate("stale_producer"),
    "frame_jitter": _jitter,
    "frame_latency": _latency,
    "reception_stamp": _at(bus.POLL_PERIOD_S[0]),
    "bus_gap": _ANY,
    "clock_skew": _clock_skew,
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
