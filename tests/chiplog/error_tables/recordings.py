"""Recordings: logs and tables that are listed, encoded or read."""

from __future__ import annotations

from error_tables.row import Row

_TABLE = "t_s,left_ticks,right_ticks,gyro_code\n" + "".join(
    f"{k / 100},{3 * k},{4 * k},32768\n" for k in range(30)
)
_SIDELESS = "t_s,wheel_a,wheel_b\n" + "".join(f"{k / 100},{3 * k},{4 * k}\n" for k in range(30))
_SPEED_DBC = """VERSION ""
BU_: A B
BO_ 256 WHEELS: 4 A
 SG_ left : 0|16@1- (0.001,0) [-30|30] "m/s" B
 SG_ right : 16|16@1- (0.001,0) [-30|30] "m/s" B
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 256 10;
"""
_SPEED_MAP = '[signals]\nleft_count = "WHEELS.left"\nright_count = "WHEELS.right"\n'
_PLACES = "t_s,left_ticks,right_ticks,x,y\n" + "".join(
    f"{k / 10},{30 * k},{40 * k},{48 + k * 1e-6:.6f},{111 + k * 1e-6:.6f}\n" for k in range(40)
)
_GLOBE_DBC = """VERSION ""
BU_: A B
BO_ 256 WHEELS: 4 A
 SG_ left : 0|16@1+ (1,0) [0|65535] "" B
 SG_ right : 16|16@1+ (1,0) [0|65535] "" B
BO_ 512 GNSS: 8 A
 SG_ lon : 0|32@1- (1E-007,0) [-180|180] "deg" B
 SG_ lat : 32|32@1- (1E-007,0) [-90|90] "deg" B
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 256 10;
BA_ "GenMsgCycleTime" BO_ 512 100;
"""
_GLOBE_MAP = (
    '[signals]\nleft_count = "WHEELS.left"\nright_count = "WHEELS.right"\n'
    'reference_x = "GNSS.lon"\nreference_y = "GNSS.lat"\n'
)


def _places(x_unit: str, y_unit: str) -> str:
    """Return a map of a table whose reference has these units."""
    return (
        '[columns]\ntime = "t_s"\nleft_count = "left_ticks"\nright_count = "right_ticks"\n'
        f'reference_x = {{ column = "x", unit = "{x_unit}" }}\n'
        f'reference_y = {{ column = "y", unit = "{y_unit}" }}\n'
    )


_ODD_DBC = """VERSION ""
BU_: A B
BO_ 256 CAR: 4 A
 SG_ wheel_left : 0|16@1+ (0.01,0) [0|655] "furlong/s" B
 SG_ wheel_right : 16|16@1+ (0.01,0) [0|655] "furlong/s" B
"""
_ODD_LOG = "".join(f"({k / 100:.6f}) can0 100#{k:02X}00{k:02X}00\n" for k in range(30))

RECORDINGS: tuple[Row, ...] = (
    Row(
        "wheel speeds where a loop needs counts",
        "chiplog run --dbc mine.dbc --signals map.toml",
        "WHEELS.left is a wheel's speed, which can only be read from a log: expected counts, an "
        "angle or a distance",
        {"mine.dbc": _SPEED_DBC, "map.toml": _SPEED_MAP},
    ),
    Row(
        "a receiver's fixes where a loop needs metres",
        "chiplog run --reference-frames --dbc mine.dbc --signals map.toml",
        "GNSS.lon is a place on the globe, which can only be read from a log: expected a length",
        {"mine.dbc": _GLOBE_DBC, "map.toml": _GLOBE_MAP},
    ),
    Row(
        "a longitude and a latitude that were exchanged",
        "chiplog diagnose table.csv --signals map.toml",
        "table.csv: a fix at latitude 111°, longitude 48°: expected at most 90° and 360°; "
        "reference_x is the longitude, reference_y the latitude",
        {"table.csv": _PLACES, "map.toml": _places("deg", "deg")},
    ),
    Row(
        "a longitude beside a length",
        "chiplog diagnose table.csv --signals map.toml",
        "table.csv: reference_x measures angle, reference_y length: expected two lengths, or a "
        "longitude and a latitude",
        {"table.csv": _PLACES, "map.toml": _places("deg", "m")},
    ),
    Row(
        "a known role without its signal",
        "chiplog map table.csv --is left_count",
        "--is 'left_count': expected ROLE=SIGNAL, for example left_count=WHEELS.a",
        {"table.csv": _TABLE},
    ),
    Row(
        "a known role that does not exist",
        "chiplog map table.csv --is left=left_ticks",
        "left=left_ticks: no such role: the nearest is left_count",
        {"table.csv": _TABLE},
    ),
    Row(
        "speeds of a wheel without their unit",
        "chiplog map table.csv --is left_count=wheel",
        "left_count=wheel: its values are no whole counts and its name says no unit: expected the "
        "unit in the column's name, as in wheel_m_s, or a map.toml that says it",
        {"table.csv": "t_s,wheel\n" + "".join(f"{k / 100},{k / 8}\n" for k in range(40))},
    ),
    Row(
        "a known signal that does not exist",
        "chiplog map table.csv --is left_count=left_tics",
        "left_count=left_tics: no such signal with values: the nearest is left_ticks",
        {"table.csv": _TABLE},
    ),
    Row(
        "a map that exists already",
        "chiplog map table.csv --out map.toml",
        "map.toml exists: expected a new file, or remove it first",
        {"table.csv": _TABLE, "map.toml": ""},
    ),
    Row(
        "two signals that could be one wheel",
        "chiplog map table.csv",
        "left_count could be wheel_a as well as wheel_b: neither name says left or right: expected "
        "--is left_count=wheel_a or --is left_count=wheel_b",
        {"table.csv": _SIDELESS},
    ),
    Row(
        "a log whose wheels are in an unknown unit",
        "chiplog map bus.log --dbc mine.dbc",
        "CAR.wheel_left has the name of a wheel, and its unit, furlong/s, is not understood: "
        "expected none (counts), m, cm, mm, rad, mrad, deg, turn, m/s, cm/s, mm/s, km/h, mph, "
        "rad/s, mrad/s, deg/s, turn/s, rpm",
        {"bus.log": _ODD_LOG, "mine.dbc": _ODD_DBC},
    ),
    Row(
        "a log that the DBC does not know",
        "chiplog map bus.log",
        "bus.log: no frames that chiplog.dbc knows (unknown_id 1): expected the DBC of this log",
        {"bus.log": "(0.000000) vcan0 123#0011\n"},
    ),
    Row(
        "a table without wheels",
        "chiplog encode table.csv --out bus.log",
        "table.csv: no column left_ticks: the table has t_s, x: expected that name, or --signals "
        'map.toml with left_count = "COLUMN" under [columns]',
        {"table.csv": "t_s,x\n0,1\n"},
    ),
    Row(
        "a table without a clock",
        "chiplog encode table.csv --out bus.log",
        "table.csv: no column t_s or ecu_t_s: the table has left_ticks, right_ticks: expected one "
        'of them, or --signals map.toml with time = { column = "COLUMN", unit = "s" } under '
        "[columns]",
        {"table.csv": "left_ticks,right_ticks\n0,1\n"},
    ),
    Row(
        "a table without a heading",
        "chiplog encode table.csv --out bus.log",
        "table.csv:1: numbers: expected the names of the columns in this line",
        {"table.csv": "0,1\n2,3\n"},
    ),
    Row(
        "a cell that is no number",
        "chiplog encode table.csv --out bus.log",
        "table.csv:3: left_ticks = 'x': expected a number, or nothing where it is missing",
        {"table.csv": "t_s,left_ticks,right_ticks\n0,1,2\n0.01,x,2\n"},
    ),
    Row(
        "a count that is no whole number",
        "chiplog encode table.csv --out bus.log",
        "table.csv:3: left_ticks = 1.5: expected a whole number",
        {"table.csv": "t_s,left_ticks,right_ticks\n0,1,2\n0.01,1.5,2\n"},
    ),
    Row(
        "a row between two ticks",
        "chiplog encode table.csv --out bus.log",
        "table.csv:3: 1.4 ticks after the row before: expected whole multiples of 10 ms, the cycle "
        "of ENCODER",
        {"table.csv": "t_s,left_ticks,right_ticks\n0,1,2\n0.014,2,2\n"},
    ),
)
