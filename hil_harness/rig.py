"""The rig: one object through which a test drives a robot's bus and says what it expects there."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from types import NoneType, TracebackType
from typing import Any, Final, NamedTuple

import can

from can_bus import (
    IN_PROCESS_INTERFACES,
    Database,
    Fault,
    FaultInjector,
    FaultKind,
    LogWriter,
    Raw,
    Traffic,
    load_database,
    open_bus,
    open_log_writer,
)
from hil_harness.assembly import Wire
from hil_harness.decoding import DecodedFrame
from hil_harness.devices import Device, DeviceSetup, PythonDevice, open_device
from hil_harness.effect_runs import traffic_of
from hil_harness.errors import HarnessError
from hil_harness.expectation import Expectation
from hil_harness.firmware_program import FirmwareProgram
from hil_harness.frame_recorder import FrameRecorder, SeenFrame, Wait
from hil_harness.nodes import FirmwareNode
from hil_harness.nodes.reports import firmware_messages
from hil_harness.restbus import FrameBuilder, RestBus, SignalValue
from hil_harness.rig_assembly import (
    channel_for,
    check_kind,
    checked_seed,
    given_effects,
    microseconds,
    no_plant,
    signal_map_of,
    simulated_plant,
    tick_period_us_of,
)
from hil_harness.rig_faults import FaultHandle
from hil_harness.rig_loops import LockstepLoop, RealTimeLoop, RigLoop
from hil_harness.robot import Robot, load_robot
from hil_harness.signal_map import SignalMap
from hil_harness.signal_roles import Role

ODOMETRY_ROLES: Final[tuple[Role, ...]] = ("odom_x", "odom_y", "odom_heading")


class Pose(NamedTuple):
    """A pose in the start's frame: x forward, y left, heading counter-clockwise."""

    x_m: float
    y_m: float
    heading_rad: float


class Rig:
    """A robot on a bus, and a tester's hands on it.

    On an in-process interface it runs in lockstep: time is simulated and passes only inside
    `run_for`, `expect` and `expect_none`; ``within_s`` counts bus time. On the others it runs in
    real time from construction to `close`.

    Args:
        robot: a robot description or its file; None: the shipped one.
        device: the firmware under test: a text as ``--device`` takes it, an object with
            ``step(now_us, frames)``, or None for the shipped firmware.
        effects: what differs from the description: texts such as ``"gyro_bias.bias=0.005"``, and
            files as ``chiplog diagnose --write-effects`` writes them, such as
            ``"explained.toml"``; one or many, and a text wins over a file.
        effect_library: effects of your own (a Python file, which is run) beside Chiplog's.
        scenario: a name or file that drives the plant; None: it obeys the COMMAND frames (or what
            the signal map says instead) that the test sends.
        seed: seed of the plant's noise and of faults with a probability.
        force: True runs the shipped firmware with words that overflow; STATUS says when one has.
        plant: False leaves the robot out: the sensor frames are then the test's or a rest bus's.
        dbc, signals: a DBC other than the shipped one, and the map that says what its signals mean.
        interface, channel, bitrate, bus_args: as python-can takes them; without a channel a
            lockstep rig takes one that nobody else uses.
        log: file to log to (.log, .asc or .blf): what the firmware under test received and sent.
        folder: where relative paths in *device* start; None: the current folder.

    Raises HarnessError, CanBusError and their relatives, with one line, for anything that does not
    fit together.
    """

    def __init__(
        self,
        *,
        robot: Robot | str | Path | None = None,
        device: Any = None,
        effects: str | Path | Iterable[str | Path] = (),
        effect_library: str | Path | None = None,
        scenario: str | Path | None = None,
        seed: int = 1,
        force: bool = False,
        plant: bool = True,
        dbc: Database | str | Path | None = None,
        signals: SignalMap | str | Path | None = None,
        interface: str = "virtual",
        channel: str | None = None,
        bitrate: int | None = None,
        bus_args: Mapping[str, str] | None = None,
        log: str | Path | None = None,
        folder: Path | None = None,
    ) -> None:
        """Assemble the rig; in real time it starts at once."""
        seed = checked_seed(seed)
        given = given_effects(effects)
        check_kind("force", force, (bool,), "True or False")
        check_kind("plant", plant, (bool,), "True or False")
        check_kind("scenario", scenario, (str, Path, NoneType), "a name or a file")
        check_kind("robot", robot, (Robot, str, Path, NoneType), "a robot or its file")
        check_kind("effect_library", effect_library, (str, Path, NoneType), "a Python file")
        check_kind("dbc", dbc, (Database, str, Path, NoneType), "a database or its file")
        check_kind("signals", signals, (SignalMap, str, Path, NoneType), "a signal map or its file")
        self.database = dbc if isinstance(dbc, Database) else load_database(dbc)
        self.signal_map = signal_map_of(signals, self.database, needed=plant or device is None)
        self.robot = robot if isinstance(robot, Robot) else load_robot(robot)
        self.interface = interface
        self.in_lockstep = interface in IN_PROCESS_INTERFACES
        self.tick_period_us = tick_period_us_of(self.database, self.signal_map)
        self._bitrate = bitrate if bitrate is not None else self.database.bitrate
        self._bus_args = dict(bus_args or {})
        self._builder = FrameBuilder(self.database, self.tick_period_us)
        # In real time the loop's thread takes out what the test's thread puts in.
        self._outbox: deque[tuple[str, Mapping[str, Raw]]] = deque()
        self._restbuses: list[RestBus] = []
        self._recorder = FrameRecorder(self.database)
        self._last_failure: tuple[AssertionError | None, list[SeenFrame]] = (None, [])
        self._seed = seed
        self._force = force
        self._faults = FaultInjector(self.database, seed)
        self._outgoing_faults = FaultInjector(self.database, seed + 1)
        channel = channel_for(interface, channel)
        self._plant = no_plant()
        if plant:
            assert self.signal_map is not None
            self._plant = simulated_plant(
                self.robot,
                self.database,
                self.signal_map,
                tick_period_us=self.tick_period_us,
                scenario=scenario,
                effects=given,
                effect_library=effect_library,
                seed=seed,
            )
        self._firmware_message_names: frozenset[str] = frozenset()
        if device is None:
            assert self.signal_map is not None
            shipped = firmware_messages(self.database, self.signal_map)
            self._firmware_message_names = frozenset(spec.name for spec in shipped)
        with ExitStack() as resources:
            self.device = self._open_device(device, channel, folder)
            resources.callback(self.device.close)
            writer = None if log is None else resources.enter_context(open_log_writer(log))
            self._loop = self._open_loop(channel, writer)
            resources.callback(self._loop.close)
            self._resources = resources.pop_all()

    def run_for(self, duration_s: float) -> None:
        """Let *duration_s* of bus time pass: in lockstep, the ticks that begin in it."""
        self._loop.advance(microseconds(duration_s, "duration_s"), lambda: False)

    def send(self, message: str, /, **signals: SignalValue) -> None:
        """Send one frame at the next tick: scaled values, value-table words, or None for invalid.

        Signals not given take the DBC's initial value; counter and CRC are right. Raises
        HarnessError or CanBusError for names and values that the DBC does not have.
        """
        self._outbox.append((message, self._builder.raw_values(message, signals)))

    def expect(
        self, message: str, /, *, within_s: float | None = None, **signals: object
    ) -> DecodedFrame:
        """Wait for a frame whose signals are as given; return it.

        A signal should be a number, ``pytest.approx(…)``, a word of its value table, None for
        marked invalid, or what a function of its scaled value says yes to. Only frames from now on
        count, for *within_s* of bus time (default: two cycles of the message, or one second if it
        has none).
        Raises AssertionError, saying what came instead.
        """
        __tracebackhide__ = True  # pytest then shows the line of the test
        wait, span_us = self._wait_for(Expectation(message, signals), within_s)
        if wait.found is None:
            line = wait.expectation.was_not_met(span_us, wait.came, wait.counts())
            raise self._failure(line)
        return wait.found

    def expect_none(
        self, message: str, /, *, within_s: float | None = None, **signals: object
    ) -> None:
        """Let *within_s* of bus time pass and see that no such frame comes.

        Raises AssertionError as soon as one does.
        """
        __tracebackhide__ = True  # pytest then shows the line of the test
        wait, span_us = self._wait_for(Expectation(message, signals), within_s)
        if wait.found is not None:
            raise self._failure(wait.expectation.was_met(span_us, wait.found))

    def latest(self, message: str) -> DecodedFrame:
        """Return the last frame of a message. Raises AssertionError if none has come yet."""
        frame = self._recorder.latest(message)
        if frame is None:
            raise AssertionError(f"no {message} has come yet, at {self.now_us * 1e-6:.6f} s")
        return frame

    @property
    def status(self) -> DecodedFrame:
        """The firmware's last STATUS frame. Raises AssertionError if none has come yet."""
        return self.latest("STATUS")

    @property
    def odometry(self) -> Pose:
        """Where the firmware says that the robot is, by its last odometry frames.

        The heading is as on the bus: with the shipped DBC within half a turn of zero. Raises
        AssertionError if a frame is missing or marked invalid, HarnessError if the map has none.
        """
        return Pose(*(self._last_value(role) for role in ODOMETRY_ROLES))

    @property
    def truth(self) -> Pose:
        """Where the robot truly is; its heading is not wrapped.

        Raises HarnessError if the rig has no plant.
        """
        return Pose(*self._plant.pose())

    def fault(
        self,
        kind: FaultKind,
        message: str | None = None,
        *,
        node: str | None = None,
        during_s: float | None = None,
        count: int | None = None,
        probability: float = 1.0,
        delay_s: float = 0.0,
        bit: int | None = None,
    ) -> FaultHandle:
        """Disturb frames from now on: drop, delay, corrupt or duplicate them, or silence a node.

        It strikes the frames of *message*, of *node*, or of both, on their way to the firmware
        under test, or from it to everybody else. It ends after *during_s* or *count* frames, by
        `clear()` on what this returns, or with its ``with`` block. *delay_s* belongs to "delay",
        *bit* (which data bit is inverted; None: one at random) to "corrupt".
        Raises CanBusError for a fault that makes no sense, HarnessError without message and node.
        """
        start_us = self.now_us
        fault = Fault(
            kind=kind,
            message=message,
            node=node,
            start_us=start_us,
            stop_us=None if during_s is None else start_us + microseconds(during_s, "during_s"),
            count=count,
            probability=probability,
            delay_us=microseconds(delay_s, "delay_s"),
            bit=bit,
        )
        if message is None and node is None:
            raise HarnessError(
                f"fault {kind!r}: name a message or a node that it strikes, "
                f'as in rig.fault({kind!r}, "IMU") or rig.fault({kind!r}, node="PLANT")'
            )
        return FaultHandle(fault, (self._faults, self._outgoing_faults))

    def restbus(self, *senders: str, **overrides: Mapping[str, SignalValue]) -> RestBus:
        """Send every cyclic message of these nodes at its cycle time, as if they were there.

        Messages that the rig's plant or the shipped firmware sends already are left to them.
        Override signals here, as in ``rig.restbus("HOST", COMMAND={"v_m_s": 0.3})``, or later with
        `set` on what this returns.
        """
        restbus = RestBus(
            self._builder,
            senders,
            overrides,
            without=self._plant.message_names | self._firmware_message_names,
            start_us=self.now_us,
        )
        self._restbuses.append(restbus)
        return restbus

    def open_bus(self) -> can.BusABC:
        """Return a python-can bus on the rig's channel; the caller shuts it down."""
        return open_bus(
            self.interface, self.channel, bitrate=self._bitrate, bus_args=self._bus_args
        )

    def recent_frames(self, count: int, *, before: BaseException | None = None) -> list[str]:
        """Return the last frames on the bus, decoded, one line each.

        *before* is what `expect` or `expect_none` raised last: then the frames end there, though
        in real time the bus has gone on since. For any other exception they end now.
        """
        error, frames = self._last_failure
        if before is None or before is not error:
            frames = self._recorder.history()
        return self._recorder.lines(frames[-count:])

    @property
    def now_us(self) -> int:
        """Bus time since the start, whole microseconds: in lockstep, that of the next tick."""
        return self._loop.now_us

    @property
    def channel(self) -> str:
        """The python-can channel that the rig is on."""
        return self._loop.channel

    def close(self) -> None:
        """Stop, and give back buses, device and log; may be called twice."""
        self._resources.close()

    def __enter__(self) -> Rig:
        """Use as a context manager: the rig is closed after it."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the rig."""
        self.close()

    def _wait_for(
        self, expectation: Expectation, within_s: float | None
    ) -> tuple[Wait, tuple[int, int]]:
        """Let time pass until the expectation is met; also return from when to when at most."""
        wait = Wait(expectation, self.database)
        if within_s is not None:
            duration_us = microseconds(within_s, "within_s")
        else:
            cycle_us = self.database.message(expectation.message).cycle_time_us
            duration_us = 1_000_000 if cycle_us is None else 2 * cycle_us
        start_us = self.now_us
        self._recorder.wait(wait, lambda is_over: self._loop.advance(duration_us, is_over))
        return wait, (start_us, start_us + duration_us)

    def _failure(self, line: str) -> AssertionError:
        """Return the error of an expectation, and keep the frames before it."""
        error = AssertionError(line)
        self._last_failure = (error, self._recorder.history())
        return error

    def _last_value(self, role: Role) -> float:
        if self.signal_map is None:
            raise HarnessError("this rig has no signal map, so nothing is known to be odometry")
        mapped = self.signal_map[role]
        frame = self.latest(mapped.message.name)
        raw = frame.raw[mapped.signal.name]
        if raw == mapped.signal.invalid_raw:
            raise AssertionError(f"{mapped.path} is marked invalid at {frame.time_s:.6f} s")
        return mapped.to_si(raw)

    def _frames_to_send(self, now_us: int) -> list[can.Message]:
        """Return what the test has sent since the last tick, and what its rest buses send now."""
        frames = []
        while self._outbox:
            message, raw = self._outbox.popleft()
            frames.append(self._builder.build(message, raw, now_us))
        for restbus in self._restbuses:
            frames += restbus.due(now_us)
        return frames

    def _open_device(self, device: Any, channel: str, folder: Path | None) -> Device:
        if device is None:
            assert self.signal_map is not None
            program = FirmwareProgram(
                self.robot,
                self.signal_map,
                self.tick_period_us,
                schedule=self._plant.settings.over_time(lambda at: at.firmware),
                seed=self._seed,
                allow_overflow=self._force,
            )
            if not self._force:
                for kernel in program.held:
                    self._plant.require_fits(kernel)
            shipped = FirmwareNode(
                self.robot,
                database=self.database,
                signal_map=self.signal_map,
                tick_period_us=self.tick_period_us,
                program=program,
            )
            return PythonDevice(shipped, name="shipped firmware")
        if isinstance(device, Device):
            return device
        if not isinstance(device, str):
            return PythonDevice(device)
        setup = DeviceSetup(
            tick_period_us=self.tick_period_us,
            database=self.database,
            signal_map=self.signal_map,
            robot=self.robot,
            in_lockstep=self.in_lockstep,
            interface=self.interface,
            channel=channel,
            bitrate=self._bitrate,
            folder=folder,
        )
        return open_device(device, setup)

    def _traffic(self) -> Traffic | None:
        if self.signal_map is None:
            return None
        wire = Wire(self.database, self.signal_map)
        traffic = traffic_of(self._plant.settings, wire, self._seed)
        if traffic is not None and not self.in_lockstep:
            raise HarnessError("an effect of stage bus needs simulated time: expected 'virtual'")
        return traffic

    def _open_loop(self, channel: str, log: LogWriter | None) -> RigLoop:
        loop = LockstepLoop if self.in_lockstep else RealTimeLoop
        return loop(
            self._plant.node,
            self.device,
            tick_period_us=self.tick_period_us,
            interface=self.interface,
            channel=channel,
            bitrate=self._bitrate,
            bus_args=self._bus_args,
            log=log,
            faults=self._faults,
            outgoing_faults=self._outgoing_faults,
            traffic=self._traffic(),
            seen=self._recorder.see,
            source=self._frames_to_send,
        )
