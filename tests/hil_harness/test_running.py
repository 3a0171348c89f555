"""A whole run: plant, bus, firmware, and what the result says about them."""

import math
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from can_bus import FrameChecker, load_database, open_bus, read_log
from hil_harness import (
    HarnessError,
    RunConfig,
    load_robot,
    load_wire,
    parse_effect,
    replay,
    run,
    scenario,
)
from hil_harness.results import RunResult
from hil_harness.standalone import rejected_frames


def run_scenario(name: str, **arguments: object) -> RunResult:
    return run(RunConfig(scenario=scenario(name), robot=load_robot(None), **arguments))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def lesson() -> RunResult:
    return run_scenario("lesson")


def final_distance_m(estimate: np.ndarray, truth: np.ndarray) -> float:
    offset = (estimate - truth)[-1, :2]
    return float(math.hypot(offset[0], offset[1]))


def test_the_lesson_ends_where_the_lesson_says_for_wheels_alone(lesson: RunResult) -> None:
    # 16-bit counters carry the lesson's increments rounded: 6.850275 m to the printed digits.
    wheels = lesson.estimators["wheel only"].float_twin
    assert final_distance_m(wheels, lesson.truth) == pytest.approx(6.850275, abs=5e-7)


def test_the_lesson_ends_where_the_lesson_says_for_the_gyro_within_its_converter(
    lesson: RunResult,
) -> None:
    # The ADC rounds each of 5,999 rate samples to 1/7506 rad/s. The heading error after k samples
    # is a random walk with step q·T/√12, and the position error it makes at 0.6 m/s has standard
    # deviation v·T·q·T/√12·√(Σk²) = 0.6·0.01·(0.01/7506)/√12·√(6000³/3) m = 6.2e-4 m.
    # Against 5.280128 m (no converter) five of those are allowed.
    gyro = lesson.estimators["gyro heading"].float_twin
    assert final_distance_m(gyro, lesson.truth) == pytest.approx(5.280128, abs=5 * 6.2e-4)


def test_the_error_parts_add_up_component_by_component(lesson: RunResult) -> None:
    errors = lesson.errors
    assert np.abs(errors.total - (errors.arithmetic + errors.model)).max() < 1e-12


def test_fixed_point_costs_the_lesson_less_than_a_hundredth_of_a_millimetre(
    lesson: RunResult,
) -> None:
    # Truncated position increments of 2^-32 m carry their remainder; what is left is the sine
    # table's interpolation, (π/2/1024)²/8 per unit step: at most 36 m · 2.9e-7 = 1.1e-5 m.
    arithmetic = lesson.errors.arithmetic
    assert np.hypot(arithmetic[:, 0], arithmetic[:, 1]).max() < 1.1e-5


def test_every_tick_sends_encoder_imu_and_pose_and_nothing_else_so_often(
    lesson: RunResult,
) -> None:
    frames = lesson.bus.frames_by_message
    at_tick_rate = {name for name, count in frames.items() if count == lesson.ticks}
    assert at_tick_rate == {"ENCODER", "IMU", "ODOMETRY_X", "ODOMETRY_Y", "ODOMETRY_HEADING"}
    assert all(
        count < lesson.ticks / 10 for name, count in frames.items() if name not in at_tick_rate
    )
    assert "REFERENCE_POSE" not in frames


def test_in_lockstep_the_clock_of_the_log_is_simulated_time(lesson: RunResult) -> None:
    assert np.array_equal(lesson.stamp_us / 1e6, lesson.time_s)


def test_nothing_is_rejected_on_a_healthy_bus(lesson: RunResult) -> None:
    assert set(lesson.bus.rejected.values()) == {0}


def test_the_same_seed_gives_the_same_bytes(tmp_path: Path) -> None:
    for name in ("a.log", "b.log"):
        run_scenario("figure8", duration_s=3.0, seed=11, log=tmp_path / name)
    run_scenario("figure8", duration_s=3.0, seed=12, log=tmp_path / "c.log")
    first = (tmp_path / "a.log").read_bytes()
    assert first == (tmp_path / "b.log").read_bytes()
    assert first != (tmp_path / "c.log").read_bytes()


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf"])
def test_the_log_holds_every_frame_in_the_format_of_its_name(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bus{suffix}"
    result = run_scenario("spin", duration_s=1.0, log=path)
    assert sum(1 for _ in read_log(path)) == result.bus.frames


def test_an_effect_asked_for_overrides_that_of_the_scenario() -> None:
    plain = run_scenario("lesson", duration_s=5.0)
    unbiased = run_scenario("lesson", duration_s=5.0, effects=(parse_effect("gyro_bias.bias=0"),))
    # b_g·t, to the last converter step of each sample
    difference_rad = plain.firmware[-1, 2] - unbiased.firmware[-1, 2]
    assert difference_rad == pytest.approx(0.005 * 4.99, abs=499 * 0.01 / 7505 / 2)


def test_a_run_with_reference_frames_puts_the_truth_on_the_bus() -> None:
    result = run_scenario("straight", duration_s=2.0, send_reference=True)
    assert result.bus.frames_by_message["REFERENCE_POSE"] > 0


def test_a_run_of_no_length_is_refused() -> None:
    with pytest.raises(HarnessError, match=r"--duration-s -1: expected a positive number"):
        run_scenario("lesson", duration_s=-1.0)
    with pytest.raises(HarnessError, match="expected 1 to"):
        run_scenario("lesson", duration_s=1e-6)


def test_lockstep_is_refused_where_the_clock_cannot_be_simulated() -> None:
    with pytest.raises(HarnessError, match="no simulated clock"):
        run_scenario("lesson", time="lockstep", interface="socketcan", channel="vcan0")


def test_the_summary_has_every_field_of_the_contract(lesson: RunResult) -> None:
    summary = lesson.summary()
    assert {
        "schema", "scenario", "seed", "time", "ticks", "duration_s", "realtime_factor", "versions",
        "final", "error", "bus", "timing",
    } <= set(summary)  # fmt: skip
    assert (summary["scenario"], summary["seed"], summary["ticks"]) == ("lesson", 7, 6000)
    assert summary["time"] == "lockstep"
    assert set(summary["final"]) == {"truth", "float", "firmware"}
    assert set(summary["error"]) == {"total", "arithmetic", "model"}
    assert set(summary["error"]["total"]) == {"x_m", "y_m", "heading_rad", "position_m"}
    assert set(summary["bus"]) == {"frames", "load", "rejected"}
    assert set(summary["bus"]["rejected"]) == {
        "length", "crc", "counter", "range", "age", "unknown_id",
    }  # fmt: skip
    assert set(summary["timing"]) == {
        "missed_deadlines",
        "jitter_us",
        "outages",
        "unsent_frames",
    }
    assert set(summary["timing"]["jitter_us"]) == {"p50", "p99", "max"}


@pytest.fixture
def heard_ctrl_c() -> Iterator[None]:
    """Hear Ctrl-C: what a shell starts in the background is told to ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("heard_ctrl_c")
def test_ctrl_c_ends_a_run_with_what_it_has(tmp_path: Path) -> None:
    def interrupt(done: int, ticks: int) -> None:
        if done == ticks // 2:
            signal.raise_signal(signal.SIGINT)

    path = tmp_path / "bus.log"
    config = RunConfig(scenario=scenario("straight"), robot=load_robot(None), log=path)
    result = run(replace(config, duration_s=4.0), interrupt)
    assert result.interrupted
    assert result.ticks == 200
    assert sum(1 for _ in read_log(path)) == result.bus.frames
    replayed = replay(path, config.robot, load_wire())
    assert replayed.is_equal
    assert (replayed.ticks, replayed.state) == (result.ticks, result.kernel_state)


@pytest.mark.usefixtures("heard_ctrl_c")
def test_a_second_ctrl_c_interrupts_at_once() -> None:
    def insist(done: int, ticks: int) -> None:
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        run(
            RunConfig(scenario=scenario("straight"), robot=load_robot(None), duration_s=1.0), insist
        )


@pytest.mark.parametrize(
    ("lost", "complaint"),
    [
        ('BA_ "GenMsgCycleTime" BO_', "has no GenMsgCycleTime: expected one"),
        ('BA_ "E2EProfile" BO_', "has crc and tick_counter, but no E2E attributes"),
    ],
)
def test_a_dbc_that_lost_its_attributes_is_refused_not_guessed_at(
    tmp_path: Path, lost: str, complaint: str
) -> None:
    lines = load_database().path.read_text().splitlines(keepends=True)
    dbc = tmp_path / "cut.dbc"
    dbc.write_text("".join(line for line in lines if not line.startswith(lost)))
    with pytest.raises(HarnessError, match=complaint):
        run_scenario("spin", duration_s=0.1, dbc=dbc)


def test_datagrams_that_are_no_frames_are_among_the_rejected() -> None:
    with open_bus("udp_multicast", "239.74.163.77") as bus:
        checker = FrameChecker(load_database(), ["ENCODER"], max_age_us=0)
        assert "malformed" not in rejected_frames(checker, bus)
        bus.malformed = 3  # type: ignore[attr-defined]
        assert rejected_frames(checker, bus)["malformed"] == 3
