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
from numpy.typing import NDArray

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
from precision_study.ranges.drives import drive_chunks

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


def words(kernel: Kernel) -> dict[str, int]:
    """Return the magnitude of what the kernel holds of each intermediate that its state shows."""
    state = kernel.state()
    held = {
        "increment of a wheel": [state["left_step_ticks"], state["right_step_ticks"]],
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
    return {name: max(abs(value) for value in values) for name, values in held.items()}


ROUNDINGS = st.sampled_from(["floor", "half_up", "half_even", "toward_zero"])
OVERFLOWS = st.sampled_from(["wrap", "saturate"])
FORMATS = st.fixed_dictionaries(
    {
        "mode": st.sampled_from(["wheel", "gyro", "blend"]),
        "integration": st.sampled_from(["euler_before", "midpoint", "euler_after"]),
        "position": st.fixed_dictionaries(
            {
                "word_bits": st.integers(12, 64),
                "frac_bits": st.integers(4, 30),
                "rounding": ROUNDINGS,
                "overflow": OVERFLOWS,
                "carry_remainder": st.booleans(),
            }
        ),
        "step": st.fixed_dictionaries(
            {
                "word_bits": st.integers(12, 32),
                "frac_bits": st.integers(12, 30),
                "rounding": ROUNDINGS,
                "overflow": OVERFLOWS,
                "carry_remainder": st.booleans(),
            }
        ),
        "turn_step": st.fixed_dictionaries(
            {
                "word_bits": st.integers(24, 64),
                "frac_bits": st.integers(32, 48),
                "rounding": ROUNDINGS,
                "overflow": OVERFLOWS,
                "carry_remainder": st.booleans(),
            }
        ),
        "trig": st.fixed_dictionaries(
            {
                "method": st.sampled_from(["table", "cordic"]),
                "entries": st.sampled_from([1, 16, 1024]),
                "iterations": st.integers(1, 30),
                "interpolated": st.booleans(),
            }
        ),
        "gyro": st.fixed_dictionaries({"auto_zero_rad_s": st.sampled_from([0.0, 0.1, 10.0])}),
        "standstill": st.fixed_dictionaries(
            {"ticks": st.integers(1, 9), "block_log2": st.integers(0, 4)}
        ),
        "velocity": st.fixed_dictionaries({"filter_log2": st.integers(0, 8)}),
    }
)
ROBOTS = st.builds(
    replace,
    st.just(ROBOT),
    wheel_radius_m=st.floats(0.01, 0.5),
    wheelbase_m=st.floats(0.1, 3.0),
    ticks_per_rev=st.sampled_from([60, 360, 2048, 8192]),
    tick_period_s=st.sampled_from([0.001, 0.01, 0.02]),
    gyro_sensitivity_rad_s_per_lsb=st.floats(1e-5, 1e-2),
    max_wheel_rate_rad_s=st.sampled_from([3.0, 30.0, 100.0]),
)


@st.composite
def configs(draw: st.DrawFn) -> KernelConfig:
    """Draw a robot with formats that its 64-bit intermediates bear; words may be too narrow."""
    description = FirmwareDescription.from_table(draw(FORMATS))
    try:
        return build_config(description, draw(ROBOTS), allow_overflow=True)
    except FirmwareError:
        assume(False)
        raise


@given(configs(), st.integers(0, 2**32))
@settings(max_examples=50)
def test_no_drive_of_the_envelope_leaves_the_ranges(config: KernelConfig, seed: int) -> None:
    ticks = 200
    envelope = Envelope.of(config, mission_s=ticks * config.constants.tick_period_s)
    rng = np.random.default_rng(seed)
    held = rng.integers(1, 40, size=ticks)
    steps = envelope.step_ticks * rng.integers(-1, 2, size=(ticks, 2))
    code = rng.choice([envelope.code_low, 32768, envelope.code_high], size=ticks)
    silent = rng.choice([0, 0, 1], size=ticks)
    phases = np.repeat(np.arange(ticks), held)[: ticks - 1]
    counts = np.cumsum(steps[phases], axis=0)
    kernel, largest = Kernel(config), dict[str, int]()
    kernel.step(0, 0, FRESH, 32768, FRESH)
    for place, phase in enumerate(phases):
        validity = STALE if silent[phase] and place % 20 else FRESH
        kernel.step(int(counts[place, 0]), int(counts[place, 1]), validity, int(code[phase]), FRESH)
        for name, value in words(kernel).items():
            largest[name] = max(largest.get(name, 0), value)
    bounds = intermediates(config, envelope)
    for one in bounds:
        reached = [value for name, value in largest.items() if one.name.startswith(name)]
        assert max(reached, default=0) <= min(one.bound, 1 << (one.word_bits - 1)), one.name
    if all(one.is_proved for one in bounds):
        assert StatusBit.OVERFLOW not in kernel.status


@given(configs(), st.sampled_from([2.0, 20.0, 200.0]), st.data())
@settings(max_examples=40)
def test_a_word_of_any_robot_is_proved_or_overflowed_by_a_drive_that_the_kernel_confirms(
    config: KernelConfig, mission_s: float, data: st.DataObject
) -> None:
    """Words as wide as drawn, and one of them exactly as wide as needed or one bit less."""
    narrowed = data.draw(st.sampled_from(["", "position", "step", "turn_step"]))
    missing = data.draw(st.integers(0, 1))
    envelope = Envelope.of(config, mission_s=mission_s)
    if narrowed:
        word_bits = max(
            one.least_word_bits for one in intermediates(config, envelope) if one.word == narrowed
        )
        word_bits = min(max(word_bits - missing, 8), {"step": 32}.get(narrowed, 64))
        table = config.description.model_dump()
        table[narrowed]["word_bits"] = word_bits
        try:
            description = FirmwareDescription.from_table(table)
            config = build_config(description, config.constants, allow_overflow=True)
        except FirmwareError:
            assume(False)
        envelope = Envelope.of(config, mission_s=mission_s)
    for one in find_ranges(config, envelope):
        assert one.verdict in ("impossible", "overflows", "overflows later"), one
        if one.drive is None:
            continue
        assert one.tick is not None
        assert (one.tick <= envelope.mission_ticks) == (one.verdict == "overflows")
        kernel = Kernel(config)
        assert sum(part.ticks for part in one.drive) == one.tick  # and the baseline before them
        kernel.run(inputs_of(one))
        if one.intermediate.word == "velocity":
            assert (config.velocity_high_q in (abs(kernel.v_m_s_q), abs(kernel.w_rad_s_q))) or (
                config.velocity_low_q in (kernel.v_m_s_q, kernel.w_rad_s_q)
            )
        else:
            assert kernel.overflow_count > 0


def inputs_of(finding: Finding) -> NDArray[np.int64]:
    """Return a finding's drive as the kernel's inputs, int64[n, 5]."""
    assert finding.drive is not None
    return np.concatenate(list(drive_chunks(finding.drive)))


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
    drive = inputs_of(found)
    for given_inputs in drive[: found.tick].tolist():
        oracle.step(*given_inputs)
        assert StatusBit.OVERFLOW not in oracle.status
    oracle.step(*drive[found.tick].tolist())
    assert StatusBit.OVERFLOW in oracle.status


def test_where_steps_wrap_an_odd_count_goes_farther_than_any_even_one_and_is_driven() -> None:
    """Nine counts are 128 of a word's 128 units, no even number more than 116: one wheel leads."""
    robot = replace(ROBOT, wheel_radius_m=0.2, wheelbase_m=2.0, ticks_per_rev=360)
    step = {"word_bits": 8, "frac_bits": 13, "overflow": "wrap", "carry_remainder": False}
    position = {"word_bits": 14, "frac_bits": 12, "carry_remainder": False}
    table = {"mode": "wheel", "step": step, "position": position}
    config = build_config(FirmwareDescription.from_table(table), robot, allow_overflow=True)
    found = finding(config, "x and y", mission_s=1.32)
    assert found.verdict == "overflows"
    assert found.drive is not None
    assert found.drive[0].left_step % 2 == 1
    drive = inputs_of(found)
    gains = np.diff(drive[:, :2], axis=0)
    assert set(gains.sum(axis=1)) == {found.drive[0].left_step}
    assert np.ptp(drive[:, 1] - drive[:, 0]) == 1  # the heading turns by one count, and back


def test_a_bound_that_is_its_words_limit_is_shown_by_a_drive_a_tick_longer_than_the_mission() -> (
    None
):
    config = forced(position={"word_bits": 14, "frac_bits": 6})
    within = finding(config, "x and y", mission_s=84.73)
    assert (within.verdict, within.tick) == ("overflows", 8473)
    beyond = finding(config, "x and y", mission_s=84.72)
    assert (beyond.verdict, beyond.tick) == ("overflows later", 8473)


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
    kernel.run(inputs_of(found))
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
    assert f"overflows after {wrong['tick'] / 100:g} s of: {wrong['tick']:,} ticks of " in said


def test_formats_that_no_kernel_bears_are_refused_with_their_line(
    tmp_path: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robot.toml").write_text("[firmware.step]\nfrac_bits = 2\nconstant_frac_bits = 5\n")
    assert main(["ranges", "--robot", "robot.toml"]) == 2
    assert "robot.toml:3: firmware.step.constant_frac_bits = 5: " in capsys.readouterr().err
