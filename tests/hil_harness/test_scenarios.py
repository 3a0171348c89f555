"""What the robot is told to do goes where it should, smoothly, and within its drive's limits."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from hil_harness.errors import HarnessError
from hil_harness.scenarios import (
    Scenario,
    Segment,
    SegmentProfile,
    load_scenario,
    scenario,
    scenario_names,
)
from hil_harness.scenarios.named import (
    RANDOM_MAX_REVERSE_M_S,
    RANDOM_MAX_SPEED_M_S,
    RANDOM_MAX_TURN_RAD_S,
    SQUARE_SIDE_M,
)
from hil_harness.scenarios.profile import FigureEight, Profile

FloatArray = NDArray[np.float64]
TICK_US = 10_000
TICK_S = 0.01


def drive(commands: FloatArray, tick_s: float = TICK_S) -> FloatArray:
    """Return x_m, y_m, heading_rad after each tick; exact for rates constant within a tick."""
    turn = commands[:, 1] * tick_s
    heading = np.concatenate([[0.0], np.cumsum(turn)])
    middle = heading[:-1] + turn / 2
    chord = commands[:, 0] * tick_s * np.sinc(turn / 2 / np.pi)
    x = np.concatenate([[0.0], np.cumsum(chord * np.cos(middle))])
    y = np.concatenate([[0.0], np.cumsum(chord * np.sin(middle))])
    return np.column_stack([x, y, heading])


def commands_of(name: str, hold_ticks: int = 1) -> FloatArray:
    found = scenario(name)
    return found.commands(found.tick_count(TICK_US), TICK_US, hold_ticks=hold_ticks)


def test_the_lesson_is_commanded_as_printed() -> None:
    lesson = scenario("lesson")
    t = np.arange(6000) * 0.01
    expected = np.column_stack([np.full(6000, 0.6), 0.10 * np.sin(2 * np.pi * t / 20)])
    assert lesson.tick_count(TICK_US) == 6000
    assert np.array_equal(lesson.commands(6000, TICK_US), expected)
    assert np.array_equal(lesson.commands(6000, TICK_US, hold_ticks=16), expected)


def test_the_lesson_carries_its_own_world() -> None:
    lesson = scenario("lesson")
    assert (lesson.drive, lesson.encoder_model, lesson.noise) == (
        "ideal",
        "lesson_counter",
        "lesson",
    )
    assert (lesson.seed, lesson.duration_s, lesson.per_tick_commands) == (7, 60.0, True)
    assert [str(setting).split("=")[0] for setting in lesson.effects] == [
        "radius_scale.scale",
        "radius_mismatch.mismatch",
        "wheelbase_scale.scale",
        "gyro_bias.bias",
    ]


@pytest.mark.parametrize("name", ["square", "square_cw", "square_ccw", "figure8"])
@pytest.mark.parametrize("hold_ticks", [1, 16])
def test_a_closed_drive_ends_where_it_began(name: str, hold_ticks: int) -> None:
    poses = drive(commands_of(name, hold_ticks))
    x, y, heading = poses[-1]
    # A held command is a staircase: it keeps distance and turn exactly, and bends where speed and
    # turn rate change together, which only the figure of eight does.
    tolerance_m = 0.01 if name == "figure8" else 1e-9
    assert math.hypot(x, y) < tolerance_m
    assert math.cos(heading) == pytest.approx(1.0, abs=1e-12)


def test_the_square_is_driven_both_ways_round_as_in_umbmark() -> None:
    poses = drive(commands_of("square"))
    first, second = poses[: len(poses) // 2], poses[len(poses) // 2 :]
    for part, sense in ((first, -1), (second, +1)):
        assert np.ptp(part[:, 0]) == pytest.approx(SQUARE_SIDE_M, abs=1e-9)
        assert np.ptp(part[:, 1]) == pytest.approx(SQUARE_SIDE_M, abs=1e-9)
        assert sense * np.sum(part[:, 1]) > 0
        turned = part[-1, 2] - part[0, 2]
        assert turned == pytest.approx(sense * 2 * math.pi, abs=1e-9)


@pytest.mark.parametrize("name", ["square", "spin", "straight"])
def test_the_robot_turns_only_while_it_stands(name: str) -> None:
    commands = commands_of(name, hold_ticks=16)
    assert np.all((np.abs(commands[:, 0]) < 1e-12) | (np.abs(commands[:, 1]) < 1e-12))


def test_the_straight_is_ten_metres() -> None:
    assert drive(commands_of("straight", 16))[-1] == pytest.approx([10.0, 0.0, 0.0], abs=1e-9)


def test_the_spin_turns_three_times_each_way_at_each_rate() -> None:
    heading = drive(commands_of("spin"))[:, 2]
    assert heading.max() == pytest.approx(6 * math.pi, abs=1e-9)
    assert heading[-1] == pytest.approx(0.0, abs=1e-9)


def test_stop_and_go_comes_to_rest_between_all_its_starts_and_returns() -> None:
    commands = commands_of("stop_and_go")
    at_rest = np.abs(commands[:, 0]) < 1e-12
    starts = int(np.count_nonzero(at_rest[:-1] & ~at_rest[1:]))
    assert starts == 8
    assert drive(commands)[-1] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("name", [name for name in scenario_names() if name != "lesson"])
def test_every_drive_starts_and_ends_at_rest_and_is_smooth(name: str) -> None:
    found = scenario(name)
    time_s = np.arange(0.0, found.duration_s, 0.001)
    rates = found.profile.rates(time_s)
    assert np.all(rates[time_s < 1.0] == 0.0)
    assert np.all(np.abs(rates[time_s > found.duration_s - 1.0]) < 1e-12)
    # Wheels of the default robot: 0.05 m radius, 0.3 m base; its drive allows 60 rad/s².
    wheel = (rates[:, :1] + rates[:, 1:] * np.array([[-0.15, 0.15]])) / 0.05
    assert np.abs(wheel).max() < 25.0
    assert np.abs(np.diff(wheel, axis=0) / 0.001).max() < 60.0


@given(st.integers(0, 2**64 - 1))
def test_a_random_drive_depends_on_its_seed_alone_and_stays_within_bounds(seed: int) -> None:
    one, again = scenario("random", seed=seed), scenario("random", seed=seed)
    commands = one.commands(one.tick_count(TICK_US), TICK_US)
    assert np.array_equal(commands, again.commands(again.tick_count(TICK_US), TICK_US))
    assert commands[:, 0].min() >= -RANDOM_MAX_REVERSE_M_S - 1e-9
    assert commands[:, 0].max() <= RANDOM_MAX_SPEED_M_S + 1e-9
    assert np.abs(commands[:, 1]).max() <= RANDOM_MAX_TURN_RAD_S + 1e-9
    assert one.duration_s == pytest.approx(120.0)
    assert one.seed == seed


def test_another_seed_draws_another_drive() -> None:
    one, other = scenario("random", seed=1), scenario("random", seed=2)
    assert not np.array_equal(one.commands(5000, TICK_US), other.commands(5000, TICK_US))


def test_a_seed_that_is_no_seed_is_refused() -> None:
    with pytest.raises(HarnessError, match=r"^seed -1: expected a whole number from 0 to"):
        scenario("random", seed=-1)


segments = st.builds(
    Segment,
    v_m_s=st.floats(-2, 2),
    w_rad_s=st.floats(-2, 2),
    duration_s=st.floats(1.0, 10.0),
    ramp_s=st.floats(0.0, 1.0),
)


@given(st.lists(segments, min_size=1, max_size=5))
def test_travel_is_the_integral_of_the_rates(parts: list[Segment]) -> None:
    assert_travel_integrates_rates(SegmentProfile(parts))


@pytest.mark.parametrize("name", ["lesson", "figure8"])
def test_travel_of_a_shipped_profile_is_the_integral_of_its_rates(name: str) -> None:
    assert_travel_integrates_rates(scenario(name).profile)


def assert_travel_integrates_rates(profile: Profile) -> None:
    step_s = 0.002
    middles = np.arange(0.5 * step_s, profile.duration_s + 2.0, step_s)
    travel = profile.travel(np.array([middles[0] - step_s / 2, middles[-1] + step_s / 2]))
    by_midpoints = profile.rates(middles).sum(axis=0) * step_s
    # A step of at most 4 (from −2 to 2) that falls between two midpoints costs half a step's area.
    steps = len(getattr(profile, "segments", ())) + 1
    assert by_midpoints == pytest.approx(travel[1] - travel[0], abs=steps * 4 * step_s / 2 + 1e-4)


@given(
    st.lists(segments, min_size=1, max_size=4),
    st.integers(1, 40),
    st.sampled_from([1000, 10_000, 12_345]),
)
def test_a_held_command_keeps_distance_and_turn(
    parts: list[Segment], hold_ticks: int, tick_us: int
) -> None:
    profile = SegmentProfile(parts)
    held = Scenario("held", "", profile, duration_s=profile.duration_s)
    holds = int((profile.duration_s + 1.0) * 1e6 / tick_us / hold_ticks) + 1
    commands = held.commands(holds * hold_ticks, tick_us, hold_ticks=hold_ticks)
    expected = profile.travel(np.array([holds * hold_ticks * tick_us / 1e6]))[0]
    assert commands.sum(axis=0) * tick_us / 1e6 == pytest.approx(expected, abs=1e-9)
    assert np.array_equal(commands, np.repeat(commands[::hold_ticks], hold_ticks, axis=0))


def test_the_figure_of_eight_is_as_wide_as_it_says() -> None:
    eight = FigureEight(speed_m_s=1.0, lap_s=12.0, laps=1, rest_s=0.0, ramp_s=0.0)
    time_s = np.arange(0.0, 12.0, 0.001)
    poses = drive(np.diff(eight.travel(time_s), axis=0) / 0.001, 0.001)
    assert np.linalg.norm(poses[-1, :2] - poses[0, :2]) < 0.005
    heading = poses[:, 2]
    assert heading.max() == pytest.approx(2.404825557695773, abs=1e-6)
    assert heading.min() == pytest.approx(-2.404825557695773, abs=1e-6)


FILE = """\
name = "two_arcs"
description = "left, then right"
duration_s = 30.0
seed = 3

[[segments]]
v_m_s = 0.5
w_rad_s = 0.3
duration_s = 10.0

[[segments]]
v_m_s = 0.5
w_rad_s = -0.3
duration_s = 10
ramp_s = 1.5

[effects.gyro_bias]
bias = 0.01
"""


def write(folder: Path, text: str) -> Path:
    file = folder / "two_arcs.toml"
    file.write_text(text, encoding="utf-8")
    return file


def test_a_scenario_file_is_driven(tmp_path: Path) -> None:
    found = load_scenario(write(tmp_path, FILE))
    assert (found.name, found.duration_s, found.seed, found.drive) == ("two_arcs", 30.0, 3, "motor")
    assert [str(setting) for setting in found.effects] == ["gyro_bias.bias=0.01"]
    commands = found.commands(found.tick_count(TICK_US), TICK_US)
    assert commands[500] == pytest.approx([0.5, 0.3])
    assert commands[1900] == pytest.approx([0.5, -0.3])
    assert commands[-1] == pytest.approx([0.0, 0.0])


def test_a_path_is_a_file_and_anything_else_a_name(tmp_path: Path) -> None:
    file = write(tmp_path, FILE)
    assert scenario(file).name == "two_arcs"
    assert scenario(str(file), seed=11).seed == 11
    with pytest.raises(HarnessError, match=r"^no such scenario: figur8: the nearest is figure8;"):
        scenario("figur8")
    with pytest.raises(HarnessError, match=r"no such file"):
        scenario(tmp_path / "none.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "v_m_s = 0.5\nw_rad_s = 0.3",
            'v_m_s = "fast"\nw_rad_s = 0.3',
            'two_arcs.toml:7: segments[1].v_m_s = "fast": '
            "expected a number from -100 to 100, for example 0.5",
        ),
        (
            "duration_s = 10\n",
            "",
            "two_arcs.toml:11: segments[2].duration_s is missing: "
            "expected a number above 0 and of at most 604800, for example 10.0",
        ),
        (
            "ramp_s = 1.5",
            "ramp_s = 12",
            "two_arcs.toml:15: segments[2]: a ramp of 12 s does not fit into 10 s: "
            "expected ramp_s of at most 10",
        ),
        (
            "w_rad_s = -0.3",
            "w_deg_s = -0.3",
            "two_arcs.toml:13: segments[2].w_deg_s: unknown key: the nearest is w_rad_s",
        ),
        (
            "w_rad_s = 0.3",
            "w_rad_s = nan",
            "two_arcs.toml:8: segments[1].w_rad_s = nan: "
            "expected a number from -100 to 100, for example 0.3",
        ),
        (
            "duration_s = 30.0",
            "duration_s = 15.0",
            "two_arcs.toml:3: duration_s = 15 cuts off segments of 20 s: "
            "expected at least 20, or none",
        ),
        (
            'name = "two_arcs"',
            'name = "../up"',
            'two_arcs.toml:1: name = "../up": expected letters, digits, - and _, '
            'for example "two_arcs"',
        ),
        (
            "bias = 0.01",
            "bais = 0.01",
            "two_arcs.toml:18: effects.gyro_bias.bais: gyro_bias has no such parameter: "
            "the nearest is bias",
        ),
        (
            "[effects.gyro_bias]",
            "[effects.gyro_drift]",
            "two_arcs.toml:17: effects.gyro_drift: no such effect: the nearest is ",
        ),
        (
            "bias = 0.01",
            "bias = true",
            "two_arcs.toml:18: effects.gyro_bias.bias = true: expected a number",
        ),
        ('name = "two_arcs"\n', "", "two_arcs.toml: name is missing: expected letters"),
    ],
)
def test_a_mistake_in_a_scenario_file_is_said_in_one_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    assert old in FILE
    with pytest.raises(HarnessError) as caught:
        load_scenario(write(tmp_path, FILE.replace(old, new, 1)))
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "segment",
    [(math.nan, 0.0, 1.0, 0.5), (0.0, math.inf, 1.0, 0.5), (0.0, 0.0, 1.0, 2.0), (0, 0, -1.0, 0.0)],
)
def test_a_segment_that_cannot_be_driven_is_refused(
    segment: tuple[float, float, float, float],
) -> None:
    with pytest.raises(HarnessError, match=r"^segment: "):
        Segment(*segment)


def test_commands_for_a_negative_time_are_refused() -> None:
    with pytest.raises(HarnessError, match="expected a count from 0, a period from 1"):
        scenario("straight").commands(-1, TICK_US)
