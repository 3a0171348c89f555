"""From a recording to what the ECU's kernel was handed, tick by tick, and what it said."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from can_bus import Arrivals
from firmware_model import FRESH, STALE, FirmwareConstants, FirmwareError, KernelConfig
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.recording import Floats, Ints, Recording
from hil_harness.assembly import Wire
from hil_harness.effect_runs import accepted_frames
from hil_harness.nodes.firmware import firmware_config
from hil_harness.robot import Robot
from hil_harness.signal_roles import Role

Bools = NDArray[np.bool_]

_FINEST_M: Final = 1e-12
_FINEST_RAD: Final = 1e-12
_DIGITS: Final = 12
_LONGEST_GAP_TICKS: Final = 100_000
_MAX_CODE: Final = 65535


@dataclass(frozen=True)
class ReplayInputs:
    """What the kernel takes, on every tick of the ECU's clock, and where the log's rows lie in it.

    Attributes:
        config: the described kernel.
        left_count, right_count, gyro_code: int64[m], 0 where stale.
        encoder_validity, gyro_validity: int8[m]; STALE where the log has no frame, or one that the
            ECU does not use because its stream is not trusted after a silence.
        at_row: int64[n], the tick of each row of the recording.
        t_s: float64[m], log time of each tick.
    """

    config: KernelConfig
    left_count: Ints
    right_count: Ints
    gyro_code: Ints
    encoder_validity: NDArray[np.int8]
    gyro_validity: NDArray[np.int8]
    at_row: Ints
    t_s: Floats

    @property
    def ticks(self) -> int:
        """How many ticks there are."""
        return len(self.left_count)

    def with_gyro_late(self, ticks: int) -> ReplayInputs:
        """Return inputs where each gyro sample is used so many ticks later; below 0, earlier."""
        if ticks == 0:
            return self
        code, validity = np.roll(self.gyro_code, ticks), np.roll(self.gyro_validity, ticks)
        empty = slice(None, ticks) if ticks > 0 else slice(ticks, None)
        code[empty], validity[empty] = 0, STALE
        return replace(self, gyro_code=code, gyro_validity=validity)


@dataclass(frozen=True)
class Odometry:
    """What the ECU said: the recorded pose and the steps in which it was recorded.

    Attributes:
        pose: float64[n, 3]: x [m], y [m], heading [rad, unwrapped]; a row without is NaN.
        quantum_m, quantum_rad: resolution of the record.
    """

    pose: Floats
    quantum_m: float
    quantum_rad: float


def replay_inputs(recording: Recording, robot: Robot, wire: Wire) -> ReplayInputs:
    """Return the recording's counts and codes as the kernel takes them that is known to run.

    Raises HarnessError for a description that no kernel can be built from, and DiagnosisError for
    known effects that no firmware of this description can have.
    """
    config = firmware_config(robot, wire.signal_map, round(recording.tick_period_s * 1e6))
    try:
        known = recording.granted.firmware
        config = known.config(config.description, config.constants)
    except FirmwareError as error:
        raise DiagnosisError(f"{recording.granted.name}: {error}") from None
    at_row = _grid(recording.tick)
    ticks = int(at_row[-1]) + 1

    def on_grid(values: Floats) -> tuple[Ints, Bools]:
        known = np.isfinite(values)
        whole = np.zeros(ticks, np.int64)
        fresh = np.zeros(ticks, np.bool_)
        whole[at_row[known]] = np.rint(values[known]).astype(np.int64)
        fresh[at_row[known]] = True
        return whole, fresh

    left, has_left = on_grid(recording.left_ticks)
    right, has_right = on_grid(recording.right_ticks)
    code, has_gyro = on_grid(_codes(recording, config.constants))
    has_wheels = _is_used(has_left & has_right, "left_count", recording, wire)
    has_gyro = _is_used(has_gyro, "gyro", recording, wire)
    return ReplayInputs(
        config=config,
        left_count=left,
        right_count=right,
        gyro_code=np.clip(code, 0, _MAX_CODE),
        encoder_validity=np.where(has_wheels, FRESH, STALE).astype(np.int8),
        gyro_validity=np.where(has_gyro, FRESH, STALE).astype(np.int8),
        at_row=at_row,
        t_s=np.interp(np.arange(ticks), at_row, recording.t_s),
    )


def _is_used(has_come: Bools, role: Role, recording: Recording, wire: Wire) -> Bools:
    """Return where the ECU uses what has come: no frame that ends a silence, no repetition."""
    mapped = wire.signal_map.get(role)
    frames = None if mapped is None else recording.frames.get(mapped.message.name)
    if mapped is None or frames is None or not frames.modulo or has_come.all():
        return has_come
    tick = frames.counter[(frames.counter >= 0) & (frames.counter < len(has_come))]
    arrivals = Arrivals(tick, tick, tick * wire.tick_period_us)
    return has_come & (accepted_frames(mapped.message, arrivals, wire, len(has_come))[1] >= 0)


def _codes(recording: Recording, known: FirmwareConstants) -> Floats:
    """Return the gyro's codes in those of the kernel, which may differ from the converter's."""
    if recording.gyro_rate_rad_s is None:
        return np.full(len(recording.tick), np.nan)
    per_code = known.gyro_sensitivity_rad_s_per_lsb
    return np.asarray(recording.gyro_rate_rad_s / per_code + known.gyro_zero_rate_code)


def _grid(tick: Ints) -> Ints:
    """Return each row's place among the ticks; a very long gap takes no more than matters."""
    steps = np.diff(tick, prepend=tick[0])
    return np.asarray(np.cumsum(np.minimum(steps, _LONGEST_GAP_TICKS)), np.int64)


def lacks_the_gyro(recording: Recording, robot: Robot) -> bool:
    """Tell whether the described firmware turns by a gyro of which the log has nothing."""
    rate = recording.gyro_rate_rad_s
    has_none = rate is None or not np.isfinite(rate).any()
    return has_none and robot.firmware.mode != "wheel"


def recorded_odometry(recording: Recording, wire: Wire) -> Odometry | None:
    """Return the recorded pose; None where a part of it is missing or hardly ever there."""
    columns = (
        recording.odometry_x_m,
        recording.odometry_y_m,
        recording.odometry_heading_rad,
    )
    if any(column is None for column in columns):
        return None
    pose = np.column_stack([column for column in columns if column is not None])
    pose[~np.isfinite(pose).all(axis=1)] = np.nan
    if np.count_nonzero(np.isfinite(pose[:, 0])) < 3:
        return None
    from_frames = bool(recording.frames)
    quantum_m = max(
        _decimal_step(pose[:, :2]) if not from_frames else _signal_step(wire, "odom_x"),
        _FINEST_M,
    )
    quantum_rad = max(
        _decimal_step(pose[:, 2]) if not from_frames else _signal_step(wire, "odom_heading"),
        _FINEST_RAD,
    )
    return Odometry(pose, quantum_m, quantum_rad)


def _signal_step(wire: Wire, role: str) -> float:
    mapped = wire.signal_map.get(role)  # type: ignore[arg-type]  # both names are roles
    return 0.0 if mapped is None else abs(mapped.si_per_lsb)


def _decimal_step(values: Floats) -> float:
    """Return the decimal step in which *values* were written, 0 where there is none."""
    known = values[np.isfinite(values)]
    known = known[:: max(len(known) // 2000, 1)]
    largest = float(np.max(np.abs(known), initial=1.0))
    for digits in range(_DIGITS + 1):
        step = 10.0**-digits
        slack = max(1e-6 * step, 4.0 * math.ulp(largest))
        if slack < 0.05 * step and np.all(np.abs(known - np.round(known, digits)) <= slack):
            return step
    return 0.0
