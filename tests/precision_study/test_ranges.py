"""Ranges are proved: no drive leaves them, and where a word is too narrow a drive shows it."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from full_size import at_full_size
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from chiplog.cli import main
from firmware_model import (
    FRESH,
    STALE,
    STATE_FIELDS,
    FirmwareConstants,
    FirmwareDescription,
    FirmwareError,
    Kernel,
    KernelConfig,
    StatusBit,
    build_config,
)
from firmware_model.c99_layout import c_types
from precision_study import StudyError
from precision_study.ranges import (
    Envelope,
    Finding,
    find_ranges,
    intermediates,
)
from precision_study.ranges.drives import drives
from precision_study.ranges.stretches import drive_chunks

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


def held(kernel: Kernel) -> dict[str, int]:
    """Return what the kernel holds after a tick: its state, and what it puts out."""
    outputs = {"speed": kernel.v_m_s_q, "turn rate": kernel.w_rad_s_q}
    return kernel.state() | outputs


CHOICES = {
    *("status", "encoder_decision", "heading_source", "v_is_valid", "w_is_valid"),
    *("gyro_is_zeroed", "is_initialised", "gap_misses_gyro", "offset_is_valid", "turn_blocks"),
    *("offset_samples_log2", "rest_next_log2", "pending_samples_log2"),
}
"""Fields of the state that are a flag, a choice or the logarithm of a count that has a row."""


@pytest.mark.parametrize("method", ["table", "cordic"])
def test_every_number_of_the_state_has_a_row_with_the_width_that_c_gives_it(method: str) -> None:
    table = {"mode": "blend", "trig": {"method": method}}
    config = build_config(FirmwareDescription.from_table(table), ROBOT)
    rows = intermediates(config, Envelope.of(config))
    assert sorted(name for one in rows for name in one.holds) == sorted(set(STATE_FIELDS) - CHOICES)
    types = c_types("chiplog_state")
    for one in rows:
        for name in one.holds:
            if name not in ("x_m_q", "y_m_q"):  # in a word of the user's choice
                assert (one.field, one.word_bits) == (types[name], int(types[name][-4:-2]))
    (total,) = (one for one in rows if one.name == "sum of codes at rest")
    assert (total.word_bits, total.is_signed) == (32, False)
    names = {one.name for one in rows}
    assert ("angle that CORDIC has still to turn" in names) == (method == "cordic")


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
    spans = rng.integers(1, 40, size=ticks)
    steps = math.floor(envelope.rate) * rng.integers(-1, 2, size=(ticks, 2))
    code = rng.choice([envelope.code_low, 32768, envelope.code_high], size=ticks)
    silent = rng.choice([0, 0, 1], size=ticks)
    phases = np.repeat(np.arange(ticks), spans)[: ticks - 1]
    counts = np.cumsum(steps[phases], axis=0)
    kernel, bounds = Kernel(config), intermediates(config, envelope)
    low, high = dict[str, int](), dict[str, int]()
    kernel.step(0, 0, FRESH, 32768, FRESH)
    for place, phase in enumerate(phases):
        validity = STALE if silent[phase] and place % 20 else FRESH
        kernel.step(int(counts[place, 0]), int(counts[place, 1]), validity, int(code[phase]), FRESH)
        for name, value in held(kernel).items():
            low[name], high[name] = min(low.get(name, 0), value), max(high.get(name, 0), value)
    words = {
        "position": (config.position_low_q, config.position_high_q),
        "velocity": (config.velocity_low_q, config.velocity_high_q),
    }
    for one in bounds:
        least, most = words.get(one.word, (one.low, one.high))  # the kernel limits it to its word
        for name in set(one.holds) or {one.name} & {"speed", "turn rate"}:
            assert max(one.low, least) <= low[name] <= high[name] <= min(one.high, most), name
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
            one.range_bits for one in intermediates(config, envelope) if one.word == narrowed
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
    drive = inputs_of(found)
    gains = np.diff(drive[:, :2], axis=0)
    assert set(gains.sum(axis=1)) == {9}
    assert np.ptp(drive[:, 1] - drive[:, 0]) == 1  # the heading turns by one count, and back


@pytest.mark.parametrize("acceleration_rad_s2", [None, 60.0])
@pytest.mark.parametrize(
    "rounding", ["floor", "half_even", *at_full_size("half_up", "toward_zero")]
)
def test_a_tick_lies_between_the_proof_and_the_drive(
    rounding: str, acceleration_rad_s2: float | None
) -> None:
    """The longest mission that is proved is a few ticks shorter than a drive that overflows.

    A robot that goes straight on at top speed has no time to turn about while a wheel trembles; the
    proof takes it for both.
    """
    config = forced(position={"word_bits": 14, "frac_bits": 6, "rounding": rounding})

    def envelope(ticks: int) -> Envelope:
        limit = acceleration_rad_s2
        return Envelope.of(config, mission_s=ticks / 100, acceleration_rad_s2=limit)

    def proves(ticks: int) -> bool:
        rows = intermediates(config, envelope(ticks))
        return all(one.is_proved for one in rows if one.word == "position")

    low, high = 8000, 9000
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if proves(middle) else (low, middle)
    (one,) = (one for one in find_ranges(config, envelope(high)) if one.verdict != "impossible")
    assert one.tick is not None
    assert low < one.tick <= high + 8


def test_a_drive_that_overflows_is_one_that_the_robot_can_make() -> None:
    config = forced(
        mode="wheel",
        position={"word_bits": 20, "frac_bits": 14},
        step={"word_bits": 16, "frac_bits": 22},
        turn_step={"word_bits": 32, "frac_bits": 40},
    )
    limits: dict[str, float] = {
        "speed_m_s": 1.0,
        "acceleration_rad_s2": 20.0,
        "turn_rate_rad_s": 0.8,
    }
    envelope = Envelope.of(config, mission_s=600.0, **limits)
    found = [one for one in find_ranges(config, envelope) if one.drive is not None]
    assert {one.intermediate.word for one in found} >= {"position", "step"}
    tick_m = math.tau * ROBOT.wheel_radius_m / ROBOT.ticks_per_rev
    for one in found:
        assert one.verdict == "overflows"
        gains_m = np.diff(inputs_of(one)[:, :2], axis=0) * tick_m
        # Over so many ticks a count more or less is little, and speeds are means over them.
        span = 20
        speeds = np.add.reduceat(gains_m, np.arange(0, len(gains_m) - span, span)) / (span * 0.01)
        count = 2 * tick_m / (span * 0.01)
        assert np.abs(speeds[:-1]).max(initial=0) <= 1.0 + count
        turns = np.abs(speeds[:-1, 1] - speeds[:-1, 0]) / ROBOT.wheelbase_m
        assert turns.max(initial=0) <= 0.8 + 2 * count / ROBOT.wheelbase_m
        rises = np.abs(np.diff(speeds[:-1], axis=0)).max(initial=0)
        assert rises <= 20.0 * ROBOT.wheel_radius_m * span * 0.01 * 1.02 + 2 * count


@pytest.mark.parametrize(
    ("acceleration_rad_s2", "gone_m"), [(20.0, 0.55), (None, 0.85)], ids=["a spin", "swings"]
)
def test_remainders_of_a_coarse_step_overflow_on_the_spot_as_the_kernel_confirms(
    acceleration_rad_s2: float | None, gone_m: float
) -> None:
    """A quarter of a metre by the wheels, metres of remainders taken and given back."""
    firmware: dict[str, Any] = {"mode": "wheel", "step": {"frac_bits": 8}}
    envelope: dict[str, Any] = {"distance_m": 0.25, "acceleration_rad_s2": acceleration_rad_s2}

    def position(word_bits: int, frac_bits: int) -> Finding:
        config = forced(**firmware, position={"word_bits": word_bits, "frac_bits": frac_bits})
        found = find_ranges(config, Envelope.of(config, mission_s=200.0, **envelope))
        return next(one for one in found if one.intermediate.word == "position")

    wide = position(40, 8).intermediate
    assert wide.bound / 2**8 < 5.0
    assert position(wide.least_word_bits, 8).verdict == "impossible"
    config = forced(**firmware, position={"word_bits": 40, "frac_bits": 8})
    limits = Envelope.of(config, mission_s=200.0, **envelope)
    farthest = 0
    for drive in drives(config, limits, wide):
        inputs = np.concatenate(list(drive_chunks(drive)))
        gains = np.diff(inputs[:, :2], axis=0)
        trembling = limits.jitter * int(np.count_nonzero(gains.sum(axis=1)))
        assert np.abs(gains.sum(axis=1)).sum() <= limits.way_ticks + trembling
        assert np.abs(gains).max() <= limits.wheel_ticks(1)
        assert np.abs(gains[:, 1] - gains[:, 0]).max() <= limits.turn_ticks(1)
        kernel = Kernel(config)
        kernel.run(inputs)
        farthest = max(farthest, kernel.x_m_q)
    assert gone_m * wide.bound < farthest <= wide.bound
    narrow = position(10, 8)
    assert narrow.verdict == "overflows"
    kernel = Kernel(forced(**firmware, position={"word_bits": 10, "frac_bits": 8}))
    kernel.run(inputs_of(narrow))
    assert kernel.overflow_count == 1


def test_a_limit_of_the_robot_proves_a_word_that_any_drive_would_overflow() -> None:
    config = forced(turn_step={"word_bits": 37, "frac_bits": 44})
    name = "turn by the gyro"
    assert finding(config, name).verdict == "overflows"
    slow = Envelope.of(config, turn_rate_rad_s=1.0)
    (found,) = (one for one in find_ranges(config, slow) if one.intermediate.name.startswith(name))
    assert found.verdict == "impossible"
    position = forced(position={"word_bits": 24, "frac_bits": 14})
    assert finding(position, "x and y").verdict == "overflows"
    near = Envelope.of(position, distance_m=500.0)
    (found,) = (one for one in find_ranges(position, near) if one.intermediate.word == "position")
    assert found.verdict == "impossible"


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
        Envelope.of(config, acceleration_rad_s2=1.0),
        Envelope.of(config, turn_rate_rad_s=0.5),
        Envelope.of(config, distance_m=10.0),
    ):
        pairs = list(zip(whole, intermediates(config, smaller), strict=True))
        assert all(more.low <= less.low <= less.high <= more.high for more, less in pairs)
        assert any(less.bound < more.bound for more, less in pairs)


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
    ramp, on = wrong["drive"]
    assert (ramp["ramp_ticks"], ramp["left_step"]) == (
        answer["envelope"]["ramp_ticks"],
        on["left_step"],
    )
    assert on["left_step"] / on["over_ticks"] == answer["envelope"]["rate"]
    assert np.isclose(wrong["tick"] * 0.01, 340, atol=1)
    assert f"overflows after {wrong['tick'] / 100:g} s of: 49 ticks of 49 from rest to" in said
