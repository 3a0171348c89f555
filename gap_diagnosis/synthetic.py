"""Recordings without a log: what reading would give of a run with known effects.

For trials, for the floor that noise leaves, and for tests: a run of minutes takes milliseconds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from can_bus import COUNTER_MODULO, MessageSpec
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.clock import Clock, fit_clock, lowered
from gap_diagnosis.reading.counts import unwrap_counts
from gap_diagnosis.reading.wheels import fastest_ticks
from gap_diagnosis.recording import FrameTimes, Recording, Reference
from hil_harness.assembly import Wire
from hil_harness.effect_runs import EffectRun, answer_ticks, run_with_effects
from hil_harness.effects import EffectSetting
from hil_harness.effects.model import Effect
from hil_harness.effects.reference_errors import correlated_noise, measure_over_time
from hil_harness.nodes.plant import COMMAND_ROLES
from hil_harness.nodes.schedule import cycle_of
from hil_harness.odometry_frames import ODOMETRY_ROLES
from hil_harness.robot import Robot
from hil_harness.scenarios import Scenario
from hil_harness.sensor_frames import SENSOR_ROLES, code_scale
from hil_harness.signal_roles import Role

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_US: Final = 1e-6
_PLACE_STREAM: Final = 16

FIRST_SEALED_SEED: Final = 1 << 64
"""From here on seeds belong to blind trials: nobody who diagnoses can draw their noise again."""


@dataclass(frozen=True)
class ReferenceNoise:
    """How well the reference measures; the defaults are those of a good motion capture room.

    Attributes:
        position_m, heading_rad: white noise of one sample, standard deviations.
        coloured_position_m, coloured_heading_rad: slow noise on top (first-order Gauss-Markov).
        correlation_time_s: of the slow noise.
        rate_hz: samples a second; None: one at each tick.
    """

    position_m: float = 0.0005
    heading_rad: float = 0.001
    coloured_position_m: float = 0.0005
    coloured_heading_rad: float = 0.0005
    correlation_time_s: float = 1.0
    rate_hz: float | None = None


def synthetic_recording(
    robot: Robot,
    wire: Wire,
    scenario: Scenario,
    effects: Sequence[EffectSetting],
    seed: int,
    *,
    reference: ReferenceNoise | None = None,
    contact_noise_m_per_sqrt_m: float = 0.0,
    duration_s: float | None = None,
    known: Mapping[str, Effect] | None = None,
) -> Recording:
    """Return the recording of one run; see `synthetic_recordings`."""
    return synthetic_recordings(
        robot,
        wire,
        scenario,
        [(effects, seed)],
        reference=reference,
        contact_noise_m_per_sqrt_m=contact_noise_m_per_sqrt_m,
        duration_s=duration_s,
        known=known,
    )[0]


def synthetic_recordings(
    robot: Robot,
    wire: Wire,
    scenario: Scenario,
    cases: Sequence[tuple[Sequence[EffectSetting], int]],
    *,
    reference: ReferenceNoise | None = None,
    contact_noise_m_per_sqrt_m: float = 0.0,
    duration_s: float | None = None,
    known: Mapping[str, Effect] | None = None,
) -> list[Recording]:
    """Return the recordings of many runs of a scenario, one per case (effects, seed).

    Args:
        robot, wire: the description and the DBC, as for a real log.
        scenario: what is driven.
        cases: effects that are switched on, and the seed of all noise, below `FIRST_SEALED_SEED`.
        reference: how well the truth is measured; None: there is no reference.
        contact_noise_m_per_sqrt_m: micro-slip of each wheel where it is more than described; real
            floors have 0.0001 to 0.003.
        duration_s: None: the scenario's.
        known: the catalogue, with a user's effects in it; None: Chiplog's.

    Raises HarnessError and its relatives for what does not fit together, DiagnosisError for a seed
    that is none of ours.
    """
    if any(seed >= FIRST_SEALED_SEED for _, seed in cases):
        raise DiagnosisError(f"seed: expected less than {FIRST_SEALED_SEED}: the rest is sealed")
    plant = robot.plant
    if contact_noise_m_per_sqrt_m > plant.contact.noise_m_per_sqrt_m:
        contact = plant.contact.model_copy(
            update={"noise_m_per_sqrt_m": contact_noise_m_per_sqrt_m}
        )
        robot = replace(robot, plant=plant.model_copy(update={"contact": contact}))
    ticks = None if duration_s is None else round(duration_s * 1e6) // wire.tick_period_us
    runs = run_with_effects(scenario, robot, wire, cases, ticks=ticks, known=known)
    return [
        _recording(scenario.name, robot, wire, run, seed, reference)
        for run, (_, seed) in zip(runs, cases, strict=True)
    ]


def _recording(
    name: str, robot: Robot, wire: Wire, run: EffectRun, seed: int, noise: ReferenceNoise | None
) -> Recording:
    plant, period_s = robot.plant, wire.tick_period_us * _US
    rows = _Rows(wire, run)
    left = rows.of_role("left_count", run.left_count)
    right = rows.of_role("right_count", run.right_count)
    gyro_code = rows.of_role("gyro", run.gyro_code)
    temperature = rows.of_role("temperature", run.temperature_code)
    supply = rows.of_role("supply", run.supply_code)
    wheels = wire.signal_map["left_count"].message
    stamps = rows.stamps(wheels)
    ticks = np.arange(len(run.time_s), dtype=np.int64)
    there = np.isfinite(stamps)
    clock = _clock(run, rows, wheels, period_s)
    period, fastest = float(1 << plant.encoder.counter_bits), fastest_ticks(plant, period_s)
    v_m_s = rows.of_command("v_command", run.commands[:, 0])
    w_rad_s = rows.of_command("w_command", run.commands[:, 1])
    odometry = rows.odometry()
    first = int(np.argmax(there))
    last = len(there) - int(np.argmax(there[::-1]))
    part = slice(first, last)
    return Recording(
        name=name,
        tick_period_s=period_s,
        t_s=clock.time_s(ticks)[part],
        stamp_s=stamps[part],
        tick=ticks[part] - first,
        left_ticks=unwrap_counts(left, ticks, period, fastest)[part],
        right_ticks=unwrap_counts(right, ticks, period, fastest)[part],
        gyro_code=gyro_code[part],
        gyro_rate_rad_s=(
            (gyro_code - plant.gyro.zero_rate_code) / plant.gyro.sensitivity_lsb_per_rad_s
        )[part],
        temperature_k=_quantity("temperature", _held(temperature), robot)[part],
        supply_v=_quantity("supply", _held(supply), robot)[part],
        v_command_m_s=v_m_s[part],
        w_command_rad_s=w_rad_s[part],
        odometry_x_m=odometry[part, 0],
        odometry_y_m=odometry[part, 1],
        odometry_heading_rad=odometry[part, 2],
        frames=rows.frames(first),
        counter_bits=plant.encoder.counter_bits,
        reference=None if noise is None else _reference(run, seed, noise),
        clock_skew=clock.skew,
        clock_skew_sd=clock.skew_sd,
    )


def _clock(run: EffectRun, rows: _Rows, wheels: MessageSpec, period_s: float) -> Clock:
    """Return the line from ticks to log time; exact where nothing happens to the stamps."""
    tick, segment, stamp_s = rows.stamped(wheels)
    if wheels.name in run.arrivals:
        line = fit_clock(tick, segment, stamp_s, period_s)
        return lowered(line, (rows.stamped(spec) for spec in rows.sensors))
    skew = run.settings.plant.clock_skew
    quantised = _US / (period_s * len(tick) ** 1.5)
    return Clock(np.zeros(1), period_s / (1.0 + skew), skew, quantised, 0.0)


class _Rows:
    """What came of each message, laid on the ticks."""

    def __init__(self, wire: Wire, run: EffectRun) -> None:
        self._wire, self._run = wire, run
        self._ticks = len(run.time_s)
        self._clock_rate = 1.0 + run.settings.plant.clock_skew

    def _sent(self, spec: MessageSpec) -> Ints:
        every, phase = cycle_of(spec, self._wire.tick_period_us)
        return np.arange(phase, self._ticks, every, dtype=np.int64)

    def _came(self, spec: MessageSpec) -> tuple[Ints, Ints, Floats]:
        """Return whose frame, whose payload [ticks] and the stamp of each frame, as they came."""
        return self._landed(spec, self._sent(spec))

    def _landed(self, spec: MessageSpec, sent: Ints) -> tuple[Ints, Ints, Floats]:
        arrivals = self._run.arrivals.get(spec.name)
        if arrivals is None:
            time_us = sent * self._wire.tick_period_us
            frame = payload = sent
        else:
            time_us = arrivals.time_us
            frame, payload = sent[arrivals.frame], sent[arrivals.payload]
        return frame, payload, np.rint(time_us / self._clock_rate) * _US

    def _first(self, frame: Ints, values: Floats) -> Floats:
        """Lay values on the ticks of their frames; of one that came twice the first stands."""
        rows = np.full(self._ticks, np.nan)
        rows[frame[::-1]] = values[::-1]
        return rows

    def odometry(self) -> Floats:
        """Return the pose that the firmware's frames said in each tick: float64[n, 3]."""
        run, rows = self._run, np.full((self._ticks, 3), np.nan)
        for column, role in enumerate(ODOMETRY_ROLES):
            mapped = self._wire.signal_map.get(role)
            if mapped is None:
                continue
            _, payload, _ = self._answered(mapped.message)
            frame = run.answer_tick[payload]
            known = frame < self._ticks
            values = run.pose[payload[known], column]
            rows[:, column] = self._first(frame[known], values)
        return rows

    def _answered(self, spec: MessageSpec) -> tuple[Ints, Ints, Floats]:
        """As `_came`, for a message of the firmware."""
        sent = answer_ticks(spec, self._wire, self._run.executed)
        return self._landed(spec, sent)

    def of_role(self, role: Role, values: Ints) -> Floats:
        """Return what a sensor's frames said in each tick, NaN where none came."""
        mapped = self._wire.signal_map.get(role)
        if mapped is None:
            return values.astype(np.float64)
        frame, payload, _ = self._came(mapped.message)
        return self._first(frame, values[payload].astype(np.float64))

    def of_command(self, role: Role, values: Floats) -> Floats:
        """Return the command that the frames so far say is in force in each tick."""
        mapped = self._wire.signal_map.get(role)
        if mapped is None or mapped.message.name not in self._run.arrivals:
            return values
        frame, payload, _ = self._came(mapped.message)
        return _held(self._first(frame, values[payload]))

    @property
    def sensors(self) -> tuple[MessageSpec, ...]:
        """The messages that carry sensors."""
        return self._wire.signal_map.messages(SENSOR_ROLES)

    def stamped(self, spec: MessageSpec) -> tuple[Ints, Ints, Floats]:
        """Return tick, segment and stamp of each frame of a message."""
        frame, _, stamp_s = self._came(spec)
        return frame, np.zeros(len(frame), dtype=np.int64), stamp_s

    def stamps(self, spec: MessageSpec) -> Floats:
        """Return the stamps of a message's frames in each tick, NaN where none came."""
        frame, _, stamp_s = self._came(spec)
        return self._first(frame, stamp_s)

    def frames(self, first: int) -> dict[str, FrameTimes]:
        """Return when the frames of each message came."""
        signals, run = self._wire.signal_map, self._run
        said: dict[Role, Ints] = {
            "left_count": run.left_count,
            "right_count": run.right_count,
            "gyro": run.gyro_code,
            "temperature": run.temperature_code,
            "supply": run.supply_code,
            "v_command": np.rint(run.commands[:, 0] / 1e-6).astype(np.int64),
            "w_command": np.rint(run.commands[:, 1] / 1e-6).astype(np.int64),
        }
        found = {}
        for spec in signals.messages((*SENSOR_ROLES, *COMMAND_ROLES)):
            frame, payload, stamp_s = self._came(spec)
            word = np.zeros(len(frame), dtype=np.uint64)
            for role, values in said.items():
                mapped = signals.get(role)
                if mapped is not None and mapped.message is spec:
                    part = values[payload].astype(np.uint64)
                    word = word * np.uint64(0x100000001B3) ^ part
            found[spec.name] = _frame_times(spec, frame - first, stamp_s, word)
        for spec in signals.messages(ODOMETRY_ROLES):
            frame, payload, stamp_s = self._answered(spec)
            roles = [role for role in ODOMETRY_ROLES if signals[role].message is spec]
            columns = np.ascontiguousarray(run.pose[payload][:, [ODOMETRY_ROLES.index(roles[0])]])
            word = columns.view(np.uint64)[:, 0]
            counter = run.answer_tick[frame] - first
            found[spec.name] = _frame_times(spec, counter, stamp_s, word)
        return found


def _frame_times(
    spec: MessageSpec, counter: Ints, stamp_s: Floats, payload: NDArray[np.uint64]
) -> FrameTimes:
    return FrameTimes(
        t_s=stamp_s,
        counter=counter if spec.is_protected else np.full(len(counter), -1, dtype=np.int64),
        modulo=COUNTER_MODULO if spec.is_protected else 0,
        cycle_s=(spec.cycle_time_us or 0) * _US,
        payload=payload,
    )


def _held(values: Floats) -> Floats:
    """Return values held from frame to frame; before the first, the first."""
    known = np.flatnonzero(np.isfinite(values))
    if len(known) == 0:
        return values
    place = np.searchsorted(known, np.arange(len(values)), side="right") - 1
    return np.asarray(values[known[np.maximum(place, 0)]], dtype=np.float64)


def _quantity(role: Role, code: Floats, robot: Robot) -> Floats:
    per_code, at_zero = code_scale(role, robot.plant)
    return code * per_code + at_zero


def _reference(run: EffectRun, seed: int, noise: ReferenceNoise) -> Reference:
    """Return the truth as the measuring system reports it."""
    time_s, truth = run.time_s, run.truth
    if noise.rate_hz is not None:
        time_s = np.arange(0.0, run.time_s[-1], 1.0 / noise.rate_hz)
        truth = np.column_stack([np.interp(time_s, run.time_s, one) for one in run.truth.T])
    schedule = run.settings.over_time(lambda at: at.reference)
    measured = truth.copy()
    levels = (
        (noise.position_m, noise.coloured_position_m),
        (noise.position_m, noise.coloured_position_m),
        (noise.heading_rad, noise.coloured_heading_rad),
    )
    errors = schedule[0][1]
    is_white = errors.correlation_time_s == 0.0
    for column, (white, coloured) in enumerate(levels):
        # A level of noise that the effect states is the whole of its kind: where samples scatter
        # more, a reference wanders all the same.
        stated = (errors.heading_noise_rad if column == 2 else errors.position_noise_m) > 0.0
        if white > 0.0 and not (stated and is_white):
            measured[:, column] += white * correlated_noise(
                time_s, 0.0, seed, _PLACE_STREAM + column
            )
        if coloured > 0.0 and not (stated and not is_white):
            measured[:, column] += coloured * correlated_noise(
                time_s, noise.correlation_time_s, seed, _PLACE_STREAM + 3 + column
            )
    stamps, poses = measure_over_time(time_s, measured, schedule, seed)
    poses = run.settings.setup.reference(poses)
    return Reference(stamps, poses[:, 0].copy(), poses[:, 1].copy(), poses[:, 2].copy())
