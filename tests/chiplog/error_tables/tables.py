"""Tables in place of logs: what they hold, and what a map says of them."""

from __future__ import annotations

from collections.abc import Callable

from error_tables.row import Row


def table(names: str, cells: Callable[[int], str], rows: int = 300) -> str:
    """Return a table of comma-separated values."""
    return names + "\n" + "".join(f"{cells(k)}\n" for k in range(rows))


WHEELS = "t_s,left_ticks,right_ticks"
DRIVE = table(WHEELS, lambda k: f"{k / 100},{3 * k},{4 * k}")
"""A drive of three seconds."""

TABLES: tuple[Row, ...] = (
    Row(
        "a table that is not there",
        "chiplog diagnose gone.csv",
        "gone.csv: cannot read this table: No such file or directory",
    ),
    Row(
        "a Parquet table that is not there",
        "chiplog diagnose gone.parquet",
        "gone.parquet: no such file: expected a table",
    ),
    Row(
        "a Parquet table without its library, or damaged",
        "chiplog diagnose table.parquet",
        "table.parquet: reading Parquet needs pyarrow: pip install pyarrow, or save it as .csv",
        {"table.parquet": b"PAR1"},
        or_line="table.parquet: not a Parquet file: Parquet file size is 4 bytes, smaller than the "
        "minimum file footer (8 bytes)",
    ),
    Row(
        "an empty table",
        "chiplog diagnose table.csv",
        "table.csv: empty: expected a line with the names of the columns",
        {"table.csv": ""},
    ),
    Row(
        "a column that stands twice",
        "chiplog diagnose table.csv",
        "table.csv:1: column 'left_ticks' stands twice: expected each name once",
        {"table.csv": "t_s,left_ticks,left_ticks\n"},
    ),
    Row(
        "a table with thousands of columns",
        "chiplog diagnose table.csv",
        "table.csv: 2001 columns: expected at most 2000",
        {"table.csv": ",".join(f"c{k}" for k in range(2001)) + "\n"},
    ),
    Row(
        "a row with a cell too many",
        "chiplog diagnose table.csv",
        "table.csv:302: 4 cells: expected 3, as in the header",
        {"table.csv": DRIVE + "3,900,1200,7\n4,x,1\n"},
    ),
    Row(
        "a line that never ends",
        "chiplog diagnose table.csv",
        "table.csv: a line of over 1 MiB: this is no table",
        {"table.csv": WHEELS + "\n" + "1" * (1 << 20)},
    ),
    Row(
        "a table of few rows",
        "chiplog diagnose table.csv",
        "table.csv: 2 rows: expected at least 20",
        {"table.csv": WHEELS + "\n0,1,2\n0.01,2,3\n"},
    ),
    Row(
        "a wheel without numbers",
        "chiplog diagnose table.csv",
        "table.csv: column left_ticks has no number: expected the wheel's counts",
        {"table.csv": table(WHEELS, lambda k: f"{k / 100},,{4 * k}")},
    ),
    Row(
        "a row without its time",
        "chiplog diagnose table.csv",
        "table.csv: row 9: no time: expected a number in every row",
        {"table.csv": table(WHEELS, lambda k: f"{k / 100 if k != 7 else ''},{3 * k},{4 * k}")},
    ),
    Row(
        "a clock that stands",
        "chiplog diagnose table.csv",
        "table.csv: 300 rows at one time: expected a clock that runs",
        {"table.csv": table(WHEELS, lambda k: f"1,{3 * k},{4 * k}")},
    ),
    Row(
        "a clock in milliseconds",
        "chiplog diagnose table.csv",
        "table.csv: rows are 10 s apart: expected one every 2 s at least, by a clock in seconds "
        "(or is it in milliseconds?)",
        {"table.csv": table(WHEELS, lambda k: f"{10 * k},{3 * k},{4 * k}")},
    ),
    Row(
        "a clock that is set back",
        "chiplog diagnose table.csv",
        "table.csv: row 202: 1.500 s before an earlier row: expected one recording in the order of "
        "its time, by a clock that was not set meanwhile",
        {
            "table.csv": table(
                WHEELS, lambda k: f"{k / 100 - 1.51 * (k >= 200):.2f},{3 * k},{4 * k}"
            )
        },
    ),
    Row(
        "a drive of less than two seconds",
        "chiplog diagnose table.csv",
        "table.csv: 0.29 s long: expected at least 2 s, better a minute or more",
        {"table.csv": table(WHEELS, lambda k: f"{k / 100},{3 * k},{4 * k}", 30)},
    ),
    Row(
        "a robot that never moves",
        "chiplog diagnose table.csv",
        "table.csv: the robot never moves (0 encoder ticks in 3 s): expected a log of a drive",
        {"table.csv": table(WHEELS, lambda k: f"{k / 100},5,6")},
    ),
    Row(
        "a size that no unit explains",
        "chiplog diagnose table.csv",
        "table.csv: way of the left wheel reaches 9.17e+12 rad: expected at most 8.97e+05 rad; "
        "look at its unit",
        {"table.csv": table(WHEELS, lambda k: f"{k / 100},{10**13 * k},{4 * k}")},
    ),
    Row(
        "nothing but wheels",
        "chiplog diagnose table.csv",
        "table.csv: nothing to compare the wheels with: expected a gyro, a reference, "
        "commands, odometry frames of a firmware that needs none, or stamped bus frames",
        {"table.csv": DRIVE},
    ),
    Row(
        "codes of another robot's converter",
        "chiplog diagnose table.csv",
        "table.csv: gyro_code = 70000: the robot description's adc.bits = 16 gives codes from "
        "0 to 65535: expected the robot that made this log",
        {"table.csv": table(WHEELS + ",gyro_code", lambda k: f"{k / 100},{3 * k},{4 * k},70000")},
    ),
    Row(
        "a map of a table without columns",
        "chiplog diagnose table.csv --signals map.toml",
        'map.toml: no [columns]: a table needs them, for example left_count = "wheel_left"',
        {"table.csv": DRIVE, "map.toml": '[signals]\nleft_count = "A.b"\n'},
    ),
    Row(
        "a column's role that does not exist",
        "chiplog diagnose table.csv --signals map.toml",
        "map.toml:2: columns.left: no such role: the nearest is left_count",
        {
            "table.csv": DRIVE,
            "map.toml": '[columns]\nleft = "left_ticks"\n',
        },
    ),
    Row(
        "a column that the table has not",
        "chiplog diagnose table.csv --signals map.toml",
        'map.toml:2: left_count = "left_tics": the table has no such column: the nearest is '
        "left_ticks",
        {
            "table.csv": DRIVE,
            "map.toml": '[columns]\nleft_count = "left_tics"\n',
        },
    ),
    Row(
        "a column that is mapped twice",
        "chiplog diagnose table.csv --signals map.toml",
        "map.toml:3: right_count = left_ticks: already mapped as left_count",
        {
            "table.csv": DRIVE,
            "map.toml": '[columns]\nleft_count = "left_ticks"\nright_count = "left_ticks"\n',
        },
    ),
    Row(
        "a column in a unit of something else",
        "chiplog diagnose table.csv --signals map.toml",
        "map.toml:2: left_count: left_ticks has unit V: expected none (counts), m, cm, mm, "
        "rad, mrad, deg, turn, m/s, cm/s, mm/s, km/h, mph, rad/s, mrad/s, deg/s, turn/s, rpm",
        {
            "table.csv": DRIVE,
            "map.toml": '[columns]\nleft_count = { column = "left_ticks", unit = "V" }\n',
        },
    ),
    Row(
        "a column of a kind that its role has not",
        "chiplog diagnose table.csv --signals map.toml",
        'map.toml:2: left_count: kind = "adc_code": expected "physical" or "counts"',
        {
            "table.csv": DRIVE,
            "map.toml": '[columns]\nleft_count = { column = "left_ticks", kind = "adc_code" }\n',
        },
    ),
    Row(
        "a column of codes turned round",
        "chiplog diagnose table.csv --signals map.toml",
        "map.toml:2: gyro: invert = true: left_ticks is a converter code: expected counts or a "
        "quantity",
        {
            "table.csv": DRIVE,
            "map.toml": '[columns]\ngyro = { column = "left_ticks", invert = true }\n',
        },
    ),
    Row(
        "a clock in no unit of time",
        "chiplog diagnose table.csv --signals map.toml",
        "map.toml:2: time: t_s has unit V: expected s, ms, us or ns",
        {
            "table.csv": DRIVE,
            "map.toml": '[columns]\ntime = { column = "t_s", unit = "V" }\n',
        },
    ),
    Row(
        "a table to encode without rows",
        "chiplog encode table.csv --out bus.log",
        "table.csv: no rows: expected one for each tick",
        {"table.csv": WHEELS + "\n"},
    ),
    Row(
        "a table to encode that lasts for weeks",
        "chiplog encode table.csv --out bus.log",
        "table.csv: 200000000 ticks: expected a shorter table",
        {"table.csv": WHEELS + "\n0,1,2\n2000000,2,3\n"},
    ),
    Row(
        "a table to encode whose clock goes back",
        "chiplog encode table.csv --out bus.log",
        "table.csv:3: t_s = 0.5: expected seconds from 0, each later than the row before",
        {"table.csv": WHEELS + "\n1,1,2\n0.5,2,3\n"},
    ),
    Row(
        "a table of very many columns to look at",
        "chiplog map table.csv",
        "table.csv: 201 columns: at most 200 can be looked at",
        {"table.csv": ",".join(f"c{k}" for k in range(201)) + "\n"},
    ),
    Row(
        "a table to look at without a clock",
        "chiplog map table.csv",
        "table.csv: no clock among the columns: expected one with time, stamp, t or a unit of "
        "time in its name whose values ascend",
        {"table.csv": table("a,b", lambda k: f"{k},{k}")},
    ),
    Row(
        "a table to look at whose clock goes back",
        "chiplog map table.csv",
        "table.csv: t_s goes back, from 1.49 in row 150 to 0 in the next: expected rows in the "
        "order of time, of one recording",
        {"table.csv": table(WHEELS, lambda k: f"{k % 150 / 100},{k},{k}")},
    ),
    Row(
        "a table to look at whose wheels never turn",
        "chiplog map table.csv",
        "left_wheel_ticks has the name of a wheel, and never changes (7): expected a log in which "
        "the robot drives",
        {"table.csv": table("t_s,left_wheel_ticks,right_wheel_ticks", lambda k: f"{k / 100},7,7")},
    ),
    Row(
        "a table in UTF-16",
        "chiplog map table.csv",
        "table.csv: no text in UTF-8, as UTF-16 is none: expected UTF-8",
        {"table.csv": DRIVE.encode("utf-16-le")},
    ),
    Row(
        "a table whose rows come in bursts",
        "chiplog diagnose table.csv",
        "table.csv: 300 of 6,636 ticks of 0.3 ms have frames or rows of the wheels: expected them "
        "evenly in time, each once, not in bursts",
        {
            "table.csv": table(
                WHEELS, lambda k: f"{k // 3 * 0.02 + k % 3 * 0.0003:.6f},{3 * k},{4 * k}"
            )
        },
    ),
    Row(
        "a table to look at with few numbers",
        "chiplog map table.csv",
        "table.csv: no column with 10 numbers: expected a table of a drive",
        {"table.csv": "t_s,a\n0,1\n0.01,2\n"},
    ),
    Row(
        "a table to look at without wheels",
        "chiplog map table.csv",
        "no signal looks like left_count or right_count: expected a wheel's counts, angle, "
        "distance or speed among t_s, a; --is left_count=SIGNAL says which",
        {"table.csv": table("t_s,a", lambda k: f"{k / 100},0")},
    ),
    Row(
        "a table to look at whose wheels have no unit",
        "chiplog map table.csv",
        "WHEEL_FL has the name of a wheel, and no unit: expected it in a map.toml, below "
        "[columns], as in "
        'left_count = { column = "WHEEL_FL", unit = "km/h" }',
        {"table.csv": table("t_s,WHEEL_FL,WHEEL_FR", lambda k: f"{k / 100},{k / 7},{k / 9}")},
    ),
    Row(
        "two columns that could be one sensor",
        "chiplog map table.csv",
        "gyro could be gyro_z_a_rad_s as well as gyro_z_b_rad_s: nothing in names, units or "
        "values tells them apart: expected --is gyro=gyro_z_a_rad_s or --is gyro=gyro_z_b_rad_s",
        {
            "table.csv": table(
                WHEELS + ",gyro_z_a_rad_s,gyro_z_b_rad_s",
                lambda k: f"{k / 100},{3 * k},{3 * k + k * k // 40},{k / 3000},{k / 3000}",
            )
        },
    ),
)
