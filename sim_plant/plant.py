"""The plant one tick at a time, as a node in a loop uses it."""

from __future__ import annotations

from collections import deque
from typing import Literal, NamedTuple

import numpy as np

from sim_plant import kernel, records
from sim_plant.description import PlantDescription
from sim_plant.errors import PlantError
from sim_plant.mechanisms import Mechanisms, MechanismSchedule
from sim_plant.records import DriveModel, EncoderModel
from sim_plant.streams import BLOCK_TICKS, Noise

NoiseModel = Literal["streams", "lesson"]

MAX_COMMAND = 1000.0
MAX_SEED = 2**128 - 1
MIN_TICK_PERIOD_US = 100
MAX_TICK_PERIOD_US = 1_000_000


class SensorCounts(NamedTuple):
    """What a microcontroller reads at one tick: raw counter values and ADC codes [ticks, LSB]."""

    left_count: int
    right_count: int
    gyro_code: int
    accel_x_code: int
    accel_y_code: int
    temperature_code: int
    supply_code: int


class Plant:
    """One robot in its world, advanced by whole ticks; deterministic for a seed.

    Command k drives (t_k, t_{k+1}]; the sensors at t_k are the counters at t_k and the gyro's mean
    over (t_{k−1}, t_k]. Tick 0, before any step, is there from construction: pose (0, 0, 0), at
    rest (drive="ideal": in motion from its first step on).

    Args:
        description: the robot as described.
        mechanisms: how the real one differs, always or over time.
        tick_period_us: tick period [µs], 100 to 1 000 000.
        seed: 0 to 2^128 − 1; one seed is one run, here and in `simulate`.
        encoder_model: "counter" (a real one) or "lesson_counter".
        noise: "streams" (one counter-based stream per mechanism) or "lesson" (numpy's
            `default_rng(seed)` in the lesson's order for both encoders and the gyro).
        drive: "motor", or "ideal": the wheels turn as the true geometry needs for the body to
            follow the command, without delay or dynamics; contact effects disturb that as usual.

    Raises:
        PlantError: an argument out of its range.
    """

    def __init__(
        self,
        description: PlantDescription,
        mechanisms: Mechanisms | MechanismSchedule | None = None,
        *,
        tick_period_us: int,
        seed: int,
        encoder_model: EncoderModel = "counter",
        noise: NoiseModel = "streams",
        drive: DriveModel = "motor",
    ) -> None:
        """Build the plant and read its sensors at tick 0."""
        check_choices(tick_period_us, encoder_model, noise, drive)
        self._tick_period_us = tick_period_us
        self._parameters = records.build_parameters(
            description,
            mechanisms or Mechanisms(),
            tick_s=tick_period_us / 1e6,
            drive_model=drive,
            encoder_model=encoder_model,
        )
        self._noise = Noise(records.active_streams(self._parameters), lesson=noise == "lesson")
        self._noise.start(check_seed(seed))
        delays = self._parameters["delay_ticks"].tolist()
        if drive == "ideal":
            delays = [0] * len(delays)
        longest = max(delays)
        # commands k − delay − 1 … k; the robot was told to rest before the first
        self._commands = deque([(0.0, 0.0)] * (longest + 2), maxlen=longest + 2)
        starts = self._parameters["from_tick"].tolist()[1:]
        # from which tick on, and how many of the oldest commands are too old then
        self._changes = [
            (tick, longest - delay) for tick, delay in zip(starts, delays[1:], strict=True)
        ]
        self._skipped = longest - delays[0]
        self._motion_state = np.zeros(1, records.MOTION_STATE)
        self._sensor_state = np.zeros(1, records.SENSOR_STATE)
        self._sample = np.zeros(1, records.SAMPLE)
        self._sample_values = self._sample.view(np.float64)
        self._codes = np.zeros(records.CODES, np.int64)
        self._tick = 0
        self._fill_noise(0)
        # a motion of one tick, tick 0, is only observed
        kernel.run_motion(
            self._parameters,
            self._motion_state,
            self._sample,
            self._noise.normals,
            np.zeros((1, 2)),
            0,
        )
        kernel.read(
            self._parameters, self._sensor_state, self._sample, self._noise.normals, 0, self._codes
        )

    def step(self, v_command_m_s: float, w_command_rad_s: float) -> None:
        """Advance one tick under a command, held over it.

        Args:
            v_command_m_s: forward speed [m/s], at most 1000 either way.
            w_command_rad_s: turn rate [rad/s], anticlockwise positive, at most 1000 either way.

        Raises:
            PlantError: a command that is not a number or too large; the plant has not moved.
        """
        if not (
            -MAX_COMMAND <= v_command_m_s <= MAX_COMMAND
            and -MAX_COMMAND <= w_command_rad_s <= MAX_COMMAND
        ):
            raise PlantError(
                f"command ({v_command_m_s!r} m/s, {w_command_rad_s!r} rad/s) at tick "
                f"{self._tick}: expected two numbers from {-MAX_COMMAND:g} to {MAX_COMMAND:g}"
            )
        self._tick += 1
        k = self._tick % BLOCK_TICKS
        if k == 0:
            self._fill_noise(self._tick // BLOCK_TICKS)
        commands = self._commands
        commands.append((float(v_command_m_s), float(w_command_rad_s)))
        while self._changes and self._tick >= self._changes[0][0]:
            self._skipped = self._changes.pop(0)[1]
        v0, w0 = commands[self._skipped]
        v1, w1 = commands[self._skipped + 1]
        kernel.step(
            self._parameters,
            self._motion_state,
            self._sensor_state,
            self._sample,
            self._noise.normals,
            k,
            self._codes,
            v0,
            w0,
            v1,
            w1,
        )

    def _fill_noise(self, block: int) -> None:
        noise = self._noise
        kernel.fill_noise(noise.sources, noise.raws, noise.seed, noise.active, noise.columns, block)

    @property
    def counts(self) -> SensorCounts:
        """The raw sensor readings of the present tick."""
        return SensorCounts._make(self._codes.tolist())

    @property
    def pose(self) -> tuple[float, float, float]:
        """The true (x_m, y_m, heading_rad) at the present tick; the heading is not wrapped."""
        x_m, y_m, heading_rad = self._sample_values[:3].tolist()
        return x_m, y_m, heading_rad

    @property
    def gyro_rate_rad_s(self) -> float:
        """The gyro's analogue reading of the present tick, before the ADC [rad/s]."""
        return float(self._sensor_state["gyro_rate_rad_s"][0])

    @property
    def tick(self) -> int:
        """The number of steps taken."""
        return self._tick

    @property
    def time_us(self) -> int:
        """Simulated time since tick 0 [µs]."""
        return self._tick * self._tick_period_us


def check_seed(seed: int) -> int:
    """Return the seed as an int.

    Raises:
        PlantError: not a whole number from 0 to 2^128 − 1.
    """
    if isinstance(seed, bool) or not isinstance(seed, (int, np.integer)):
        raise PlantError(f"seed = {seed!r}: expected a whole number from 0 to 2^128 − 1, such as 7")
    if not 0 <= seed <= MAX_SEED:
        raise PlantError(f"seed = {seed}: expected a whole number from 0 to 2^128 − 1, such as 7")
    return int(seed)


def check_choices(tick_period_us: int, encoder_model: str, noise: str, drive: str) -> None:
    """Refuse a tick period or a named choice that the plant does not know.

    Raises:
        PlantError: one line naming the argument, its value and the choices.
    """
    if (
        isinstance(tick_period_us, bool)
        or not isinstance(tick_period_us, int)
        or not (MIN_TICK_PERIOD_US <= tick_period_us <= MAX_TICK_PERIOD_US)
    ):
        raise PlantError(
            f"tick_period_us = {tick_period_us!r}: expected a whole number from "
            f"{MIN_TICK_PERIOD_US} to {MAX_TICK_PERIOD_US}, for example 10000"
        )
    for name, value, choices in (
        ("encoder_model", encoder_model, ("counter", "lesson_counter")),
        ("noise", noise, ("streams", "lesson")),
        ("drive", drive, ("motor", "ideal")),
    ):
        if value not in choices:
            raise PlantError(f"{name} = {value!r}: expected {' or '.join(map(repr, choices))}")
