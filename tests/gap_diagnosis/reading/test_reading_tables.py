"""Tables: by plain names or through a map, wrapped or not, with holes, with clocks of their own."""

from pathlib import Path

import numpy as np
import pytest
from drives import ROBOT, TICK_S, Drive, drive
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading import read_recording
from gap_diagnosis.reading.table_clock import table_clock
from gap_diagnosis.recording import Recording
from hil_harness import HarnessError, load_robot

TICKS_PER_RAD = ROBOT.plant.encoder.ticks_per_rev / (2 * np.pi)


def read(table: Drive, folder: Path, map_text: str | None = None) -> Recording:
    signals = None
    if map_text is not None:
        signals = folder / "map.toml"
        signals.write_text(map_text, encoding="utf-8")
    return read_recording(table.write(folder / "table.csv"), robot=ROBOT, signals=signals)


def assert_same_wheels(found: Recording, table: Drive, tolerance: float = 0) -> None:
    for name in ("left_ticks", "right_ticks"):
        want = table.columns[name] - table.columns[name][0]
        assert np.max(np.abs(getattr(found, name) - want)) <= tolerance


def test_wrapped_and_unwrapped_counts_are_the_same_drive(tmp_path: Path) -> None:
    plain = drive(500, counts_per_tick=300)
    plain.columns["left_ticks"] += 60_000
    wrapped = Drive(dict(plain.columns))
    for name in ("left_ticks", "right_ticks"):
        wrapped.columns[name] = plain.columns[name] % 65_536
    assert_same_wheels(read(plain, tmp_path), plain)
    assert_same_wheels(read(wrapped, tmp_path), plain)


def test_counts_that_wrap_at_32_bits_are_a_drive_like_any_other(tmp_path: Path) -> None:
    robot_toml = tmp_path / "robot.toml"
    robot_toml.write_text("[encoder]\nticks_per_rev = 80914\ncounter_bits = 32\n")
    table = drive()
    low, period = table.columns["left_ticks"].min(), 2.0**32
    table.columns["left_ticks"] = (table.columns["left_ticks"] - low - 100) % period
    file = table.write(tmp_path / "table.csv")
    found = read_recording(file, robot=load_robot(robot_toml))
    assert float(np.ptp(table.columns["left_ticks"])) > period / 2
    assert np.max(np.abs(np.diff(found.left_ticks))) < 200
    assert found.counter_bits == 32


@settings(max_examples=25, phases=[Phase.explicit, Phase.generate])
@given(
    seed=st.integers(0, 2**32 - 1),
    skew=st.floats(-2e-3, 2e-3),
    jitter_s=st.floats(0, 0.01),
    wrap_s=st.sampled_from([None, 65.536]),
    loss=st.floats(0, 0.1),
)
def test_an_ecu_clock_takes_the_jitter_out_of_the_stamps(
    seed: int,
    skew: float,
    jitter_s: float,
    wrap_s: float | None,
    loss: float,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    random = np.random.default_rng(seed)
    table = drive(1500, seed=seed % 1000)
    ecu_s = np.round(table.columns["t_s"] + 55, 6)
    true_s = 5 + np.arange(1500) * TICK_S / (1 + skew)
    table.columns["t_s"] = np.round(true_s + jitter_s * random.exponential(size=1500), 6)
    table.columns["ecu_t_s"] = ecu_s if wrap_s is None else np.round(ecu_s % wrap_s, 6)
    kept = random.random(1500) >= loss
    kept[[0, -1]] = True
    order = random.permutation(np.flatnonzero(kept)) if wrap_s is None else np.flatnonzero(kept)
    shuffled = Drive({name: column[order] for name, column in table.columns.items()})
    found = read(shuffled, tmp_path_factory.mktemp("tables"))
    assert len(found.tick) == 1500
    there = np.isfinite(found.left_ticks)
    assert np.array_equal(there, kept)
    assert np.array_equal(
        found.left_ticks[there],
        (table.columns["left_ticks"] - table.columns["left_ticks"][0])[kept],
    )
    assert abs(found.clock_skew - skew) < 6 * found.clock_skew_sd + 1e-9
    drifted = found.t_s - true_s
    assert np.ptp(drifted) < 1e-5 + 8 * found.clock_skew_sd * 15


def counted_at(true_s: NDArray[np.float64], stamp_s: NDArray[np.float64]) -> Drive:
    """Return wheels that were read at true times in curves of changing speed, and stamped."""
    left = 4000 * true_s + 3000 * np.sin(true_s)
    right = 5000 * true_s - 3000 * np.cos(0.7 * true_s)
    columns = {"t_s": np.round(stamp_s, 6), "left_ticks": np.floor(left)}
    return Drive(columns | {"right_ticks": np.floor(right)})


def test_without_an_ecu_clock_rows_are_sampled_when_they_say(tmp_path: Path) -> None:
    uneven_s = 100 + np.cumsum(np.random.default_rng(0).uniform(0.1, 0.2, 300))
    table = counted_at(uneven_s, uneven_s)
    found = read(table, tmp_path)
    there = np.isfinite(found.left_ticks)
    assert found.t_s[there] == pytest.approx(uneven_s, abs=2e-4)
    assert np.isnan(found.clock_skew)
    assert_same_wheels(found, table)


@pytest.mark.parametrize("share", [0.0, 0.3])
def test_a_stamp_that_jitters_while_the_counts_go_evenly_is_put_right(
    share: float, tmp_path: Path
) -> None:
    random = np.random.default_rng(1)
    uneven_s = 0.002 * np.sqrt(share) * random.standard_normal(3000)
    true_s = 1.7e9 + np.arange(3000) / 30 + uneven_s
    late_s = 0.002 * np.sqrt(1 - share) * random.standard_normal(3000)
    late_s[1000:1010] += np.linspace(0.3, 0.05, 10)  # the host was busy
    table = counted_at(true_s, true_s + late_s)
    table.columns["left_ticks"][500] = np.nan
    found = read(table, tmp_path)
    off_s = found.t_s[found.stamp_s == found.stamp_s]
    off_s -= true_s
    off_s -= np.median(off_s)
    best_s = 0.002 * np.sqrt(share * (1 - share))
    assert np.std(off_s[[*range(960), *range(1050, 3000)]]) < best_s + 4e-4


def test_jitter_of_a_sixth_of_a_tick_hardly_ever_loses_or_adds_a_tick() -> None:
    random = np.random.default_rng(4)
    there = random.random(20_000) > 0.02
    stamps_s = np.arange(20_000) / 30 + 0.0055 * np.abs(random.standard_normal(20_000))
    clock = table_clock("table", stamps_s[there], None, None)
    assert np.count_nonzero(np.diff(clock.tick) != np.diff(np.flatnonzero(there))) <= 3


@pytest.mark.parametrize("together", [2, 3, 4])
def test_rows_that_come_in_a_burst_are_all_there_and_none_is_lost(together: int) -> None:
    """Of rows with one stamp all but the first were left out, and each was a lost tick: a robot on
    a busy bus was pushed about (> 0.99)."""
    counts = np.arange(2000.0)
    stamps_s = 0.025 * counts
    for last in range(100, 2000, 150):
        stamps_s[last - together + 1 : last + 1] = stamps_s[last]
    clock = table_clock("table", stamps_s, None, None, [counts])
    assert np.array_equal(clock.order, np.arange(2000))
    assert np.array_equal(clock.tick, np.arange(2000))
    assert np.all(np.diff(clock.t_s) > 0)


def test_rows_that_say_the_same_at_the_same_time_are_one() -> None:
    counts = np.arange(200.0)
    twice = np.repeat(np.arange(200), np.where(counts == 50, 2, 1))
    clock = table_clock("table", 0.025 * counts[twice], None, None, [counts[twice]])
    assert np.array_equal(twice[clock.order], np.arange(200))


def test_where_many_rows_share_a_stamp_the_first_of_each_counts() -> None:
    """They are of several sources, and no bursts."""
    rows = np.arange(400.0)
    clock = table_clock("table", 0.025 * (rows // 2), None, None, [rows])
    assert np.array_equal(clock.order, np.arange(0, 400, 2))
    assert np.array_equal(clock.tick, np.arange(200))


def test_a_map_reads_angles_distances_speeds_and_other_units(tmp_path: Path) -> None:
    table = drive(600)
    angle = table.columns["left_ticks"] / TICKS_PER_RAD
    distance = table.columns["right_ticks"] / TICKS_PER_RAD * ROBOT.plant.wheels.radius_m
    rate = (table.columns["gyro_code"] - 32_768) / ROBOT.plant.gyro.sensitivity_lsb_per_rad_s
    foreign = Drive(
        {
            "stamp": np.round(table.columns["t_s"] * 1e9),
            "wl": np.degrees(angle) % 360,
            "wr": distance * -1000,
            "yaw": np.degrees(rate),
        }
    )
    found = read(
        foreign,
        tmp_path,
        '[columns]\ntime = { column = "stamp", unit = "ns" }\n'
        'left_count = { column = "wl", unit = "deg", wrap = 360 }\n'
        'right_count = { column = "wr", unit = "mm", invert = true }\n'
        'gyro = { column = "yaw", unit = "deg/s" }\n',
    )
    assert_same_wheels(found, table, tolerance=1e-6)
    assert found.gyro_rate_rad_s == pytest.approx(rate, abs=1e-12)
    assert found.gyro_code == pytest.approx(table.columns["gyro_code"], abs=1e-6)


@pytest.mark.parametrize("steps_s", [[TICK_S], [0.009, 0.009, 0.015]])
def test_wheel_speeds_add_up_to_counts_over_the_time_they_took(
    steps_s: list[float], tmp_path: Path
) -> None:
    steps = np.resize(steps_s, 2000)
    seconds = np.round(np.cumsum(steps) - steps[0], 6)
    speed = 0.5 * np.sin(seconds)
    table = Drive({"t_s": seconds, "vl": speed, "vr": speed})
    found = read(
        table,
        tmp_path,
        '[columns]\ntime = "t_s"\nleft_count = { column = "vl", unit = "m/s" }\n'
        'right_count = { column = "vr", unit = "m/s" }\n',
    )
    travelled_m = 0.5 * (1 - np.cos(seconds))
    want = travelled_m / ROBOT.plant.wheels.radius_m * TICKS_PER_RAD
    there = np.isfinite(found.left_ticks)
    assert found.left_ticks[there] == pytest.approx(want, abs=0.2)


def test_empty_cells_are_missing_and_commands_hold_over_them(tmp_path: Path) -> None:
    table = drive(300)
    table.columns["left_ticks"][40:45] = np.nan
    table.columns["gyro_code"][10] = np.nan
    table.columns["v_command_m_s"][1:] = np.nan
    found = read(table, tmp_path)
    assert np.flatnonzero(np.isnan(found.left_ticks)).tolist() == [40, 41, 42, 43, 44]
    assert found.gyro_code is not None
    assert found.v_command_m_s is not None
    assert np.flatnonzero(np.isnan(found.gyro_code)).tolist() == [10]
    assert np.all(found.v_command_m_s == table.columns["v_command_m_s"][0])


def test_a_table_that_joins_sensors_of_two_rates_has_a_row_for_each_wheel_reading(
    tmp_path: Path,
) -> None:
    table = drive(300)
    fine = {name: np.full(900, np.nan) for name in table.columns}
    fine["t_s"] = np.round(5 + np.arange(900) * TICK_S / 3, 6)
    for name in ("left_ticks", "right_ticks"):
        fine[name][::3] = table.columns[name]
    fine["gyro_code"] = np.arange(900.0) + 30_000
    found = read(Drive(fine), tmp_path)
    assert len(found.tick) == 300
    assert found.tick_period_s == pytest.approx(TICK_S)
    assert found.gyro_code is not None
    # Row k covers the samples after row k - 1 and its own: three in a row but for the first.
    assert found.gyro_code[1:] == pytest.approx(30_000 + 3 * np.arange(1, 300) - 1)


def test_a_gap_in_a_table_has_rows_of_nothing(tmp_path: Path) -> None:
    table = drive(500)
    kept = np.concatenate((np.arange(200), np.arange(230, 500)))
    found = read(Drive({name: column[kept] for name, column in table.columns.items()}), tmp_path)
    assert len(found.tick) == 500
    assert np.isnan(found.left_ticks[200:230]).all()
    assert found.t_s == pytest.approx(table.columns["t_s"], abs=1e-9)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "empty: expected a line with the names"),
        ("1,2,3\n4,5,6\n", "expected the names of the columns in this line"),
        ("t_s,t_s\n0,1\n", "column 't_s' stands twice"),
        ("t_s,left_ticks\n0,1\n", "no column right_ticks: the table has t_s, left_ticks"),
        ("left_ticks,right_ticks\n0,1\n", "no column t_s or ecu_t_s"),
        ("t_s,left_ticks,right_ticks\n0,1,2\n0.01,x,2\n", r"table.csv:3: left_ticks = 'x'"),
        ("t_s,left_ticks,right_ticks\n0,1,2\n0.01,1\n", r"table.csv:3: 2 cells: expected 3"),
        ("t_s,left_ticks,right_ticks\n0,1,2\n", "1 rows: expected at least 20"),
    ],
)
def test_a_table_that_cannot_be_read_is_one_sentence(text: str, said: str, tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    table.write_text(text, encoding="utf-8")
    with pytest.raises((DiagnosisError, HarnessError), match=said):
        read_recording(table, robot=ROBOT)


def test_values_that_are_not_finite_are_missing_and_one_note_counts_them(tmp_path: Path) -> None:
    """Columns with holes and infinities were diagnosed without a word of them."""
    table = drive(300)
    assert read(table, tmp_path).notes == ()
    table.columns["left_ticks"][[40, 41]] = np.nan
    table.columns["gyro_code"][[50, 51, 52]] = np.inf, -np.inf, np.nan
    assert read(table, tmp_path).notes == (
        "Values empty or not finite were taken as missing: 2 of 300 of left_ticks, 3 of 300 of "
        "gyro_code.",
    )


def test_empty_cells_between_sensors_of_several_rates_are_no_news(tmp_path: Path) -> None:
    table = drive(600)
    for name in ("left_ticks", "right_ticks"):
        table.columns[name][::2] = np.nan
    table.columns["gyro_code"][1::2] = np.nan
    assert read(table, tmp_path).notes == ()


def test_a_row_without_time_is_one_sentence(tmp_path: Path) -> None:
    table = drive(300)
    table.columns["t_s"][7] = np.nan
    with pytest.raises(DiagnosisError, match="row 9: no time"):
        read(table, tmp_path)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ('gyri = "gyro_code"', "no such role: the nearest is gyro"),
        ('gyro = "gyro_kode"', "no such column: the nearest is gyro_code"),
        ('gyro = { column = "gyro_code", unit = "V" }', "expected none .adc_code., rad/s"),
        ('gyro = "left_ticks"', "already mapped as left_count"),
    ],
)
def test_a_mistake_in_a_map_is_named_with_its_line(line: str, said: str, tmp_path: Path) -> None:
    plain = '[columns]\ntime = "t_s"\nleft_count = "left_ticks"\nright_count = "right_ticks"\n'
    with pytest.raises(HarnessError, match=rf"map.toml:5: .*{said}"):
        read(drive(300), tmp_path, plain + line + "\n")


def test_parquet_reads_as_csv_does_or_says_what_to_install(tmp_path: Path) -> None:
    table = tmp_path / "table.parquet"
    table.write_bytes(b"PAR1")
    with pytest.raises(DiagnosisError, match=r"pip install pyarrow|not a Parquet file"):
        read_recording(table, robot=ROBOT)


@pytest.mark.parametrize(
    ("column", "said"),
    [
        ("left_ticks", "way of the left wheel"),
        ("v_command_m_s", "commanded speed"),
        ("w_command_rad_s", "commanded turn rate"),
        ("odom_x_m", "odometry x"),
    ],
)
def test_sizes_whose_squares_would_overflow_are_one_sentence(
    column: str, said: str, tmp_path: Path
) -> None:
    """A misread cell of 1e300 filled the answer with infinities."""
    table = drive(400)
    table.columns[column] = np.where(np.arange(400) > 200, 1e300, 0.0)
    with pytest.raises(DiagnosisError, match=rf"table\.csv: {said} reaches .*e\+\d+ .* its unit$"):
        read(table, tmp_path)


def test_metres_said_to_be_millimetres_are_read(tmp_path: Path) -> None:
    """A mistake that the diagnosis tells is no reason to refuse a log."""
    table = drive(400)
    for name in ("left_ticks", "right_ticks"):
        table.columns[name] *= 1000
    assert read(table, tmp_path).duration_s > 3.9
