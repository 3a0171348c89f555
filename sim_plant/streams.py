"""Random streams: one per mechanism, counter-based, the same wherever and however a run is cut.

The normals of ticks [j·1024, (j+1)·1024) of a stream come from a Philox4x64 generator (Salmon et
al. 2011, *Parallel random numbers: as easy as 1, 2, 3*) with key (seed, stream) and a counter that
starts at j·2^64. So a block depends on nothing but seed, stream and j; a mechanism that is off
draws nothing; and switching one on does not shift another's noise.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import Any, Protocol

import numpy as np
from numba import njit
from numpy.typing import NDArray

BLOCK_TICKS = 1024


class Stream(IntEnum):
    """Row of the noise table and second key word of the generator; never renumber."""

    ENCODER_RIGHT = 0
    ENCODER_LEFT = 1
    GYRO_NOISE = 2
    GYRO_BIAS_WALK = 3
    MICRO_SLIP_LEFT = 4
    MICRO_SLIP_RIGHT = 5
    MICRO_SLIP_STEP_LEFT = 6
    MICRO_SLIP_STEP_RIGHT = 7
    ACCEL_X = 8
    ACCEL_Y = 9
    TEMPERATURE = 10
    SUPPLY = 11


MOTION_STREAMS = frozenset(
    {
        Stream.MICRO_SLIP_LEFT,
        Stream.MICRO_SLIP_RIGHT,
        Stream.MICRO_SLIP_STEP_LEFT,
        Stream.MICRO_SLIP_STEP_RIGHT,
    }
)


class Noise(Protocol):
    """A source of the noise table, read block after block from the start."""

    def fill(self, block: int, table: NDArray[np.float64]) -> None:
        """Write the standard normals of one block of ticks into `table[stream, 0:1024]`."""


@njit(cache=True, nogil=True)  # numba's normals are numpy's, bit for bit, in half the time
def _fill_normals(generator: Any, row: NDArray[np.float64]) -> None:
    for k in range(row.size):
        row[k] = generator.standard_normal()


@njit(cache=True, nogil=True)
def _fill_lesson(generator: Any, table: NDArray[np.float64], first: int) -> None:
    for k in range(first, BLOCK_TICKS):
        table[0, k] = generator.standard_normal()
        table[1, k] = generator.standard_normal()
        table[2, k] = generator.standard_normal()


class StreamNoise:
    """Independent Philox streams for the active mechanisms; rows of the others stay untouched."""

    def __init__(self, seed: int, active: Iterable[Stream]) -> None:
        """Key the streams with `seed`, a whole number from 0 to 2^64 − 1."""
        self._seed = seed
        self._active = tuple(sorted(active))
        self._bits = np.random.Philox(key=0)
        self._generator = np.random.Generator(self._bits)

    def fill(self, block: int, table: NDArray[np.float64]) -> None:
        """Write one block; see `Noise`."""
        for stream in self._active:
            self._bits.state = {
                "bit_generator": "Philox",
                "state": {
                    "counter": np.array([0, block, 0, 0], np.uint64),
                    "key": np.array([self._seed, stream], np.uint64),
                },
                "buffer": np.zeros(4, np.uint64),
                "buffer_pos": 4,  # empty: the next draw starts at the counter
                "has_uint32": 0,
                "uinteger": 0,
            }
            _fill_normals(self._generator, table[stream, :BLOCK_TICKS])


class LessonNoise:
    """The lesson's single generator: right tick, left tick, gyro for each tick from the first step.

    Draw j (from 0) serves tick j + 1; tick 0 has no noise. All other mechanisms draw from
    their own streams as usual.
    """

    def __init__(self, seed: int, active: Iterable[Stream]) -> None:
        """Seed numpy's `default_rng` as the lesson does."""
        self._generator = np.random.default_rng(seed)
        lesson = {Stream.ENCODER_RIGHT, Stream.ENCODER_LEFT, Stream.GYRO_NOISE}
        others = set(active) - lesson
        self._streams = StreamNoise(seed, others) if others else None

    def fill(self, block: int, table: NDArray[np.float64]) -> None:
        """Write one block; blocks must be asked for in order, from 0."""
        if block == 0:
            table[: Stream.GYRO_NOISE + 1, 0] = 0.0
        _fill_lesson(self._generator, table, 1 if block == 0 else 0)
        if self._streams is not None:
            self._streams.fill(block, table)
