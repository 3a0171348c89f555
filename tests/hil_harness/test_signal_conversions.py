"""What the plant reads goes over any bus and comes to the kernel as what it was."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from foreign_bus import foreign_database, write_map
from hypothesis import example, given
from hypothesis import strategies as st

from can_bus import CanBusError, Database, FrameChecker, load_database, make_message
from can_bus.signals import Raw
from firmware_model import FRESH, STALE, Kernel, StatusBit
from hil_harness.errors import HarnessError
from hil_harness.kernel_inputs import KernelInputs, described_gyro
from hil_harness.nodes.firmware import firmware_config
from hil_harness.odometry_frames import odometry_converters, odometry_raw
from hil_harness.robot import load_robot
from hil_harness.sensor_frames import SENSOR_ROLES, SensorFrames
from hil_harness.signal_map import MappedSignal, SignalMap, default_map, load_map
from hil_harness.signal_roles import Quantity
from hil_harness.wheel_counter import Extender, count_to_raw, raw_to_count, rounding_ticks
from sim_plant import PlantDescription, SensorCounts

PLANT = PlantDescription()
COUNTER = 1 << PLANT.encoder.counter_bits

codes = st.integers(0, 65535)
counts = st.builds(SensorCounts, *[codes] * len(SENSOR_ROLES))


@pytest.fixture(scope="module")
def database(tmp_path_factory: pytest.TempPathFactory) -> Database:
    return foreign_database(tmp_path_factory.mktemp("dbc"))


def mapped(folder: Path, database: Database, **signals: str) -> SignalMap:
    entries = {"left_count": '"WHEELS.Left"', "right_count": '"WHEELS.Right"', **signals}
    lines = "\n".join(f"{role} = {entry}" for role, entry in entries.items())
    return load_map(write_map(folder, lines), database)


@given(counts)
def test_on_the_shipped_bus_raw_values_are_the_counts_themselves(reading: SensorCounts) -> None:
    frames = SensorFrames(default_map(load_database()), PLANT)
    raw: dict[str, Raw] = {}
    for message in frames.messages:
        raw |= frames.raw_values(message, reading)
    assert list(raw.values()) == list(reading)


@given(counts, st.integers(0, 14))
def test_a_frame_of_the_shipped_bus_passes_the_receivers_checks(
    reading: SensorCounts, counter: int
) -> None:
    shipped = load_database()
    frames = SensorFrames(default_map(shipped), PLANT)
    names = [message.name for message in frames.messages]
    checker = FrameChecker(shipped, names, max_age_us=0)
    inputs = KernelInputs(default_map(shipped), PLANT)
    received: dict[str, Raw] = {}
    for message in frames.messages:
        frame = make_message(message, frames.encode(message, reading, counter), 0)
        accepted = checker.check(frame, 0)
        assert accepted is not None
        received |= accepted.raw
    assert inputs.left_count(received["left_count"]) == reading.left_count
    assert inputs.right_count(received["right_count"]) == reading.right_count
    assert inputs.gyro_code(received["gyro_z_raw"]) == reading.gyro_code
    assert inputs.gyro == described_gyro(PLANT)


steps = st.lists(st.integers(-30_000, 30_000), max_size=40)


@given(codes, steps)
def test_an_extender_follows_a_counter_across_its_wraps(first: int, moves: list[int]) -> None:
    extender = Extender(COUNTER)
    total = first
    assert extender.follow(total % COUNTER) == first
    for move in moves:
        total += move
        assert extender.follow(total % COUNTER) == total


@pytest.mark.parametrize("name", ["WHEELS.Left", "ANGLES.LeftPath"])
@given(first=codes, moves=st.lists(st.integers(-3000, 3000), max_size=40))
def test_a_count_comes_back_from_a_wider_counter_and_from_a_fine_distance(
    name: str, first: int, moves: list[int], database: Database
) -> None:
    # 0.1 mm is finer than a tick of 0.15 mm, so no tick is lost on the way.
    signal = wheel(database, name)
    there, back = count_to_raw(signal, PLANT), raw_to_count(signal, PLANT)
    assert there is not None
    assert back is not None
    total = first
    for move in [0, *moves]:
        total += move
        raw = there(total % COUNTER)
        assert signal.signal.in_range(raw)
        assert back(raw) == total % COUNTER


@pytest.mark.parametrize(("name", "least"), [("WHEELS.Left", 0), ("ANGLES.LeftPath", 1)])
def test_only_a_signal_with_steps_of_its_own_rounds_counts(
    name: str, least: int, database: Database
) -> None:
    assert least <= rounding_ticks(wheel(database, name), PLANT) <= 2 * least


@pytest.mark.parametrize(
    ("entry", "code_up"),
    [
        ('"YAW.Rate"', 1),
        ('{ signal = "YAW.Rate", invert = true }', -1),
        ('"CLOCKWISE.Rate"', -1),
        ('{ signal = "CLOCKWISE.Rate", invert = true }', 1),
    ],
)
def test_a_turn_to_the_left_is_one_to_the_kernel_whichever_way_the_bus_counts(
    tmp_path: Path, database: Database, entry: str, code_up: int
) -> None:
    signal_map = mapped(tmp_path, database, gyro=entry)
    frames, inputs = SensorFrames(signal_map, PLANT), KernelInputs(signal_map, PLANT)
    message = signal_map["gyro"].message
    for rate in (-4.0, -0.5, 0.0, 0.5, 4.0):
        code = round(PLANT.gyro.zero_rate_code + rate * PLANT.gyro.sensitivity_lsb_per_rad_s)
        raw = frames.raw_values(message, SensorCounts(0, 0, code, 0, 0, 0, 0))["Rate"]
        assert raw * code_up == pytest.approx(math.degrees(rate) / 0.01, abs=1)
        received = inputs.gyro_code(raw) - inputs.gyro.zero_rate_code
        assert received * inputs.gyro.sensitivity_rad_s_per_lsb == pytest.approx(rate, abs=2e-4)


@given(first=codes, moves=steps)
def test_an_inverted_wheel_comes_back_as_it_was(
    first: int, moves: list[int], database: Database
) -> None:
    signal = replace(wheel(database, "WHEELS.Left"), si_factor=-1.0)
    there, back = count_to_raw(signal, PLANT), raw_to_count(signal, PLANT)
    assert there is not None
    assert back is not None
    total = first
    for move in [0, *moves]:
        total += move
        assert there(total % COUNTER) == -total
        assert back(-total) == total % COUNTER


@given(moves=st.lists(st.integers(-60, 60), min_size=1, max_size=60), turns=st.integers(0, 50))
def test_a_turn_that_is_no_whole_number_of_steps_never_drifts(
    moves: list[int], turns: int, database: Database
) -> None:
    # Steps of 0.1 rad: 62.83… to a turn, 33 ticks to a step; sent and read to half a step each.
    signal = wheel(database, "ANGLES.LeftRad")
    there, back = count_to_raw(signal, PLANT), raw_to_count(signal, PLANT)
    assert there is not None
    assert back is not None
    total, half_step_ticks = 0, 0.05 / (2 * math.pi) * 2048
    for move in [0, *[500] * (turns * 4), *moves]:
        total += move
        off = (back(there(total % COUNTER)) - total + COUNTER // 2) % COUNTER - COUNTER // 2
        assert abs(off) <= 1.2 * half_step_ticks + 1


def wheel(database: Database, name: str) -> MappedSignal:
    message, signal = name.split(".")
    spec = database.message(message)
    unit = spec.signals[signal].unit
    factor = {"deg": math.pi / 180, "rad": 1.0, "mm": 0.001}.get(unit)
    if factor is None:
        return MappedSignal("left_count", spec, spec.signals[signal], "counts")
    quantity: Quantity = "length" if unit == "mm" else "angle"
    return MappedSignal("left_count", spec, spec.signals[signal], "physical", quantity, factor)


@given(first=st.integers(0, 9999), moves=st.lists(st.integers(-4999, 4999), max_size=40))
def test_a_counter_from_0_to_9999_is_followed(
    first: int, moves: list[int], database: Database
) -> None:
    back = raw_to_count(wheel(database, "DECADE.Left"), PLANT)
    assert back is not None
    total = first
    for move in [0, *moves]:
        total += move
        assert back(total % 10_000) == total % COUNTER


@given(
    before=st.integers(-(2**20), 2**20),
    jump=st.integers(COUNTER // 2, 2**24) | st.integers(-(2**24), -COUNTER // 2),
    moves=st.lists(st.integers(-3000, 3000), max_size=10),
)
@example(before=0, jump=COUNTER + 3, moves=[])
def test_a_jump_beyond_the_robots_counter_is_refused_by_the_kernel_and_never_folded(
    before: int, jump: int, moves: list[int], database: Database
) -> None:
    signal = wheel(database, "WHEELS.Left")
    back = raw_to_count(signal, PLANT)
    assert back is not None
    kernel = Kernel(firmware_config(load_robot(), default_map(load_database()), 10_000))
    raw = before
    kernel.step(back(raw), 0, FRESH, 0, STALE)
    raw += jump
    kernel.step(back(raw), 0, FRESH, 0, STALE)
    assert StatusBit.ENCODER_JUMP in StatusBit(kernel.status)
    assert kernel.pose_q == (0, 0, 0)
    last = back(raw)
    for move in moves:  # from there on it is followed as before
        raw += move
        assert (back(raw) - last - move) % COUNTER == 0
        last = back(raw)


@pytest.mark.parametrize("name", ["ANGLES.Left", "ANGLES.Right"])
@given(moves=st.lists(st.integers(-900, 900), max_size=60))
def test_a_wheel_angle_wraps_at_the_turn_and_never_drifts(
    name: str, moves: list[int], database: Database
) -> None:
    # 0.01° is 1/17 of a tick: the nearest tick to the angle sent is the tick itself.
    signal = wheel(database, name)
    there, back = count_to_raw(signal, PLANT), raw_to_count(signal, PLANT)
    assert there is not None
    assert back is not None
    total = 0
    for move in [0, *moves]:
        total += move
        raw = there(total % COUNTER)
        assert 0 <= raw < 36_000
        turn = total / PLANT.encoder.ticks_per_rev
        assert raw / 36_000 == pytest.approx(turn % 1.0, abs=1 / 36_000) or raw == 0
        assert back(raw) == total % COUNTER


def test_a_counter_narrower_than_the_robots_is_refused(database: Database) -> None:
    with pytest.raises(HarnessError) as caught:
        count_to_raw(wheel(database, "DECADE.Right"), PLANT)
    assert str(caught.value) == (
        "DECADE.Right counts to 255 and back to 0, the robot's encoder to 65535: expected "
        "encoder.counter_bits = 8 in robot.toml, or a wider signal"
    )
    narrow = PlantDescription.from_tables({"encoder": {"counter_bits": 8}})
    assert count_to_raw(wheel(database, "DECADE.Right"), narrow) is None


def test_a_turn_rate_is_the_sensors_own_rate_to_half_a_step(
    tmp_path: Path, database: Database
) -> None:
    signal_map = mapped(tmp_path, database, gyro='"YAW.Rate"')
    frames = SensorFrames(signal_map, PLANT)
    yaw = database.message("YAW")
    for code in range(0, 65536, 7):
        rate = (code - PLANT.gyro.zero_rate_code) / PLANT.gyro.sensitivity_lsb_per_rad_s
        raw = frames.raw_values(yaw, SensorCounts(0, 0, code, 0, 0, 0, 0))["Rate"]
        assert signal_map["gyro"].to_si(raw) == pytest.approx(rate, abs=math.radians(0.00501))


def test_a_turn_rate_is_a_code_whose_scale_and_zero_stand_in_the_dbc(
    tmp_path: Path, database: Database
) -> None:
    for name, zero in [("YAW.Rate", 32768.0), ("YAW.Offset", 32500.0)]:
        signal_map = mapped(tmp_path, database, gyro=f'"{name}"')
        inputs = KernelInputs(signal_map, PLANT)
        gyro = signal_map["gyro"]
        assert inputs.gyro.zero_rate_code == pytest.approx(zero)
        for raw in range(gyro.signal.low_raw, gyro.signal.high_raw + 1, 101):
            code = inputs.gyro_code(raw)
            rate = (code - inputs.gyro.zero_rate_code) * inputs.gyro.sensitivity_rad_s_per_lsb
            assert 0 <= code <= 65535
            assert rate == pytest.approx(gyro.to_si(raw), abs=1e-9)


def test_the_sensors_own_limit_counts_as_saturated_on_any_bus(
    tmp_path: Path, database: Database
) -> None:
    signal_map = mapped(tmp_path, database, gyro='"YAW.Rate"')
    inputs, frames = KernelInputs(signal_map, PLANT), SensorFrames(signal_map, PLANT)
    low, high = PLANT.gyro_code_limits
    yaw = database.message("YAW")
    for code, saturated in [(low, True), (high, True), (low + 9, False), (high - 9, False)]:
        raw = frames.raw_values(yaw, SensorCounts(0, 0, code, 0, 0, 0, 0))["Rate"]
        received = inputs.gyro_code(raw)
        assert (received <= inputs.gyro.min_code or received >= inputs.gyro.max_code) == saturated


def test_a_rate_finer_than_16_bits_keeps_the_codes_about_rest(
    tmp_path: Path, database: Database
) -> None:
    inputs = KernelInputs(mapped(tmp_path, database, gyro='"FINE.Rate"'), PLANT)
    gyro = inputs.gyro
    assert gyro.sensitivity_rad_s_per_lsb == pytest.approx(1e-5)
    assert inputs.gyro_code(0) == gyro.zero_rate_code
    assert inputs.gyro_code(1000) - inputs.gyro_code(-1000) == 2000
    assert (inputs.gyro_code(-4_000_000), inputs.gyro_code(4_000_000)) == (0, 65535)
    assert (gyro.min_code, gyro.max_code) == (0, 65535)


def test_a_rate_sent_as_a_float_becomes_the_described_gyros_code_again(
    tmp_path: Path, database: Database
) -> None:
    signal_map = mapped(tmp_path, database, gyro='"FLOATS.Rate"')
    frames, inputs = SensorFrames(signal_map, PLANT), KernelInputs(signal_map, PLANT)
    message = database.message("FLOATS")
    assert inputs.gyro == described_gyro(PLANT)
    for code in range(0, 65536, 97):
        data = frames.encode(message, SensorCounts(0, 0, code, 0, 0, 0, 0), 0)
        assert inputs.gyro_code(message.decode_raw(data)["Rate"]) == code


def test_other_sensors_speak_their_units(tmp_path: Path, database: Database) -> None:
    signal_map = mapped(
        tmp_path,
        database,
        accel_x='"BODY.AccelX"',
        temperature='"BODY.Heat"',
        supply='"BODY.Battery"',
    )
    reading = SensorCounts(0, 0, 0, 32768 + 1671, 0, 32768 + 3400, 49152)
    raw = SensorFrames(signal_map, PLANT).raw_values(database.message("BODY"), reading)
    assert raw == {"AccelX": 100, "Heat": 75, "Battery": 12_000}


def test_a_signal_too_narrow_for_the_converter_is_refused(
    tmp_path: Path, database: Database
) -> None:
    signal_map = mapped(tmp_path, database, gyro='{ signal = "DECADE.Right", kind = "adc_code" }')
    with pytest.raises(HarnessError) as caught:
        SensorFrames(signal_map, PLANT)
    assert str(caught.value) == (
        "DECADE.Right holds codes from 0 to 255, the robot's ADC gives 0 to 65535: expected "
        "adc.bits = 8 in robot.toml, or a wider signal"
    )


def test_signals_without_a_role_stand_at_their_initial_value(
    tmp_path: Path, database: Database
) -> None:
    signal_map = mapped(tmp_path, database, gyro='"YAW.Rate"')
    raw = SensorFrames(signal_map, PLANT).raw_values(
        database.message("YAW"), SensorCounts(0, 0, 32768, 0, 0, 0, 0)
    )
    assert raw == {"Rate": 0, "Offset": 0, "Bare": 0, "Odd": 0}


@given(st.integers(-(2**51) + 1, 2**51 - 1), st.integers(-(2**31), 2**31 - 1))
def test_at_the_default_formats_odometry_is_the_accumulator_itself(
    x_q: int, heading_q: int
) -> None:
    shipped = default_map(load_database())
    to_raw = odometry_converters(shipped, position_frac_bits=32, heading_frac_bits=32)
    assert to_raw["odom_x"](x_q) == x_q
    assert to_raw["odom_y"](x_q) == x_q
    assert to_raw["odom_heading"](heading_q) == heading_q
    assert shipped["odom_x"].to_si(x_q) == x_q / 2**32


@given(st.integers(-(2**30), 2**30 - 1), st.integers(8, 31))
def test_a_coarser_accumulator_is_sent_exactly(value_q: int, frac_bits: int) -> None:
    shipped = default_map(load_database())
    sent = odometry_raw(shipped["odom_x"], frac_bits)(value_q % (1 << frac_bits))
    assert sent == (value_q % (1 << frac_bits)) << (32 - frac_bits)


@given(x_q=st.integers(-(2**32), 2**32), heading_q=st.integers(-(2**31), 2**31 - 1))
def test_odometry_on_a_foreign_bus_is_the_nearest_value_it_can_say(
    x_q: int, heading_q: int, database: Database
) -> None:
    position = database.message("POSITION").signals["Y"]
    heading = database.message("HEADING").signals
    y = MappedSignal("odom_y", database.message("POSITION"), position, "physical", "length", 0.001)
    raw = odometry_raw(y, 32)(x_q)
    assert y.to_si(raw) == pytest.approx(x_q / 2**32, abs=0.00005 * (1 + 1e-9))
    for name, low, unit_rad in [
        ("Compass", 0.0, math.pi / 180),
        ("Signed", -180.0, math.pi / 180),
        ("Radians", 0.0, 1.0),
    ]:
        spec = database.message("HEADING")
        angle = MappedSignal("odom_heading", spec, heading[name], "physical", "angle", unit_rad)
        degrees = math.degrees(angle.to_si(odometry_raw(angle, 32)(heading_q)))
        assert low <= degrees <= low + 360
        away = (degrees - 360 * heading_q / 2**32 + 180) % 360 - 180
        assert abs(away) <= math.degrees(angle.si_per_lsb) / 2 * (1 + 1e-9)


def test_a_position_beyond_the_signal_is_not_available_and_never_clipped(
    database: Database,
) -> None:
    spec = database.message("POSITION")
    x = MappedSignal("odom_x", spec, spec.signals["X"], "physical", "length", 0.001)
    y = MappedSignal("odom_y", spec, spec.signals["Y"], "physical", "length", 0.001)
    two_metres = 2 << 32
    assert odometry_raw(x, 32)(two_metres) == spec.signals["X"].invalid_raw
    with pytest.raises(HarnessError) as caught:
        odometry_raw(y, 32)(two_metres)
    assert str(caught.value) == (
        "POSITION.Y: 2 m is raw value 20000, its range ends at 10000: expected a wider range in "
        "the DBC, or a value named SNA (VAL_) for what is beyond it"
    )


@given(st.floats(-7.9, 7.9), st.floats(-31.9, 31.9))
def test_commands_go_both_ways(v_m_s: float, w_rad_s: float) -> None:
    shipped = default_map(load_database())
    for signal, value in ((shipped["v_command"], v_m_s), (shipped["w_command"], w_rad_s)):
        assert signal.to_si(signal.to_raw(value)) == pytest.approx(value, abs=signal.si_per_lsb / 2)
    with pytest.raises(CanBusError, match=r"COMMAND\.v_m_s = 9\.0 m/s: expected"):
        shipped["v_command"].to_raw(9.0)
