"""What a proposed map says of clocks, of a gyro's angle, and of signs that it turns round."""

from pathlib import Path

import numpy as np
import pytest
from drives import ROBOT, Drive, drive

from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.left_out import left_out
from gap_diagnosis.reading.map_text import propose_map

TURNING = drive(900)
TURN = TURNING.columns["right_ticks"] - TURNING.columns["left_ticks"]
TURNING.columns["gyro_code"] = np.rint(32_768 + 40 * np.gradient(TURN))
MS = np.rint(1000 * TURNING.columns["t_s"])


def table(folder: Path, **columns: np.ndarray) -> Path:
    kept = {name: value for name, value in TURNING.columns.items() if name != "t_s"}
    return Drive({**columns, **kept}).write(folder / "foreign.csv")


@pytest.mark.parametrize(
    ("name", "per_ms", "unit"),
    [
        ("mcu_ms", 1, "ms"),
        ("timestamp_ns", 1e6, "ns"),
        ("time_us", 1e3, "us"),
        ("millis", 1, "ms"),
        ("log [us]", 1e3, "us"),
        ("elapsed (s)", 1e-3, "s"),
    ],
)
def test_a_clock_is_found_by_the_unit_in_its_name(
    name: str, per_ms: float, unit: str, tmp_path: Path
) -> None:
    path = table(tmp_path, **{name: MS * per_ms})
    text = propose_map(path, None)[2]
    assert f'time = {{ column = "{name}", unit = "{unit}" }}  # GUESS' in text
    (tmp_path / "map.toml").write_text(text)
    found = read_recording(path, robot=ROBOT, signals=tmp_path / "map.toml")
    assert found.tick_period_s == pytest.approx(0.01)


@pytest.mark.parametrize("wrap", [None, 4096.0])
def test_a_controllers_clock_beside_the_logs_is_the_ecus(
    wrap: float | None, tmp_path: Path
) -> None:
    mcu_ms = MS if wrap is None else MS % wrap
    path = table(tmp_path, mcu_ms=mcu_ms, stamp=1.7e9 + MS / 1e3)
    text = propose_map(path, None)[2]
    assert 'time = { column = "stamp", unit = "s" }' in text
    assert 'ecu_time = { column = "mcu_ms", unit = "ms"' in text
    (tmp_path / "map.toml").write_text(text)
    found = read_recording(path, robot=ROBOT, signals=tmp_path / "map.toml")
    assert np.isfinite(found.clock_skew_sd)


@pytest.mark.parametrize("name", ["left_m_s", "yaw_rad_s", "cmd_v_mps", "rate_deg_sec"])
def test_a_speeds_unit_is_no_time(name: str, tmp_path: Path) -> None:
    path = table(tmp_path, **{name: MS, "t": MS / 1e3})
    assert f'time = {{ column = "{name}"' not in propose_map(path, None)[2]


@pytest.mark.parametrize("name", ["imu_heading_deg", "gyro_angle [rad]", "IMU yaw (deg)"])
def test_a_gyros_angle_that_is_left_out_is_told(name: str, tmp_path: Path) -> None:
    columns = {"t_s": TURNING.columns["t_s"], name: TURN / 100}
    kept = {side: TURNING.columns[side] for side in ("left_ticks", "right_ticks")}
    path = Drive({**columns, **kept}).write(tmp_path / "foreign.csv")
    found, guesses, text = propose_map(path, None)
    assert "gyro" not in guesses
    (sentence,) = left_out(found, guesses, is_table=True).values()
    assert sentence.startswith(f"{name} is left out: it is an angle")
    assert f"# {sentence}" in text
    with_gyro = table(tmp_path, **columns)
    found, guesses, _ = propose_map(with_gyro, None)
    assert left_out(found, guesses, is_table=True) == {}


def test_a_sign_that_the_map_turns_round_is_told_with_its_reason(tmp_path: Path) -> None:
    kept = {name: value for name, value in TURNING.columns.items() if name != "gyro_code"}
    path = Drive({**kept, "yaw_rate_rad_s": -np.gradient(TURN)}).write(tmp_path / "foreign.csv")
    text = propose_map(path, None)[2]
    (line,) = [one for one in text.splitlines() if one.startswith("gyro")]
    assert "invert = true" in line
    assert "turns against the wheels (-0." in line
    assert line.endswith("so it is inverted here")


@pytest.mark.parametrize("swapped", [False, True])
def test_a_gyro_that_agrees_with_the_command_is_not_turned_round_for_swapped_wheels(
    swapped: bool, tmp_path: Path
) -> None:
    """The map made the gyro fit the wheels, and the commands were then blamed for both."""
    columns = dict(TURNING.columns)
    columns["w_command_rad_s"] = np.gradient(TURN) * (1 if swapped else -1)
    columns["yaw_rate_rad_s"] = np.gradient(TURN)
    del columns["gyro_code"]
    wheels = ("right_ticks", "left_ticks") if swapped else ("left_ticks", "right_ticks")
    names = {"left_ticks": wheels[0], "right_ticks": wheels[1]}
    gyro = propose_map(Drive(columns).write(tmp_path / "foreign.csv", names), None)[1]["gyro"]
    assert not gyro.invert
    told = "turns against the wheels, and so does the command (-0."
    assert gyro.reasons[-1].startswith(told) == swapped
