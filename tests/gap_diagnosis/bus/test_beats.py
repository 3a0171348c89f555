"""Which frames of a message without a counter were lost, the beat of its stamps tells."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from gap_diagnosis.bus import BusBlock, bus_block
from gap_diagnosis.bus.beats import beats_of
from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.cycle_times import wire_of_log
from hil_harness.robot import load_robot

ROBOT = load_robot()
DURATION_S = 120.0
WHEELS_S, YAW_S = 0.02, 0.01
DBC = """VERSION ""
BU_: A B
BO_ 288 WHEELS: 4 A
 SG_ left : 0|16@1+ (0.01,0) [0|300] "km/h" B
 SG_ right : 16|16@1+ (0.01,0) [0|300] "km/h" B
BO_ 289 YAW: 2 A
 SG_ rate : 0|16@1- (0.01,0) [-300|300] "deg/s" B
"""
MAP = """[signals]
left_count = "WHEELS.left"
right_count = "WHEELS.right"
gyro = "YAW.rate"
"""

Floats = NDArray[np.float64]


def as_sent(cycle_s: float, *, rate: float = 1.0) -> Floats:
    return np.arange(0.0, DURATION_S, cycle_s) * rate


def bus_of(folder: Path, wheels_s: Floats, yaw_s: Floats) -> BusBlock:
    """The bus of a car in bends, whose frames without counters came at these times."""
    random = np.random.default_rng(0)
    lines = []
    for stamp_s in wheels_s:
        speed = 3000 + 200 * np.sin(stamp_s / 3) + random.normal(0, 2, 2)
        lines.append((stamp_s, f"120#{np.rint(speed).astype(np.uint16).tobytes().hex()}"))
    for stamp_s in yaw_s:
        rate = np.array(300 * np.sin(stamp_s / 5) + random.normal(0, 2))
        lines.append((stamp_s, f"121#{np.rint(rate).astype(np.int16).tobytes().hex()}"))
    log = folder / "car.log"
    log.write_text("".join(f"({stamp_s:.6f}) can0 {said}\n" for stamp_s, said in sorted(lines)))
    (folder / "car.dbc").write_text(DBC)
    (folder / "map.toml").write_text(MAP)
    wire = wire_of_log(log, ROBOT, folder / "car.dbc", folder / "map.toml")
    block = bus_block(read_recording(log, robot=ROBOT, wire=wire), ROBOT, wire)
    assert block is not None
    return block


def evidence(block: BusBlock, effect: str) -> float:
    return block.fit(frozenset({effect})).log_evidence


def held_up(stamp_s: Floats, random: np.random.Generator, share: float, late_s: float) -> Floats:
    """Return stamps of which a share came as much later, each before the next but one."""
    return stamp_s + late_s * (random.random(len(stamp_s)) < share)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("jitter_s", [1e-4, 2e-3, 8e-3])
def test_a_bus_that_loses_nothing_speaks_for_no_loss(
    seed: int, jitter_s: float, tmp_path: Path
) -> None:
    random = np.random.default_rng(seed)
    wheels_s, yaw_s = (
        sent_s + random.uniform(0, min(jitter_s, 0.4 * cycle_s), len(sent_s))
        for cycle_s in (WHEELS_S, YAW_S)
        for sent_s in [as_sent(cycle_s, rate=1 + random.uniform(-0.003, 0.003))]
    )
    block = bus_of(tmp_path, wheels_s, yaw_s)
    assert {"frame_loss", "bus_gap"} <= block.effects
    speaks = {one: evidence(block, one) for one in block.effects - {"clock_skew"}}
    assert max(speaks.values()) <= 0.0, speaks


@pytest.mark.parametrize("seed", range(4))
def test_lost_frames_are_told_with_their_message_and_how_often(seed: int, tmp_path: Path) -> None:
    random = np.random.default_rng(seed)
    wheels_s, yaw_s = as_sent(WHEELS_S), as_sent(YAW_S, rate=1.002)
    came = random.random(len(yaw_s)) > 0.01
    lost = int(np.count_nonzero(~came[1:-1]))
    yaw_s = yaw_s[came] + random.uniform(0, 2e-3, int(came.sum()))
    fit = bus_of(tmp_path, wheels_s, yaw_s).fit(frozenset({"frame_loss"}))
    assert fit.log_evidence > 20
    assert fit.parameters["frame_loss.frame"].value == "YAW"
    assert fit.parameters["frame_loss.probability"].value == pytest.approx(
        lost / len(came), rel=3 / np.sqrt(lost)
    )


@pytest.mark.parametrize("seed", range(4))
def test_frames_that_were_held_up_are_not_lost(seed: int, tmp_path: Path) -> None:
    """By nearly two cycles, one in two hundred: each leaves a long interval and a short one."""
    random = np.random.default_rng(seed)
    yaw_s = held_up(as_sent(YAW_S), random, 1 / 200, 1.8 * YAW_S)
    block = bus_of(tmp_path, as_sent(WHEELS_S), yaw_s)
    assert evidence(block, "frame_loss") <= 0.0


def test_a_silence_of_all_sensors_is_told_with_its_window(tmp_path: Path) -> None:
    wheels_s, yaw_s = (
        sent_s[(sent_s < 40.001) | (sent_s > 40.499)]
        for sent_s in (as_sent(WHEELS_S), as_sent(YAW_S))
    )
    block = bus_of(tmp_path, wheels_s, yaw_s)
    assert evidence(block, "bus_gap") > max(4.0, evidence(block, "frame_loss"))
    ((start_s, stop_s),) = block.fit(frozenset({"bus_gap"})).windows
    assert (start_s, stop_s) == pytest.approx((40.0, 40.5), abs=1e-3)


@pytest.mark.parametrize("spread", [0.35, 1.0])
def test_a_message_that_keeps_no_beat_tells_no_loss(spread: float, tmp_path: Path) -> None:
    """Sent on events, or stamped by a program that was busy: an interval of two says nothing."""
    random = np.random.default_rng(0)
    wheels_s, yaw_s = (
        np.cumsum(cycle_s * random.uniform(1 - spread, 1 + spread, round(DURATION_S / cycle_s)))
        for cycle_s in (WHEELS_S, YAW_S)
    )
    assert not {"frame_loss", "bus_gap"} & bus_of(tmp_path, wheels_s, yaw_s).effects


@pytest.mark.parametrize("cycle_s", [0.012, 0.0125, 0.0143, 0.01002])
def test_a_cycle_that_stamps_or_the_sender_round_tells_no_loss(
    cycle_s: float, tmp_path: Path
) -> None:
    """What is due every 12 ms leaves out each sixth beat of 10 ms: lost frames at 6500 nats."""
    yaw_s = np.ceil(as_sent(cycle_s) / 0.01) * 0.01
    block = bus_of(tmp_path, as_sent(WHEELS_S), yaw_s)
    assert evidence(block, "frame_loss") <= 0.0


def test_a_message_that_comes_in_bursts_tells_no_loss(tmp_path: Path) -> None:
    """Two frames right after one another: all cycles from them to the next two were lost."""
    yaw_s = (as_sent(WHEELS_S)[:, np.newaxis] + np.array([0.0, 2.5e-4])).ravel()
    block = bus_of(tmp_path, as_sent(WHEELS_S), yaw_s)
    assert evidence(block, "frame_loss") <= 0.0


def cycles(stamp_s: Sequence[float], cycle_s: float) -> list[int] | None:
    found = beats_of(np.array(stamp_s), np.zeros(len(stamp_s), dtype=np.bool_), cycle_s)
    return None if found is None else found.tick.tolist()


def test_a_clock_that_is_off_moves_no_frame_to_another_cycle() -> None:
    """After a hundred cycles half a percent is half a cycle: rounding lost one and doubled one."""
    stamps_s = [0.02 * 1.005 * k for k in range(1000)]
    assert cycles(stamps_s, 0.02) == list(range(1000))


def test_a_description_of_another_cycle_is_not_believed() -> None:
    stamps_s = [0.02 * k for k in range(200)]
    assert cycles(stamps_s, 0.1) == list(range(200))


def test_frames_that_come_all_at_once_have_no_cycle() -> None:
    assert cycles([0.0] * 40, 0.0) is None
