"""A car as its owner would log it: wheel speeds in km/h, yaw rate in deg/s, a clock of its own."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.left_out import left_out
from gap_diagnosis.reading.map_text import propose_map, signals_of
from gap_diagnosis.reading.propose import propose
from gap_diagnosis.reading.signal_names import words_of
from gap_diagnosis.reading.signals_found import FoundSignal
from hil_harness.robot import load_robot

NAMES = "timestamp_ms;WSS_RearLeft_kmh;WSS_RearRight_kmh;ESP_YawRate_deg_s;LatAccel_m_s2"
ROBOT = """
[wheels]
radius_m = 0.31
wheelbase_m = 1.55
[encoder]
ticks_per_rev = 96
[drive]
max_wheel_rate_rad_s = 150.0
[gyro]
range_rad_s = 2.0
"""
RATE_HZ = 50
SECONDS = 60
TRACK_M = 1.55


def car(folder: Path, names: str = NAMES) -> Path:
    """Write a table of speeds in steps of 0.03 km/h at uneven stamps, with a gap."""
    draw = np.random.default_rng(1)
    time_s = np.arange(RATE_HZ * SECONDS) / RATE_HZ
    speed = 10 + 4 * np.sin(time_s / 7)
    turn = 0.3 * np.sin(time_s / 3)
    sides = [np.round(3.6 * (speed + s * turn * TRACK_M / 2) / 0.03) * 0.03 for s in (-1, 1)]
    stamp_ms = 1.7e12 + 1e3 * time_s + np.abs(draw.normal(0, 1.5, len(time_s)))
    lines = [names]
    for k in range(len(time_s)):
        if not 1000 <= k < 1020:
            lines.append(
                f"{stamp_ms[k]:.1f};{sides[0][k]:.2f};{sides[1][k]:.2f};"
                f"{math.degrees(turn[k]):.3f};{speed[k] * turn[k]:.3f}"
            )
    table = folder / "car.csv"
    table.write_text("\n".join(lines) + "\n")
    return table


def test_a_cars_table_is_mapped_without_a_word_and_reads_as_it_drove(tmp_path: Path) -> None:
    table = car(tmp_path)
    _, guesses, text = propose_map(table, None)
    assert guesses["left_count"].unit == guesses["right_count"].unit == "km/h"
    assert "turns with the wheels (+1.00)" in guesses["gyro"].reasons
    assert guesses["accel_y"].signal.path == "LatAccel_m_s2"
    (tmp_path / "map.toml").write_text(text)
    (tmp_path / "robot.toml").write_text(ROBOT)
    robot = load_robot(tmp_path / "robot.toml")
    found = read_recording(table, robot=robot, signals=tmp_path / "map.toml")
    per_m = 96 / (math.tau * 0.31)
    metres = (found.left_ticks + found.right_ticks) / 2 / per_m
    assert metres[-1] == pytest.approx(10 * SECONDS + 28 * (1 - math.cos(SECONDS / 7)), rel=0.005)
    turned = (found.right_ticks - found.left_ticks) / per_m / TRACK_M
    assert turned[-1] == pytest.approx(0.9 * (1 - math.cos(SECONDS / 3)), abs=0.05)


@pytest.mark.parametrize(
    "names",
    [
        "t;WSpd_RL [km/h];WSpd_RR [km/h];yaw rate (deg/s);n",
        "time_ms;rl_kph;rr_kph;yawrate_dps;n",
        "t;wheel_rl_mph;wheel_rr_mph;yaw_rate_deg_sec;n",
        "Timestamp;wheel_hl_km_h;wheel_hr_km_h;yaw_deg_per_s;n",
    ],
)
def test_cars_spell_sides_and_units_in_many_ways(names: str, tmp_path: Path) -> None:
    _, guesses, _ = propose_map(car(tmp_path, names), None)
    columns = names.split(";")
    assert [guesses[role].signal.path for role in ("left_count", "right_count", "gyro")] == (
        columns[1:4]
    )


@pytest.mark.parametrize(
    "names",
    [
        "time_ms;wheel_rl_kmh;wheel_rr_kmh;wheel_fl_kmh;wheel_fr_kmh",
        "time_ms;WSS_RearLeft_kmh;WSS_RearRight_kmh;WSS_FrontLeft_kmh;WSS_FrontRight_kmh",
        "time_ms;left_back_wheel_mph;right_back_wheel_mph;left_wheel_mph;right_wheel_mph",
    ],
)
def test_of_four_wheels_the_rear_ones_are_guessed_as_front_ones_are_steered(
    names: str, tmp_path: Path
) -> None:
    _, guesses, text = propose_map(car(tmp_path, names), None)
    columns = names.split(";")
    assert [guesses[role].signal.path for role in ("left_count", "right_count")] == columns[1:3]
    assert "GUESS: name" in text
    assert text.count("the rear wheels, as the front ones may be steered") == 2


def test_wheels_of_one_side_are_not_chosen_from_by_a_coin(tmp_path: Path) -> None:
    names = "time_ms;wheel_fl_kmh;wheel_fr_kmh;yaw_deg_s;wheel_rl_kmh"
    with pytest.raises(DiagnosisError, match=r"wheel_fl_kmh as well as wheel_rl_kmh.*--is"):
        propose_map(car(tmp_path, names), None)


def test_wheels_without_a_unit_are_asked_for_it(tmp_path: Path) -> None:
    names = "time_ms;WHEEL_FL;WHEEL_FR;yaw_deg_s;n"
    with pytest.raises(DiagnosisError, match=r"WHEEL_FL has the name of a wheel, and no unit"):
        propose_map(car(tmp_path, names), None)


@pytest.mark.parametrize("name", ["Gierwinkel für odom [deg]", "Lenkwinkel f\ufffdr Rad [deg]"])
def test_a_letter_beside_an_umlaut_is_no_side_of_a_wheel(name: str, tmp_path: Path) -> None:
    names = f"time_ms;wheel_rl_kmh;wheel_rr_kmh;yaw_deg_s;{name}"
    found = signals_of(car(tmp_path, names), None)
    assert not {"r", "f"} & set(words_of(found[name]))
    assert propose(found, is_table=True)["right_count"].signal.path == "wheel_rr_kmh"


@pytest.mark.parametrize("name", ["STEER_ANGLE_deg", "LAT_ACCEL_m_s2"])
def test_what_does_not_turn_is_no_heading_and_sideways_is_not_ahead(
    name: str, tmp_path: Path
) -> None:
    names = f"time_ms;wheel_rl_kmh;wheel_rr_kmh;yaw_deg_s;{name}"
    _, guesses, _ = propose_map(car(tmp_path, names), None)
    assert not {"odom_heading", "accel_x"} & guesses.keys()


def bus_of(
    table: Path, yaw: str, yaw_unit: str, wheel_unit: str = "km/h"
) -> dict[str, FoundSignal]:
    """Return the signals of a bus that says what a car's table says."""
    names = {"WSS_RearLeft_kmh": "ABS.WHEEL_RL", "WSS_RearRight_kmh": "ABS.WHEEL_RR"}
    units = dict.fromkeys(names.values(), wheel_unit) | {yaw: yaw_unit}
    found = {}
    for column, signal in signals_of(table, None).items():
        path = names.get(column, yaw if "Yaw" in column else f"OTHER.{column}")
        found[path] = replace(signal, path=path, unit=units.get(path, ""))
    return found


@pytest.mark.parametrize("name", ["ESP.YawRate", "KINEMATICS.YAW_RATE", "IMU.gyro_z", "A.omega"])
def test_a_yaw_rate_that_is_left_out_for_its_unit_is_told_with_those_it_could_have(
    name: str, tmp_path: Path
) -> None:
    found = bus_of(car(tmp_path), name, "furlong/s")
    guesses = propose(found, is_table=False)
    assert "gyro" not in guesses
    assert left_out(found, guesses) == {
        name: f"{name} is left out: its unit, furlong/s, is not understood; as gyro one of none "
        "(adc_code), rad/s, mrad/s, deg/s, turn/s, rpm would be"
    }
    bare = bus_of(car(tmp_path), name, "")
    assert left_out(bare, propose(bare, is_table=False)) == {
        name: f"{name} is left out: the DBC gives it no unit; expected one in the map, as in "
        f'gyro = {{ signal = "{name}", unit = "deg/s" }}'
    }


@pytest.mark.parametrize("name", ["CMD.target_speed", "DRIVE.v_set"])
def test_a_commanded_speed_that_is_left_out_for_its_unit_is_told_too(
    name: str, tmp_path: Path
) -> None:
    found = bus_of(car(tmp_path), name, "furlong/s")
    (line,) = left_out(found, propose(found, is_table=False)).values()
    assert "as v_command one of m/s, cm/s, mm/s, km/h, mph would be" in line


@pytest.mark.parametrize(
    ("name", "unit"), [("ESP.YawRate", "deg/s"), ("ESP.YawAngle", "grad"), ("ESP.Torque", "Nm")]
)
def test_nothing_is_said_of_what_is_read_or_is_no_rate_by_its_name(
    name: str, unit: str, tmp_path: Path
) -> None:
    found = bus_of(car(tmp_path), name, unit)
    assert left_out(found, propose(found, is_table=False)) == {}


@pytest.mark.parametrize("name", ["YAW_LAT.YawRateSens", "LAT_DYN.yaw_rate", "Lateral.YAWRATE"])
def test_a_yaw_rate_is_found_in_a_message_that_is_named_after_what_is_lateral(
    name: str, tmp_path: Path
) -> None:
    found = bus_of(car(tmp_path), name, "deg/s")
    assert propose(found, is_table=False)["gyro"].signal.path == name
    unread = bus_of(car(tmp_path), name, "furlong/s")
    assert name in left_out(unread, propose(unread, is_table=False))


def test_an_axis_that_only_the_message_says_is_the_signals(tmp_path: Path) -> None:
    found = bus_of(car(tmp_path), "GYRO_X.rate", "deg/s")
    assert "gyro" not in propose(found, is_table=False)


def test_wheels_in_a_unit_that_is_not_understood_are_told_which_would_be(tmp_path: Path) -> None:
    found = bus_of(car(tmp_path), "ESP.YawRate", "deg/s", wheel_unit="furlong/s")
    with pytest.raises(DiagnosisError) as caught:
        propose(found, is_table=False)
    assert str(caught.value) == (
        "ABS.WHEEL_RL has the name of a wheel, and its unit, furlong/s, is not understood: "
        "expected none (counts), m, cm, mm, rad, mrad, deg, turn, m/s, cm/s, mm/s, km/h, mph, "
        "rad/s, mrad/s, deg/s, turn/s, rpm"
    )


def test_what_says_that_a_sensor_failed_is_not_the_sensor(tmp_path: Path) -> None:
    """A car's TEMP_ACC_FAULTED was its temperature."""
    names = NAMES.replace("LatAccel_m_s2", "TEMP_ACC_FAULTED")
    _, guesses, _ = propose_map(car(tmp_path, names), None)
    assert "temperature" not in guesses
    names = NAMES.replace("ESP_YawRate_deg_s", "ESP_YawRate_valid")
    _, guesses, _ = propose_map(car(tmp_path, names), None)
    assert "gyro" not in guesses
    names = NAMES.replace("LatAccel_m_s2", "imu_status_temperature_degc")
    _, guesses, _ = propose_map(car(tmp_path, names), None)
    assert guesses["temperature"].signal.path == "imu_status_temperature_degc"
