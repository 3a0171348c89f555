"""Runs of one configuration, some ticks at a time: memory does not grow with the ticks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firmware_model import FRESH, KernelConfig
from firmware_model.compiled import compiled_batch
from firmware_model.config import CONFIG_DTYPE
from firmware_model.kernel import initial_state
from firmware_model.oracle import Integers, OracleRuns, integer_type
from firmware_model.state import STATE_DTYPE
from firmware_model.twin import TWIN_CONFIG_DTYPE, TWIN_DTYPE, build_twin_config

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

CHUNK_TICKS = 4096


@dataclass(frozen=True)
class Stretch:
    """Some ticks of every run; the arrays are overwritten by the next stretch.

    Attributes:
        start: the first tick, from the beginning of the arrays that were handed in.
        pose_q: int64[runs, n, 3], x_m_q, y_m_q and heading_turn_q after each tick; Python's
            integers where the configuration is beyond C.
        twin_pose: float64[runs, n, 3], x_m, y_m and the unwrapped heading_rad of the float twin.
        status: int32[runs, n], the status word.
        overflow_count: integers [runs], overflows since power-on.
    """

    start: int
    pose_q: Integers
    twin_pose: Floats
    status: NDArray[np.int32]
    overflow_count: Integers


class Streams:
    """Kernel and float twin of some runs, which go on from wherever the last ticks left them.

    In machine code; in Python, some hundred times slower, what C cannot hold.
    """

    def __init__(self, config: KernelConfig, runs: int) -> None:
        """Put every run at power-on."""
        self._integers = integer_type([config])
        self._runs = OracleRuns([config] * runs) if config.beyond_c else _Compiled(config, runs)

    def over(
        self,
        left_count: Ints,
        right_count: Ints,
        gyro_code: Ints,
        *,
        chunk_ticks: int = CHUNK_TICKS,
    ) -> Iterator[Stretch]:
        """Yield what `firmware_model.run_batch` would return with history, a stretch at a time.

        Args:
            left_count, right_count, gyro_code: int64[runs, ticks], the next ones, all fresh; the
                ticks of a run lie beside each other in memory.
            chunk_ticks: how many ticks are held at once.
        """
        runs, ticks = left_count.shape
        longest = min(chunk_ticks, ticks)
        fresh = np.full((runs, longest), FRESH, np.int8)
        size = 0
        for start in range(0, ticks, max(longest, 1)):
            part = slice(start, min(start + longest, ticks))
            if part.stop - start != size:
                size = part.stop - start
                pose_q = np.empty((runs, size, 3), dtype=self._integers)
                twin_pose = np.empty((runs, size, 3), dtype=np.float64)
                status = np.empty((runs, size), dtype=np.int32)
                source = np.empty((runs, size), dtype=np.int8)
            self._runs.step(
                (
                    left_count[:, part],
                    right_count[:, part],
                    fresh[:, :size],
                    gyro_code[:, part],
                    fresh[:, :size],
                ),
                (pose_q, status, source, twin_pose),
            )
            yield Stretch(start, pose_q, twin_pose, status, self._runs.overflow_count)


class _Compiled:
    """Runs of the compiled kernel side by side; as `OracleRuns`."""

    def __init__(self, config: KernelConfig, runs: int) -> None:
        """Put every run at power-on."""
        self._records = _repeated(config, CONFIG_DTYPE, runs)
        self._table = _table(config)
        self._states = _repeated(initial_state(config), STATE_DTYPE, runs)
        self._twin_configs = _repeated(build_twin_config(config), TWIN_CONFIG_DTYPE, runs)
        self._twins = np.zeros(runs, TWIN_DTYPE)
        self._batch = compiled_batch()

    @property
    def overflow_count(self) -> Ints:
        """Overflows of each run since power-on."""
        return self._states["overflow_count"]

    def step(self, inputs: Sequence[NDArray[Any]], histories: Sequence[NDArray[Any]]) -> None:
        """Step each run through the next ticks."""
        kernels = self._states, self._records, self._table
        self._batch(*kernels, *inputs, self._twins, self._twin_configs, *histories)


def stream(
    config: KernelConfig,
    left_count: Ints,
    right_count: Ints,
    gyro_code: Ints,
    *,
    chunk_ticks: int = CHUNK_TICKS,
) -> Iterator[Stretch]:
    """Yield whole runs from power-on; the arguments are those of `Streams.over`."""
    runs = Streams(config, len(left_count))
    return runs.over(left_count, right_count, gyro_code, chunk_ticks=chunk_ticks)


_KEPT_TABLES = 64
_TABLES: dict[tuple[str, int, int, int], Ints] = {}


def _table(config: KernelConfig) -> Ints:
    """Return the sine or CORDIC table, which many configurations share, as an array."""
    trig = config.description.trig
    key = (trig.method, trig.entries, trig.iterations, trig.frac_bits)
    table = _TABLES.get(key)
    if table is None:
        if len(_TABLES) >= _KEPT_TABLES:
            _TABLES.clear()
        table = np.array(config.table, dtype=np.int64)
        _TABLES[key] = table
    return table


def _repeated(record: object, dtype: np.dtype[Any], runs: int) -> NDArray[Any]:
    """Return one record per run; the fields of *dtype*, all of one type, are those of *record*."""
    assert dtype.names is not None  # a record type
    values = np.empty((runs, len(dtype.names)), dtype[0])
    values[:] = attrgetter(*dtype.names)(record)
    return values.view(dtype)[:, 0]
