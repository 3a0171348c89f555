"""The described robot: the lesson's by default, checked field by field."""

from typing import Any

import pytest
from pydantic import ValidationError

from sim_plant import PlantDescription, PlantError

WRONG: list[tuple[dict[str, Any], str]] = [
    (
        {"wheels": {"radius_m": -1}},
        "wheels.radius_m = -1: expected a number from 0.001 to 10, for example 0.05025",
    ),
    (
        {"encoder": {"ticks_per_rev": "2048 ticks"}},
        "encoder.ticks_per_rev = '2048 ticks': "
        "expected a whole number from 1 to 1e+07, for example 2048",
    ),
    (
        {"encoder": {"ticks_per_rev": 10**12}},
        "encoder.ticks_per_rev = 1000000000000: "
        "expected a whole number from 1 to 1e+07, for example 2048",
    ),
    (
        {"encoder": {"counter_bits": True}},
        "encoder.counter_bits = True: expected a whole number from 8 to 32, for example 16",
    ),
    (
        {"drive": {"delay_s": 1e9}},
        "drive.delay_s = 1000000000.0: expected a number from 0 to 1, for example 0",
    ),
    (
        {"wheels": {"wheelbase_m": float("nan")}},
        "wheels.wheelbase_m = nan: expected a number from 0.01 to 10, for example 0.2985",
    ),
    (
        {"gyro": {"range_rad_s": 0.0}},
        "gyro.range_rad_s = 0.0: expected a number above 0 up to 1000, for example 4.36332",
    ),
    (
        {"adc": {"bits": 12}},
        "gyro.zero_rate_code = 32768: expected at most 4095, the largest code of adc.bits = 12",
    ),
    (
        {"whee\nls": {}},
        r"'whee\nls': no such table; expected one of wheels, encoder, drive, contact, gyro, "
        "accelerometer, adc, temperature, supply",
    ),
    (
        {"wheels": {"radius": 0.05}},
        "'radius' in table wheels: no such field; expected one of radius_m, wheelbase_m",
    ),
    ({"wheels": 3}, "wheels = 3: expected a table with radius_m, wheelbase_m"),
]


@pytest.mark.parametrize(("tables", "message"), WRONG)
def test_a_wrong_description_is_answered_in_one_line_with_what_would_be_right(
    tables: dict[str, Any], message: str
) -> None:
    with pytest.raises(PlantError) as caught:
        PlantDescription.from_tables(tables)
    assert str(caught.value) == message


def test_the_default_robot_is_the_lessons_as_its_odometry_describes_it() -> None:
    robot = PlantDescription()
    assert robot.wheels.radius_m == pytest.approx(1.005 * 0.05, rel=1e-15)
    assert robot.wheels.wheelbase_m == pytest.approx(0.995 * 0.30, rel=1e-15)
    assert robot.encoder.ticks_per_rev == 2048
    assert robot.encoder.noise_ticks == 0.2
    # σ = 0.002 rad/s at 100 Hz
    assert robot.gyro.noise_density_rad_per_sqrt_s * 100**0.5 == pytest.approx(0.002, rel=1e-15)


def test_the_gyros_lsb_lies_far_below_its_noise() -> None:
    gyro = PlantDescription().gyro
    assert 1 / gyro.sensitivity_lsb_per_rad_s < 0.1 * gyro.noise_density_rad_per_sqrt_s / 0.1


def test_a_whole_number_in_the_file_serves_as_a_float() -> None:
    assert PlantDescription.from_tables({"wheels": {"radius_m": 1}}).wheels.radius_m == 1.0


def test_a_description_does_not_change() -> None:
    with pytest.raises(ValidationError):
        PlantDescription().wheels.radius_m = 1.0


@pytest.mark.parametrize(
    ("tables", "limits"),
    [
        ({}, (18, 65518)),  # ±250 °/s at 131 LSB per °/s: 32768 ± 32750
        ({"gyro": {"range_rad_s": 10.0}}, (0, 65535)),
        ({"gyro": {"zero_rate_code": 1000}}, (0, 33750)),
        ({"adc": {"bits": 12}, "gyro": {"zero_rate_code": 2048, "range_rad_s": 0.1}}, (1297, 2799)),
    ],
)
def test_the_gyros_code_limits_are_its_range_or_the_rails(
    tables: dict[str, Any], limits: tuple[int, int]
) -> None:
    middle = {"accelerometer": {"zero_code": 0}, "temperature": {"code_at_298_k": 0}}
    assert PlantDescription.from_tables(middle | tables).gyro_code_limits == limits
