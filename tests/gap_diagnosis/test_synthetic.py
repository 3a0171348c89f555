"""A synthetic recording is what reading gives of the log of the same run."""

import math
from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

from gap_diagnosis.reading.recordings import read_recording
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording, synthetic_recordings
from hil_harness.assembly import RunConfig, Wire, load_wire
from hil_harness.effects import EffectSetting, combine_effects, parse_effect
from hil_harness.robot import Robot, load_robot
from hil_harness.running import run
from hil_harness.scenarios import scenario

SECONDS = 12.0
SEED = 4
DRIVE = scenario("stop_and_go")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot()


@pytest.fixture(scope="module")
def wire() -> Wire:
    return load_wire()


def settings_of(*texts: str) -> tuple[EffectSetting, ...]:
    return combine_effects(parse_effect(text) for text in texts)


def recorded(robot: Robot, log: Path, texts: Sequence[str]) -> Recording:
    config = RunConfig(
        scenario=DRIVE,
        robot=robot,
        effects=settings_of(*texts),
        seed=SEED,
        duration_s=SECONDS,
        log=log,
    )
    run(config)
    return read_recording(log, robot=robot)


CASES = [
    (),
    ("radius_scale.scale=0.01", "gyro_bias.bias=0.01"),
    ("clock_skew.skew=0.002",),
    ("frame_latency.delay=0.012",),
    ("frame_jitter.sigma=0.002",),
    ("frame_loss.probability=0.05", "frame_loss.burst=3"),
    ("frame_duplication.probability=0.05",),
    ("stale_producer.frame=IMU", "stale_producer.cycles=3", "stale_producer.probability=0.05"),
    ("missed_deadline.probability=0.02",),
    ("bus_gap.start_s=4", "bus_gap.stop_s=4.2"),
    ("frame_loss.frame=ODOMETRY_X", "frame_loss.probability=0.1"),
    ("setup_wheels_swapped",),
    ("firmware_constant.constant=wheelbase", "firmware_constant.scale=0.02"),
]


@pytest.mark.parametrize("texts", CASES, ids=" ".join)
def test_it_is_what_reading_gives(
    robot: Robot, wire: Wire, tmp_path: Path, texts: tuple[str, ...]
) -> None:
    read = recorded(robot, tmp_path / "bus.log", texts)
    made = synthetic_recording(robot, wire, DRIVE, settings_of(*texts), SEED, duration_s=SECONDS)
    # What is still under way when the run ends never reaches the log.
    rows = min(len(read.t_s), len(made.t_s))
    assert abs(len(read.t_s) - len(made.t_s)) <= 3
    np.testing.assert_allclose(read.t_s[:rows], made.t_s[:rows], atol=2e-5)
    for name in (
        "stamp_s", "tick", "left_ticks", "right_ticks", "gyro_code", "gyro_rate_rad_s",
        "temperature_k", "supply_v", "odometry_x_m", "odometry_y_m", "odometry_heading_rad",
    ):  # fmt: skip
        one, other = getattr(read, name)[:rows], getattr(made, name)[:rows]
        np.testing.assert_allclose(one, other, atol=1e-8, err_msg=name)
    for name in ("v_command_m_s", "w_command_rad_s"):
        np.testing.assert_allclose(
            getattr(read, name)[:rows], getattr(made, name)[:rows], atol=1e-9, err_msg=name
        )
    assert read.counter_bits == made.counter_bits
    assert read.clock_skew == pytest.approx(made.clock_skew, abs=5e-6)
    for name, frames in read.frames.items():
        if name not in made.frames:
            continue
        count = min(len(frames.t_s), len(made.frames[name].t_s))
        np.testing.assert_allclose(frames.t_s[:count], made.frames[name].t_s[:count], atol=1e-8)
        assert frames.modulo == made.frames[name].modulo
        assert frames.cycle_s == made.frames[name].cycle_s
        if frames.cycle_s < 0.02:
            np.testing.assert_array_equal(
                frames.counter[:count], made.frames[name].counter[:count], err_msg=name
            )
        repeats = np.diff(frames.payload[:count]) == 0
        shown = np.diff(made.frames[name].payload[:count]) == 0
        if name == "ENCODER":
            np.testing.assert_array_equal(repeats, shown)


@pytest.mark.parametrize(
    ("texts", "late_s"),
    [
        (("frame_jitter.sigma=0.005",), 0.0),
        (("reception_stamp.period=0.0131",), 0.0),
        (("frame_latency.frame=ENCODER", "frame_latency.delay=0.012"), 0.0),
        (("frame_latency.delay=0.012",), 0.012),
        (("frame_latency.delay=0.012", "frame_jitter.sigma=0.002"), 0.012),
    ],
)
def test_ticks_lie_where_the_sensors_sampled_but_for_what_all_frames_are_late_by(
    robot: Robot, wire: Wire, texts: tuple[str, ...], late_s: float
) -> None:
    drive = scenario("calibration")
    plain = synthetic_recording(robot, wire, drive, (), SEED)
    made = synthetic_recording(robot, wire, drive, settings_of(*texts), SEED)
    rows = min(len(plain.t_s), len(made.t_s))
    np.testing.assert_allclose(made.t_s[:rows] - plain.t_s[:rows], late_s, atol=5e-4)


def test_many_cases_at_once_are_each_alone(robot: Robot, wire: Wire) -> None:
    cases = [
        (settings_of(), 1),
        (settings_of("gyro_bias.bias=0.01"), 1),
        (settings_of("frame_jitter.sigma=0.001", "wheelbase_scale.scale=0.02"), 9),
    ]
    noise = ReferenceNoise()
    together = synthetic_recordings(
        robot, wire, DRIVE, cases, reference=noise, contact_noise_m_per_sqrt_m=5e-4
    )
    for (effects, seed), one in zip(cases, together, strict=True):
        alone = synthetic_recording(
            robot, wire, DRIVE, effects, seed, reference=noise, contact_noise_m_per_sqrt_m=5e-4
        )
        assert one.reference is not None
        assert alone.reference is not None
        for item in fields(one.reference):
            np.testing.assert_array_equal(
                getattr(one.reference, item.name), getattr(alone.reference, item.name)
            )
        np.testing.assert_array_equal(one.left_ticks, alone.left_ticks)
        np.testing.assert_array_equal(one.odometry_x_m, alone.odometry_x_m)


def test_the_reference_has_the_noise_that_is_asked_for(robot: Robot, wire: Wire) -> None:
    silent = ReferenceNoise(0.0, 0.0, 0.0, 0.0)
    white = ReferenceNoise(0.002, 0.005, 0.0, 0.0)
    slow = ReferenceNoise(0.0, 0.0, 0.002, 0.0, correlation_time_s=0.1)
    drive = scenario("calibration")
    exact, noisy, drifting = (
        synthetic_recording(robot, wire, drive, (), 2, reference=noise).reference
        for noise in (silent, white, slow)
    )
    assert exact is not None
    assert noisy is not None
    assert drifting is not None
    assert exact.heading_rad is not None
    assert noisy.heading_rad is not None
    count = len(exact.t_s)
    assert np.std(noisy.x_m - exact.x_m) == pytest.approx(0.002, rel=5 / math.sqrt(2 * count))
    turn = np.std(noisy.heading_rad - exact.heading_rad)
    assert turn == pytest.approx(0.005, rel=5 / math.sqrt(2 * count))
    noise = drifting.x_m - exact.x_m
    kept = float(np.mean(noise[10:] * noise[:-10]) / np.mean(noise**2))
    assert kept == pytest.approx(math.exp(-1), abs=0.15)


@pytest.mark.parametrize("correlation_s", [0.0, 0.5])
def test_a_noise_of_the_reference_takes_the_place_of_its_own_kind_only(
    robot: Robot, wire: Wire, correlation_s: float
) -> None:
    """One that scatters more wanders all the same: its slow noise was gone, and a fit that allows
    for some told the scatter 0.4 % too small."""
    values = (("position", 0.01), ("correlation_time", correlation_s))
    effect = EffectSetting("reference_noise", values)
    white, slow = ReferenceNoise(0.02, 0.0, 0.0, 0.0), ReferenceNoise(0.0, 0.0, 0.02, 0.0)
    silent = ReferenceNoise(0.0, 0.0, 0.0, 0.0)

    def x_m(noise: ReferenceNoise, *effects: EffectSetting) -> Floats:
        drive = scenario("calibration")
        made = synthetic_recording(robot, wire, drive, effects, 2, reference=noise).reference
        assert made is not None
        return made.x_m

    own, other = (white, slow) if correlation_s == 0.0 else (slow, white)
    stated = x_m(silent, effect)
    np.testing.assert_array_equal(x_m(own, effect), stated)
    beside = x_m(other, effect) - stated
    np.testing.assert_allclose(beside, x_m(other) - x_m(silent), atol=1e-12)


def test_a_reference_may_have_a_rate_of_its_own(robot: Robot, wire: Wire) -> None:
    noise = ReferenceNoise(rate_hz=25.0)
    made = synthetic_recording(robot, wire, DRIVE, (), 2, reference=noise)
    assert made.reference is not None
    np.testing.assert_allclose(np.diff(made.reference.t_s), 0.04)


def test_contact_noise_moves_the_robot_and_not_its_counts(robot: Robot, wire: Wire) -> None:
    smooth, rough = (
        synthetic_recording(
            robot, wire, DRIVE, (), 2,
            reference=ReferenceNoise(0.0, 0.0, 0.0, 0.0),
            contact_noise_m_per_sqrt_m=level,
        )
        for level in (0.0, 0.003)
    )  # fmt: skip
    np.testing.assert_array_equal(smooth.left_ticks, rough.left_ticks)
    assert smooth.reference is not None
    assert rough.reference is not None
    assert np.ptp(smooth.reference.x_m - rough.reference.x_m) > 1e-3
