"""One run, start to finish: the loop in lockstep or real time, and what came of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import can
import numpy as np
from numpy.typing import NDArray

from can_bus import LogWriter, Traffic, open_bus, open_log_writer
from hil_harness.assembly import (
    RunConfig,
    Wire,
    build_plant_node,
    default_channel,
    load_wire,
)
from hil_harness.devices import Device, DeviceSetup, open_device
from hil_harness.effect_runs import traffic_of
from hil_harness.effects import Settings
from hil_harness.effects.reference_errors import NO_ERRORS, measure_over_time
from hil_harness.errors import HarnessError
from hil_harness.firmware_program import AS_DESCRIBED, FirmwareProgram
from hil_harness.lockstep import Lockstep
from hil_harness.meter import BusMeter
from hil_harness.nodes import FirmwareNode, Node, PlantNode
from hil_harness.peers import Outages, Tell
from hil_harness.reach import require_run_fits
from hil_harness.realtime import Pacer, run_paced
from hil_harness.results import BusStatistics, Poses, Reception, RunResult, Timing
from hil_harness.skewed_log import SkewedLog
from hil_harness.standalone import firmware_watch, rejected_frames, with_outages
from hil_harness.stopping import stop_between_ticks
from hil_harness.traces import lesson_estimates, odometry_poses, trace

Progress = Callable[[int, int], None]
"""Hears ticks done and ticks in all."""


class _Witness:
    """Stands between the bus and a device that is not ours, and remembers what passed."""

    def __init__(self, device: Node, trigger_ids: frozenset[tuple[int, bool]]) -> None:
        self._device = device
        self.trigger_ids = trigger_ids
        self.received: list[tuple[int, Sequence[can.Message]]] = []
        self.answered: list[tuple[int, Sequence[can.Message]]] = []

    def step(self, now_us: int, frames: Sequence[can.Message], /) -> Sequence[can.Message]:
        self.received.append((now_us, frames))
        answer = self._device.step(now_us, frames)
        self.answered.append((now_us, answer))
        return answer


class _PlantWitness(_Witness):
    """The same around the plant, for an ECU outside: what the plant sent is what the ECU heard."""

    def step(self, now_us: int, frames: Sequence[can.Message], /) -> Sequence[can.Message]:
        answer = self._device.step(now_us, frames)
        self.received.append((now_us, answer))
        self.answered.append((now_us, frames))
        return answer


@dataclass
class _Outcome:
    """How the loop ended."""

    ticks: int
    wall_s: float
    timing: Timing = field(default_factory=Timing)
    interrupted: bool = False
    bus: can.BusABC | None = None


def run(config: RunConfig, progress: Progress | None = None, tell: Tell | None = None) -> RunResult:
    """Run a scenario through plant, bus and firmware, and return what came of it.

    The log is written while running. Ctrl-C ends the run early: the result then covers what ran,
    and says `interrupted`. In real time `tell` hears at once when an ECU outside falls silent and
    when it is back. Raises HarnessError, CanBusError and their relatives with one line.
    """
    wire = load_wire(config.dbc, config.signals)
    period_us = wire.tick_period_us
    ticks = config.tick_count(period_us)
    settings = config.settings()
    _refuse_in_real_time(config, settings, wire)
    plant = build_plant_node(config, wire, ticks)
    program = _program(config, settings, wire)
    for kernel in program.held:
        require_run_fits(config, wire, kernel, ticks)
    shadow = FirmwareNode(
        config.robot,
        database=wire.database,
        signal_map=wire.signal_map,
        tick_period_us=period_us,
        program=program,
    )
    meter = BusMeter(wire.database)
    channel = config.channel or default_channel(config.interface)
    with ExitStack() as stack:
        device = _open_device(config, wire, channel)
        if device is not None:
            stack.callback(device.close)
        log = None if config.log is None else stack.enter_context(open_log_writer(config.log))
        skew = settings.plant.clock_skew
        if log is not None and skew != 0.0:
            log = SkewedLog(log, skew)
        parts = _Parts.of(plant, shadow, device)
        report = None if progress is None else _reporter(progress, ticks)
        if config.time_base == "lockstep":
            traffic = traffic_of(settings, wire, config.seed_in_use)
            outcome = _run_lockstep(
                config, parts, wire, ticks, channel, log, meter, report, traffic
            )
        else:
            outcome = _run_real(
                config, parts, wire, ticks, channel, log, meter, report, Outages(tell)
            )
    return _result(config, wire, parts, outcome, meter)


def _program(config: RunConfig, settings: Settings, wire: Wire) -> FirmwareProgram:
    """Return what Chiplog's own firmware runs; a foreign one is what it is."""
    schedule = settings.over_time(lambda at: at.firmware)
    if config.device is not None and schedule != AS_DESCRIBED:
        raise HarnessError(
            "an effect of stage firmware changes Chiplog's own firmware: expected no --device"
        )
    return FirmwareProgram(
        config.robot,
        wire.signal_map,
        wire.tick_period_us,
        schedule=schedule,
        seed=config.seed_in_use,
        implementation=config.kernel,
        allow_overflow=config.force,
    )


def _refuse_in_real_time(config: RunConfig, settings: Settings, wire: Wire) -> None:
    if config.time_base == "lockstep":
        return
    if settings.plant.clock_skew != 0.0 or traffic_of(settings, wire, 0) is not None:
        raise HarnessError(
            "an effect of stage bus needs simulated time: expected --time lockstep, or a bus that "
            "does this by itself"
        )


@dataclass
class _Parts:
    """The nodes of a run, with a witness where the firmware is not ours."""

    plant: PlantNode
    shadow: FirmwareNode
    plant_side: Node
    firmware: FirmwareNode | _Witness | None
    witness: _Witness | None

    @classmethod
    def of(cls, plant: PlantNode, shadow: FirmwareNode, device: Device | None) -> _Parts:
        if device is None:
            return cls(plant, shadow, plant, shadow, None)
        if device.in_loop:
            witness = _Witness(device, shadow.trigger_ids)
            return cls(plant, shadow, plant, witness, witness)
        outside = _PlantWitness(plant, frozenset())
        return cls(plant, shadow, outside, None, outside)


def _open_device(config: RunConfig, wire: Wire, channel: str) -> Device | None:
    if config.device is None:
        return None
    setup = DeviceSetup(
        tick_period_us=wire.tick_period_us,
        database=wire.database,
        signal_map=wire.signal_map,
        robot=config.robot,
        in_lockstep=config.time_base == "lockstep",
        interface=config.interface,
        channel=channel,
        bitrate=config.bitrate,
    )
    return open_device(config.device, setup)


def _run_lockstep(
    config: RunConfig,
    parts: _Parts,
    wire: Wire,
    ticks: int,
    channel: str,
    log: LogWriter | None,
    meter: BusMeter,
    report: Callable[[int], None] | None,
    traffic: Traffic | None,
) -> _Outcome:
    if parts.firmware is None:
        raise HarnessError(
            "an ECU outside cannot run in lockstep: expected --time real and an interface that "
            "connects processes or hardware"
        )
    with Lockstep(
        parts.plant_side,
        parts.firmware,
        tick_period_us=wire.tick_period_us,
        interface=config.interface,
        channel=channel,
        bitrate=config.bitrate or wire.database.bitrate,
        bus_args=config.bus_args,
        log=log,
        meter=meter,
        traffic=traffic,
    ) as loop:
        started = time.perf_counter()
        with stop_between_ticks() as stop:
            loop.run(ticks, report, stop)
        wall_s = time.perf_counter() - started
        return _Outcome(loop.ticks, wall_s, interrupted=loop.ticks < ticks)


def _run_real(
    config: RunConfig,
    parts: _Parts,
    wire: Wire,
    ticks: int,
    channel: str,
    log: LogWriter | None,
    meter: BusMeter,
    report: Callable[[int], None] | None,
    outages: Outages,
) -> _Outcome:
    period_us = wire.tick_period_us
    arguments: dict[str, Any] = {"bitrate": config.bitrate, "bus_args": config.bus_args}
    with ExitStack() as stack:
        plant_bus = stack.enter_context(open_bus(config.interface, channel, **arguments))
        firmware_bus = None
        if parts.firmware is not None:
            firmware_bus = stack.enter_context(open_bus(config.interface, channel, **arguments))
        pacer = Pacer(period_us)
        started = time.perf_counter()
        with stop_between_ticks() as stop:
            run_paced(
                parts.plant_side,
                parts.firmware,
                plant_bus=plant_bus,
                firmware_bus=firmware_bus,
                tick_period_us=period_us,
                ticks=ticks,
                log=log,
                meter=meter,
                pacer=pacer,
                progress=report,
                stop=stop,
                watch=firmware_watch(wire, outages) if parts.firmware is None else None,
                outages=outages,
            )
        wall_s = time.perf_counter() - started
        done = parts.plant.ticks
        heard = firmware_bus or plant_bus
        return _Outcome(
            done, wall_s, with_outages(pacer.timing(), outages), interrupted=done < ticks, bus=heard
        )


def _reporter(progress: Progress, ticks: int) -> Callable[[int], None]:
    return lambda done: progress(done, ticks)


def _result(
    config: RunConfig, wire: Wire, parts: _Parts, outcome: _Outcome, meter: BusMeter
) -> RunResult:
    """Lay the trajectories side by side; a run cut short ends with its last whole tick."""
    shadow = parts.shadow
    if parts.witness is not None:
        for now_us, frames in parts.witness.received:
            shadow.step(now_us, frames)
    inputs = shadow.inputs
    ticks = min(len(parts.plant.truth), len(inputs.left_count))
    settings = config.settings()
    program = _program(config, settings, wire)
    ours = trace(program, inputs)
    firmware: Poses = ours.firmware[:ticks]
    odometry: Mapping[str, Reception] = {}
    if parts.witness is not None:
        # An ECU outside answers into the next tick: its frames are the plant's next input.
        answers = parts.witness.answered[1:] if parts.firmware is None else parts.witness.answered
        stated = odometry_poses(answers, ticks, wire.database, wire.signal_map)
        firmware, odometry = stated.poses, stated.receptions
    period_us = wire.tick_period_us
    return RunResult(
        scenario=config.scenario.name,
        seed=config.seed_in_use,
        time=config.time_base,
        tick_period_us=period_us,
        time_s=np.arange(ticks) * period_us / 1e6,
        stamp_us=parts.plant.stamp_us[:ticks],
        truth=parts.plant.truth[:ticks],
        float_twin=ours.float_twin[:ticks],
        firmware=firmware,
        estimators=lesson_estimates(shadow.config, inputs),
        status=ours.status[:ticks],
        kernel_state=shadow.kernel.state(),
        bus=BusStatistics(
            frames=meter.frames,
            load=meter.load(ticks * period_us, config.bitrate or wire.database.bitrate),
            rejected=rejected_frames(shadow.checker, outcome.bus),
            frames_by_message=meter.frames_by_message(),
        ),
        timing=outcome.timing,
        wall_s=outcome.wall_s,
        interrupted=outcome.interrupted,
        configuration=_configuration(config, wire),
        odometry=odometry,
        reference=_reference(config, settings, parts.plant, ticks),
    )


def _reference(
    config: RunConfig, settings: Settings, plant: PlantNode, ticks: int
) -> tuple[NDArray[np.float64], Poses] | None:
    """Return what a measuring system with errors reports; None where it reports the truth."""
    schedule = settings.over_time(lambda at: at.reference)
    skew = settings.plant.clock_skew
    if schedule == NO_ERRORS and skew == 0.0 and not settings.setup.touches_reference:
        return None
    stamps_s = plant.stamp_us[:ticks] / 1e6 / (1.0 + skew)
    start_s = float(stamps_s[0]) if config.time_base == "real" and ticks else 0.0
    measured_s, measured = measure_over_time(
        stamps_s - start_s, plant.truth[:ticks], schedule, config.seed_in_use
    )
    return measured_s + start_s, settings.setup.reference(measured)


def _configuration(config: RunConfig, wire: Wire) -> dict[str, Any]:
    robot = config.robot
    return {
        "robot": robot.name,
        "dbc": wire.database.path.name,
        "interface": config.interface,
        "device": config.device or "chiplog firmware",
        "effects": [str(setting) for setting in config.effects_in_use],
        "wheel_radius_m": robot.plant.wheels.radius_m,
        "wheelbase_m": robot.plant.wheels.wheelbase_m,
        "ticks_per_rev": robot.plant.encoder.ticks_per_rev,
        "firmware": robot.firmware.model_dump(),
    }
