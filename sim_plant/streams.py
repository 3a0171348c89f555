"""Random streams: one per mechanism, counter-based, the same wherever and however a run is cut.

The normals of ticks [j·1024, (j+1)·1024) of a stream come from a Philox4x64 generator (Salmon et
al. 2011, *Parallel random numbers: as easy as 1, 2, 3*) with the seed's lower 64 bits and the
stream as its key, the upper 64 in the counter's third word, and a counter that starts at j·2^64. So
a block depends on nothing but seed, stream and j; a mechanism that is off
draws nothing; and switching one on does not shift another's noise.
"""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_plant.compiled import inlined
from sim_plant.generators import BUFFER_WORDS, SOURCE, draw_pcg, draw_philox, seed_pcg64

BLOCK_TICKS = 1024
_WORD = 2**64 - 1


class Stream(IntEnum):
    """Column of the noise table and second key word of the generator; never renumber."""

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
    MISSED_LEFT = 12
    MISSED_RIGHT = 13
    EXTRA_LEFT = 14
    EXTRA_RIGHT = 15
    SLIP_WANDER_LEFT = 16
    SLIP_WANDER_RIGHT = 17


MOTION_STREAMS = frozenset(
    {
        Stream.MICRO_SLIP_LEFT,
        Stream.MICRO_SLIP_RIGHT,
        Stream.MICRO_SLIP_STEP_LEFT,
        Stream.MICRO_SLIP_STEP_RIGHT,
        Stream.SLIP_WANDER_LEFT,
        Stream.SLIP_WANDER_RIGHT,
    }
)

# The lesson's generator serves the first columns: right tick, left tick, gyro, in its order.
LESSON_STREAMS = frozenset({Stream.ENCODER_RIGHT, Stream.ENCODER_LEFT, Stream.GYRO_NOISE})

# One tick's standard normals, a field for each stream.
NORMALS = np.dtype([(stream.name.lower(), "f8") for stream in Stream])


@inlined
def fill_block(sources: Any, raws: Any, seed: Any, active: Any, columns: Any, block: int) -> None:
    """Write the normals of one block of ticks into the active columns; the others stay as they are.

    Where `sources` holds a second generator, it is the lesson's: it draws for the encoders and the
    gyro, block after block from the start; draw j (from 0) serves tick j // 3 + 1.
    """
    if sources.size > 1:
        if block == 0:
            seed_pcg64(sources[1], seed)
            columns[0, :3] = 0.0  # the lesson has no noise at tick 0
        draw_pcg(sources[1], raws, columns, 1 if block == 0 else 0, 3)
    for stream in range(active.size):
        if active[stream]:
            draw_philox(sources[0], raws, columns, stream, seed, stream, block)


def seed_words(seed: int) -> NDArray[np.uint64]:
    """Return uint64[2]: the lower and the upper 64 bits of a seed; what is beyond is left out."""
    whole = int(seed)
    return np.array([whole & _WORD, whole >> 64 & _WORD], np.uint64)


def stream_generator(seed: int, stream: int) -> np.random.Generator:
    """Return numpy's generator of a stream, for noise beside the plant's.

    Args:
        seed: a whole number; its lower 128 bits count.
        stream: 64 bits of a namespace of the caller's own.
    """
    low, high = seed_words(seed)
    key = np.array([low, stream], np.uint64)
    philox = np.random.Philox(key=key, counter=np.array([0, 0, high, 0], np.uint64))
    return np.random.Generator(philox)


class Noise:
    """The normals of one run at a time, a block of ticks after the other.

    Attributes:
        normals: `NORMALS`[1024], the present block; zeros where a mechanism is off.
        columns: the same memory as float64[1024, streams].
        sources, raws, seed, active: what `fill_block` needs besides.
    """

    def __init__(self, active: Iterable[Stream], *, lesson: bool) -> None:
        """Draw only for the active streams; `lesson`: and for the lesson's three, in its order."""
        self.normals = np.zeros(BLOCK_TICKS, NORMALS)
        self.columns = self.normals.view(np.float64).reshape(BLOCK_TICKS, len(Stream))
        self.sources = np.zeros(2 if lesson else 1, SOURCE)
        self.raws = np.zeros(BUFFER_WORDS, np.uint64)
        self.active = np.zeros(len(Stream), np.bool_)
        for stream in active:
            self.active[stream] = not (lesson and stream in LESSON_STREAMS)
        self.seed = seed_words(0)

    def start(self, seed: int) -> None:
        """Begin the run of a seed, a whole number from 0 to 2^128 − 1."""
        self.seed = seed_words(seed)
