"""Runs with any effects and no bus in between: what a log and a reference of them would hold.

The same plant, disturbances and firmware as in the loop, over whole arrays.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from can_bus import (
    COUNTER_MODULO,
    Arrivals,
    CounterCheck,
    E2EState,
    E2EStateMachine,
    MessageSpec,
    Traffic,
)
from firmware_model import FRESH, INVALID, STALE, pose_m_rad, run_batch
from hil_harness.assembly import Wire, commands_on_the_wire
from hil_harness.effects import EffectSetting, Settings, apply_effects, combine_effects
from hil_harness.effects.model import Effect
from hil_harness.effects.setup_mistakes import SensorMistakes
from hil_harness.firmware_program import AS_DESCRIBED, FirmwareProgram, run_program
from hil_harness.kernel_inputs import KERNEL_ROLES
from hil_harness.nodes.plant import COMMAND_ROLES
from hil_harness.nodes.schedule import cycle_of
from hil_harness.odometry_frames import ODOMETRY_ROLES
from hil_harness.robot import Robot
from hil_harness.scenarios import Scenario
from hil_harness.sensor_frames import SENSOR_ROLES
from sim_plant import Mechanisms, MechanismSchedule, PlantDescription, PlantRuns, simulate
from sim_plant.plant import NoiseModel
from sim_plant.records import DriveModel, EncoderModel

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


class Simulator(Protocol):
    """What moves the robots of many runs, as `sim_plant.simulate` does."""

    def __call__(
        self,
        description: PlantDescription,
        mechanisms: Sequence[Mechanisms | MechanismSchedule],
        commands: Floats,
        seeds: Sequence[int],
        *,
        tick_period_us: int,
        encoder_model: EncoderModel = "counter",
        noise: NoiseModel = "streams",
        drive: DriveModel = "motor",
    ) -> PlantRuns:
        """Run the plant once per seed over the same commands."""


@dataclass(frozen=True)
class EffectRun:
    """One run; each array has a row per tick.

    Attributes:
        settings: what the effects add up to.
        time_s: float64[n], when each tick was on the log's clock (the true one).
        truth: float64[n, 3], the true pose.
        left_count, right_count, gyro_code: int64[n], as sampled into the frames.
        temperature_code, supply_code: int64[n].
        commands: float64[n, 2], (v_m_s, w_rad_s) as recorded.
        arrivals: per disturbed message, which of its frames came when.
        pose: float64[n, 3], the firmware's, heading unwrapped.
        executed: bool[n], whether the firmware answered in that tick.
        answer_tick: int64[n], the tick whose counter its answer carries: that of the encoder frame
            it has used, or one more than before while there is none.
    """

    settings: Settings
    time_s: Floats
    truth: Floats
    left_count: Ints
    right_count: Ints
    gyro_code: Ints
    temperature_code: Ints
    supply_code: Ints
    commands: Floats
    arrivals: Mapping[str, Arrivals]
    pose: Floats
    executed: Bools
    answer_tick: Ints


def sensor_messages(wire: Wire) -> tuple[str, ...]:
    """Return the names of the messages that carry sensors."""
    return tuple(spec.name for spec in wire.signal_map.messages(SENSOR_ROLES))


def traffic_of(settings: Settings, wire: Wire, seed: int) -> Traffic | None:
    """Return what carries the frames of a run; None where nothing disturbs them.

    Raises CanBusError for an effect on a message that the DBC does not have.
    """
    schedule = settings.over_time(lambda at: at.bus)
    traffic = Traffic(wire.database, schedule, sensor_messages(wire), seed)
    return traffic if any(traffic.touches(name) for name in wire.database.messages) else None


def run_with_effects(
    scenario: Scenario,
    robot: Robot,
    wire: Wire,
    cases: Sequence[tuple[Sequence[EffectSetting], int]],
    *,
    ticks: int | None = None,
    known: Mapping[str, Effect] | None = None,
    simulator: Simulator = simulate,
) -> list[EffectRun]:
    """Run a scenario once per case, each with its own effects and seed, in the plant *simulator*.

    Raises HarnessError, PlantError, FirmwareError or CanBusError for what does not fit together.
    """
    period_us = wire.tick_period_us
    count = scenario.tick_count(period_us) if ticks is None else ticks
    all_settings = [
        apply_effects(combine_effects(scenario.effects, effects, known=known), known)
        for effects, _ in cases
    ]
    commands = commands_on_the_wire(scenario, count, wire)
    plant = simulator(
        robot.plant,
        [settings.plant_over_time for settings in all_settings],
        commands,
        [seed for _, seed in cases],
        tick_period_us=period_us,
        encoder_model=scenario.encoder_model,
        noise=scenario.noise,
        drive=scenario.drive,
    )
    plain = FirmwareProgram(robot, wire.signal_map, period_us)
    runs = []
    for row, (settings, (_, seed)) in enumerate(zip(all_settings, cases, strict=True)):
        mistakes = SensorMistakes(settings.setup, robot.plant)
        left, right, gyro = mistakes.apply_columns(
            plant.left_count[row], plant.right_count[row], plant.gyro_code[row]
        )
        traffic = traffic_of(settings, wire, seed)
        arrivals = {} if traffic is None else _arrivals(traffic, wire, count)
        inputs = _kernel_inputs(wire, arrivals, left, right, gyro)
        pose, executed = _firmware(settings, robot, wire, inputs, seed, plain)
        if traffic is not None:
            arrivals |= _answer_arrivals(traffic, wire, executed)
        tick_s = period_us * 1e-6 / (1.0 + settings.plant.clock_skew)
        assert plant.temperature_code is not None  # asked for
        assert plant.supply_code is not None  # likewise
        runs.append(
            EffectRun(
                settings=settings,
                time_s=np.arange(count, dtype=np.float64) * tick_s,
                truth=_truth(plant, row),
                left_count=left,
                right_count=right,
                gyro_code=gyro,
                temperature_code=plant.temperature_code[row],
                supply_code=plant.supply_code[row],
                commands=settings.setup.commands(commands),
                arrivals=arrivals,
                pose=pose,
                executed=executed,
                answer_tick=ticks_of_answers(wire, arrivals, count),
            )
        )
    return runs


def _truth(plant: PlantRuns, row: int) -> Floats:
    truth: Floats = plant.truth[row if len(plant.truth) > 1 else 0]
    return truth


def _arrivals(traffic: Traffic, wire: Wire, ticks: int) -> dict[str, Arrivals]:
    """Return the fates of the frames of every disturbed message that the plant's side sends."""
    found = {}
    for spec in wire.signal_map.messages((*SENSOR_ROLES, *COMMAND_ROLES)):
        if traffic.touches(spec.name):
            every, phase = cycle_of(spec, wire.tick_period_us)
            sent_us = np.arange(phase, ticks, every, dtype=np.int64) * wire.tick_period_us
            found[spec.name] = traffic.arrivals(spec.name, sent_us)
    return found


def answer_ticks(spec: MessageSpec, wire: Wire, executed: Bools) -> Ints:
    """Return the ticks in which the firmware sends a message."""
    every, phase = cycle_of(spec, wire.tick_period_us)
    due = np.arange(phase, len(executed), every, dtype=np.int64)
    sent: Ints = due[executed[due]]
    return sent


def _answer_arrivals(traffic: Traffic, wire: Wire, executed: Bools) -> dict[str, Arrivals]:
    """Return the fates of the frames of every disturbed message that the firmware sends."""
    found = {}
    for spec in wire.signal_map.messages(ODOMETRY_ROLES):
        if traffic.touches(spec.name):
            sent = answer_ticks(spec, wire, executed)
            found[spec.name] = traffic.arrivals(spec.name, sent * wire.tick_period_us)
    return found


def _kernel_inputs(
    wire: Wire, arrivals: Mapping[str, Arrivals], left: Ints, right: Ints, gyro: Ints
) -> Ints:
    """Return int64[ticks, 5]: what the firmware's node hands its kernel."""
    ticks = len(left)
    columns = {"left_count": left, "right_count": right, "gyro": gyro}
    accepted: dict[str, tuple[Ints, Ints, Bools]] = {}
    values, fresh = {}, {}
    distrusted = dict.fromkeys(KERNEL_ROLES, np.zeros(ticks, dtype=np.bool_))
    for role in KERNEL_ROLES:
        mapped = wire.signal_map.get(role)
        values[role] = columns[role]
        fresh[role] = np.ones(ticks, dtype=np.bool_)
        if mapped is None:
            fresh[role][:] = False
            continue
        spec = mapped.message
        every, phase = cycle_of(spec, wire.tick_period_us)
        if spec.name not in arrivals and every == 1:
            continue
        if spec.name not in accepted:
            accepted[spec.name] = accepted_frames(spec, arrivals.get(spec.name), wire, ticks)
        payload, distrusted[role] = accepted[spec.name][1:]
        fresh[role] = payload >= 0
        sampled = phase + np.maximum(payload, 0) * every
        values[role] = np.where(fresh[role], columns[role][sampled], 0)
    encoder = np.where(fresh["left_count"] & fresh["right_count"], FRESH, STALE)
    encoder[distrusted["left_count"] | distrusted["right_count"]] = INVALID
    inertial = np.where(fresh["gyro"], FRESH, STALE)
    inertial[distrusted["gyro"]] = INVALID
    return np.column_stack(
        [values["left_count"], values["right_count"], encoder, values["gyro"], inertial]
    ).astype(np.int64)


def ticks_of_answers(wire: Wire, arrivals: Mapping[str, Arrivals], ticks: int) -> Ints:
    """Return int64[ticks]: whose counter the firmware's answer of each tick carries."""
    wheels = wire.signal_map["left_count"].message
    if wheels.name not in arrivals or not wheels.is_protected:
        return np.arange(ticks, dtype=np.int64)
    every, phase = cycle_of(wheels, wire.tick_period_us)
    frame = accepted_frames(wheels, arrivals[wheels.name], wire, ticks)[0]
    tick = np.arange(ticks, dtype=np.int64)
    # Since the last frame that was used the node counts by itself.
    last = np.maximum.accumulate(np.where(frame >= 0, tick, -1))
    used = phase + frame[np.maximum(last, 0)] * every
    return np.where(last >= 0, used + tick - last, tick)


def accepted_frames(
    spec: MessageSpec, arrivals: Arrivals | None, wire: Wire, ticks: int
) -> tuple[Ints, Ints, Bools]:
    """Return per tick whose counter the node answers with, whose payload it uses; -1 for none.

    The third array tells where a frame came that is not used because its stream is not trusted. As
    `FrameChecker`: of a protected message only frames in sequence; the newest of a tick counts.
    """
    period_us = wire.tick_period_us
    every, phase = cycle_of(spec, period_us)
    newest = np.full(ticks, -1, dtype=np.int64)
    distrusted = np.zeros(ticks, dtype=np.bool_)
    if arrivals is None:
        newest[phase::every] = np.arange(len(newest[phase::every]))
        return newest, newest, distrusted
    which = newest.copy()
    check = None if spec.e2e is None else CounterCheck(spec.e2e)
    machine = E2EStateMachine()
    cycle_us = spec.cycle_time_us
    last_us: int | None = None
    for frame, payload, time_us in zip(
        arrivals.frame.tolist(), arrivals.payload.tolist(), arrivals.time_us.tolist(), strict=True
    ):
        tick = -(-time_us // period_us)
        if tick >= ticks:
            continue
        if check is not None:
            now_us = tick * period_us
            if last_us is not None and cycle_us is not None:
                missed = (2 * (now_us - last_us) + cycle_us) // (2 * cycle_us) - 1
                if missed > 0:
                    check.pass_cycles(missed)
                    machine.pass_cycles(missed)
            last_us = now_us
            status = check.check((phase + frame * every) % COUNTER_MODULO)
            state = machine.add(status)
            if not status.is_accepted:
                continue
            distrusted[tick] = state is E2EState.INVALID
        which[tick] = frame
        if not distrusted[tick]:
            newest[tick] = payload
    return which, newest, distrusted


def _firmware(
    settings: Settings,
    robot: Robot,
    wire: Wire,
    inputs: Ints,
    seed: int,
    plain: FirmwareProgram,
) -> tuple[Floats, Bools]:
    """Return the firmware's pose in each tick, and whether it was executed."""
    schedule = settings.over_time(lambda at: at.firmware)
    program = plain
    if schedule != AS_DESCRIBED:
        program = FirmwareProgram(
            robot, wire.signal_map, wire.tick_period_us, schedule=schedule, seed=seed
        )
    if program.is_constant:
        left, right, encoder, code, inertial = np.ascontiguousarray(inputs.T)[:, np.newaxis]
        runs = run_batch(
            program.kernel.config, left, right, code, encoder, inertial, twin=False, workers=1
        )
        return runs.pose_m_rad()[0], np.ones(len(inputs), dtype=np.bool_)
    pose_q, _, executed, _ = run_program(program, inputs)
    return pose_m_rad(program.described, pose_q), executed
