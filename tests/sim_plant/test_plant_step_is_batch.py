"""A run tick by tick and the same run in a batch: equal, bit for bit."""

import math
from dataclasses import fields
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from quiet_robot import held

from sim_plant import (
    Batch,
    Mechanisms,
    MechanismSchedule,
    Plant,
    PlantDescription,
    PlantError,
    PlantRuns,
    SensorCounts,
    simulate,
)
from sim_plant.streams import BLOCK_TICKS

MODELS = st.fixed_dictionaries(
    {
        "encoder_model": st.sampled_from(["counter", "lesson_counter"]),
        "noise": st.sampled_from(["streams", "lesson"]),
        "drive": st.sampled_from(["motor", "ideal"]),
        "tick_period_us": st.sampled_from([1_000, 10_000, 12_345]),
    }
)


def _value(name: str, metadata: Any, *, whole: bool) -> st.SearchStrategy[Any]:
    low, high = metadata["low"], metadata["high"]
    if whole:
        return st.integers(int(low), int(high))
    if low == -math.inf:  # a time
        return st.one_of(st.just(-math.inf), st.just(math.inf), st.floats(-1.0, 5.0))
    if high == math.inf:  # a limit
        return st.floats(max(low, 1e-3), 100.0)
    return st.floats(low, high, allow_subnormal=False)


@st.composite
def mechanisms(draw: st.DrawFn) -> Mechanisms:
    chosen = draw(st.lists(st.sampled_from(fields(Mechanisms)), max_size=8, unique=True))
    return Mechanisms(
        **{
            item.name: draw(_value(item.name, item.metadata, whole=isinstance(item.default, int)))
            for item in chosen
        }
    )


@st.composite
def drives(draw: st.DrawFn) -> NDArray[np.float64]:
    legs = draw(
        st.lists(
            st.tuples(st.floats(-2.0, 2.0), st.floats(-3.0, 3.0), st.integers(1, 40)),
            min_size=1,
            max_size=4,
        )
    )
    return np.vstack([held(v, w, ticks) for v, w, ticks in legs])


def assert_tick_by_tick_is_row(
    runs: PlantRuns, row: int, commands: NDArray[np.float64], plant: Plant
) -> None:
    truth = runs.truth[row if len(runs.truth) > 1 else 0]
    codes = np.stack([getattr(runs, name)[row] for name in SensorCounts._fields], axis=1)
    assert runs.gyro_rate_rad_s is not None
    for tick, (v_m_s, w_rad_s) in enumerate(commands):
        assert plant.tick == tick
        assert plant.pose == tuple(truth[tick])
        assert plant.counts == tuple(codes[tick])
        assert plant.gyro_rate_rad_s == runs.gyro_rate_rad_s[row, tick]
        plant.step(v_m_s, w_rad_s)


@settings(max_examples=150)
@given(
    commands=drives(),
    each=st.lists(mechanisms(), min_size=1, max_size=3),
    seed=st.integers(0, 2**128 - 4),
    models=MODELS,
    same=st.booleans(),
)
def test_plant_step_is_simulate_for_any_drive_mechanisms_and_seed(
    commands: NDArray[np.float64],
    each: list[Mechanisms],
    seed: int,
    models: dict[str, Any],
    same: bool,
) -> None:
    if same:
        each = each[:1] * len(each)
    seeds = [seed + i for i in range(len(each))]
    runs = simulate(PlantDescription(), each, commands, seeds, **models)
    for row, (one, row_seed) in enumerate(zip(each, seeds, strict=True)):
        plant = Plant(PlantDescription(), one, seed=row_seed, **models)
        assert_tick_by_tick_is_row(runs, row, commands, plant)


@pytest.mark.parametrize("noise", ["streams", "lesson"])
def test_a_run_over_several_blocks_of_noise_is_the_same_both_ways(noise: Any) -> None:
    models: dict[str, Any] = {"tick_period_us": 10_000, "noise": noise}
    wandering = Mechanisms(micro_slip_left_m_per_sqrt_m=1e-3, gyro_bias_walk_rad_s_per_sqrt_s=1e-3)
    commands = held(0.7, -0.3, 2 * BLOCK_TICKS + 5)
    runs = simulate(PlantDescription(), wandering, commands, [11], **models)
    plant = Plant(PlantDescription(), wandering, seed=11, **models)
    assert_tick_by_tick_is_row(runs, 0, commands, plant)


@pytest.mark.parametrize("noise", ["streams", "lesson"])
@pytest.mark.parametrize("slip_m", [0.0, 1e-4])
def test_ticks_in_blocks_are_those_of_one_call_and_commands_are_repeated(
    noise: Any, slip_m: float
) -> None:
    lap, ticks = held(0.7, -0.3, 300), 2 * BLOCK_TICKS + 5
    lap[::7] *= 0.5
    slipping = Mechanisms(micro_slip_step_left_m=slip_m, gyro_bias_walk_rad_s_per_sqrt_s=1e-3)
    options: dict[str, Any] = {"tick_period_us": 10_000, "noise": noise}
    laps = np.tile(lap, (-(-ticks // len(lap)), 1))[:ticks]
    whole = simulate(PlantDescription(), slipping, laps, [3, 9], **options)
    batch = Batch(PlantDescription(), slipping, lap, [3, 9], **options)
    parts = [batch.advance(count) for count in (BLOCK_TICKS, BLOCK_TICKS, 5)]
    for item in fields(PlantRuns):
        joined = np.concatenate([getattr(part, item.name) for part in parts], axis=1)
        np.testing.assert_array_equal(joined, getattr(whole, item.name))
    with pytest.raises(PlantError, match="multiple of 1024"):
        batch.advance(1)


def _same(a: PlantRuns, b: PlantRuns, rows: slice = slice(None)) -> bool:
    return all(
        np.array_equal(getattr(a, item.name)[rows], getattr(b, item.name))
        for item in fields(PlantRuns)
        if item.name != "truth"
    )


def test_a_seed_is_one_run_on_any_number_of_workers_and_in_any_company() -> None:
    commands = held(0.4, 0.5, 300)
    slipping = Mechanisms(micro_slip_step_left_m=1e-4)
    options: dict[str, Any] = {"tick_period_us": 10_000}
    both = simulate(PlantDescription(), slipping, commands, [3, 9, 4], workers=2, **options)
    one = simulate(PlantDescription(), slipping, commands, [3, 9, 4], workers=1, **options)
    alone = simulate(PlantDescription(), slipping, commands, [9], **options)
    assert _same(both, one)
    assert np.array_equal(both.truth, one.truth)
    assert _same(both, alone, slice(1, 2))
    assert np.array_equal(both.truth[1:2], alone.truth)


def test_runs_with_mechanisms_of_their_own_are_as_if_alone() -> None:
    commands = held(0.4, 0.5, 300)
    options: dict[str, Any] = {"tick_period_us": 10_000}
    each = [
        Mechanisms(accel_noise_m_s2_per_sqrt_hz=0.5, gyro_bias_walk_rad_s_per_sqrt_s=0.01),
        Mechanisms(radius_scale=0.01),
        Mechanisms(),
    ]
    together = simulate(PlantDescription(), each, commands, [5, 5, 5], workers=1, **options)
    for row, one in enumerate(each):
        alone = simulate(PlantDescription(), one, commands, [5], **options)
        assert _same(together, alone, slice(row, row + 1))
        assert np.array_equal(together.truth[row], alone.truth[0])


def test_odometry_outputs_are_those_of_the_full_run() -> None:
    commands = held(0.4, 0.5, 300)
    full = simulate(PlantDescription(), Mechanisms(), commands, [1, 2], tick_period_us=10_000)
    short = simulate(
        PlantDescription(),
        Mechanisms(),
        commands,
        [1, 2],
        tick_period_us=10_000,
        outputs="odometry",
    )
    assert short.accel_x_code is None
    assert short.gyro_rate_rad_s is None
    for name in ("truth", "left_count", "right_count", "gyro_code"):
        assert np.array_equal(getattr(full, name), getattr(short, name))


def test_runs_share_one_motion_exactly_when_nothing_random_moves_them() -> None:
    commands = held(0.4, 0.0, 20)
    options: dict[str, Any] = {"tick_period_us": 10_000}
    shared = simulate(PlantDescription(), Mechanisms(), commands, range(4), **options)
    own = simulate(
        PlantDescription(), Mechanisms(micro_slip_step_left_m=1e-5), commands, range(4), **options
    )
    assert shared.truth.shape == (1, 20, 3)
    assert own.truth.shape == (4, 20, 3)
    assert len(np.unique(own.truth[:, -1, 1])) == 4


@pytest.mark.parametrize("drive", ["motor", "ideal"])
def test_a_run_whose_mechanisms_change_with_time_is_the_same_both_ways(drive: Any) -> None:
    models: dict[str, Any] = {"tick_period_us": 10_000, "drive": drive}
    for_a_while = MechanismSchedule(
        (
            (-math.inf, Mechanisms(drive_delay_s=0.03)),
            (0.5, Mechanisms(drive_delay_s=0.05, gyro_bias_rad_s=0.02)),
            (1.0, Mechanisms()),
        )
    )
    commands = np.vstack([held(0.7, -0.3, 80), held(-0.2, 0.4, 70)])
    runs = simulate(PlantDescription(), for_a_while, commands, [11], **models)
    plant = Plant(PlantDescription(), for_a_while, seed=11, **models)
    assert_tick_by_tick_is_row(runs, 0, commands, plant)


def test_one_tick_is_a_run() -> None:
    runs = simulate(PlantDescription(), Mechanisms(), [[0.1, 0.0]], [1], tick_period_us=10_000)
    assert runs.left_count.shape == (1, 1)
    assert not runs.truth.any()


def test_no_seeds_are_no_runs() -> None:
    runs = simulate(PlantDescription(), Mechanisms(), held(0.1, 0, 5), [], tick_period_us=10_000)
    assert runs.left_count.shape == (0, 5)


def test_time_is_counted_in_whole_microseconds() -> None:
    plant = Plant(PlantDescription(), tick_period_us=12_345, seed=1)
    for _ in range(3):
        plant.step(0.0, 0.0)
    assert plant.time_us == 37_035


WRONG_ARGUMENTS: list[tuple[dict[str, Any], str]] = [
    ({"seeds": [-1]}, "seed = -1: expected a whole number from 0 to 2^128 − 1, such as 7"),
    ({"seeds": [1.5]}, "seed = 1.5: expected a whole number from 0 to 2^128 − 1, such as 7"),
    (
        {"tick_period_us": 10.0},
        "tick_period_us = 10.0: expected a whole number from 100 to 1000000, for example 10000",
    ),
    ({"drive": "jet"}, "drive = 'jet': expected 'motor' or 'ideal'"),
    ({"noise": "pink"}, "noise = 'pink': expected 'streams' or 'lesson'"),
    (
        {"encoder_model": "lesson"},
        "encoder_model = 'lesson': expected 'counter' or 'lesson_counter'",
    ),
    ({"outputs": "some"}, "outputs = 'some': expected 'all' or 'odometry'"),
    ({"workers": 0}, "workers = 0: expected a whole number of at least 1"),
    (
        {"mechanisms": [Mechanisms()] * 2},
        "mechanisms: expected one for all or one for each of the 1 seeds, got 2",
    ),
    ({"commands": [1.0, 2.0]}, "commands of shape (2,): expected (ticks, 2), at least one tick"),
    (
        {"commands": [[0.0, 0.0], [0.0, math.nan]]},
        "command (0.0 m/s, nan rad/s) at tick 1: expected two numbers from -1000 to 1000",
    ),
]


@pytest.mark.parametrize(("wrong", "message"), WRONG_ARGUMENTS)
def test_a_wrong_argument_of_simulate_is_named_in_one_line(
    wrong: dict[str, Any], message: str
) -> None:
    arguments: dict[str, Any] = {
        "mechanisms": Mechanisms(),
        "commands": held(0.1, 0.0, 3),
        "seeds": [1],
        "tick_period_us": 10_000,
    } | wrong
    with pytest.raises(PlantError) as caught:
        simulate(PlantDescription(), **arguments)
    assert str(caught.value) == message


def test_a_refused_command_leaves_the_plant_where_it_was() -> None:
    plant = Plant(PlantDescription(), tick_period_us=10_000, seed=1)
    plant.step(0.5, 0.1)
    before = plant.pose, plant.counts, plant.time_us
    with pytest.raises(PlantError, match=r"^command \(inf m/s, 0 rad/s\) at tick 1: expected"):
        plant.step(math.inf, 0)
    assert (plant.pose, plant.counts, plant.time_us) == before
