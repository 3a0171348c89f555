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
from sim_plant.mechanisms import Mechanisms, MechanismSchedule
from sim_plant.plant import MAX_COMMAND, NoiseModel, check_choices, check_seed
from sim_plant.records import DriveModel, EncoderModel
from sim_plant.streams import BLOCK_TICKS, MOTION_STREAMS, NORMALS, Noise, Stream

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
        seeds: one whole number from 0 to 2^64 − 1 per run.
        tick_period_us, encoder_model, noise, drive: as for `Plant`.
        outputs: "odometry" leaves out all but truth, both counters and the gyro's code.
        workers: threads over runs; default: as many as this process has processors.

    Raises:
        PlantError: an argument out of its range.
    """
    check_choices(tick_period_us, encoder_model, noise, drive)
    if outputs not in ("all", "odometry"):
        raise PlantError(f"outputs = {outputs!r}: expected 'all' or 'odometry'")
    if workers is not None and workers < 1:
        raise PlantError(f"workers = {workers}: expected a whole number of at least 1")
    rows = _check_commands(commands)
    run_seeds = [check_seed(seed) for seed in seeds]
    per_run: list[Mechanisms | MechanismSchedule]
    if isinstance(mechanisms, Mechanisms | MechanismSchedule):
        per_run = [mechanisms] * len(run_seeds)
    else:
        per_run = list(mechanisms)
        if len(per_run) != len(run_seeds):
            raise PlantError(
                f"mechanisms: expected one for all or one for each of the {len(run_seeds)} seeds, "
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
    batch = _Batch(
        [built[id(item)] for item in per_run],
        run_seeds,
        rows,
        noise,
        everything=outputs == "all",
    )
    threads = workers or _processors()
    runs = range(len(run_seeds))
    if threads == 1 or len(runs) < 2:
        batch.work(runs)
    else:
        # A few shares per thread, so that all threads end together.
        size = -(-len(runs) // (_SHARES_PER_THREAD * threads))
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(batch.work, (runs[i : i + size] for i in runs[::size])))
    return batch.runs()


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


class _Batch:
    """The arrays of one `simulate` call; `work` fills the rows of some runs."""

    def __init__(
        self,
        parameters: list[NDArray[Any]],
        seeds: list[int],
        commands: NDArray[np.float64],
        noise: NoiseModel,
        *,
        everything: bool,
    ) -> None:
        self._parameters = parameters
        self._seeds = np.array(seeds, np.uint64)
        self._commands = commands
        self._noise: NoiseModel = noise
        runs, ticks = len(seeds), commands.shape[0]
        shape = (runs, ticks)
        # One allocation: large ones come in huge pages, and their first touch is quicker.
        self._left, self._right, self._gyro = np.empty((3, *shape), np.int64)
        extra = shape if everything else (0, 0)
        self._rates = np.empty(extra, np.float64)
        self._others = np.empty((4, *extra), np.int64)
        self._shared: NDArray[Any] | None = None
        one_for_all = len({id(record) for record in parameters}) == 1
        if one_for_all and not records.active_streams(parameters[0]) & MOTION_STREAMS:
            self._shared = self._move_once(parameters[0])
            self._truth = self._shared.view(np.float64).reshape(1, ticks, -1)[:, :, :3]
        else:
            self._truth = np.empty((runs, ticks, 3))

    def _move_once(self, parameters: NDArray[Any]) -> NDArray[Any]:
        samples = np.zeros(self._commands.shape[0], records.SAMPLE)
        kernel.run_motion(
            parameters,
            np.zeros(1, records.MOTION_STATE),
            samples,
            np.zeros(1, NORMALS),
            self._commands,
        )
        return samples

    def work(self, runs: range) -> None:
        """Fill the rows of these runs."""
        shared = self._shared is not None
        samples = (
            self._shared if self._shared is not None else np.zeros(BLOCK_TICKS, records.SAMPLE)
        )
        truth = np.empty((0, 0, 3)) if shared else self._truth
        for _, group in itertools.groupby(runs, lambda run: id(self._parameters[run])):
            same = list(group)
            parameters = self._parameters[same[0]]
            noise = self._noise_for(parameters)
            kernel.run(
                parameters,
                np.zeros(len(same), records.MOTION_STATE),
                np.zeros(len(same), records.SENSOR_STATE),
                self._commands,
                samples,
                noise.sources,
                noise.raws,
                self._seeds[same[0] : same[-1] + 1],
                noise.active,
                noise.columns,
                noise.normals,
                same[0],
                truth,
                self._left,
                self._right,
                self._gyro,
                self._rates,
                *self._others,
            )

    def _noise_for(self, parameters: NDArray[Any]) -> Noise:
        active = records.active_streams(parameters)
        if not self._rates.size:
            active -= _UNREAD_STREAMS
        return Noise(active, lesson=self._noise == "lesson")

    def runs(self) -> PlantRuns:
        """Return what has been filled."""
        complete = self._rates.size > 0
        others = self._others if complete else (None,) * 4
        return PlantRuns(
            self._truth,
            self._left,
            self._right,
            self._gyro,
            self._rates if complete else None,
            *others,
        )
