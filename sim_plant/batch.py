"""Many runs at once: the same compiled ticks as `Plant.step`, bit for bit, without the calls."""

from __future__ import annotations

import itertools
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sim_plant import kernel, records
from sim_plant.description import PlantDescription
from sim_plant.errors import PlantError
from sim_plant.generators import SOURCE
from sim_plant.mechanisms import Mechanisms, MechanismSchedule
from sim_plant.plant import MAX_COMMAND, NoiseModel, check_choices, check_seed
from sim_plant.records import DriveModel, EncoderModel
from sim_plant.streams import BLOCK_TICKS, MOTION_STREAMS, NORMALS, Noise, Stream, seed_words

Outputs = Literal["all", "odometry"]

_SHARES_PER_THREAD = 4

# The streams of the sensors that "odometry" leaves out.
_UNREAD_STREAMS = frozenset({Stream.ACCEL_X, Stream.ACCEL_Y, Stream.TEMPERATURE, Stream.SUPPLY})


@dataclass(frozen=True)
class PlantRuns:
    """What a batch of runs leaves; run i was seeded with seeds[i], column k is tick k at t_k.

    Attributes:
        truth: float64[runs, ticks, 3], (x_m, y_m, heading_rad); float64[1, ticks, 3] where all runs
            share one motion. The heading is not wrapped.
        left_count, right_count: int64[runs, ticks], wrapping counters [ticks].
        gyro_code: int64[runs, ticks] [LSB].
        gyro_rate_rad_s: float64[runs, ticks], the analogue rate before the ADC; None where only
            "odometry" was asked for, like the codes that follow.
        accel_x_code, accel_y_code, temperature_code, supply_code: int64[runs, ticks] [LSB].
    """

    truth: NDArray[np.float64]
    left_count: NDArray[np.int64]
    right_count: NDArray[np.int64]
    gyro_code: NDArray[np.int64]
    gyro_rate_rad_s: NDArray[np.float64] | None
    accel_x_code: NDArray[np.int64] | None
    accel_y_code: NDArray[np.int64] | None
    temperature_code: NDArray[np.int64] | None
    supply_code: NDArray[np.int64] | None


def simulate(
    description: PlantDescription,
    mechanisms: Mechanisms | MechanismSchedule | Sequence[Mechanisms | MechanismSchedule],
    commands: ArrayLike,
    seeds: Sequence[int] | NDArray[np.integer[Any]],
    *,
    tick_period_us: int,
    encoder_model: EncoderModel = "counter",
    noise: NoiseModel = "streams",
    drive: DriveModel = "motor",
    outputs: Outputs = "all",
    workers: int | None = None,
) -> PlantRuns:
    """Run the plant once per seed over the same commands.

    Args:
        description: the robot as described.
        mechanisms: how the real one differs, always or over time; one for all runs, or one per
            run.
        commands: float64[ticks, 2], rows (v_m_s, w_rad_s); row k drives (t_k, t_{k+1}], so the last
            one is not used.
        seeds: one whole number from 0 to 2^128 − 1 per run.
        tick_period_us, encoder_model, noise, drive: as for `Plant`.
        outputs: "odometry" leaves out all but truth, both counters and the gyro's code.
        workers: threads over runs; default: as many as this process has processors.

    Raises:
        PlantError: an argument out of its range.
    """
    rows = _check_commands(commands)
    batch = Batch(
        description,
        mechanisms,
        rows,
        seeds,
        tick_period_us=tick_period_us,
        encoder_model=encoder_model,
        noise=noise,
        drive=drive,
        outputs=outputs,
        workers=workers,
    )
    return batch.advance(len(rows))


def _processors() -> int:
    if hasattr(os, "sched_getaffinity"):  # not on macOS and Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _check_commands(commands: ArrayLike) -> NDArray[np.float64]:
    rows = np.ascontiguousarray(commands, np.float64)
    if rows.ndim != 2 or rows.shape[1] != 2 or rows.shape[0] < 1:
        raise PlantError(f"commands of shape {rows.shape}: expected (ticks, 2), at least one tick")
    wrong = np.flatnonzero(~(np.abs(rows) <= MAX_COMMAND).all(axis=1))
    if wrong.size:
        k = int(wrong[0])
        raise PlantError(
            f"command ({rows[k, 0]} m/s, {rows[k, 1]} rad/s) at tick {k}: expected two numbers "
            f"from {-MAX_COMMAND:g} to {MAX_COMMAND:g}"
        )
    return rows


class Batch:
    """Runs that are simulated some ticks at a time, with the same bits as all at once.

    The arguments are those of `simulate`, but that the rows of `commands` are repeated for ever.
    """

    def __init__(
        self,
        description: PlantDescription,
        mechanisms: Mechanisms | MechanismSchedule | Sequence[Mechanisms | MechanismSchedule],
        commands: ArrayLike,
        seeds: Sequence[int] | NDArray[np.integer[Any]],
        *,
        tick_period_us: int,
        encoder_model: EncoderModel = "counter",
        noise: NoiseModel = "streams",
        drive: DriveModel = "motor",
        outputs: Outputs = "all",
        workers: int | None = None,
    ) -> None:
        """Put every robot at its start. Raises PlantError for an argument out of its range."""
        check_choices(tick_period_us, encoder_model, noise, drive)
        if outputs not in ("all", "odometry"):
            raise PlantError(f"outputs = {outputs!r}: expected 'all' or 'odometry'")
        if workers is not None and workers < 1:
            raise PlantError(f"workers = {workers}: expected a whole number of at least 1")
        self._commands = _check_commands(commands)
        runs = len(seeds)
        self._seeds = np.zeros((runs, 2), np.uint64)
        for row, seed in zip(self._seeds, seeds, strict=True):
            row[:] = seed_words(check_seed(seed))
        per_run: list[Mechanisms | MechanismSchedule]
        if isinstance(mechanisms, Mechanisms | MechanismSchedule):
            per_run = [mechanisms] * runs
        else:
            per_run = list(mechanisms)
            if len(per_run) != runs:
                raise PlantError(
                    f"mechanisms: expected one for all or one for each of the {runs} seeds, "
                    f"got {len(per_run)}"
                )
        built = {
            id(item): records.build_parameters(
                description,
                item,
                tick_s=tick_period_us / 1e6,
                drive_model=drive,
                encoder_model=encoder_model,
            )
            for item in {id(item): item for item in per_run}.values()
        }
        self._parameters = [built[id(item)] for item in per_run]
        self._noise: NoiseModel = noise
        self._everything = outputs == "all"
        self._threads = workers or _processors()
        self._tick = 0
        one_for_all = len(built) == 1
        self._is_shared = one_for_all and not (
            records.active_streams(self._parameters[0]) & MOTION_STREAMS
        )
        self._motion_states = np.zeros(1 if self._is_shared else runs, records.MOTION_STATE)
        self._sensor_states = np.zeros(runs, records.SENSOR_STATE)
        self._sources = np.zeros((runs, 2 if noise == "lesson" else 1), SOURCE)

    def advance(self, ticks: int) -> PlantRuns:
        """Return the next ticks of every run.

        Args:
            ticks: how many; but for the last time a multiple of `BLOCK_TICKS`.

        Raises:
            PlantError: ticks that begin within a block of noise.
        """
        if self._tick % BLOCK_TICKS:
            raise PlantError(f"tick {self._tick}: expected a multiple of {BLOCK_TICKS} to go on")
        into = _Arrays(len(self._seeds), ticks, everything=self._everything)
        samples: NDArray[Any] | None = None
        if self._is_shared:
            samples = np.zeros(ticks, records.SAMPLE)
            kernel.run_motion(
                self._parameters[0],
                self._motion_states,
                samples,
                np.zeros(1, NORMALS),
                self._commands,
                self._tick,
            )
            into.truth = samples.view(np.float64).reshape(1, ticks, -1)[:, :, :3]
        else:
            into.truth = np.empty((len(self._seeds), ticks, 3))
        runs = range(len(self._seeds))
        if self._threads == 1 or len(runs) < 2:
            self._work(runs, samples, into)
        else:
            # A few shares per thread, so that all threads end together.
            size = -(-len(runs) // (_SHARES_PER_THREAD * self._threads))
            shares = (runs[i : i + size] for i in runs[::size])
            with ThreadPoolExecutor(self._threads) as pool:
                list(pool.map(lambda share: self._work(share, samples, into), shares))
        self._tick += ticks
        return into.runs()

    def _work(self, runs: range, samples: NDArray[Any] | None, into: _Arrays) -> None:
        """Fill the rows of these runs; *samples* is the motion that they share, if they do."""
        truth = into.truth
        if samples is None:
            samples = np.zeros(BLOCK_TICKS, records.SAMPLE)
        else:
            truth = np.empty((0, 0, 3))
        for _, group in itertools.groupby(runs, lambda run: id(self._parameters[run])):
            same = list(group)
            these = slice(same[0], same[-1] + 1)
            parameters = self._parameters[same[0]]
            noise = self._noise_for(parameters)
            kernel.run(
                parameters,
                self._motion_states[these],
                self._sensor_states[these],
                self._commands,
                samples,
                self._sources[these],
                noise.raws,
                self._seeds[these],
                noise.active,
                noise.columns,
                noise.normals,
                same[0],
                truth,
                into.left,
                into.right,
                into.gyro,
                into.rates,
                *into.others,
            )

    def _noise_for(self, parameters: NDArray[Any]) -> Noise:
        active = records.active_streams(parameters)
        if not self._everything:
            active -= _UNREAD_STREAMS
        return Noise(active, lesson=self._noise == "lesson")


class _Arrays:
    """Room for some ticks of some runs."""

    def __init__(self, runs: int, ticks: int, *, everything: bool) -> None:
        shape = (runs, ticks)
        # One allocation: large ones come in huge pages, and their first touch is quicker.
        self.left, self.right, self.gyro = np.empty((3, *shape), np.int64)
        extra = shape if everything else (0, 0)
        self.rates = np.empty(extra, np.float64)
        self.others = np.empty((4, *extra), np.int64)
        self.truth: NDArray[np.float64] = np.empty((0, 0, 3))

    def runs(self) -> PlantRuns:
        """Return what has been filled."""
        complete = self.rates.size > 0
        others = self.others if complete else (None,) * 4
        rates = self.rates if complete else None
        return PlantRuns(self.truth, self.left, self.right, self.gyro, rates, *others)
