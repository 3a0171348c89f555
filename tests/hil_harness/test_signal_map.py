"""A map says what the signals of a DBC are to the robot, and refuses what they cannot be."""

from pathlib import Path

import pytest
from foreign_bus import foreign_database, write_map

from can_bus import Database, load_database, shipped_path
from hil_harness.errors import HarnessError
from hil_harness.signal_map import REQUIRED, default_map, load_map
from hil_harness.signal_roles import QUANTITIES, RAW_KIND, ROLES, UNITS, unit_of

WHEELS = 'left_count = "WHEELS.Left"\nright_count = "WHEELS.Right"'


@pytest.fixture
def database(tmp_path: Path) -> Database:
    return foreign_database(tmp_path)


def test_the_shipped_dbc_fills_every_role() -> None:
    shipped = default_map(load_database())
    assert tuple(shipped.signals) == ROLES
    kinds = {role: mapped.kind for role, mapped in shipped.signals.items()}
    assert kinds == {role: RAW_KIND.get(role, "physical") for role in ROLES}


def test_a_faulty_message_of_the_wheels_is_not_a_missing_one(tmp_path: Path) -> None:
    text = shipped_path().read_text(encoding="utf-8")
    path = tmp_path / "mine.dbc"
    path.write_text(
        text.replace("SG_ right_count : 40|", "SG_ right_count : 30|"), encoding="utf-8"
    )
    database = load_database(path, leave_out_faulty=True)
    assert list(database.faulty) == ["ENCODER"]
    with pytest.raises(HarnessError, match=r"mine.dbc:\d+: ENCODER: The signals .* overlapping"):
        default_map(database)


def test_the_tick_period_is_the_cycle_time_of_the_wheels(tmp_path: Path) -> None:
    shipped = load_database()
    assert default_map(shipped).tick_period_us == shipped.message("ENCODER").cycle_time_us
    foreign = load_map(write_map(tmp_path, WHEELS), foreign_database(tmp_path))
    assert foreign.tick_period_us == 20_000


def test_wheels_without_a_cycle_time_set_no_tick(tmp_path: Path, database: Database) -> None:
    signals = 'left_count = "DECADE.Left"\nright_count = "DECADE.Right"'
    with pytest.raises(HarnessError, match="DECADE has no GenMsgCycleTime: expected one"):
        _ = load_map(write_map(tmp_path, signals), database).tick_period_us


def test_a_dbc_with_names_of_its_own_needs_a_map(database: Database) -> None:
    with pytest.raises(HarnessError) as caught:
        default_map(database)
    assert str(caught.value) == (
        "foreign.dbc has no ENCODER.left_count: a DBC with names of its own needs "
        "--signals map.toml, which says what its signals mean"
    )


def test_the_unit_of_the_dbc_says_what_kind_of_signal_it_is(
    tmp_path: Path, database: Database
) -> None:
    signals = f'{WHEELS}\ngyro = "YAW.Rate"\nodom_x = "POSITION.X"\nsupply = "BODY.Battery"'
    found = load_map(write_map(tmp_path, signals), database)
    assert found["left_count"].kind == "counts"
    assert (found["gyro"].kind, found["gyro"].quantity) == ("physical", "turn rate")
    assert found["gyro"].to_si(18000) == pytest.approx(3.141592653589793)
    assert found["odom_x"].to_si(12345) == pytest.approx(1.2345)
    assert found["odom_x"].to_raw(0.123449) == 1234
    assert found["supply"].to_si(12345) == pytest.approx(12.345)
    assert list(found.signals) == [role for role in ROLES if role in found.signals]


def test_temperatures_know_celsius(tmp_path: Path, database: Database) -> None:
    found = load_map(write_map(tmp_path, f'{WHEELS}\ntemperature = "BODY.Heat"'), database)
    assert found["temperature"].to_si(65) == pytest.approx(298.15)
    assert found["temperature"].to_raw(298.15) == 65


def test_a_signal_that_counts_the_other_way_is_turned_round(
    tmp_path: Path, database: Database
) -> None:
    signals = f'{WHEELS}\ngyro = {{ signal = "YAW.Rate", invert = true }}'
    found = load_map(write_map(tmp_path, signals), database)
    assert found["gyro"].to_si(18000) == pytest.approx(-3.141592653589793)
    assert found["gyro"].to_raw(-3.141592653589793) == 18000


def test_a_unit_may_be_given_where_the_dbc_gives_none(tmp_path: Path, database: Database) -> None:
    signals = f'{WHEELS}\ngyro = {{ signal = "YAW.Bare", unit = "rad/s" }}'
    found = load_map(write_map(tmp_path, signals), database)
    assert found["gyro"].to_si(1500) == pytest.approx(1.5)


def test_a_kind_may_be_given_where_the_unit_is_not_one_we_know(
    tmp_path: Path, database: Database
) -> None:
    signals = f'{WHEELS}\ngyro = {{ signal = "YAW.Odd", kind = "adc_code" }}'
    assert load_map(write_map(tmp_path, signals), database)["gyro"].kind == "adc_code"


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        (
            f'{WHEELS}\ngyro = "YAWW.Rate"',
            'map.toml:4: gyro = "YAWW.Rate": foreign.dbc has no such message: the nearest is YAW',
        ),
        (
            f'{WHEELS}\ngyro = "YAW.Rat"',
            'map.toml:4: gyro = "YAW.Rat": YAW has no such signal: the nearest is Rate',
        ),
        (
            f'{WHEELS}\ngyroscope = "YAW.Rate"',
            "map.toml:4: signals.gyroscope: no such role: the nearest is gyro",
        ),
        (
            'left_count = "WHEELS.Left"',
            "map.toml: right_count is missing: dead reckoning needs "
            'right_count = "MESSAGE.signal" under [signals]',
        ),
        (
            "",
            "map.toml: left_count, right_count are missing: dead reckoning needs ",
        ),
        (
            f'{WHEELS}\ngyro = "POSITION.X"',
            "map.toml:4: gyro: POSITION.X has unit mm: "
            "expected none (adc_code), rad/s, mrad/s, deg/s, turn/s, rpm",
        ),
        (
            f'{WHEELS}\nodom_x = "WHEELS.Left"',
            "map.toml:4: odom_x = WHEELS.Left: already mapped as left_count",
        ),
        (
            f'{WHEELS}\nodom_x = "YAW.Bare"',
            "map.toml:4: odom_x: YAW.Bare has no unit: expected m, cm, mm",
        ),
        (
            f'{WHEELS}\ngyro = "YAW.Odd"',
            "map.toml:4: gyro: YAW.Odd has unit furlong: expected none (adc_code), rad/s",
        ),
        (
            f'{WHEELS}\ngyro = "YAW.Bare"',
            "map.toml:4: gyro: YAW.Bare has factor 0.001 and offset 0: adc_code need a whole "
            'number with factor 1; a quantity needs unit = "…", one of none (adc_code), rad/s',
        ),
        (
            'left_count = "DECADE.Scaled"\nright_count = "WHEELS.Right"',
            "map.toml:2: left_count: DECADE.Scaled has factor 2 and offset 0: counts need a whole "
            "number with factor 1",
        ),
        (
            f'{WHEELS}\ngyro = {{ signal = "YAW.Rate", unit = "rad/s" }}',
            'map.toml:4: gyro: unit = "rad/s": the DBC gives YAW.Rate the unit deg/s: '
            "expected no unit here",
        ),
        (
            f'{WHEELS}\ngyro = {{ signal = "YAW.Odd", kind = "counts" }}',
            'map.toml:4: gyro: kind = "counts": expected one of "adc_code", "physical"',
        ),
        (
            f'{WHEELS}\nodom_x = {{ signal = "POSITION.X", kind = "adc_code" }}',
            'map.toml:4: odom_x: kind = "adc_code": expected "physical"',
        ),
        (
            f'{WHEELS}\ngyro = "YAW"',
            'map.toml:4: signals.gyro = "YAW": expected "MESSAGE.signal" of the DBC',
        ),
        (
            f"{WHEELS}\ngyro = 3",
            'map.toml:4: signals.gyro = 3: expected "MESSAGE.signal" of the DBC',
        ),
        (
            f'{WHEELS}\ngyro = {{ signal = "YAW.Rate", inverse = true }}',
            "map.toml:4: signals.gyro.inverse: unknown key: the nearest is invert",
        ),
        (
            f'{WHEELS}\ngyro = {{ signal = "YAW.Odd", kind = "adc_code", invert = true }}',
            "map.toml:4: gyro: invert = true: YAW.Odd is a converter code: "
            "expected counts or a quantity",
        ),
    ],
)
def test_a_mistake_in_a_map_is_said_in_one_line(
    tmp_path: Path, database: Database, signals: str, message: str
) -> None:
    with pytest.raises(HarnessError) as caught:
        load_map(write_map(tmp_path, signals), database)
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_a_map_without_signals_is_refused(tmp_path: Path, database: Database) -> None:
    file = tmp_path / "map.toml"
    file.write_text("schema = 1\n")
    with pytest.raises(HarnessError, match=r"^map\.toml: left_count, right_count are missing"):
        load_map(file, database)


def test_what_a_run_needs_is_asked_for_by_name(tmp_path: Path, database: Database) -> None:
    found = load_map(write_map(tmp_path, WHEELS), database)
    found.require(REQUIRED, "dead reckoning")
    assert found.get("odom_x") is None
    with pytest.raises(HarnessError) as caught:
        found.require(["odom_x", "odom_y"], "comparing the device's odometry")
    assert str(caught.value) == (
        "map.toml: odom_x, odom_y are missing: comparing the device's odometry needs "
        'odom_x = "MESSAGE.signal" under [signals]'
    )
    with pytest.raises(HarnessError, match=r"^map\.toml: gyro is missing: this needs gyro = "):
        _ = found["gyro"]


def test_messages_of_roles_come_once_each() -> None:
    shipped = default_map(load_database())
    names = [message.name for message in shipped.messages(ROLES)]
    assert names == [
        "ENCODER",
        "IMU",
        "ENVIRONMENT",
        "COMMAND",
        "ODOMETRY_X",
        "ODOMETRY_Y",
        "ODOMETRY_HEADING",
        "REFERENCE_POSE",
    ]


def test_every_quantity_that_a_role_can_have_has_units() -> None:
    known = {unit.quantity for unit in UNITS.values()}
    # Time has units for the clocks of tables, which are no roles.
    assert {quantity for role in ROLES for quantity in QUANTITIES[role]} == known - {"time"}
    assert unit_of(" DEG/S ") == UNITS["deg/s"]
    assert unit_of("furlong") is None


@pytest.mark.parametrize(
    ("spellings", "unit"),
    [
        ("deg/sec degree/s degrees/s degree/sec degrees/sec degrees/second", "deg/s"),
        ("rad/sec radian/s radians/s radians/sec radians/second", "rad/s"),
        ("m/sec meter/s meters/s", "m/s"),
        ("km/hr kph kmph kmh km^h km/hour", "km/h"),
        ("m/sec^2 m/s/s", "m/s^2"),
        ("MPH mi/h", "mph"),
    ],
)
def test_units_are_understood_as_dbcs_in_the_wild_spell_them(spellings: str, unit: str) -> None:
    """A yaw rate in deg/sec was left out of the map, and the gyro out of the diagnosis."""
    assert {unit_of(one) for one in spellings.split()} == {UNITS[unit]}


def test_blanks_within_a_unit_say_nothing() -> None:
    assert unit_of("km / h") == UNITS["km/h"]


def test_a_mile_per_hour_is_a_speed_of_447_millimetres_per_second() -> None:
    assert (UNITS["mph"].quantity, UNITS["mph"].factor) == ("speed", 0.44704)
