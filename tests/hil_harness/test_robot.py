"""The robot is described in one file, and whatever is wrong in it is said with its line."""

import math
import re
import tomllib
from pathlib import Path

import pytest
from pydantic import BaseModel

from can_bus import load_database
from firmware_model import FirmwareDescription, build_config
from hil_harness.errors import HarnessError
from hil_harness.nodes.firmware import firmware_config
from hil_harness.robot import (
    RobotFile,
    Tolerance,
    default_robot_text,
    load_robot,
    robot_schema,
)
from hil_harness.signal_map import default_map
from sim_plant import PlantDescription

TICK_US = 10_000


def write(folder: Path, text: str) -> Path:
    file = folder / "robot.toml"
    file.write_text(text, encoding="utf-8")
    return file


def fields_by_table(model: type[BaseModel], table: str = "") -> dict[str, set[str]]:
    """Return the plain fields of each table of a model."""
    tables: dict[str, set[str]] = {table: set()}
    for name, field in model.model_fields.items():
        key = field.alias or name
        if isinstance(field.annotation, type) and issubclass(field.annotation, BaseModel):
            tables |= fields_by_table(field.annotation, f"{table}.{key}".lstrip("."))
        else:
            tables[table].add(key)
    return tables


def keys_in_text(text: str) -> dict[str, set[str]]:
    """Return the keys of each table of a TOML text, those in comments (``# key = value``) too."""
    tables: dict[str, set[str]] = {"": set()}
    table = ""
    for line in text.splitlines():
        if header := re.match(r"\[([\w.]+)\]", line):
            table = header[1]
            tables[table] = set()
        elif key := re.match(r"(?:# )?(\w+) = ", line):
            tables[table].add(key[1])
    return tables


def test_the_shipped_robot_is_the_lessons_as_its_odometry_describes_it() -> None:
    robot = load_robot()
    assert robot.plant.wheels.radius_m == pytest.approx(1.005 * 0.05, rel=1e-15)
    assert robot.plant.wheels.wheelbase_m == pytest.approx(0.995 * 0.30, rel=1e-15)
    assert robot.plant.encoder.ticks_per_rev == 2048
    assert (robot.name, robot.source) == ("lesson", None)


def test_the_shipped_file_says_what_is_assumed_where_a_line_is_left_out(tmp_path: Path) -> None:
    robot = load_robot()
    assert robot.plant == PlantDescription()
    assert robot.firmware == FirmwareDescription()
    assert robot.tolerance == Tolerance()
    empty = load_robot(write(tmp_path, ""))
    assert (empty.plant, empty.firmware, empty.tolerance) == (
        robot.plant,
        robot.firmware,
        robot.tolerance,
    )


def test_the_shipped_file_mentions_every_field_and_no_other() -> None:
    mentioned = {table: keys for table, keys in keys_in_text(default_robot_text()).items() if keys}
    known = {table: keys for table, keys in fields_by_table(RobotFile).items() if keys}
    assert mentioned == known


def test_every_line_of_the_shipped_file_can_be_switched_on_as_it_stands(tmp_path: Path) -> None:
    text = re.sub(r"^# (\w+ = )", r"\1", default_robot_text(), flags=re.MULTILINE)
    robot = load_robot(write(tmp_path, text))
    assert robot.firmware.step.constant_frac_bits == 44


def test_a_copy_of_the_shipped_file_is_the_shipped_robot(tmp_path: Path) -> None:
    copy = load_robot(write(tmp_path, default_robot_text()))
    assert (copy.plant, copy.firmware) == (load_robot().plant, load_robot().firmware)
    assert copy.source is not None
    assert copy.source.path == tmp_path / "robot.toml"


def test_tolerances_are_those_of_the_design() -> None:
    tolerance = Tolerance()
    assert (tolerance.radius_scale, tolerance.radius_mismatch) == (0.002, 0.0005)
    assert (tolerance.wheelbase_scale, tolerance.gyro_scale) == (0.003, 0.003)
    assert tolerance.gyro_bias_rad_s == pytest.approx(math.radians(0.02), rel=1e-4)
    assert tolerance.time_offset_s == 0.002


def test_what_plant_and_firmware_share_is_written_once(tmp_path: Path) -> None:
    text = (
        "[wheels]\nradius_m = 0.1\nwheelbase_m = 0.5\n[encoder]\nticks_per_rev = 1000\n"
        "[gyro]\nsensitivity_lsb_per_rad_s = 1000.0\nzero_rate_code = 30000\nrange_rad_s = 5.0\n"
    )
    robot = load_robot(write(tmp_path, text))
    constants = robot.firmware_constants(TICK_US)
    assert (constants.wheel_radius_m, constants.wheelbase_m) == (0.1, 0.5)
    assert (constants.ticks_per_rev, constants.counter_bits) == (1000, 16)
    assert constants.gyro_sensitivity_rad_s_per_lsb == 0.001
    assert constants.gyro_zero_rate_code == 30000
    assert (constants.gyro_min_code, constants.gyro_max_code) == (25000, 35000)
    assert constants.tick_period_s == 0.01
    assert constants.max_wheel_rate_rad_s == robot.plant.drive.max_wheel_rate_rad_s


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            '\n[encoder]\nticks_per_rev = "2048 ticks"',
            'robot.toml:3: encoder.ticks_per_rev = "2048 ticks": '
            "expected a whole number from 1 to 10000000, for example 2048",
        ),
        (
            "[wheel]\nradius_m = 0.05",
            "robot.toml:1: wheel: unknown key: the nearest is wheels",
        ),
        (
            "[wheels]\nradius = 0.05",
            "robot.toml:2: wheels.radius: unknown key: the nearest is radius_m",
        ),
        (
            "[wheels]\nradius_m = -0.05",
            "robot.toml:2: wheels.radius_m = -0.05: "
            "expected a number from 0.001 to 10, for example 0.05025",
        ),
        (
            "[wheels]\nradius_m = nan",
            "robot.toml:2: wheels.radius_m = nan: "
            "expected a number from 0.001 to 10, for example 0.05025",
        ),
        (
            '[firmware]\nmode = "giro"',
            'robot.toml:2: firmware.mode = "giro": expected one of "wheel", "gyro", "blend"',
        ),
        (
            '[firmware.position]\nrounding = "up"',
            'robot.toml:2: firmware.position.rounding = "up": '
            'expected one of "floor", "half_up", "half_even", "toward_zero"',
        ),
        (
            "[firmware.trig]\nentries = 1000",
            "robot.toml:2: firmware.trig.entries = 1000: "
            "expected a power of two, for example 512 or 1024",
        ),
        (
            "[firmware.position]\nword_bits = 129",
            "robot.toml:2: firmware.position.word_bits = 129: expected a whole number from 8 to "
            "128, for example 64",
        ),
        (
            "[tolerance]\nradius_scale = 0",
            "robot.toml:2: tolerance.radius_scale = 0: "
            "expected a number above 0 and of at most 1, for example 0.002",
        ),
        ("schema = 2", "robot.toml:1: schema = 2: expected 1"),
        ("[robot]\nname = ''", 'robot.toml:2: robot.name = "": expected text of '),
        (
            "[adc]\nbits = 12",
            "robot.toml:2: gyro.zero_rate_code = 32768: expected at most 4095, "
            "the largest code of adc.bits = 12",
        ),
        (
            "[gyro]\nrange_rad_s = 1e-5",
            "robot.toml:2: gyro.range_rad_s = 1e-05: 0.075 LSB: expected a range of at least one "
            "code of gyro.sensitivity_lsb_per_rad_s",
        ),
        ("[encoder\n", "robot.toml:1: not a TOML file: "),
    ],
)
def test_a_mistake_is_said_with_its_line_and_what_would_be_right(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(HarnessError) as caught:
        load_robot(write(tmp_path, text))
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_problems_of_both_packages_are_reported_together(tmp_path: Path) -> None:
    text = "[firmware]\nmode = 1\n[wheels]\nradius_m = 'x'\n[encoder]\nbits = 3\n"
    with pytest.raises(HarnessError) as caught:
        load_robot(write(tmp_path, text))
    assert [line.split(":")[1] for line in caught.value.problems] == ["2", "4", "6"]


def test_a_fine_encoder_that_is_added_up_in_32_bits_can_be_described(tmp_path: Path) -> None:
    """A Husky's has 78,000 counts a metre; the firmware's formats hold it at its tick."""
    file = write(
        tmp_path,
        "[wheels]\nradius_m = 0.1651\nwheelbase_m = 0.555\n"
        "[encoder]\nticks_per_rev = 80914\ncounter_bits = 32\n"
        "[drive]\nmax_wheel_rate_rad_s = 12\n",
    )
    robot = load_robot(file)
    known = robot.firmware_constants(20_000)
    assert (known.ticks_per_rev, known.counter_bits) == (80914, 32)
    assert build_config(robot.firmware, known).counter_bits == 32


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("ticks_per_rev = 10000001", "10000001: expected a whole number from 1 to 10000000"),
        ("counter_bits = 33", "33: expected a whole number from 8 to 32"),
    ],
)
def test_what_the_firmware_could_not_hold_is_refused(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(HarnessError, match=message):
        load_robot(write(tmp_path, f"[encoder]\n{text}\n"))


def test_a_wheel_too_fast_for_its_counter_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path, "[encoder]\ncounter_bits = 8\nticks_per_rev = 65535\n")
    robot = load_robot(file)
    with pytest.raises(HarnessError) as caught:
        robot.firmware_constants(TICK_US)
    assert str(caught.value) == (
        "robot.toml:2: at drive.max_wheel_rate_rad_s = 30 a wheel makes 3129 ticks in 10000 µs, "
        "and 8 bits tell directions apart below 128: expected more encoder.counter_bits, fewer "
        "encoder.ticks_per_rev or a slower drive"
    )


@pytest.mark.parametrize(
    ("text", "where"),
    [
        ("[wheels]\nradius_m = 0.1\n[firmware.step]\nword_bits = 16\nfrac_bits = 20\n", ":5: "),
        ("[encoder]\ncounter_bits = 8\n[drive]\nmax_wheel_rate_rad_s = 36\n", ":4: "),
        ("[firmware.position]\nword_bits = 16\n", ":2: "),
    ],
)
def test_formats_that_do_not_fit_together_are_said_with_the_line_of_one_of_them(
    tmp_path: Path, text: str, where: str
) -> None:
    with pytest.raises(HarnessError) as caught:
        firmware_config(load_robot(write(tmp_path, text)), default_map(load_database()), TICK_US)
    assert str(caught.value).startswith(f"robot.toml{where}")


def test_the_schema_names_every_table() -> None:
    schema = robot_schema()
    shipped = tomllib.loads(default_robot_text())
    assert set(schema["properties"]) == set(shipped)
    assert schema["additionalProperties"] is False
