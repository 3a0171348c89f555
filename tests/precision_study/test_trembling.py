"""Wheels that tremble on a count's edge, and a gyro's noise: they move x and y without any way."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from chiplog.commands.export_c import proved_mission
from chiplog.commands.kernel_config import kernel_config, wheel_rounding_ticks
from firmware_model import FRESH, INVALID, STALE, Kernel, KernelConfig, StatusBit
from hil_harness import HarnessError, RunConfig, run, scenario
from hil_harness.assembly import load_wire
from hil_harness.robot import load_robot
from hil_harness.wheel_counter import over_the_bus
from precision_study.ranges import (
    Envelope,
    Intermediate,
    envelope_of,
    find_ranges,
    intermediates,
)
from precision_study.ranges.dithers import dithers, losses
from precision_study.ranges.drives import drives
from precision_study.ranges.stretches import drive_chunks

COARSE = 'rounding = "floor"\ncarry_remainder = false\n'
RESTS = {
    "a word of 8 m": ("frac_bits = 10\nword_bits = 14\n" + COARSE, "mission_s = 600.0", ""),
    "64 counts a turn": (
        "frac_bits = 10\nword_bits = 16\n" + COARSE,
        "mission_s = 60.0\nspeed_m_s = 0.2\ntick_period_us = 500",
        "[encoder]\nticks_per_rev = 64\n",
    ),
}


@pytest.mark.parametrize("name", RESTS)
def test_a_robot_at_rest_whose_encoders_tremble_overflows_and_no_less_is_said(
    name: str, tmp_path: Path
) -> None:
    """The described noise on a count's edge: a count and more in most ticks, no way at all."""
    position, design, other = RESTS[name]
    file = tmp_path / "robot.toml"
    file.write_text(f"{other}[firmware.position]\n{position}[design]\n{design}\ndistance_m = 0.5\n")
    robot = load_robot(file)
    config = kernel_config(robot, None, None)
    envelope = envelope_of(robot, config)
    (found,) = (one for one in find_ranges(config, envelope) if one.verdict != "impossible")
    assert (found.intermediate.word, found.verdict) == ("position", "overflows")
    noise = robot.plant.encoder.noise_ticks * np.random.default_rng(1).normal(
        size=(envelope.mission_ticks + 1, 2)
    )
    inputs = np.full((len(noise), 5), [0, 0, FRESH, 32768, FRESH], dtype=np.int64)
    inputs[:, :2] = np.floor(noise)
    kernel = Kernel(config)
    kernel.run(inputs)
    assert kernel.overflow_count > 0
    wide = Kernel(replace(config, position_low_q=-(1 << 40), position_high_q=1 << 40))
    wide.run(inputs)
    assert found.intermediate.low <= wide.x_m_q < config.position_low_q


def test_a_count_taken_forward_and_given_back_backward_overflows_and_no_less_is_said(
    tmp_path: Path,
) -> None:
    """A robot is turned while its wheels rest on an edge: remainders are carried, and no matter."""
    file = tmp_path / "robot.toml"
    file.write_text(
        "[wheels]\nradius_m = 0.0655\n[encoder]\nticks_per_rev = 64\nnoise_ticks = 0.0\n"
        "[firmware.position]\nword_bits = 20\nfrac_bits = 20\n"
        "[design]\nmission_s = 60.0\nspeed_m_s = 0.0065\ntick_period_us = 500\n"
    )
    robot = load_robot(file)
    config = kernel_config(robot, None, None)
    envelope = envelope_of(robot, config)
    (found,) = (one for one in find_ranges(config, envelope) if one.verdict != "impossible")
    assert (found.intermediate.word, found.verdict) == ("position", "overflows")
    ticks = np.arange(envelope.mission_ticks)
    inputs = np.full((ticks.size, 5), [0, 0, FRESH, 32768, FRESH], dtype=np.int64)
    inputs[:, 3] = envelope.code_high - 5 + ticks % 2
    code_rad = config.constants.gyro_sensitivity_rad_s_per_lsb * config.constants.tick_period_s
    turned_rad = (envelope.code_high - 4.5 - 32768) * code_rad * ticks
    half_turns = np.floor(turned_rad / math.pi + 0.5)
    inputs[:, 0] = inputs[:, 1] = half_turns % 2 == 0
    kernel = Kernel(config)
    kernel.step(0, 0, FRESH, 32768, FRESH)
    kernel.run(inputs)
    assert kernel.overflow_count > 0


def described(
    tmp_path: Path, tables: str, bus: tuple[Path, Path] | None = None
) -> tuple[KernelConfig, Envelope, Intermediate]:
    """Return a robot's configuration, its envelope, and the bound of x and y."""
    file = tmp_path / "robot.toml"
    file.write_text(tables)
    robot = load_robot(file)
    dbc, signals = bus or (None, None)
    config = kernel_config(robot, dbc, signals)
    rounding_ticks = wheel_rounding_ticks(robot, dbc, signals)
    envelope = envelope_of(robot, config, rounding_ticks=rounding_ticks)
    rows = intermediates(config, envelope)
    return config, envelope, next(one for one in rows if one.word == "position")


def require_no_less_is_said(
    config: KernelConfig, said: Intermediate, inputs: NDArray[np.int64]
) -> None:
    """Hold the kernel's x and y after these inputs, which overflow their word, to the bound."""
    wide = Kernel(replace(config, position_low_q=-(1 << 40), position_high_q=1 << 40))
    wide.run(inputs)
    farthest = max(abs(wide.x_m_q), abs(wide.y_m_q))
    assert config.position_high_q < farthest <= said.bound


@pytest.mark.parametrize(
    ("encoder", "design", "position"),
    [
        ("counter_bits = 8", "distance_m = 10.0\nturn_rate_rad_s = 0.5", (20, 15)),
        ("noise_ticks = 0.0", "distance_m = 0.2\nturn_rate_rad_s = 0.05", (12, 12)),
    ],
    ids=["a counter of 8 bits", "no noise"],
)
def test_frames_lost_for_longer_than_is_bridged_let_a_wheel_at_rest_count_on(
    encoder: str, design: str, position: tuple[int, int], tmp_path: Path
) -> None:
    """A count ahead, then a silence in which it goes back unseen: the next frame is a baseline."""
    word_bits, frac_bits = position
    config, envelope, said = described(
        tmp_path,
        f'[encoder]\n{encoder}\n[firmware]\nmode = "wheel"\n[firmware.position]\n'
        f"word_bits = {word_bits}\nfrac_bits = {frac_bits}\n[design]\n{design}\n",
    )
    ahead = 1 + math.floor(envelope.noise_ticks)
    cycle = [(0, FRESH), (ahead, FRESH), *[(0, STALE)] * config.gap_limit_ticks]
    inputs = np.full((envelope.mission_ticks + 1, 5), [0, 0, FRESH, 32768, INVALID], dtype=np.int64)
    for place, (count, validity) in enumerate(cycle):
        inputs[place :: len(cycle), :2] = count
        inputs[place :: len(cycle), 2] = validity
    require_no_less_is_said(config, said, inputs)


def test_a_gyro_whose_noise_exceeds_a_standstill_turns_a_robot_at_rest(tmp_path: Path) -> None:
    """A count ahead where four deviations have turned it one way, the same back where the other."""
    config, envelope, said = described(
        tmp_path,
        "[encoder]\nnoise_ticks = 0.0\n[gyro]\nnoise_density_rad_per_sqrt_s = 0.005\n"
        '[firmware]\nmode = "gyro"\n[firmware.standstill]\nmax_rate_rad_s = 0.001\n'
        "[firmware.position]\nword_bits = 10\nfrac_bits = 14\n[drive]\nmax_wheel_rate_rad_s = 5.0\n"
        "[design]\nmission_s = 2400.0\ndistance_m = 0.005\nturn_rate_rad_s = 0.001\n",
    )
    ticks = np.arange(envelope.mission_ticks)
    code = round(4 * 0.005 / 0.01**0.5 / config.constants.gyro_sensitivity_rad_s_per_lsb)
    inputs = np.full((ticks.size, 5), [0, 0, FRESH, 32768, FRESH], dtype=np.int64)
    inputs[:, 3] += np.where(ticks % 2, code, -code)
    inputs[:, 0] = inputs[:, 1] = ticks % 2 == 0
    require_no_less_is_said(config, said, inputs)


def test_ticks_without_a_sample_of_the_gyro_are_none_of_a_block_that_trembling_adds_up_in(
    tmp_path: Path,
) -> None:
    """Ahead in the ticks with a sample, back in those without: a block has only what is ahead."""
    config, envelope, _ = described(tmp_path, "[encoder]\nnoise_ticks = 0.0\n")
    ahead = envelope.turn_ticks(1) // 2
    ticks = np.arange(4 * config.stuck_block_ticks)
    inputs = np.full((ticks.size, 5), [0, 0, FRESH, 32768, FRESH], dtype=np.int64)
    inputs[:, 1] = np.where(ticks % 2, ahead, 0)
    inputs[:, 0] = -inputs[:, 1]
    inputs[ticks % 2 == 0, 4] = INVALID
    kernel = Kernel(config)
    kernel.run(inputs)
    rows = intermediates(config, envelope)
    (row,) = (one for one in rows if "turn_block_high" in one.holds)
    assert envelope.turn_ticks(config.stuck_block_ticks) < kernel.state()["turn_block_high"]
    assert kernel.state()["turn_block_high"] <= row.high


def test_trembling_too_wide_for_a_counted_step_makes_no_drive(tmp_path: Path) -> None:
    """Of 64 counts a turn few are believed in a tick, and noise of a whole one shakes by more."""
    config, envelope, said = described(
        tmp_path,
        "[encoder]\nticks_per_rev = 64\nnoise_ticks = 1.0\n[drive]\nmax_wheel_rate_rad_s = 3.0\n"
        "[firmware.position]\nword_bits = 15\nfrac_bits = 9\ncarry_remainder = false\n"
        "[design]\nmission_s = 60.0\ndistance_m = 1.0\n",
    )
    assert envelope.trembling_ticks > 2 * envelope.wheel_ticks(1)
    for drive in drives(config, envelope, said):
        assert all(one.ticks > 0 and one.ramp_ticks >= 0 for one in drive)


@pytest.mark.parametrize(
    ("tables", "share"),
    [
        (
            "[firmware.step]\nfrac_bits = 6\n[firmware.trig]\nentries = 16\ninterpolated = false\n",
            0.6,
        ),
        ('[firmware.position]\nfrac_bits = 8\nrounding = "floor"\ncarry_remainder = false\n', 0.6),
        ("[encoder]\ncounter_bits = 8\n", 0.5),
    ],
    ids=["nearest entries", "a rounding for each tick", "frames that are lost"],
)
def test_wheels_at_rest_come_near_to_the_bound_as_the_kernel_confirms(
    tables: str, share: float, tmp_path: Path
) -> None:
    """About the edge of a table's entry or of a rounding, which the kernel itself has told."""
    if "[encoder]" not in tables:
        tables += "[encoder]\n"
    tables = tables.replace("[encoder]\n", "[encoder]\nnoise_ticks = 0.0\n")
    rest = '[firmware]\nmode = "wheel"\n[firmware.velocity]\nfrac_bits = 8\n'
    design = "[design]\nmission_s = 300.0\ndistance_m = 0.05\nturn_rate_rad_s = 0.5\n"
    config, envelope, said = described(tmp_path, rest + tables + design)
    wide = replace(config, position_low_q=-(1 << 60), position_high_q=1 << 60)
    farthest = 0
    for drive in (*dithers(config, envelope), *losses(config, envelope)):
        kernel = Kernel(wide)
        for inputs in drive_chunks(drive):
            way = np.abs(np.diff(inputs[:, :2], axis=0)).max(initial=0)
            assert way <= envelope.wheel_ticks(1)
            kernel.run(inputs)
        farthest = max(farthest, abs(kernel.x_m_q), abs(kernel.y_m_q))
    assert share * said.bound < farthest <= said.bound


SPINNING = (
    "[encoder]\ncounter_bits = 8\n[drive]\nmax_wheel_rate_rad_s = 38.9\n"
    '[firmware]\nmode = "wheel"\n[firmware.plausibility]\nrate_margin = 1.0\nextra_ticks = 0\n'
    "[firmware.position]\nword_bits = 20\nfrac_bits = 15\n"
    "[design]\nmission_s = 60.0\ndistance_m = 0.5\n"
)


def test_noise_that_takes_an_increment_for_one_backward_is_told_and_nothing_else_is_proved(
    tmp_path: Path,
) -> None:
    """A robot spins in place: one wheel's 130 counts are 126 backward, and that is believed."""
    file = tmp_path / "robot.toml"
    file.write_text(SPINNING)
    robot = load_robot(file)
    config = kernel_config(robot, None, None)
    rounding_ticks = wheel_rounding_ticks(robot, None, None)
    envelope = envelope_of(robot, config, rounding_ticks=rounding_ticks)
    inputs = np.full((2 * 3000, 5), [0, 0, FRESH, 32768, INVALID], dtype=np.int64)
    kernel = Kernel(config)
    kernel.step(0, 0, FRESH, 32768, INVALID)
    way = np.arange(1, len(inputs) + 1) * float(envelope.rate)
    deviations = 6 * robot.plant.encoder.noise_ticks
    sign = np.where(np.arange(len(inputs)) % 2, 1.0, -1.0)
    inputs[:, 0] = np.floor(-way - sign * deviations)
    inputs[:, 1] = np.floor(way + sign * deviations)
    half = 1 << (config.counter_bits - 1)
    believed = (np.diff(inputs[:, 1]) + half) % (2 * half) - half
    assert believed.min() >= -config.max_step_ticks, "each is believed"
    assert (believed < 0).any(), "and some are backward"
    kernel.run(inputs)
    assert StatusBit.ENCODER_JUMP not in kernel.status
    found = find_ranges(config, envelope)
    (counter,) = (one for one in found if one.intermediate.field == "encoder.counter_bits")
    (position,) = (one for one in found if one.intermediate.word == "position")
    assert counter.verdict == "overflows"
    assert counter.intermediate.least_word_bits == 9
    assert position.verdict != "impossible"
    told = r"^.*robot\.toml:2: encoder\.counter_bits = 8: .* expected at least 9, less "
    with pytest.raises(HarnessError, match=told):
        proved_mission(robot, config, rounding_ticks)
    with pytest.raises(HarnessError, match=told):
        run(RunConfig(scenario=scenario("straight"), robot=robot, duration_s=0.1))
    file.write_text(SPINNING.replace("counter_bits = 8", "counter_bits = 9"))
    wider = load_robot(file)
    config = kernel_config(wider, None, None)
    found = find_ranges(config, envelope_of(wider, config, rounding_ticks=rounding_ticks))
    assert {one.verdict for one in found} == {"impossible"}


FOREIGN = Path(__file__).parents[2] / "examples" / "foreign_dbc"


def in_steps_of(way_mm: int, folder: Path) -> tuple[Path, Path]:
    """Write a bus on which a wheel's way stands in such steps; return DBC and map."""
    text = (FOREIGN / "vehicle.dbc").read_text()
    for name in ("LeftPulses : 7", "RightPulses : 23"):
        before = f'{name}|16@0+ (1,0) [0|65535] "pulses"'
        assert before in text
        text = text.replace(before, f'{name}|16@0+ ({way_mm},0) [0|{65535 * way_mm}] "mm"')
    (folder / "vehicle.dbc").write_text(text)
    (folder / "map.toml").write_text((FOREIGN / "map.toml").read_text())
    return folder / "vehicle.dbc", folder / "map.toml"


def test_a_wheel_whose_signal_has_steps_of_a_centimetre_trembles_by_those(tmp_path: Path) -> None:
    """A reading ahead by the step of the signal facing one way, back facing the other."""
    bus = in_steps_of(10, tmp_path)
    config, envelope, said = described(
        tmp_path,
        "[encoder]\nnoise_ticks = 0.0\n[firmware.position]\nword_bits = 22\nfrac_bits = 20\n"
        "[design]\nmission_s = 600.0\ndistance_m = 0.5\nturn_rate_rad_s = 1.0\n",
        bus,
    )
    plant, wheel = load_robot(tmp_path / "robot.toml").plant, load_wire(*bus).signal_map
    readings = over_the_bus(wheel["left_count"], plant, np.arange(140))
    edge = int(np.flatnonzero(np.diff(readings))[0])
    assert np.diff(readings)[edge] > 60
    ticks = np.arange(envelope.mission_ticks)
    code = envelope.code_high - 300
    known = config.constants
    rate_rad_s = (code - known.gyro_zero_rate_code) * known.gyro_sensitivity_rad_s_per_lsb
    turn_rad = rate_rad_s * known.tick_period_s
    is_ahead = np.cos(turn_rad * ticks) >= 0
    inputs = np.full((ticks.size, 5), [0, 0, FRESH, code, FRESH], dtype=np.int64)
    inputs[:, 0] = inputs[:, 1] = np.where(is_ahead, readings[edge + 1], readings[edge])
    require_no_less_is_said(config, said, inputs)


def test_a_gyro_that_turns_at_once_overflows_and_no_less_is_said(tmp_path: Path) -> None:
    """A wheel's acceleration does not hold back what the gyro reads: it reads any believed code."""
    file = tmp_path / "robot.toml"
    file.write_text(
        '[firmware]\nmode = "gyro"\n[firmware.step]\nfrac_bits = 4\n'
        "[firmware.position]\nword_bits = 13\nfrac_bits = 9\n[encoder]\nnoise_ticks = 0.0\n"
        "[drive]\nmax_wheel_acceleration_rad_s2 = 1.0\n"
        "[design]\nmission_s = 90.0\nspeed_m_s = 0.2\ndistance_m = 0.5\n"
    )
    robot = load_robot(file)
    config = kernel_config(robot, None, None, force=True)
    (found,) = (
        one
        for one in find_ranges(config, envelope_of(robot, config))
        if one.verdict != "impossible"
    )
    assert (found.intermediate.word, found.verdict) == ("position", "overflows")


def test_a_word_that_no_drive_of_the_mission_fills_is_filled_by_a_longer_one(
    tmp_path: Path,
) -> None:
    """The mission's way is less than a step: neither it nor twice of it has any."""
    file = tmp_path / "robot.toml"
    file.write_text(
        '[firmware]\nmode = "wheel"\n[firmware.step]\nfrac_bits = 4\n'
        "[firmware.position]\nword_bits = 18\nfrac_bits = 20\n[encoder]\nnoise_ticks = 0.0\n"
        "[design]\nmission_s = 20.0\nspeed_m_s = 0.001\ndistance_m = 0.05\n"
    )
    robot = load_robot(file)
    config = kernel_config(robot, None, None, force=True)
    envelope = envelope_of(robot, config)
    (found,) = (one for one in find_ranges(config, envelope) if one.verdict != "impossible")
    assert found.verdict == "overflows later"
    assert found.drive is not None
    kernel = Kernel(config)
    for chunk in drive_chunks(found.drive):
        kernel.run(chunk)
    assert kernel.overflow_count == 1
    assert found.tick is not None
    assert found.tick > envelope.mission_ticks
