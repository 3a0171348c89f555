"""Random streams: numpy's numbers, one stream per mechanism, independent of how a run is cut."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from quiet_robot import drive, held, quiet

from sim_plant import Mechanisms, PlantDescription, kernel, records
from sim_plant.streams import BLOCK_TICKS, LESSON_STREAMS, Noise, Stream, stream_generator

SEEDS = st.integers(0, 2**128 - 1)


def blocks(noise: Noise, seed: int, numbers: range) -> NDArray[np.float64]:
    """Return the normals of some blocks, float64[blocks, ticks, streams]."""
    noise.start(seed)
    read = []
    for block in numbers:
        kernel.fill_noise(noise.sources, noise.raws, noise.seed, noise.active, noise.columns, block)
        read.append(noise.columns.copy())
    return np.array(read)


@given(seed=SEEDS, stream=st.sampled_from(Stream), block=st.integers(0, 2**40))
def test_a_stream_is_numpys_philox_keyed_by_seed_and_stream(
    seed: int, stream: Stream, block: int
) -> None:
    drawn = blocks(Noise([stream], lesson=False), seed, range(block, block + 1))[0, :, stream]
    philox = np.random.Philox(
        key=np.array([seed % 2**64, stream], np.uint64),
        counter=np.array([0, block, seed >> 64, 0], np.uint64),
    )
    assert np.array_equal(drawn, np.random.Generator(philox).standard_normal(BLOCK_TICKS))


@given(seed=SEEDS, stream=st.sampled_from(Stream))
def test_noise_beside_the_plants_comes_from_streams_like_its_own(seed: int, stream: Stream) -> None:
    first = blocks(Noise([stream], lesson=False), seed, range(1))[0, :, stream]
    assert np.array_equal(stream_generator(seed, stream).standard_normal(BLOCK_TICKS), first)


@pytest.mark.parametrize("bit", [0, 31, 63, 64, 95, 127])
def test_every_bit_of_a_seed_makes_another_run(bit: int) -> None:
    """Of 128 bits the plant took 64, and the rest could have been anything."""
    robot = quiet(gyro={"noise_density_rad_per_sqrt_s": 1e-4})
    runs = drive(held(0.3, 0.1, 50), description=robot, seeds=[0, 1 << bit])
    assert not np.array_equal(*runs.gyro_code)


@given(seed=SEEDS)
def test_the_lessons_noise_is_default_rng_from_the_first_step_on(seed: int) -> None:
    drawn = blocks(Noise([], lesson=True), seed, range(3))[:, :, : len(LESSON_STREAMS)]
    expected = np.random.default_rng(seed).standard_normal((3 * BLOCK_TICKS - 1, 3))
    ticks = drawn.reshape(-1, 3)
    assert not ticks[0].any()
    assert np.array_equal(ticks[1:], expected)


def test_the_tails_and_wedges_of_the_normals_are_numpys(size: str) -> None:
    # one draw in 256·30 000 or so lies beyond the ziggurat's last layer at 3.65
    count = 10_000 if size == "full" else 300
    drawn = blocks(Noise([], lesson=True), 2026, range(count))[:, :, :3].reshape(-1, 3)[1:]
    assert np.array_equal(drawn, np.random.default_rng(2026).standard_normal(drawn.shape))
    assert np.abs(drawn).max() > 4.0


def test_the_streams_of_lesson_noise_other_than_its_three_are_the_usual_ones() -> None:
    usual = blocks(Noise(Stream, lesson=False), 5, range(2))
    lesson = blocks(Noise(Stream, lesson=True), 5, range(2))
    others = [stream for stream in Stream if stream not in LESSON_STREAMS]
    assert np.array_equal(usual[:, :, others], lesson[:, :, others])


def test_a_mechanism_that_is_off_draws_nothing() -> None:
    on = records.build_parameters(
        PlantDescription(),
        Mechanisms(),
        tick_s=0.01,
        drive_model="motor",
        encoder_model="counter",
    )
    off = records.build_parameters(
        quiet(), Mechanisms(), tick_s=0.01, drive_model="motor", encoder_model="counter"
    )
    assert records.active_streams(on) == LESSON_STREAMS | {Stream.ACCEL_X, Stream.ACCEL_Y}
    assert not records.active_streams(off)
    assert not blocks(Noise([], lesson=False), 3, range(1)).any()


NOISE_OF = {
    "gyro_noise_rad_per_sqrt_s": {"gyro"},
    "gyro_bias_walk_rad_s_per_sqrt_s": {"gyro"},
    "accel_noise_m_s2_per_sqrt_hz": {"accel_x", "accel_y"},
    "micro_slip_left_m_per_sqrt_m": {"gyro", "accel_y"},
    "micro_slip_step_right_m": {"gyro", "accel_y"},
    "slip_wander_left": {"gyro", "accel_y"},
}


@pytest.mark.parametrize("mechanism", NOISE_OF)
def test_switching_a_noise_on_leaves_the_other_sensors_codes_untouched(mechanism: str) -> None:
    commands = held(0.5, 0.2, 1500)
    description = PlantDescription()
    on: dict[str, Any] = {mechanism: 0.05}
    before = drive(commands, description=description, seeds=[7, 8])
    after = drive(commands, Mechanisms(**on), description=description, seeds=[7, 8])
    changed = {
        name.removesuffix("_code")
        for name in (
            "left_count",
            "right_count",
            "gyro_code",
            "accel_x_code",
            "accel_y_code",
            "temperature_code",
            "supply_code",
        )
        if not np.array_equal(getattr(before, name), getattr(after, name))
    }
    assert changed == NOISE_OF[mechanism]


def test_streams_and_seeds_are_uncorrelated(size: str) -> None:
    count = 1000 if size == "full" else 100
    noise = Noise(Stream, lesson=False)
    rows = [blocks(noise, seed, range(count)).reshape(-1, len(Stream)) for seed in (0, 1)]
    samples = np.hstack(rows)
    correlation = np.corrcoef(samples, rowvar=False) - np.eye(samples.shape[1])
    # 276 pairs: a normal of deviation 1/√n stays within 4.5 of it but for one case in 500
    assert np.abs(correlation).max() < 4.5 / np.sqrt(samples.shape[0])
    # neighbouring blocks share nothing either
    first, second = rows[0][:-BLOCK_TICKS], rows[0][BLOCK_TICKS:]
    assert np.abs((first * second).mean(axis=0)).max() < 4.5 / np.sqrt(len(first))
