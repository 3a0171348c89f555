"""From a run to what a lab would have of it: a candump log and a reference trajectory."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from can_bus import COUNTER_MODULO, MessageSpec, make_message, open_log_writer
from gap_diagnosis.recording import Reference
from gap_diagnosis.trials.reference_noise import Draw, ReferenceLevels, reference_errors
from hil_harness.assembly import Wire
from hil_harness.effect_runs import EffectRun, answer_ticks
from hil_harness.effects.reference_errors import measure_over_time
from hil_harness.nodes.plant import COMMAND_ROLES
from hil_harness.nodes.schedule import cycle_of, encode_frame
from hil_harness.odometry_frames import ODOMETRY_ROLES
from hil_harness.robot import Robot
from hil_harness.sensor_frames import SENSOR_ROLES, SensorFrames
from hil_harness.signal_roles import Role
from sim_plant import SensorCounts

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

_TAU: Final = 2 * math.pi


def write_log(path: Path, run: EffectRun, robot: Robot, wire: Wire) -> None:
    """Write the frames of a run as the ECU received and sent them."""
    frames = _Frames(run, robot, wire)
    entries: list[tuple[int, int, int, MessageSpec, bytearray]] = []
    signals = wire.signal_map
    for rank, roles in enumerate(((*SENSOR_ROLES, *COMMAND_ROLES), ODOMETRY_ROLES)):
        for spec in signals.messages(roles):
            stamp_us, counter, payload = frames.came(spec, is_answer=rank == 1)
            data = frames.encoded(spec, payload, counter)
            entries += [
                (stamp, rank, spec.frame_id, spec, one)
                for stamp, one in zip(stamp_us.tolist(), data, strict=True)
            ]
    entries.sort(key=lambda entry: entry[:3])
    with open_log_writer(path) as log:
        for stamp, rank, _, spec, one in entries:
            log.write(make_message(spec, one, stamp), rank == 0)


class _Frames:
    """What stands in the frames of a run."""

    def __init__(self, run: EffectRun, robot: Robot, wire: Wire) -> None:
        self._run, self._robot, self._wire = run, robot, wire
        self._sensors = SensorFrames(wire.signal_map, robot.plant)
        self._rate = 1.0 + run.settings.plant.clock_skew
        self._columns: Mapping[Role, Floats] = {
            "v_command": run.commands[:, 0],
            "w_command": run.commands[:, 1],
            "odom_x": run.pose[:, 0],
            "odom_y": run.pose[:, 1],
            "odom_heading": run.pose[:, 2],
        }

    def came(self, spec: MessageSpec, *, is_answer: bool) -> tuple[Ints, Ints, Ints]:
        """Return the stamp [µs], the tick whose counter and the tick whose payload it has."""
        run, period_us = self._run, self._wire.tick_period_us
        if is_answer:
            sent = answer_ticks(spec, self._wire, run.executed)
        else:
            every, phase = cycle_of(spec, period_us)
            sent = np.arange(phase, len(run.time_s), every, dtype=np.int64)
        arrivals = run.arrivals.get(spec.name)
        if arrivals is None:
            frame = payload = sent
            time_us = sent * period_us
        else:
            frame, payload = sent[arrivals.frame], sent[arrivals.payload]
            time_us = arrivals.time_us
        counter = run.answer_tick[frame] if is_answer else frame
        return np.rint(time_us / self._rate).astype(np.int64), counter, payload

    def encoded(self, spec: MessageSpec, ticks: Ints, counters: Ints) -> list[bytearray]:
        """Return a message's frames: payloads of these *ticks*, protected by *counters*."""
        columns = self._raw(spec, ticks)
        rows = zip(*(columns[signal.name] for signal in spec.payload), strict=True)
        if not spec.is_plain:
            return [
                encode_frame(spec, dict(zip(columns, row, strict=True)), counter)
                for row, counter in zip(rows, counters.tolist(), strict=True)
            ]
        if not spec.is_protected:
            return [spec.pack(row) for row in rows]
        alive = (counters % COUNTER_MODULO).tolist()
        return [spec.pack(row, counter) for row, counter in zip(rows, alive, strict=True)]

    def _raw(self, spec: MessageSpec, ticks: Ints) -> dict[str, list[Any]]:
        """Return the raw values of each signal of a message in these ticks."""
        raw: dict[str, list[Any]] = {
            signal.name: [signal.initial_raw] * len(ticks) for signal in spec.payload
        }
        if any(spec is message for message in self._sensors.messages):
            read = [self._sensors.raw_values(spec, one) for one in self._counts(ticks)]
            raw |= {name: [one[name] for one in read] for name in raw}
        for role, values in self._columns.items():
            mapped = self._wire.signal_map.get(role)
            if mapped is None or mapped.message is not spec:
                continue
            told = values[ticks].tolist()
            if role == "odom_heading":
                told = [(value + math.pi) % _TAU - math.pi for value in told]
            raw[mapped.signal.name] = [mapped.to_raw(value) for value in told]
        return raw

    def _counts(self, ticks: Ints) -> Iterator[SensorCounts]:
        """Yield what the sensors read in these ticks."""
        run, plant = self._run, self._robot.plant
        mask = (1 << plant.encoder.counter_bits) - 1
        level = np.full(len(ticks), plant.accelerometer.zero_code)
        read = (
            run.left_count[ticks].astype(np.int64) & mask,
            run.right_count[ticks].astype(np.int64) & mask,
            run.gyro_code[ticks],
            level,
            level,
            run.temperature_code[ticks],
            run.supply_code[ticks],
        )
        whole = (one.astype(np.int64).tolist() for one in read)
        return map(SensorCounts._make, zip(*whole, strict=True))


def measured(run: EffectRun, levels: ReferenceLevels, draw: Draw, seed: int) -> Reference:
    """Return the truth of a run as its reference reports it, on stamps of its own."""
    time_s = np.arange(
        float(draw.uniform(0.0, 1.0 / levels.rate_hz)), run.time_s[-1], 1.0 / levels.rate_hz
    )
    seen_s = time_s + levels.stamp_s * draw.standard_normal(len(time_s))
    truth = np.column_stack([np.interp(seen_s, run.time_s, one) for one in run.truth.T])
    schedule = run.settings.over_time(lambda at: at.reference)
    stated = schedule[0][1]
    truth += reference_errors(
        time_s,
        levels,
        draw,
        position=stated.position_noise_m == 0.0,
        heading=stated.heading_noise_rad == 0.0,
    )
    stamps, poses = measure_over_time(time_s, truth, schedule, seed)
    poses = run.settings.setup.reference(poses)
    order = np.argsort(stamps, kind="stable")
    x_m, y_m, heading_rad = poses[order].T
    return Reference(stamps[order], x_m, y_m, heading_rad)


def tum_lines(reference: Reference) -> Iterator[str]:
    """Yield `t x y z qx qy qz qw`; every number has as many decimals, whatever it is."""
    heading = reference.heading_rad
    assert heading is not None  # a trial's reference has one
    rows = np.column_stack(
        [reference.t_s, reference.x_m, reference.y_m, np.sin(heading / 2), np.cos(heading / 2)]
    )
    for t, x, y, sine, cosine in rows.tolist():
        yield f"{t:.6f} {x:.6f} {y:.6f} 0 0 0 {sine:.9f} {cosine:.9f}\n"
