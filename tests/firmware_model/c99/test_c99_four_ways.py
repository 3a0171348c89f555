"""Python, machine code, C on this PC and C on an emulated Cortex-M3: the same odometry bytes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kernel_cases import ROBOT, config_of, configs, inputs
from machines import assert_four_ways, assert_same, job_of, oracle, run_program
from test_c99_bit_equal import FORMATS, LIMITS, MODES, RULES, formats
from test_kernel_bit_equal import random_ticks

from firmware_model import FirmwareDescription, KernelConfig, build_config
from firmware_model.cortex_m import Job, measure, run_jobs
from hil_harness.assembly import load_wire
from hil_harness.effect_runs import run_with_effects
from hil_harness.firmware_program import FirmwareProgram
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario, scenario_names


@given(st.data())
@settings(max_examples=60)
def test_random_configurations_and_extreme_inputs_break_no_rule_of_c(data: st.DataObject) -> None:
    config = data.draw(configs())
    job = job_of(config, data.draw(inputs(config)))
    assert_same(run_program([job])[0], oracle(job), "sanitizers")


@given(st.data())
@settings(max_examples=40)
def test_random_configurations_and_extreme_inputs_are_the_same_on_the_emulated_core(
    data: st.DataObject,
) -> None:
    config = data.draw(configs())
    job = job_of(config, data.draw(inputs(config)))
    assert_same(run_jobs([job])[0], oracle(job), "cortex_m3")


def test_every_mode_rule_and_rounding_is_the_same(size: str) -> None:
    count = 1_500 if size == "small" else 50_000
    jobs = []
    for place, (mode, rule) in enumerate((mode, rule) for mode in MODES for rule in RULES):
        for config in (
            config_of(mode=mode, integration=rule),
            config_of(mode=mode, integration=rule, **formats(place)),
            config_of(mode=mode, stale_heading_ticks=place % 5, **formats(place + 1)),
        ):
            jobs.append(Job(config, random_ticks(config, place, count)))
    assert_four_ways(jobs)


def test_every_scenario_is_the_same_in_every_mode_and_format(size: str) -> None:
    """Small: its first 6 s, in the default formats and one other. Full: whole, in all of them."""
    robot, wire = load_robot(None), load_wire(None, None)
    constants = FirmwareProgram(robot, wire.signal_map, wire.tick_period_us).described.constants
    place = 0
    for name in scenario_names():
        ticks = 600 if size == "small" else None
        run = run_with_effects(scenario(name), robot, wire, [((), 1)], ticks=ticks)[0]
        columns = np.zeros((len(run.left_count), 5), dtype=np.int64)
        columns[:, 0], columns[:, 1], columns[:, 3] = run.left_count, run.right_count, run.gyro_code
        tables: list[dict[str, object]] = []
        for mode in MODES:
            others = [place % FORMATS] if size == "small" else list(range(FORMATS))
            tables += [{"mode": mode}, *[{"mode": mode, **formats(other)} for other in others]]
            place += 1
        described = [
            FirmwareDescription.from_table(robot.firmware.model_dump() | table) for table in tables
        ]
        assert_four_ways([Job(build_config(one, constants), columns) for one in described])
    assert place >= FORMATS


def sweep(config: KernelConfig) -> list[tuple[int, ...]]:
    """Return drives over every edge: counter, rails, heading, standstill, reversal, loss."""
    fastest = config.max_step_ticks
    zero = int(config.constants.gyro_zero_rate_code)
    low, high = config.gyro_min_code, config.gyro_max_code
    ticks: list[tuple[int, ...]] = []
    left = right = (1 << config.counter_bits) - 5 * fastest
    for left_step, right_step, code in (
        (fastest, fastest, zero),  # over the counter's end
        (-fastest, -fastest, zero),  # and back
        (fastest, -fastest, high - 1),  # the heading wraps
        (-fastest, fastest, low + 1),
        (1, -1, low),  # the rails
        (0, 0, high),
        (0, 0, zero),  # a standstill, with jitter
        (0, 0, zero + 1),
        (fastest + 1, 0, zero),  # refused
    ):
        for turn in range(60):
            left, right = left + left_step, right + right_step
            ticks.append((left, right, 0, code, 0))
            if turn == 30:
                ticks += [
                    (left, right, validity, code, other)
                    for validity in (0, 1, 2, 3)
                    for other in (0, 1, 2, -1)
                ]
    ticks += [(left, right, 1, zero, 0)] * (min(config.gap_limit_ticks, 400) + 5)
    ticks += [(count, -count - 1, 0, code, 0) for count in LIMITS for code in LIMITS]
    return ticks


def test_every_edge_of_every_input_is_the_same() -> None:
    jobs = []
    for bits in (8, 16, 32):
        robot = replace(ROBOT, counter_bits=bits, ticks_per_rev=360, max_wheel_rate_rad_s=20.0)
        for place, mode in enumerate(MODES):
            table = {"mode": mode, "standstill": {"ticks": 3, "settle_ticks": 2, "block_log2": 2}}
            table["turn_step"] = {"frac_bits": 40}
            table["heading"] = {"frac_bits": 32}
            table |= formats(place) if bits == 8 else {}
            config = build_config(FirmwareDescription.from_table(table), robot, allow_overflow=True)
            jobs.append(job_of(config, sweep(config)))
    assert_four_ways(jobs)


def test_words_at_the_limits_of_32_and_64_bits_wrap_and_saturate_alike() -> None:
    jobs = []
    for word_bits, frac_bits in ((64, 48), (32, 31), (32, 30), (33, 32), (62, 48), (63, 48)):
        for overflow in ("wrap", "saturate"):
            position = {"word_bits": word_bits, "frac_bits": frac_bits, "overflow": overflow}
            table = {"position": position, "step": {"frac_bits": 30, "overflow": overflow}}
            config = build_config(FirmwareDescription.from_table(table), ROBOT, allow_overflow=True)
            drive = [(100 * tick, 100 * tick, 0, 32768, 0) for tick in range(3_000)]
            jobs.append(job_of(config, drive))
    assert any(answer.state["overflow_count"] for answer in assert_four_ways(jobs))


def test_a_day_of_motion_in_one_run_is_the_same_all_four_ways(size: str) -> None:
    """Small: 100 s at 100 Hz. Full: 24 h, 8.64 million ticks; counters wrap and words with them."""
    config = config_of(position={"word_bits": 32, "frac_bits": 21})
    ticks = random_ticks(config, seed=24, count=10_000 if size == "small" else 8_640_000)
    assert_four_ways([Job(config, ticks)])


def test_the_emulated_core_counts_the_same_instructions_each_time() -> None:
    config = config_of()
    job = Job(config, random_ticks(config, seed=1, count=3_000))
    once, again = measure(job), measure(job)
    assert once == again
    assert 100 < once.instructions < once.worst_instructions < 10_000


def test_more_rotations_take_more_instructions_and_each_as_many_as_the_next() -> None:
    """A law the counter must obey: CORDIC's loop is the same code each time around."""

    def instructions(rotations: int) -> float:
        trig = {"method": "cordic", "iterations": rotations}
        config = config_of(trig=trig, mode="wheel")
        drive = [(300 * tick, 300 * tick, 0, 32768, 0) for tick in range(512)]
        return measure(job_of(config, drive)).instructions

    eight, sixteen, thirty_two = instructions(8), instructions(16), instructions(32)
    assert eight < sixteen < thirty_two
    assert (thirty_two - sixteen) / 16 == pytest.approx((sixteen - eight) / 8, rel=0.2)
