"""Logs of foreign buses: no counters, other kinds of wheels, an IMU with a rate of its own."""

import math
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest
from drives import ROBOT

from gap_diagnosis import diagnose as diagnosing
from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.granted import Granted
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.reading import read_recording
from gap_diagnosis.recording import Recording
from hil_harness import HarnessError, Robot
from hil_harness.assembly import load_wire
from hil_harness.effects import EffectSetting

HEAD = 'VERSION ""\nBU_: A B\n'
CYCLES = 'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;\nBA_DEF_DEF_ "GenMsgCycleTime" 0;\n'
COUNTS = (
    "BO_ 256 WHEELS: 8 A\n"
    ' SG_ left : 0|32@1+ (1,0) [0|4294967295] "pulses" B\n'
    ' SG_ right : 32|32@1+ (1,0) [0|4294967295] "pulses" B\n'
)
SPEEDS = (
    "BO_ 256 WHEELS: 8 A\n"
    ' SG_ left : 0|32@1- (0.000001,0) [-2000|2000] "m/s" B\n'
    ' SG_ right : 32|32@1- (0.000001,0) [-2000|2000] "m/s" B\n'
)
YAW = 'BO_ 257 YAW: 4 A\n SG_ rate : 0|32@1- (0.0001,0) [-200000|200000] "deg/s" B\n'


def read(
    folder: Path,
    wheels: str,
    cycles_ms: tuple[int, int] | None,
    lines: list[tuple[float, str]],
    robot: Robot = ROBOT,
    yaw_message: str = YAW,
) -> Recording:
    dbc = HEAD + wheels + yaw_message
    if cycles_ms is not None:
        dbc += CYCLES
        dbc += f'BA_ "GenMsgCycleTime" BO_ 256 {cycles_ms[0]};\n'
        dbc += f'BA_ "GenMsgCycleTime" BO_ 257 {cycles_ms[1]};\n'
    (folder / "mine.dbc").write_text(dbc)
    (folder / "map.toml").write_text(
        '[signals]\nleft_count = "WHEELS.left"\nright_count = "WHEELS.right"\ngyro = "YAW.rate"\n'
    )
    frames = [(stamp, *rest.partition("@")[::2]) for stamp, rest in sorted(lines)]
    text = "".join(f"({stamp:.6f}) {bus or 'can0'} {rest}\n" for stamp, rest, bus in frames)
    (folder / "bus.log").write_text(text)
    return read_recording(
        folder / "bus.log", robot=robot, dbc=folder / "mine.dbc", signals=folder / "map.toml"
    )


def wheels(left: int, right: int) -> str:
    data = left.to_bytes(4, "little", signed=left < 0) + right.to_bytes(
        4, "little", signed=right < 0
    )
    return f"100#{data.hex()}"


def yaw(rate: int) -> str:
    return f"101#{rate.to_bytes(4, 'little', signed=True).hex()}"


def test_a_late_gyro_of_a_foreign_bus_is_known_by_the_name_of_its_own_message(
    tmp_path: Path,
) -> None:
    """It was told as IMU's, and no effects file that said so could be read beside that DBC."""
    lines = [(1 + k * 0.02, wheels(40 * k, 30 * k)) for k in range(200)]
    lines += [(1.005 + k * 0.02, yaw(1000 * k)) for k in range(200)]
    recording = read(tmp_path, COUNTS, (20, 20), lines)
    assert recording.own_names == {"ENCODER": "WHEELS", "IMU": "YAW"}
    late = EffectSetting("frame_latency", (("frame", "YAW"), ("delay", 0.04)))
    motion = estimate_motion(replace(recording, granted=Granted((late,))), ROBOT)
    assert [one.report for one, _ in motion.granted] == [{"frame": "IMU"}]


def test_a_table_beside_logs_of_a_foreign_bus_speaks_of_that_buss_messages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both logs knew for sure which frame was late, and together it was either: YAW or IMU."""
    lines = [(1 + k * 0.02, wheels(40 * k, 30 * k)) for k in range(200)]
    lines += [(1.005 + k * 0.02, yaw(1000 * k)) for k in range(200)]
    log = read(tmp_path, COUNTS, (20, 20), lines)
    table = replace(log, frames={}, own_names={})
    seen: list[Recording] = []

    def asked(recording: Recording, *_: object, **__: object) -> NoReturn:
        seen.append(recording)
        raise DiagnosisError("enough")

    monkeypatch.setattr(diagnosing, "analyse", asked)
    wire = load_wire(tmp_path / "mine.dbc", tmp_path / "map.toml")
    with pytest.raises(DiagnosisError, match="enough"):
        diagnosing.diagnose_recordings([table, log], ROBOT, wire)
    assert seen[0].own_names == log.own_names


@pytest.mark.parametrize("says_cycles", [True, False])
def test_a_faster_imu_is_averaged_over_the_tick_and_a_slower_one_covers_its_ticks(
    says_cycles: bool, tmp_path: Path
) -> None:
    random = np.random.default_rng(0)
    ticks = [
        (1 + k * 0.02, wheels(4_294_967_000 + 40 * k & 0xFFFFFFFF, 30 * k)) for k in range(400)
    ]
    fine = [(1 + j * 0.005 + random.uniform(0, 0.001), yaw(1000 * j)) for j in range(1600)]
    found = read(tmp_path, COUNTS, (20, 5) if says_cycles else None, ticks + fine)
    assert np.array_equal(found.left_ticks, 40.0 * np.arange(400))
    # Row k covers samples 4k - 3 to 4k.
    want = np.radians((4 * np.arange(1, 400) - 1.5) * 0.1)
    assert found.gyro_rate_rad_s[1:] == pytest.approx(want, rel=1e-12)

    slow = [(1 + j * 0.04 + random.uniform(0, 0.001), yaw(1000 * j)) for j in range(200)]
    found = read(tmp_path, COUNTS, (20, 40) if says_cycles else None, ticks + slow)
    want = np.radians(np.repeat(np.arange(200), 2)[1:] * 0.1)
    assert found.gyro_rate_rad_s[: len(want)] == pytest.approx(np.append(want, np.nan)[: len(want)])


def test_a_counter_wider_than_any_description_can_say_is_no_news(tmp_path: Path) -> None:
    lines = [(1 + k * 0.02, wheels(70_000 + 40 * k, 30 * k)) for k in range(400)]
    assert read(tmp_path, COUNTS, (20, 20), lines).notes == ()


def test_a_dbc_without_cycle_times_says_no_tick_for_a_design_to_contradict(tmp_path: Path) -> None:
    """What the log shows is a few microseconds off, as its stamps are."""
    made_for_20_ms = replace(
        ROBOT, design=ROBOT.design.model_copy(update={"tick_period_us": 20000})
    )
    lines = [(1 + k * 0.020003, wheels(40 * k, 30 * k)) for k in range(400)]
    found = read(tmp_path, COUNTS, None, lines, robot=made_for_20_ms)
    assert found.tick_period_s == pytest.approx(0.020003)


def test_frames_without_counters_are_placed_by_their_stamps(tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    lost = {50, 51, 200}
    lines = [
        (1 + k * 0.02 * 1.001 + random.uniform(0, 0.008), wheels(40 * k, 30 * k))
        for k in range(400)
        if k not in lost
    ]
    found = read(tmp_path, COUNTS, (20, 20), lines)
    assert set(np.flatnonzero(np.isnan(found.left_ticks)).tolist()) == lost
    there = np.isfinite(found.left_ticks)
    assert np.array_equal(found.left_ticks[there], 40.0 * np.arange(400)[there])
    assert found.clock_skew == pytest.approx(1 / 1.001 - 1, abs=6 * found.clock_skew_sd)
    assert found.gyro_code is None


@pytest.mark.parametrize("cycle_ms", [15, 25])
def test_a_message_that_is_due_between_two_stamps_is_read(cycle_ms: int, tmp_path: Path) -> None:
    """Stamped by a clock of 10 ms it comes every 10 or 20 (refused: of a DBC that says no cycle, as
    one that says another)."""
    stamps_s = np.ceil(np.arange(800) * cycle_ms / 10) / 100
    lines = [(1 + at, wheels(40 * k, 30 * k)) for k, at in enumerate(stamps_s.tolist())]
    found = read(tmp_path, COUNTS, None, lines)
    assert found.tick_period_s == pytest.approx(cycle_ms / 1000, rel=1e-3)
    assert np.array_equal(found.left_ticks, 40.0 * np.arange(800))


def test_wheel_speeds_of_a_log_add_up(tmp_path: Path) -> None:
    seconds = np.arange(0, 8, 0.02)
    speed = 0.4 * np.sin(seconds)
    lines = [
        (1 + t, wheels(round(v * 1e6), round(v * 1e6)))
        for t, v in zip(seconds, speed.tolist(), strict=True)
    ]
    found = read(tmp_path, SPEEDS, (20, 20), lines)
    plant = ROBOT.plant
    metres = found.left_ticks / plant.encoder.ticks_per_rev * 2 * np.pi * plant.wheels.radius_m
    assert metres == pytest.approx(0.4 * (1 - np.cos(seconds)), abs=1e-4)


@pytest.mark.parametrize("says_cycles", [True, False])
def test_an_empty_log_is_told_as_one_whether_or_not_the_dbc_says_cycles(
    says_cycles: bool, tmp_path: Path
) -> None:
    """The DBC was blamed for what the log lacked: WHEELS has no GenMsgCycleTime."""
    cycles_ms = (20, 20) if says_cycles else None
    with pytest.raises(DiagnosisError, match=r"0 frames of WHEELS: .*; the log has no frames$"):
        read(tmp_path, COUNTS, cycles_ms, [])
    with pytest.raises(DiagnosisError, match=r"0 frames of WHEELS: .*; the log has YAW$"):
        read(tmp_path, COUNTS, cycles_ms, [(0.02 * k, yaw(k)) for k in range(400)])
    with pytest.raises(DiagnosisError, match="19 frames of WHEELS: expected at least 20"):
        read(tmp_path, COUNTS, cycles_ms, [(0.02 * k, wheels(k, k)) for k in range(19)])


@pytest.mark.parametrize("says_cycles", [True, False])
def test_twenty_frames_say_their_cycle(says_cycles: bool, tmp_path: Path) -> None:
    lines = [(0.2 * k, wheels(40 * k, 30 * k)) for k in range(20)]
    found = read(tmp_path, COUNTS, (200, 200) if says_cycles else None, lines)
    assert found.tick_period_s == pytest.approx(0.2)


@pytest.mark.parametrize("said", ["[0|9999999999]", "[0|2000]"])
def test_a_range_that_cannot_be_the_signals_refuses_no_frames(said: str, tmp_path: Path) -> None:
    """DBCs passed round for cars say [0|65535] of a yaw rate that turns both ways."""
    ticks = [(1 + k * 0.02, wheels(40 * k, 30 * k)) for k in range(400)]
    rates = [round(3000 * math.sin(k / 40)) for k in range(400)]
    lines = ticks + [(1.001 + k * 0.02, yaw(rate)) for k, rate in enumerate(rates)]
    narrow = YAW.replace("[-200000|200000]", said)
    found = read(tmp_path, COUNTS, (20, 20), lines, yaw_message=narrow)
    assert np.nanmin(found.gyro_rate_rad_s) == pytest.approx(math.radians(-0.3), rel=0.01)
    assert found.rejected["range"] == 0
    assert "range of YAW.rate cannot be right" in found.notes[0]


def test_an_error_code_outside_the_range_is_refused_however_often_it_comes(tmp_path: Path) -> None:
    ticks = [(1 + k * 0.02, wheels(40 * k, 30 * k)) for k in range(400)]
    rates = [100_000_000 if k < 100 else k for k in range(400)]
    lines = ticks + [(1.001 + k * 0.02, yaw(rate)) for k, rate in enumerate(rates)]
    found = read(tmp_path, COUNTS, (20, 20), lines, yaw_message=YAW.replace("200000]", "2000]"))
    assert found.rejected["range"] == 100
    assert found.notes == ()


def test_of_several_buses_a_message_is_read_from_one(tmp_path: Path) -> None:
    """A gateway repeats it 3 ms later, and elsewhere its identifier is another message."""
    ticks = [(1 + k * 0.02, wheels(40 * k, 30 * k)) for k in range(400)]
    rates = [(1.001 + k * 0.02, yaw(k)) for k in range(400)]
    plain = read(tmp_path, COUNTS, (20, 20), ticks + rates)
    copies = [(stamp + 0.003, f"{rest}@can2") for stamp, rest in ticks]
    others = [(1.002 + k * 0.005, f"{yaw(77)}@can1") for k in range(1600)]
    found = read(tmp_path, COUNTS, (20, 20), ticks + rates + copies + others)
    np.testing.assert_array_equal(found.left_ticks, plain.left_ticks)
    np.testing.assert_array_equal(found.gyro_rate_rad_s, plain.gyro_rate_rad_s)
    assert found.rejected["other_bus"] == 2000


OVERLAPS = """BO_ 258 GUESSED: 8 A
 SG_ a : 0|16@1+ (1,0) [0|0] "" B
 SG_ b : 8|16@1+ (1,0) [0|0] "" B
"""


def test_a_message_that_cannot_be_right_says_nothing_against_those_beside_it(
    tmp_path: Path,
) -> None:
    lines = [(1 + 0.02 * k, wheels(40 * k, 30 * k)) for k in range(400)]
    lines += [(1 + 0.02 * k, yaw(1000)) for k in range(400)]
    found = read(tmp_path, COUNTS, (20, 20), lines, yaw_message=YAW + OVERLAPS)
    assert found.left_ticks[-1] == 40 * 399
    (note,) = (one for one in found.notes if "cannot be right" in one)
    assert note.startswith("Not read, as it cannot be right: mine.dbc:8: GUESSED: The signals ")


def test_a_map_that_asks_for_it_is_refused(tmp_path: Path) -> None:
    told = (
        r'map.toml:2: left_count = "WHEELS.left": .*mine.dbc:3: WHEELS: The signals .* overlapping'
    )
    with pytest.raises(HarnessError, match=told):
        read(tmp_path, OVERLAPS.replace("258 GUESSED", "256 WHEELS"), None, [], yaw_message=YAW)
