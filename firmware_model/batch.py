"""The kernel over arrays of runs: no bus, no Python in the loop, all cores."""

from __future__ import annotations

import itertools
import math
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from firmware_model.batch_inputs import BatchInputs, Int64Array
from firmware_model.c99_kernel import c99_batch
from firmware_model.c99_library import FLAGS
from firmware_model.compiled import compiled_batch
from firmware_model.config import CONFIG_DTYPE, KernelConfig
from firmware_model.errors import FirmwareError
from firmware_model.kernel import config_record, initial_state
from firmware_model.oracle import Integers, OracleRuns, integer_type
from firmware_model.state import STATE_DTYPE, STATE_FIELDS
from firmware_model.twin import TWIN_CONFIG_DTYPE, TWIN_DTYPE, build_twin_config

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class BatchRuns:
    """Results of `run_batch`; tick k of each history is the state after the inputs of tick k.

    Attributes:
        configs: the configuration of each run.
        final_states: structured array [runs] with the fields of `State`, int64 each; Python's
            integers, here and in pose_q, where a configuration is beyond C.
        final_twins: structured array [runs] (x_m, y_m, heading_rad, gap_turn_rad), or None.
        pose_q: int64 [runs, ticks, 3]: x_m_q, y_m_q, heading_turn_q, or None without history.
        status: int32 [runs, ticks], the status word, or None.
        heading_source: int8 [runs, ticks], see HeadingSource, or None.
        twin_pose: float64 [runs, ticks, 3]: x_m, y_m, heading_rad (unwrapped), or None.
    """

    configs: tuple[KernelConfig, ...]
    final_states: npt.NDArray[np.void]
    final_twins: npt.NDArray[np.void] | None
    pose_q: Integers | None
    status: npt.NDArray[np.int32] | None
    heading_source: npt.NDArray[np.int8] | None
    twin_pose: Float64Array | None

    def pose_m_rad(self) -> Float64Array:
        """Return the pose history as float64 [runs, ticks, 3] in m and rad, heading unwrapped.

        Unwrapping adds up integer differences modulo one turn: it is exact as long as the robot
        turns by less than half a turn in a tick.

        Raises:
            FirmwareError: the batch was run without history.
        """
        if self.pose_q is None:
            raise FirmwareError("pose_m_rad: no history was kept: expected run_batch(history=True)")
        poses = np.empty(self.pose_q.shape, dtype=np.float64)
        for run, config in enumerate(self.configs):
            poses[run] = pose_m_rad(config, self.pose_q[run])
        return poses


def pose_m_rad(config: KernelConfig, pose_q: Integers) -> Float64Array:
    """Return raw poses int64 [ticks, 3] as float64 [ticks, 3] in m and rad, heading unwrapped.

    The heading starts from zero before the first tick.
    """
    poses = np.empty(pose_q.shape, dtype=np.float64)
    poses[:, :2] = np.ldexp(pose_q[:, :2].astype(np.float64), -config.position_frac_bits)
    half = 1 << (config.heading_frac_bits - 1)
    turns = np.diff(pose_q[:, 2], prepend=0)
    turns = ((turns + half) & (2 * half - 1)) - half
    unwrapped = np.cumsum(turns).astype(np.float64)
    poses[:, 2] = unwrapped * (2.0 * math.pi / (2 * half))
    return poses


def run_batch(
    config: KernelConfig | Sequence[KernelConfig],
    left_count: npt.ArrayLike,
    right_count: npt.ArrayLike,
    gyro_code: npt.ArrayLike,
    encoder_validity: npt.ArrayLike | None = None,
    gyro_validity: npt.ArrayLike | None = None,
    *,
    twin: bool = True,
    history: bool = True,
    workers: int | None = None,
) -> BatchRuns:
    """Step one kernel per run through all of its ticks.

    Args:
        config: one configuration for all runs, or one per run.
        left_count: integers [runs, ticks], left encoder counter.
        right_count: integers [runs, ticks], right encoder counter.
        gyro_code: integers [runs, ticks], gyro ADC code.
        encoder_validity: integers [runs, ticks] of FRESH, STALE, INVALID; None: all fresh.
        gyro_validity: likewise for the gyro.
        twin: run the float64 twin beside each kernel.
        history: keep every tick; without it memory does not grow with the number of ticks.
        workers: threads; None: one per core.

    Inputs of one run (shape [1, ticks]) serve all configurations. No copy is made of int64 counts
    whose ticks lie beside each other in memory. Where C cannot hold a configuration all runs are
    those of the kernel in Python, on one core: some ten thousand ticks a second.

    Raises:
        FirmwareError: arrays that are not of integers, not 2-D, or of different shapes.
    """
    given = BatchInputs.of(
        config, left_count, right_count, gyro_code, encoder_validity, gyro_validity
    )
    configs, runs, ticks = given.configs, given.runs, given.ticks
    if integer_type(configs) is object:
        return _run_oracle(given, twin=twin, history=history)

    config_records, table = _records(configs)
    states = _initial_states(configs)
    twin_configs = _twin_records(configs if twin else ())
    twins = np.zeros(runs if twin else 0, TWIN_DTYPE)
    kept = runs if history else 0
    pose_q, status, source = _history(kept, ticks)
    twin_pose = np.empty((kept if twin else 0, ticks, 3), dtype=np.float64)

    batch = compiled_batch()

    def run_chunk(part: slice) -> None:
        batch(
            states[part],
            config_records[part],
            table,
            given.left[part],
            given.right[part],
            given.encoder[part],
            given.gyro[part],
            given.gyro_valid[part],
            twins[part],
            twin_configs[part],
            pose_q[part],
            status[part],
            source[part],
            twin_pose[part],
        )

    _in_threads(run_chunk, runs, workers)
    return BatchRuns(
        configs=configs,
        final_states=states,
        final_twins=twins if twin else None,
        pose_q=pose_q if history else None,
        status=status if history else None,
        heading_source=source if history else None,
        twin_pose=twin_pose if history and twin else None,
    )


def _run_oracle(given: BatchInputs, *, twin: bool, history: bool) -> BatchRuns:
    """Do as `run_batch` does, by the kernel in Python."""
    runs = OracleRuns(given.configs)
    pose_q, status, source = _history(
        given.runs if history else 0, given.ticks, integer_type(given.configs)
    )
    twin_pose = np.empty((given.runs if history and twin else 0, given.ticks, 3))
    runs.step(
        (given.left, given.right, given.encoder, given.gyro, given.gyro_valid),
        (pose_q, status, source, twin_pose),
    )
    return BatchRuns(
        configs=given.configs,
        final_states=runs.states,
        final_twins=runs.twins if twin else None,
        pose_q=pose_q if history else None,
        status=status if history else None,
        heading_source=source if history else None,
        twin_pose=twin_pose if history and twin else None,
    )


def run_batch_c99(
    config: KernelConfig | Sequence[KernelConfig],
    left_count: npt.ArrayLike,
    right_count: npt.ArrayLike,
    gyro_code: npt.ArrayLike,
    encoder_validity: npt.ArrayLike | None = None,
    gyro_validity: npt.ArrayLike | None = None,
    *,
    history: bool = True,
    workers: int | None = None,
    flags: Sequence[str] = FLAGS,
) -> BatchRuns:
    """Do as `run_batch` does, by the C99 kernel built with *flags* and without the float twin.

    Raises:
        FirmwareError: as `run_batch`; no C compiler, or one that does not compile the sources; a
            configuration beyond C.
    """
    given = BatchInputs.of(
        config, left_count, right_count, gyro_code, encoder_validity, gyro_validity
    )
    batch, c_states = c99_batch(given.configs, flags)
    pose_q, status, source = _history(given.runs if history else 0, given.ticks)
    inputs = (given.left, given.right, given.encoder, given.gyro, given.gyro_valid)
    _in_threads(lambda part: batch(part, inputs, (pose_q, status, source)), given.runs, workers)
    states = np.zeros(given.runs, STATE_DTYPE)
    for name in STATE_FIELDS:
        states[name] = c_states[name]
    return BatchRuns(
        configs=given.configs,
        final_states=states,
        final_twins=None,
        pose_q=pose_q if history else None,
        status=status if history else None,
        heading_source=source if history else None,
        twin_pose=None,
    )


def _history(
    runs: int, ticks: int, integers: npt.DTypeLike = np.int64
) -> tuple[Any, npt.NDArray[np.int32], npt.NDArray[np.int8]]:
    """Return room for pose_q, of these integers, status and heading_source of so many runs."""
    return (
        np.empty((runs, ticks, 3), dtype=integers),
        np.empty((runs, ticks), dtype=np.int32),
        np.empty((runs, ticks), dtype=np.int8),
    )


def _in_threads(work: Callable[[slice], None], runs: int, workers: int | None) -> None:
    """Call *work* with slices of the runs, a few slices per thread so that all end together."""
    threads = workers or _core_count()
    if threads == 1 or runs < 2:
        work(slice(0, runs))
        return
    size = max(-(-runs // (4 * threads)), 1)
    parts = [slice(start, min(start + size, runs)) for start in range(0, runs, size)]
    with ThreadPoolExecutor(threads) as pool:
        for _ in pool.map(work, parts):
            pass


def _core_count() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _records(configs: tuple[KernelConfig, ...]) -> tuple[npt.NDArray[np.void], Int64Array]:
    """Return one record per run and the tables of all, each table once."""
    records = np.zeros(len(configs), CONFIG_DTYPE)
    starts: dict[tuple[int, ...], int] = {}
    flat: list[int] = []
    for same in _same_configs(configs):
        config = configs[same.start]
        if config.table not in starts:
            starts[config.table] = len(flat)
            flat.extend(config.table)
        records[same] = config_record(config, table_start=starts[config.table])[0]
    return records, np.array(flat, dtype=np.int64)


def _initial_states(configs: tuple[KernelConfig, ...]) -> npt.NDArray[np.void]:
    """Return the states at power-on, one record per run."""
    states = np.zeros(len(configs), STATE_DTYPE)
    for same in _same_configs(configs):
        states[same] = astuple(initial_state(configs[same.start]))
    return states


def _twin_records(configs: tuple[KernelConfig, ...]) -> npt.NDArray[np.void]:
    """Return the twin's constants, one record per run."""
    records = np.zeros(len(configs), TWIN_CONFIG_DTYPE)
    for same in _same_configs(configs):
        records[same] = astuple(build_twin_config(configs[same.start]))
    return records


def _same_configs(configs: tuple[KernelConfig, ...]) -> Iterator[slice]:
    """Yield the stretches of neighbouring runs that share one configuration."""
    start = 0
    for _, group in itertools.groupby(configs, id):
        stop = start + len(list(group))
        yield slice(start, stop)
        start = stop
