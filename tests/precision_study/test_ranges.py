"""Ranges are proved: no drive leaves them, and where a word is too narrow a drive shows it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from chiplog.cli import main
from firmware_model import (
    FRESH,
    STALE,
    FirmwareConstants,
    FirmwareDescription,
    FirmwareError,
    Kernel,
    KernelConfig,
    StatusBit,
    build_config,
)
from precision_study import StudyError
from precision_study.ranges import Envelope, Finding, find_ranges, intermediates
from precision_study.ranges.verdicts import drive_inputs

ROBOT = FirmwareConstants(
    wheel_radius_m=0.05025,
    wheelbase_m=0.2985,
    ticks_per_rev=2048,
    counter_bits=16,
    tick_period_s=0.01,
    gyro_sensitivity_rad_s_per_lsb=math.radians(1 / 131),
    gyro_zero_rate_code=32768,
    gyro_min_code=18,
    gyro_max_code=65518,
    max_wheel_rate_rad_s=30.0,
)


def forced(**firmware: Any) -> KernelConfig:
    description = FirmwareDescription.from_table(firmware)
    return build_config(description, ROBOT, allow_overflow=True)


def finding(config: KernelConfig, name: str, mission_s: float = 3600.0) -> Finding:
    found = find_ranges(config, Envelope.of(config, mission_s=mission_s))
    return next(one for one in found if one.intermediate.name.startswith(name))


def test_the_default_firmware_cannot_overflow_in_an_hour_and_every_row_is_a_proof() -> None:
    config = build_config(FirmwareDescription(), ROBOT)
    found = find_ranges(config, Envelope.of(config))
    assert {one.verdict for one in found} == {"impossible"}
    assert all(one.drive is None for one in found)


def words(name: str, kernel: Kernel) -> list[int]:
    """Return what the kernel holds of an intermediate that its state shows."""
    state = kernel.state()
    held = {
        "increment": [state["left_step_ticks"], state["right_step_ticks"]],
        "turn of the longest gap": [state["gap_turn_q"]],
        "x and y": [state["x_m_q"], state["y_m_q"]],
        "filter of the step": [state["v_filter_q"]],
        "filter of the turn": [state["w_filter_q"]],
        "speed": [kernel.v_m_s_q],
        "turn rate": [kernel.w_rad_s_q],
        "sum of codes": [state["rest_sum"]],
        "turning of a block": [state["turn_block_sum"]],
        "count of ticks": [state["tick"]],
    }
    return next((values for start, values in held.items() if name.startswith(start)), [])


FORMATS = st.fixed_dictionaries(
    {
        "mode": st.sampled_from(["wheel", "gyro", "blend"]),
        "integration": st.sampled_from(["euler_before", "midpoint", "euler_after"]),
        "position": st.fixed_dictionaries(
            {
                "word_bits": st.integers(12, 64),
                "frac_bits": st.integers(4, 30),
                "rounding": st.sampled_from(["floor", "half_up", "half_even", "toward_zero"]),
                "carry_remainder": st.booleans(),
            }
        ),
        "step": st.fixed_dictionaries(
            {
                "frac_bits": st.integers(10, 28),
                "rounding": st.sampled_from(["floor", "half_up", "half_even", "toward_zero"]),
                "carry_remainder": st.booleans(),
            }
        ),
        "turn_step": st.fixed_dictionaries(
            {"frac_bits": st.integers(32, 48), "carry_remainder": st.booleans()}
        ),
        "velocity": st.fixed_dictionaries({"filter_log2": st.integers(0, 8)}),
    }
)


@given(st.data())
@settings(max_examples=60)
def test_no_drive_of_the_envelope_leaves_the_ranges(data: st.DataObject) -> None:
    robot = replace(ROBOT, max_wheel_rate_rad_s=data.draw(st.sampled_from([3.0, 30.0, 60.0])))
    try:
        config = build_config(FirmwareDescription.from_table(data.draw(FORMATS)), robot)
    except FirmwareError:
        assume(False)
        raise
    ticks = 300
    envelope = Envelope.of(config, mission_s=ticks * robot.tick_period_s)
    bounds = intermediates(config, envelope)
    kernel = Kernel(config)
    left = right = silent = 0
    speed, code = (0, 0), 32768
    wheel = st.sampled_from([-1, 0, 1]).map(lambda sign: sign * envelope.step_ticks)
    for tick in range(ticks):
        if tick % 20 == 0:
            speed = data.draw(wheel), data.draw(wheel)
            code = data.draw(st.sampled_from([envelope.code_low, 32768, envelope.code_high]))
            silent = data.draw(st.sampled_from([0, 0, 19]))
        left, right = left + speed[0], right + speed[1]
        kernel.step(left, right, STALE if tick % 20 < silent and tick else FRESH, code, FRESH)
        for one in bounds:
            assert all(abs(value) <= one.bound for value in words(one.name, kernel)), one.name
    if all(one.is_proved for one in bounds):
        assert StatusBit.OVERFLOW not in kernel.status


@pytest.mark.parametrize(
    ("name", "firmware"),
    [
        ("x and y", {"position": {"word_bits": 24, "frac_bits": 14}}),
        ("x and y", {"position": {"word_bits": 24, "frac_bits": 14, "overflow": "saturate"}}),
        ("step of", {"step": {"word_bits": 16, "frac_bits": 22}}),
        ("turn by the wheels", {"mode": "wheel", "turn_step": {"word_bits": 32, "frac_bits": 40}}),
        ("turn by the gyro", {"turn_step": {"word_bits": 16, "frac_bits": 40}}),
    ],
)
def test_a_word_too_narrow_is_overflowed_by_the_drive_at_the_tick_that_is_named(
    name: str, firmware: dict[str, Any]
) -> None:
    config = forced(**firmware)
    found = finding(config, name)
    assert found.verdict == "overflows"
    assert found.drive is not None
    assert found.tick is not None
    oracle = Kernel(config, "python")
    for given_inputs in drive_inputs(found.drive)[: found.tick].tolist():
        oracle.step(*given_inputs)
        assert StatusBit.OVERFLOW not in oracle.status
    oracle.step(*drive_inputs(found.drive)[found.tick].tolist())
    assert StatusBit.OVERFLOW in oracle.status


def test_one_bit_less_than_needed_overflows_and_as_many_as_needed_do_not() -> None:
    for frac_bits in (8, 12, 16):
        needed = finding(
            forced(position={"word_bits": 40, "frac_bits": frac_bits}), "x and y", 600.0
        ).intermediate.least_word_bits
        for word_bits, verdict in ((needed, "impossible"), (needed - 1, "overflows")):
            config = forced(position={"word_bits": word_bits, "frac_bits": frac_bits})
            assert finding(config, "x and y", 600.0).verdict == verdict


def test_a_turn_rate_beyond_its_output_is_shown_at_its_limit() -> None:
    robot = replace(ROBOT, gyro_sensitivity_rad_s_per_lsb=0.01)
    table = {"velocity": {"frac_bits": 24}, "turn_step": {"frac_bits": 40}}
    config = build_config(FirmwareDescription.from_table(table), robot, allow_overflow=True)
    found = finding(config, "turn rate")
    assert found.verdict == "overflows"
    assert found.drive is not None
    kernel = Kernel(config)
    kernel.run(drive_inputs(found.drive))
    assert kernel.w_rad_s_q in (config.velocity_low_q, config.velocity_high_q)


def test_a_slower_robot_and_a_shorter_mission_need_no_more_bits() -> None:
    config = build_config(FirmwareDescription(), ROBOT)
    whole = intermediates(config, Envelope.of(config))
    for smaller in (
        Envelope.of(config, mission_s=60.0),
        Envelope.of(config, speed_m_s=0.1),
    ):
        pairs = zip(whole, intermediates(config, smaller), strict=True)
        assert all(less.bound <= more.bound for more, less in pairs)


@pytest.mark.parametrize("mission_s", [0.0, -1.0, math.nan, math.inf, 1e9])
def test_a_mission_that_is_none_is_refused(mission_s: float) -> None:
    config = build_config(FirmwareDescription(), ROBOT)
    with pytest.raises(StudyError, match="expected more than 0, at most a year"):
        Envelope.of(config, mission_s=mission_s)


def test_the_command_answers_with_its_status_and_the_same_facts_as_data(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["ranges"]) == 0
    assert capsys.readouterr().out.endswith("\nNo word can overflow.\n")
    (tmp_path / "robot.toml").write_text("[firmware.position]\nword_bits = 24\nfrac_bits = 14\n")
    assert main(["ranges", "--robot", "robot.toml", "--json", "ranges.json"]) == 1
    said = capsys.readouterr().out
    assert "firmware.position.word_bits = 24, expected at least 28" in said
    answer = json.loads((tmp_path / "ranges.json").read_text())
    (wrong,) = [one for one in answer["intermediates"] if one["verdict"] != "impossible"]
    assert wrong["field"] == "firmware.position.word_bits"
    assert wrong["drive"][0]["left_step"] == answer["envelope"]["step_ticks"]
    assert np.isclose(wrong["tick"] * 0.01, 339, atol=1)
