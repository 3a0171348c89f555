"""The plant as a node: commands in, sensor frames out."""

from __future__ import annotations

import math
from collections.abc import Sequence

import can
import numpy as np
from numpy.typing import NDArray

from can_bus import (
    COUNTER_MODULO,
    CanBusError,
    Database,
    FrameChecker,
    MessageSpec,
    Raw,
    make_message,
)
from hil_harness.effects.setup_mistakes import SensorMistakes, SetupMistakes
from hil_harness.errors import HarnessError
from hil_harness.nodes.schedule import cycle_of, encode_frame
from hil_harness.sensor_frames import SensorFrames
from hil_harness.signal_map import MappedSignal, SignalMap
from hil_harness.signal_roles import Role
from sim_plant import Plant, PlantDescription

COMMAND_ROLES: tuple[Role, ...] = ("v_command", "w_command")
REFERENCE_ROLES: tuple[Role, ...] = ("reference_x", "reference_y", "reference_heading")


class PlantNode:
    """Steps the plant once per tick and sends what its sensors read.

    With `commands` (float64[n, 2]: v_m_s, w_rad_s; row k drives from t_k to t_(k+1)) it plays the
    host as well: it drives itself and sends the command frames. A command frame that arrives from
    somebody else takes over from then on. Without `commands` it rests until one arrives. `truth`
    holds the true pose of each tick, unless `keep_truth` is off (a node that runs for days). With
    `send_reference` the truth goes on the bus as well. `mistakes` sit between sensors or commands
    and the frames that state them.
    """

    def __init__(
        self,
        plant: Plant,
        description: PlantDescription,
        *,
        database: Database,
        signal_map: SignalMap,
        tick_period_us: int,
        commands: NDArray[np.float64] | None = None,
        send_reference: bool = False,
        keep_truth: bool = True,
        mistakes: SetupMistakes | None = None,
    ) -> None:
        """Bind sensors, commands and truth to the signals of the map."""
        self._plant = plant
        mistakes = mistakes or SetupMistakes()
        self._sensors = SensorFrames(signal_map, description)
        self._mistakes = SensorMistakes(mistakes, description)
        self._command_factors = (mistakes.factor("command_speed"), mistakes.factor("command_turn"))
        self._commands: list[list[float]] | None = None if commands is None else commands.tolist()
        self._command = (0.0, 0.0)
        self._tick = 0
        self._truth: list[tuple[float, float, float]] = []
        self._stamp_us: list[int] = []
        self._keep_truth = keep_truth

        def schedule(messages: Sequence[MessageSpec]) -> list[tuple[MessageSpec, int, int]]:
            cycles = [(spec, cycle_of(spec, tick_period_us)) for spec in messages]
            return [
                (spec, cycle.every, cycle.phase)
                for spec, cycle in sorted(cycles, key=lambda entry: entry[0].frame_id)
            ]

        self._sensor_schedule = schedule(self._sensors.messages)
        command_messages = signal_map.messages(COMMAND_ROLES)
        self._command_schedule = schedule(command_messages)
        self._command_signals = [signal_map.get(role) for role in COMMAND_ROLES]
        self._reference_schedule = (
            schedule(signal_map.messages(REFERENCE_ROLES)) if send_reference else []
        )
        self._reference_signals = [signal_map.get(role) for role in REFERENCE_ROLES]
        for signal in self._reference_signals[:2] if send_reference else []:
            if signal is not None and signal.quantity == "angle":
                raise HarnessError(
                    f"{signal.path} is a place on the globe, which can only be read from a log: "
                    "expected a length"
                )
        # A command holds until the next one: it may be as old as its cycle.
        longest_us = max((spec.cycle_time_us or 0 for spec in command_messages), default=0)
        self.checker = FrameChecker(
            database,
            [spec.name for spec in command_messages],
            max_age_us=max(longest_us, 2 * tick_period_us),
        )

    @property
    def ticks(self) -> int:
        """How many ticks have been stepped."""
        return self._tick

    @property
    def truth(self) -> NDArray[np.float64]:
        """The true pose of each tick so far: float64[n, 3], x_m, y_m, heading_rad unwrapped."""
        return np.array(self._truth, dtype=np.float64).reshape(-1, 3)

    @property
    def stamp_us(self) -> NDArray[np.int64]:
        """When each tick so far was, on the clock that the node was called with: int64[n]."""
        return np.array(self._stamp_us, dtype=np.int64)

    @property
    def command(self) -> tuple[float, float]:
        """The command in force: v_m_s, w_rad_s."""
        return self._command

    def step(self, now_us: int, frames: Sequence[can.Message], /) -> list[can.Message]:
        """Advance to this tick, obey the command frames, and return the frames that are due."""
        tick, plant = self._tick, self._plant
        if tick > 0:
            plant.step(*self._command)
        counts = self._mistakes.apply(plant.counts)
        pose = plant.pose
        if self._keep_truth:
            self._truth.append(pose)
            self._stamp_us.append(now_us)
        if frames:
            self._obey(frames, now_us)
        if self._commands is not None:
            v_m_s, w_rad_s = self._commands[tick] if tick < len(self._commands) else (0.0, 0.0)
            self._command = (v_m_s, w_rad_s)
        counter = tick % COUNTER_MODULO
        sent: list[can.Message] = [
            make_message(spec, self._sensors.encode(spec, counts, counter), now_us)
            for spec, every, phase in self._sensor_schedule
            if tick % every == phase
        ]
        if self._commands is not None:
            v_m_s, w_rad_s = self._command
            v_factor, w_factor = self._command_factors
            said = (v_m_s * v_factor, w_rad_s * w_factor)
            self._send(self._command_schedule, self._command_signals, said, now_us, sent)
        if self._reference_schedule:
            x_m, y_m, heading_rad = pose
            seen = (x_m, y_m, math.remainder(heading_rad, math.tau))
            self._send(self._reference_schedule, self._reference_signals, seen, now_us, sent)
        self._tick = tick + 1
        return sent

    def _send(
        self,
        schedule: Sequence[tuple[MessageSpec, int, int]],
        signals: Sequence[MappedSignal | None],
        values_si: Sequence[float],
        now_us: int,
        sent: list[can.Message],
    ) -> None:
        """Append those messages of a schedule that are due, carrying quantities in SI."""
        for spec, every, phase in schedule:
            if self._tick % every != phase:
                continue
            raw: dict[str, Raw] = {signal.name: signal.initial_raw for signal in spec.payload}
            for signal, value in zip(signals, values_si, strict=True):
                if signal is not None and signal.message.name == spec.name:
                    raw[signal.signal.name] = _raw_or_invalid(signal, value)
            sent.append(make_message(spec, encode_frame(spec, raw, self._tick), now_us))

    def _obey(self, frames: Sequence[can.Message], now_us: int) -> None:
        command = list(self._command)
        for frame in frames:
            accepted = self.checker.check(frame, now_us)
            if accepted is None:
                continue
            self._commands = None
            for axis, signal in enumerate(self._command_signals):
                if signal is not None and signal.message.name == accepted.spec.name:
                    name = signal.signal.name
                    # An invalid command is no command: a drive that loses its host stops.
                    lost = name in accepted.invalid
                    command[axis] = 0.0 if lost else signal.to_si(accepted.raw[name])
        self._command = (command[0], command[1])


def _raw_or_invalid(signal: MappedSignal, value_si: float) -> int | float:
    """Send what the signal cannot hold as not available, where the DBC has a code for that."""
    try:
        return signal.to_raw(value_si)
    except CanBusError:
        if signal.signal.invalid_raw is None:
            raise
        return signal.signal.invalid_raw
