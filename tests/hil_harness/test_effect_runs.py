"""Runs over arrays are the runs of the loop: same counts, same poses, whatever effect is on."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from can_bus import read_log
from hil_harness.assembly import RunConfig, Wire, load_wire
from hil_harness.effect_runs import EffectRun, run_with_effects
from hil_harness.effects import catalogue, combine_effects, parse_effect
from hil_harness.effects.model import EffectSetting
from hil_harness.results import RunResult
from hil_harness.robot import Robot, load_robot
from hil_harness.running import run
from hil_harness.scenarios import Scenario, scenario

SECONDS = 8.0
SEED = 5


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def wire() -> Wire:
    return load_wire()


def settings_of(texts: Sequence[str]) -> tuple[EffectSetting, ...]:
    return combine_effects(parse_effect(text) for text in texts)


def drive() -> Scenario:
    return scenario("stop_and_go")


def in_the_loop(robot: Robot, texts: Sequence[str], log: Path | None = None) -> RunResult:
    config = RunConfig(
        scenario=drive(),
        robot=robot,
        effects=settings_of(texts),
        seed=SEED,
        duration_s=SECONDS,
        log=log,
    )
    return run(config)


def at_once(robot: Robot, wire: Wire, texts: Sequence[str]) -> EffectRun:
    cases = [(settings_of(texts), SEED)]
    return run_with_effects(drive(), robot, wire, cases, ticks=round(SECONDS * 100))[0]


BUS = [
    ("frame_latency.delay=0.013",),
    ("frame_latency.frame=IMU", "frame_latency.delay=0.004"),
    ("frame_jitter.sigma=0.003",),
    ("frame_loss.probability=0.05",),
    ("frame_loss.probability=0.1", "frame_loss.burst=6"),
    ("frame_duplication.probability=0.1",),
    ("frame_reordering.frame=ENCODER", "frame_reordering.probability=0.1"),
    ("stale_producer.cycles=3", "stale_producer.probability=0.05"),
    ("reception_stamp.delay=0.001", "reception_stamp.period=0.007"),
    ("bus_gap.start_s=3", "bus_gap.stop_s=3.3"),
    ("clock_skew.skew=0.01",),
    ("frame_loss.probability=0.2", "frame_loss.start_s=2", "frame_loss.stop_s=4"),
    ("frame_jitter.sigma=0.004", "frame_loss.probability=0.05", "stale_producer.cycles=2",
     "stale_producer.probability=0.02", "frame_reordering.probability=0.03"),
]  # fmt: skip
FIRMWARE = [
    ("firmware_truncation.rounding=toward_zero",),
    ("firmware_resolution.variable=position", "firmware_resolution.bits=20"),
    ("firmware_resolution.variable=heading", "firmware_resolution.bits=16"),
    ("coarse_trig_table.entries=16", "coarse_trig_table.interpolated=0"),
    ("euler_integration.heading=after",),
    ("stale_heading.cycles=3",),
    ("firmware_constant.constant=wheelbase", "firmware_constant.scale=0.01"),
    ("firmware_overflow.variable=position", "firmware_overflow.bits=33"),
    ("moving_calibration.start_s=2.5", "moving_calibration.stop_s=4"),
    ("auto_zero.threshold=0.05",),
    ("fixed_tick_period.scale=0.01",),
    ("missed_deadline.probability=0.05",),
    ("firmware_constant.scale=0.02", "firmware_constant.start_s=4"),
]
SETUP = [
    ("setup_wheels_swapped",),
    ("setup_sign.signal=left_ticks",),
    ("setup_sign.signal=gyro",),
    ("setup_unit.signal=ticks", "setup_unit.factor=0.5"),
    ("setup_unit.signal=gyro", "setup_unit.factor=2"),
]
PLANT = [
    (),
    ("gyro_bias.bias=0.02", "gyro_bias.start_s=3", "gyro_bias.stop_s=5"),
    ("ticks_per_rev.scale=0.02", "ticks_per_rev.start_s=3"),
    ("drive_delay.delay=0.034", "drive_delay.start_s=2.503"),
    ("missed_ticks.probability=0.05", "extra_ticks.rate=20", "backlash.width=0.02"),
]


@pytest.mark.parametrize("texts", [*PLANT, *BUS, *FIRMWARE, *SETUP], ids=" ".join)
def test_a_run_over_arrays_is_the_run_of_the_loop(
    robot: Robot, wire: Wire, texts: tuple[str, ...]
) -> None:
    looped, arrays = in_the_loop(robot, texts), at_once(robot, wire, texts)
    np.testing.assert_array_equal(looped.truth, arrays.truth)
    np.testing.assert_array_equal(looped.firmware, arrays.pose)


@pytest.mark.parametrize("texts", BUS, ids=" ".join)
def test_the_log_holds_the_stamps_of_the_arrays(
    robot: Robot, wire: Wire, texts: tuple[str, ...], tmp_path: Path
) -> None:
    in_the_loop(robot, texts, tmp_path / "bus.log")
    arrays = at_once(robot, wire, texts)
    stamps: dict[str, list[float]] = {"ENCODER": [], "IMU": []}
    for message in read_log(tmp_path / "bus.log"):
        spec = wire.database.by_id(message.arbitration_id, message.is_extended_id)
        if spec is not None and spec.name in stamps:
            stamps[spec.name].append(message.timestamp)
    rate = 1.0 + arrays.settings.plant.clock_skew
    last_us = (round(SECONDS * 100) - 1) * 10_000
    for name, logged in stamps.items():
        arrivals = arrays.arrivals.get(name)
        time_us = np.arange(len(arrays.time_s)) * 10_000
        if arrivals is not None:
            time_us = arrivals.time_us[arrivals.time_us <= last_us]
        np.testing.assert_allclose(logged, np.rint(time_us / rate) * 1e-6, atol=1e-9)


def test_an_effect_of_the_reference_changes_the_reference_file_alone(
    robot: Robot, tmp_path: Path
) -> None:
    plain = in_the_loop(robot, (), tmp_path / "plain.log")
    seen = in_the_loop(
        robot,
        ("reference_yaw.angle=0.02", "reference_time_offset.offset=0.05"),
        tmp_path / "seen.log",
    )
    assert (tmp_path / "plain.log").read_bytes() == (tmp_path / "seen.log").read_bytes()
    np.testing.assert_array_equal(plain.truth, seen.truth)
    assert plain.reference is None
    assert seen.reference is not None
    stamps_s, poses = seen.reference
    np.testing.assert_allclose(stamps_s, plain.time_s + 0.05)
    np.testing.assert_allclose(poses[:, 2], plain.truth[:, 2] + 0.02)


def test_a_mirrored_reference_is_the_truth_in_axes_of_the_other_hand(
    robot: Robot, tmp_path: Path
) -> None:
    plain = in_the_loop(robot, (), tmp_path / "plain.log")
    seen = in_the_loop(robot, ("setup_sign.signal=reference",), tmp_path / "seen.log")
    assert (tmp_path / "plain.log").read_bytes() == (tmp_path / "seen.log").read_bytes()
    assert seen.reference is not None
    np.testing.assert_array_equal(seen.reference[1], plain.truth * [1.0, -1.0, -1.0])


def test_neutral_effects_of_every_stage_leave_the_log_as_it_is(
    robot: Robot, tmp_path: Path
) -> None:
    neutral = [
        f"{effect.name}.{parameter.name}={parameter.neutral}"
        for effect in catalogue().values()
        for parameter in effect.parameters
    ]
    in_the_loop(robot, (), tmp_path / "plain.log")
    in_the_loop(robot, neutral, tmp_path / "neutral.log")
    assert (tmp_path / "plain.log").read_bytes() == (tmp_path / "neutral.log").read_bytes()
