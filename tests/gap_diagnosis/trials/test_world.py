"""The trial's world: another step, a converter of its own, noise that no likelihood assumes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gap_diagnosis.motion.levels import FLOORS, level_prior
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.whitening import LEVELS
from gap_diagnosis.priors import default_prior
from gap_diagnosis.reading import read_recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.trials import drives, reference_noise, robots
from gap_diagnosis.trials.case import STRATA, Stratum
from gap_diagnosis.trials.draw import as_stepped, draw_nominal, draw_values, is_credible, world_of
from gap_diagnosis.trials.engine import finer
from gap_diagnosis.trials.logs import write_log
from gap_diagnosis.trials.reference_noise import (
    believed_levels,
    draw_levels,
    reference_errors,
)
from gap_diagnosis.trials.robots import robot_text
from gap_diagnosis.trials.sizes import SIZES
from hil_harness.assembly import commands_on_the_wire, load_wire
from hil_harness.effect_runs import run_with_effects
from hil_harness.effects import catalogue, parse_effect
from hil_harness.effects.model import EffectSetting
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

WIRE = load_wire()
ROBOT = load_robot()
CONVERTER = ("adc_inl.peak=30", "adc_offset.offset=7", "adc_gain.gain=0.01", "adc_stuck_bit.bit=3")


@pytest.mark.parametrize("setting", ["gyro_bias.bias=0", *CONVERTER, "adc_missing_code.code=32770"])
def test_with_one_step_a_tick_it_is_the_plant_itself_bit_for_bit(setting: str) -> None:
    cases = [((parse_effect(setting),), 3)]
    (ours,) = run_with_effects(scenario("figure8"), ROBOT, WIRE, cases, ticks=800)
    (fine,) = run_with_effects(
        scenario("figure8"), ROBOT, WIRE, cases, ticks=800, simulator=finer(1)
    )
    for name in ("truth", "left_count", "right_count", "gyro_code", "temperature_code", "pose"):
        assert np.array_equal(getattr(ours, name), getattr(fine, name)), name


def test_an_encoder_is_sealed_to_die_when_the_finer_plant_has_it_die() -> None:
    """Within a step of 5 ms it did at its beginning, and a log tells of that to 0.1 ms (26 standard
    deviations)."""
    for start_s in (3.0012, 3.0049):
        dead = {"side": "left", "start_s": start_s}
        sealed = as_stepped("encoder_dead", dead, 0.005)
        cases = [
            ((EffectSetting("encoder_dead", tuple(one.items())),), 3) for one in (dead, sealed)
        ]
        drawn, acted = run_with_effects(
            scenario("figure8"), ROBOT, WIRE, cases, ticks=400, simulator=finer(2)
        )
        assert np.array_equal(drawn.left_count, acted.left_count)
        assert sealed["start_s"] == pytest.approx(3.0, abs=2e-6)


def test_a_frozen_gyro_repeats_its_last_code() -> None:
    frozen = EffectSetting("gyro_frozen", (("start_s", 3.0), ("stop_s", 4.0)))
    (run,) = run_with_effects(
        scenario("figure8"), ROBOT, WIRE, [((frozen,), 3)], ticks=800, simulator=finer(4)
    )
    assert len(set(run.gyro_code[301:399].tolist())) == 1
    assert len(set(run.gyro_code[401:499].tolist())) > 1


def test_finer_steps_give_other_numbers_and_the_same_physics() -> None:
    runs = [
        run_with_effects(scenario("figure8"), ROBOT, WIRE, [((), 3)], ticks=3000, simulator=plant)[
            0
        ]
        for plant in (finer(1), finer(5))
    ]
    one, five = (run.truth for run in runs)
    assert not np.array_equal(one, five)
    # One tick of 10 ms at 0.5 m/s lies between them at most.
    assert np.abs(one - five).max() < 0.005
    noise = [np.std(np.diff(run.gyro_code[:150])) for run in runs]
    # 150 samples: a spread is known to 6 %, and steps of one code add to it.
    assert noise[1] / noise[0] == pytest.approx(1.0, abs=0.3)


def test_its_log_reads_as_the_run_that_it_was_written_from(tmp_path: Path) -> None:
    effects = (
        parse_effect("frame_loss.probability=0.01"),
        parse_effect("stale_producer.cycles=3"),
        parse_effect("clock_skew.skew=0.001"),
    )
    (run,) = run_with_effects(scenario("figure8"), ROBOT, WIRE, [(effects, 3)], ticks=1500)
    write_log(tmp_path / "bus.log", run, ROBOT, WIRE)
    read = read_recording(tmp_path / "bus.log", robot=ROBOT, wire=WIRE)
    direct = synthetic_recording(ROBOT, WIRE, scenario("figure8"), effects, 3, duration_s=15.0)
    for name in ("tick", "left_ticks", "right_ticks", "gyro_code", "stamp_s", "odometry_x_m"):
        assert np.array_equal(getattr(read, name), getattr(direct, name), equal_nan=True), name
    for message in ("ENCODER", "IMU", "ODOMETRY_X"):
        assert np.array_equal(read.frames[message].t_s, direct.frames[message].t_s), message


@pytest.mark.parametrize("kind", [*reference_noise.FAMILIAR, *reference_noise.NEW])
def test_every_kind_of_reference_noise_has_the_level_that_was_drawn(kind: str) -> None:
    draw = np.random.default_rng(1)
    time_s = np.arange(200_000) / 100.0
    levels = replace(draw_levels(kind, draw), rate_hz=100.0)
    errors = reference_errors(time_s, levels, draw, position=True, heading=False)
    expected = np.hypot(levels.position_m, levels.slow_position_m)
    # Heavy tails and slow errors make a spread of 200,000 samples uncertain by a few per cent.
    assert errors[:, 0].std() == pytest.approx(expected, rel=0.25)
    assert not errors[:, 2].any()
    kurtosis = np.mean(errors[:, 0] ** 4) / np.mean(errors[:, 0] ** 2) ** 2
    assert (kurtosis > 3.2) == (kind in {"heavy_tails", "steps_in_level", "occlusions"})
    lag = np.corrcoef(errors[1:, 0], errors[:-1, 0])[0, 1]
    assert (lag > 0.8) == (kind == "correlated")


@pytest.mark.parametrize("kind", [*drives.FRESH, *reference_noise.FRESH])
def test_what_is_fresh_in_a_trial_is_diagnosed_by_no_test(kind: str) -> None:
    """A manoeuvre that a test of the diagnosis drives is one that it was developed on."""
    root = Path(__file__).parents[3]
    own = {root / "gap_diagnosis/trials" / name for name in ("drives.py", "reference_noise.py")}
    own.add(Path(__file__))  # how a noise is spread
    rooms = ("gap_diagnosis", "tests", "benchmarks", "examples")
    files = [one for room in rooms for one in (root / room).rglob("*.py") if one not in own]
    assert len(files) > 300
    texts = {one: one.read_text(encoding="utf-8") for one in files}
    assert [one.name for one, text in texts.items() if f'"{kind}"' in text] == []
    alike = ("drives.NEW", "drives.FRESH", "reference_noise.NEW", "reference_noise.FRESH")
    trials = root / "tests/gap_diagnosis/trials", root / "gap_diagnosis/trials"
    beside = [one for one in files if not any(one.is_relative_to(room) for room in trials)]
    assert [one.name for one in beside if any(name in texts[one] for name in alike)] == []


def test_noise_that_is_believed_is_log_normal_about_what_the_diagnosis_expects() -> None:
    """In a trial of its own prior a reference was never worse than 1 mm, unless that was news."""
    believed = level_prior(ROBOT)
    draw = np.random.default_rng(2)
    found = [believed_levels("white", believed, draw) for _ in range(4000)]
    place = LEVELS.index("reference_position_m")
    logs = np.log([one.position_m for one in found])
    above = logs[logs > np.log(believed.median[place])]  # what is below the floor is at the floor
    spread = believed.spread[place]
    # Half of them; a half-normal's mean is 0.80 of the spread. Four standard errors of 4,000.
    assert len(above) == pytest.approx(2000, abs=4 * np.sqrt(1000))
    expected = np.sqrt(2 / np.pi) * spread
    assert np.mean(above - np.log(believed.median[place])) == pytest.approx(
        expected, abs=4 * 0.6 * spread / np.sqrt(len(above))
    )
    assert min(one.position_m for one in found) == pytest.approx(FLOORS[place])


@pytest.mark.parametrize("kind", [*drives.FAMILIAR, *drives.NEW])
def test_every_kind_of_drive_is_one_to_two_minutes_within_what_the_robot_can(kind: str) -> None:
    for seed in range(5):
        found = drives.drive(kind, np.random.default_rng(seed), 0.7)
        commands = found.commands(found.tick_count(10_000), 10_000)
        assert 30 < found.duration_s < 130
        assert 0.2 < np.abs(commands[:, 0]).max() <= 0.7001
        assert np.abs(commands[:, 1]).max() < 2.0


@pytest.mark.parametrize("kind", [robots.FAMILIAR, robots.NEW])
def test_robots_differ_and_their_files_are_as_long_as_each_other(kind: str, tmp_path: Path) -> None:
    found = set()
    lengths = set()
    for seed in range(8):
        text = robot_text(kind, np.random.default_rng(seed))
        (tmp_path / "robot.toml").write_text(text)
        robot = load_robot(tmp_path / "robot.toml")
        found.add(robot.plant.wheels.radius_m)
        lengths.add(
            len(text) - len(robot.firmware.mode) - len(str(robot.plant.encoder.ticks_per_rev))
        )
    assert len(found) == 8
    assert max(lengths) - min(lengths) <= 8


def test_every_effect_of_the_catalogue_can_be_drawn_within_what_it_admits() -> None:
    surroundings = {"warm_up", "supply_change", "micro_slip", "contact_offset"}
    unread = {"accelerometer_bias", "accelerometer_noise"}
    assert set(SIZES) == set(catalogue()) - surroundings - unread
    world = world_of(scenario("calibration"), ROBOT, WIRE)
    draw = np.random.default_rng(1)
    rare: tuple[Stratum, ...] = ("prior",) * 300  # few of its tails lie beyond
    for effect in SIZES:
        for stratum in (*STRATA, *rare):
            values = draw_values(effect, stratum, world, draw)
            for name, value in values.items():
                parameter = catalogue()[effect].parameter(name)
                if parameter.kind == "choice":
                    assert value in parameter.choices
                elif parameter.kind != "message":
                    assert parameter.minimum <= float(value) <= parameter.maximum


def test_in_stratum_prior_all_is_drawn_that_the_diagnosis_leaves_free_within_tolerance() -> None:
    """Six of 23 were: what it allowed for the others was nowhere, and its 50 % intervals held in
    58 of 100 cases."""
    robot = load_robot()
    warm = (EffectSetting("warm_up", (("rise", 10.0), ("time_constant", 30.0))),)
    log = synthetic_recording(
        robot, WIRE, scenario("calibration"), warm, 3, reference=ReferenceNoise()
    )
    model = MotionModel(log, robot, default_prior())
    sds = {
        (variant.effect, variant.coefficients[place]): sd
        for index, sd in model.columns.nuisances
        for variant, place in [model.columns.little[index]]
    }
    draw = np.random.default_rng(1)
    drawn = [draw_nominal(robot, frozenset(), "prior", draw) for _ in range(4000)]
    of_drives = {
        (effect, name): 0.5 * default_prior().of(effect, name).tolerance
        for effect, *names in (
            ("drive_delay", "delay"),
            ("drive_gain", "left", "right"),
            ("drive_lag", "time_constant"),
        )
        for name in names
    }
    sds |= of_drives
    assert {effect for effect, _ in sds} == drawn[0].keys()
    for (effect, name), sd in sds.items():
        if name in drawn[0][effect]:  # polar ones go by a size and an angle
            squares = np.square([float(one[effect][name]) for one in drawn])
            # Of a normal density that is cut at two standard deviations.
            assert 0.7 < squares.mean() / sd**2 < 1.0
    assert len(draw_nominal(robot, frozenset(), "field", draw)) == 6
    assert "gyro_scale" not in draw_nominal(robot, frozenset({"adc_gain"}), "prior", draw)


def test_a_command_in_a_wrong_unit_is_one_that_the_bus_carries() -> None:
    """A speed ten times as large as 1 m/s left its signal, and a whole trial was lost."""
    world = world_of(scenario("calibration"), ROBOT, WIRE)
    draw = np.random.default_rng(2)
    signal = WIRE.signal_map.get("v_command")
    assert signal is not None
    peak_m_s = float(np.abs(commands_on_the_wire(scenario("calibration"), 6000, WIRE)[:, 0]).max())
    factors = set()
    for _ in range(400):
        values = draw_values("setup_unit", "field", world, draw)
        if values["signal"] == "command_speed":
            factors.add(float(values["factor"]))
    assert len(factors) > 4
    signal.to_raw(max(factors) * peak_m_s)


def test_a_size_that_no_robot_has_is_not_drawn() -> None:
    assert is_credible("lateral_slip", {"compliance": 0.1})
    assert not is_credible("lateral_slip", {"compliance": 10.0})
    assert is_credible("floor_bump", {"time": 3.0, "yaw": -0.05, "forward": 0.01})
    assert not is_credible("floor_bump", {"time": 3.0, "yaw": -0.5, "forward": 0.01})
    assert is_credible("setup_wheels_swapped", {})
