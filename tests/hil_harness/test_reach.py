"""A drive that a position's word does not hold is refused before it is driven, by every way in."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from firmware_model import FirmwareDescription
from hil_harness import (
    HarnessError,
    Rig,
    RunConfig,
    load_robot,
    load_wire,
    run,
    run_scenario_batch,
    scenario,
)
from hil_harness.effects import combine_effects, parse_effect
from hil_harness.robot import Robot
from hil_harness.scenarios import load_scenario

FOREIGN = Path(__file__).parents[2] / "examples" / "foreign_dbc"

TEN_METRES = r"^robot\.toml: firmware\.position\.word_bits = 25: 10\.0\d m by the wheels do not fit"


def narrow(word_bits: int = 25) -> Robot:
    """Return a robot whose position counts 2^-21 m: of 25 bits it holds 8 m, of 26 bits 16 m."""
    position = {"word_bits": word_bits, "frac_bits": 21}
    return replace(load_robot(), firmware=FirmwareDescription.from_table({"position": position}))


def test_a_run_is_refused_and_nothing_is_written_and_by_force_it_counts(tmp_path: Path) -> None:
    straight, log = scenario("straight"), tmp_path / "bus.log"
    with pytest.raises(HarnessError, match=f"{TEN_METRES}.* expected at least 26 bits$"):
        run(RunConfig(scenario=straight, robot=narrow(), log=log))
    assert not log.exists()
    forced = run(RunConfig(scenario=straight, robot=narrow(), force=True))
    assert forced.kernel_state["overflow_count"] == 1
    wide = run(RunConfig(scenario=straight, robot=narrow(26)))
    assert wide.kernel_state["overflow_count"] == 0


def test_a_constant_that_rounds_to_zero_is_refused_and_by_force_the_robot_stands_still() -> None:
    step = {"frac_bits": 2, "constant_frac_bits": 5}
    table = {"step": step, "position": {"frac_bits": 20}, "velocity": {"frac_bits": 4}}
    robot = replace(load_robot(), firmware=FirmwareDescription.from_table(table))
    with pytest.raises(HarnessError, match=r"constant_frac_bits = 5: .* rounds to zero"):
        run(RunConfig(scenario=scenario("straight"), robot=robot, duration_s=2.0))
    forced = run(RunConfig(scenario=scenario("straight"), robot=robot, duration_s=2.0, force=True))
    found = forced.kernel_state
    assert (found["x_m_q"], found["overflow_count"]) == (0, 0)


def test_only_as_far_as_the_run_lasts_is_asked_and_what_effects_add() -> None:
    straight = scenario("straight")
    run(RunConfig(scenario=straight, robot=narrow(), duration_s=14.0))
    twice_as_far = (parse_effect("drive_gain.left=1"), parse_effect("drive_gain.right=1"))
    effects = combine_effects(*((one,) for one in twice_as_far))
    with pytest.raises(HarnessError, match=r"= 26: 20\.\d+ m by the wheels do not fit"):
        run(RunConfig(scenario=straight, robot=narrow(26), effects=effects))


def test_the_program_that_runs_is_held_against_the_drive_not_the_described_one() -> None:
    """It takes a count for more than described; a word that an effect narrows is to overflow."""
    straight = scenario("straight")

    def with_effects(*texts: str) -> RunConfig:
        effects = combine_effects(*((parse_effect(one),) for one in texts))
        return RunConfig(scenario=straight, robot=narrow(), duration_s=14.0, effects=effects)

    scale = "firmware_constant.constant=ticks_per_rev", "firmware_constant.scale=-0.3"
    with pytest.raises(HarnessError, match=r"= 25: 8\.\d+ m by the wheels do not fit"):
        run(with_effects(*scale))
    on_purpose = "firmware_overflow.variable=position", "firmware_overflow.bits=22"
    assert run(with_effects(*on_purpose)).kernel_state["overflow_count"] > 0


def test_what_a_bus_makes_of_the_counts_is_held_against_the_word(tmp_path: Path) -> None:
    """The wheels count 7.996 m and the word holds 8 m; in steps of 30 mm the bus tells of 8.01."""
    for name in ("vehicle.dbc", "map.toml"):
        text = (FOREIGN / name).read_text()
        for place in ('7|16@0+ (1,0) [0|65535] "pulses"', '23|16@0+ (1,0) [0|65535] "pulses"'):
            coarse = place.replace("(1,0) [0|65535]", "(30,0) [0|1966050]")
            text = text.replace(place, coarse.replace("pulses", "mm"))
        (tmp_path / name).write_text(text)
    drive = tmp_path / "drive.toml"
    drive.write_text(
        'name = "drive"\nduration_s = 20.0\n[[segments]]\nv_m_s = 0.5\nduration_s = 15.991\n'
        "[[segments]]\nduration_s = 1.0\n"
    )
    plant = narrow().plant
    still = plant.encoder.model_copy(update={"noise_ticks": 0.0})
    robot = replace(narrow(), plant=plant.model_copy(update={"encoder": still}))
    dbc, signals = tmp_path / "vehicle.dbc", tmp_path / "map.toml"
    with pytest.raises(HarnessError, match=r"= 25: 8\.0\d+ m by the wheels do not fit"):
        run(RunConfig(scenario=load_scenario(drive), robot=robot, dbc=dbc, signals=signals))


def test_a_batch_is_refused_and_by_force_it_counts() -> None:
    straight, wire = scenario("straight"), load_wire()
    with pytest.raises(HarnessError, match=TEN_METRES):
        run_scenario_batch(straight, narrow(), wire, [1, 2])
    forced = run_scenario_batch(straight, narrow(), wire, [1, 2], force=True)
    assert forced.firmware.final_states["overflow_count"].tolist() == [1, 1]


def test_a_rig_with_a_scenario_is_refused_and_by_force_its_status_tells() -> None:
    with pytest.raises(HarnessError, match=TEN_METRES):
        Rig(robot=narrow(), scenario="straight")
    with Rig(robot=narrow(), scenario="straight", force=True) as rig:
        rig.run_for(24.0)
        assert rig.status["overflow"] == 1
    with Rig(robot=narrow()) as rig:  # how far a test drives is not known
        rig.run_for(0.1)


def test_a_firmware_made_for_another_tick_is_refused(tmp_path: Path) -> None:
    (tmp_path / "robot.toml").write_text("[design]\ntick_period_us = 2500\n")
    robot = load_robot(tmp_path / "robot.toml")
    wrong = r"robot\.toml:2: design\.tick_period_us = 2500: the tick of chiplog\.dbc is 10000 µs"
    with pytest.raises(HarnessError, match=wrong):
        run(RunConfig(scenario=scenario("straight"), robot=robot))
    with pytest.raises(HarnessError, match=wrong):
        Rig(robot=robot)
    with pytest.raises(HarnessError, match=wrong):
        run_scenario_batch(scenario("straight"), robot, load_wire(), [1])
