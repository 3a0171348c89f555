"""A drive that answers in a way of its own has no name, and one that does as told needs none."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from drive_recordings import (
    ACTUATION,
    ROBOT,
    block_of,
    evidence,
    simulated,
)
from foreign_drives import (
    another_track,
    disturbed,
    logged_a_row_late,
    second_order,
    table_of_even_wheels,
    table_of_executed_commands,
    velocity_loop,
)
from full_size import at_full_size

from gap_diagnosis.drive import DriveBlock, drive_block
from gap_diagnosis.recording import Recording
from hil_harness.effects import catalogue
from hil_harness.robot import Robot


def acting(effects: Mapping[str, Mapping[str, float]]) -> DriveBlock:
    """Return the block of a drive with these effects; made once."""
    return _acting(tuple((name, tuple(values.items())) for name, values in effects.items()))


@cache
def _acting(effects: tuple[tuple[str, tuple[tuple[str, float], ...]], ...]) -> DriveBlock:
    return block_of(simulated({name: dict(values) for name, values in effects}, seed=3))


@cache
def as_described() -> DriveBlock:
    """Return the block of a drive that does as it is told; made once."""
    return block_of(simulated(seed=2))


def test_a_foreign_motor_is_better_left_unexplained_than_named() -> None:
    block = block_of(velocity_loop(1))
    named = max(evidence(block, one) for one in block.effects)
    assert block.unexplained().log_evidence > named + 50


@pytest.mark.parametrize("seed", [2, *at_full_size(1)])
def test_the_manner_of_a_motor_that_is_as_late_as_described_is_no_news(seed: int) -> None:
    """Two lags of half the size move the wheels by less than a tolerated lag does, and were
    hundreds of nats: every healthy robot of another engine was an unlisted cause."""
    block = block_of(second_order(seed))
    assert max(evidence(block, one) for one in block.effects) < 1
    assert block.unexplained().log_evidence < 1


@pytest.mark.parametrize(
    "recording",
    [
        logged_a_row_late(simulated(seed=1), 8.0),
        *at_full_size(
            logged_a_row_late(disturbed(2, level=0.003), 2.0),
            logged_a_row_late(simulated(seed=2), 30.0),
        ),
    ],
    ids=["8 s", "2 s", "30 s"],
)
def test_commands_that_are_logged_a_row_late_for_a_while_are_no_cause_without_a_name(
    recording: Recording,
) -> None:
    """14, 4 and 57 nats for what moves wheels by less than a tolerated lag does."""
    assert block_of(recording).unexplained().log_evidence < 0.5


@pytest.mark.parametrize("seed", [2, *at_full_size(1)])
def test_a_row_that_tells_what_was_carried_out_in_it_is_no_cause_without_a_name(seed: int) -> None:
    """A healthy robot of another engine, in rows of 50 ms: hundreds of nats for a drive that knew
    what it would be told."""
    block = block_of(table_of_executed_commands(seed))
    assert block.unexplained().log_evidence < 1
    assert max(evidence(block, one) for one in block.effects) < 2


def test_a_described_drive_leaves_nothing_unexplained() -> None:
    assert as_described().unexplained().log_evidence < 0


@pytest.mark.parametrize(
    "effect",
    [
        {"drive_gain": {"left": 0.10, "right": -0.08}},
        {"drive_lag": {"time_constant": 0.06}},
        {"drive_delay": {"delay": 0.04}},
        {"drive_saturation": {"limit": 10.0}},
        {"drive_deadband": {"rate": 0.3}},
    ],
)
def test_a_drive_that_answers_otherwise_is_seen_without_a_name_for_it(
    effect: dict[str, dict[str, float]],
) -> None:
    """And the name, where there is one, is likelier."""
    block = acting(effect)
    assert 10 < block.unexplained().log_evidence < evidence(block, *effect) - 3


@pytest.mark.parametrize("rate_rad_s", [0.08, *at_full_size(0.03, 0.05)])
def test_a_dead_band_within_its_tolerance_is_no_cause_without_a_name(rate_rad_s: float) -> None:
    """27 to 680 nats for an unlisted one, and a confident verdict."""
    block = block_of(simulated({"drive_deadband": {"rate": rate_rad_s}}, seed=3))
    assert block.unexplained().log_evidence < 0.5


def test_poles_that_a_wheel_hardly_feels_are_no_cause_without_a_name() -> None:
    """Beyond half of what a gain may be off by they are: at 0.0037 a trial's null was told so."""
    found = [
        block_of(
            simulated(
                {"drive_cogging": {"side": "right", "amplitude": size, "order": 6, "phase": 1.0}},
                seed=3,
            )
        ).unexplained()
        for size in (0.004, 0.01)
    ]
    assert found[0].log_evidence < 0.5
    assert found[1].log_evidence > 10


def test_a_late_drive_without_its_name_is_given_no_other() -> None:
    """A limit of the acceleration comes nearest: 1,148 nats of 3,013 in a withheld case."""
    block = block_of(simulated({"drive_delay": {"delay": 0.025}}, seed=3))
    named = max(evidence(block, one) for one in ACTUATION if one != "drive_delay")
    assert block.unexplained().log_evidence > named + 50


def test_poles_that_show_in_the_rate_are_an_unlisted_cause() -> None:
    """Six waves a turn of a hundredth of the rate: half a count is all that they move the angle by,
    and that to and fro."""
    cogging = {"drive_cogging": {"amplitude": 0.01, "order": 6, "phase": 1.0}}
    block = block_of(simulated(cogging, seed=3))
    named = max(evidence(block, one) for one in ACTUATION)
    assert block.unexplained().log_evidence > max(named, 0.0) + 20


@pytest.mark.parametrize(
    ("effect", "variable"),
    [
        ({"drive_lag": {"time_constant": 0.06}}, "acceleration"),
        ({"drive_delay": {"delay": 0.04}}, "acceleration"),
        ({"drive_gain": {"left": 0.10, "right": -0.08}}, "speed"),
        ({"drive_saturation": {"limit": 10.0}}, "speed"),
        ({"drive_deadband": {"rate": 0.3}}, "command"),
    ],
)
def test_a_leftover_without_a_name_goes_first_with_what_makes_it(
    effect: dict[str, dict[str, float]], variable: str
) -> None:
    """Late answers show while the speed changes, a gain or a limit in the speed, a dead band in
    slow commands; nothing was told of what any of them goes with."""
    first = acting(effect).goes_with[0]
    assert first.variable == variable
    assert first.share > 0.5


@pytest.mark.parametrize("share", [0.5, *at_full_size(0.9)])
def test_a_controller_with_another_track_turns_less_than_told_and_has_no_name(share: float) -> None:
    """Straight on the wheels do exactly as they are told, so that no gain of a wheel or function of
    its speed explains turns half as large: noise was, and there was no gap (0.96)."""
    block = block_of(another_track(3, share))
    named = max(evidence(block, one) for one in ACTUATION)
    assert block.unexplained().log_evidence > max(named, 0.0) + 50
    first = block.goes_with[0]
    assert first.variable == "turn_rate"
    assert first.share > 0.5


def test_poles_of_one_wheel_go_with_its_angle_alone() -> None:
    cogging = {"drive_cogging": {"side": "right", "amplitude": 0.02, "order": 6, "phase": 1.0}}
    found = block_of(simulated(cogging, seed=3)).goes_with
    assert [one.variable for one in found] == ["wheel_angle_right"]


def test_a_described_drive_has_no_leftover_that_goes_with_anything() -> None:
    assert as_described().goes_with == []


def test_a_loop_that_gives_way_on_a_slope_is_no_unlisted_cause() -> None:
    told = simulated(seed=2)
    # Downhill the wheels run ahead by a thousandth of their rate, uphill they fall behind.
    slope = 1e-3 * np.sign(np.sin(told.t_s / 3.0))
    off = [
        ticks + np.rint(np.cumsum(slope * np.diff(ticks, prepend=ticks[0])))
        for ticks in (told.left_ticks, told.right_ticks)
    ]
    block = block_of(replace(told, left_ticks=off[0], right_ticks=off[1]))
    assert block.unexplained().log_evidence <= 0


def test_a_delay_that_no_list_has_is_a_manner_where_the_wheels_go_as_described() -> None:
    """The delay explained more than the manner did, though nobody could be told of it: a limit of
    the acceleration was named for a delay of 12 ms in a sealed case (.98)."""
    late = simulated({"drive_delay": {"delay": 0.0123}}, seed=1)
    listed = drive_block(late, ROBOT)
    withheld = drive_block(late, ROBOT, without=frozenset({"drive_delay"}))
    assert listed is not None
    assert withheld is not None
    assert listed.data.manner is None
    assert evidence(listed, "drive_delay") > 10
    assert withheld.data.manner is not None


def test_a_drive_of_which_nothing_may_be_named_has_a_manner_all_the_same() -> None:
    late = simulated({"drive_delay": {"delay": 0.0123}}, seed=1)
    block = drive_block(late, ROBOT, without=frozenset(catalogue()))
    assert block is not None
    assert block.data.manner is not None


def test_what_a_gain_may_be_off_by_excuses_no_wheel_that_is_late() -> None:
    """One number for each wheel explains no part of what is late: a delay of 16 ms without its name
    was no gap, 0.93."""
    late = simulated({"drive_delay": {"delay": 0.0142}}, seed=1)
    block = drive_block(late, ROBOT, without=frozenset({"drive_delay"}))
    assert block is not None
    assert block.unexplained().log_evidence > 20
    gain = {"left": 0.009, "right": -0.009}
    uneven = simulated({"drive_gain": gain, "drive_delay": {"delay": 0.005}}, seed=1)
    assert block_of(uneven).unexplained().log_evidence < 0


def described(**drive: float) -> Robot:
    """Return the robot as somebody describes it who says this of its drive."""
    told = ROBOT.plant.drive.model_copy(update=drive)
    return replace(ROBOT, plant=ROBOT.plant.model_copy(update={"drive": told}))


@pytest.mark.parametrize(
    "limits",
    [
        {"max_wheel_acceleration_rad_s2": 8.0},
        {"max_wheel_rate_rad_s": 6.0},
        {"max_wheel_acceleration_rad_s2": 8.0, "max_wheel_rate_rad_s": 6.0},
    ],
    ids=str,
)
def test_limits_that_the_wheels_outrun_are_none_of_the_drive(limits: dict[str, float]) -> None:
    """Small robots that speed up at 200 rad/s², beside the 60 rad/s² of a description that says
    nothing of it, were an unlisted cause (0.96), and a drive of 42 rad/s left a gap of 1.3 m."""
    block = drive_block(simulated(), described(**limits))
    assert block is not None
    assert block.data.limits.keys() == limits.keys()
    assert block.unexplained().log_evidence < 1
    assert max(evidence(block, one) for one in ACTUATION) < 3


def test_a_drive_that_is_late_may_outrun_a_limit_all_the_same() -> None:
    """Of a small robot's lag of .25 s nothing of a gap of 107 mm was closed: the path that it
    explains kept to 30 rad/s, and the wheels to 55."""
    late = simulated({"drive_lag": {"time_constant": 0.25}})
    block = drive_block(late, described(max_wheel_rate_rad_s=8.0))
    assert block is not None
    assert block.data.limits.keys() == {"max_wheel_rate_rad_s"}
    (size,) = block.fit(frozenset({"drive_lag"})).parameters.values()
    assert size.value == pytest.approx(0.25, rel=0.02)


@pytest.mark.parametrize("effect", ["drive_acceleration_limit", "drive_saturation", "drive_lag"])
def test_a_drive_that_is_slower_than_described_outruns_no_limit(effect: str) -> None:
    size = {"drive_lag": {"time_constant": 0.2}}.get(effect, {"limit": 6.0})
    block = block_of(simulated({effect: size}))
    assert not block.data.limits
    assert evidence(block, effect) > 20


@pytest.mark.parametrize("seed", [2, *at_full_size(1)])
def test_wheels_that_run_as_even_as_they_are_told_show_nothing(seed: int) -> None:
    """Levels of noise were sought from rougher drives, and of ten minutes of an even one the best
    were found only where an effect was sought; and what a delay of most of a row does was no
    stand-in for a few milliseconds of it. Any effect gained 50 to 120 nats by doing nothing."""
    encoder = ROBOT.plant.encoder.model_copy(update={"ticks_per_rev": 1000})
    robot = described(time_constant_s=0.25)
    robot = replace(robot, plant=robot.plant.model_copy(update={"encoder": encoder}))
    block = drive_block(table_of_even_wheels(seed, robot), robot)
    assert block is not None
    assert max(evidence(block, one) for one in ("drive_delay", "drive_gain", "drive_lag")) < 6


def test_a_steady_gain_is_no_drive_without_a_name_unless_the_library_lacks_it() -> None:
    """It was among what an unlisted drive may be, and as each is a little likelier there than where
    a tolerance of its own is given up for it, 5 nats likelier than its name (unlisted, .93). Where
    it had none, hats that are nearly even told 1 of 120 nats (no gap)."""
    recording = simulated({"drive_gain": {"left": 0.079, "right": -0.0099}}, seed=3)
    named = evidence(block_of(recording), "drive_gain")
    withheld = drive_block(recording, ROBOT, without=frozenset({"drive_gain"}))
    assert withheld is not None
    assert withheld.unexplained().log_evidence > named - 8
    assert block_of(recording).unexplained().log_evidence < named - 10
