"""Logs and references that a diagnosis cannot be made of."""

from __future__ import annotations

from error_tables.row import Row
from error_tables.tables import DRIVE

_SPLIT = """VERSION ""
BU_: A B
BO_ 256 LEFT: 4 A
 SG_ ticks : 0|16@1+ (1,0) [0|65535] "" B
 SG_ x : 16|16@1- (0.001,0) [-30|30] "m" B
BO_ 257 RIGHT: 4 A
 SG_ ticks : 0|16@1+ (1,0) [0|65535] "" B
 SG_ y : 16|16@1- (0.001,0) [-30|30] "m" B
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 256 10;
BA_ "GenMsgCycleTime" BO_ 257 10;
"""
_MARKED = """VERSION ""
BU_: A B
BO_ 256 WHEELS: 8 A
 SG_ left : 0|16@1+ (1,0) [0|65535] "" B
 SG_ right : 32|17@1+ (1,0) [0|65535] "" B
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 256 10;
VAL_ 256 right 131071 "SNA" ;
"""
_SIDES = '[signals]\nleft_count = "LEFT.ticks"\nright_count = "RIGHT.ticks"\n'


def _frames(*identifiers: str, every_ms: int = 10) -> str:
    return "".join(
        f"({k * every_ms / 1000:.6f}) can0 {name}#{(3 * k % 256):02X}{3 * k // 256:02X}0000\n"
        for k in range(300)
        for name in identifiers
    )


def _poses(stamps: str = "0 1 2 3", pose: str = "0 0 0 0 0 0 1") -> str:
    return "".join(f"{stamp} {pose}\n" for stamp in stamps.split())


def _columns(header: str) -> str:
    """Return a table of 20 rows."""
    names = header.split(",")
    rows = [",".join([f"{k / 10}"] + [f"{1.5 * k}"] * (len(names) - 1)) for k in range(20)]
    return "\n".join([header, *rows]) + "\n"


_POSE = 'reference_x = "LEFT.x"\nreference_y = "RIGHT.y"\n'

DRIVES: tuple[Row, ...] = (
    Row(
        "a log without frames of the wheels",
        "chiplog diagnose a.log",
        "a.log: 0 frames of ENCODER: expected at least 20, as the wheels lie in it; the log "
        "has nothing that the DBC knows (refused: unknown_id 1)",
        {"a.log": "(0.000000) can0 123#0011\n"},
    ),
    Row(
        "a log of a firmware made for another tick",
        "chiplog diagnose a.log --robot robot.toml",
        "robot.toml:2: design.tick_period_us = 20000: the tick of chiplog.dbc is 10000 µs: "
        "expected --dbc with the tick that the firmware was made for",
        {"robot.toml": "[design]\ntick_period_us = 20000\n"},
    ),
    Row(
        "a log that goes back in time",
        "chiplog diagnose a.log",
        "a.log: frame 2 is stamped 8.000 s before an earlier one: expected one recording in the "
        "order of its stamps, by a clock that was not set meanwhile",
        {"a.log": "(9.000000) can0 123#0011\n(1.000000) can0 123#0011\n"},
    ),
    Row(
        "a log without the other wheel",
        "chiplog diagnose a.log --dbc a.dbc --signals map.toml",
        "a.log: no frames of RIGHT: expected them, as right_count lies in it",
        {"a.log": _frames("100"), "a.dbc": _SPLIT, "map.toml": _SIDES},
    ),
    Row(
        "a log of a wheel without one number",
        "chiplog diagnose a.log --dbc a.dbc --signals map.toml",
        "a.log: no valid right wheel count: expected a log with both",
        {
            "a.log": "".join(
                f"({k / 100:.6f}) can0 100#{k:02X}000000FFFF0100\n" for k in range(250)
            ),
            "a.dbc": _MARKED,
            "map.toml": '[signals]\nleft_count = "WHEELS.left"\nright_count = "WHEELS.right"\n',
        },
    ),
    Row(
        "a log with another cycle than its DBC says",
        "chiplog diagnose a.log --dbc a.dbc --signals map.toml",
        "a.log: LEFT comes every 20 ms, a.dbc says 10 ms: expected its GenMsgCycleTime in the DBC",
        {"a.log": _frames("100", "101", every_ms=20), "a.dbc": _SPLIT, "map.toml": _SIDES},
    ),
    Row(
        "a reference's pose in two messages",
        "chiplog diagnose a.log --dbc a.dbc --signals map.toml",
        "a.log: RIGHT.y and LEFT.x are two messages: expected the pose of the reference in one",
        {"a.log": _frames("100", "101"), "a.dbc": _SPLIT, "map.toml": _SIDES + _POSE},
    ),
    Row(
        "an MF4 log that is not there",
        "chiplog diagnose gone.mf4",
        "gone.mf4: cannot read this log: No such file or directory",
    ),
    Row(
        "an MF4 log without its library, or damaged",
        "chiplog diagnose a.mf4",
        'a.mf4: reading MF4 needs asammdf: pip install "chiplog[mf4]", or convert it: '
        "can_logconvert LOG.mf4 LOG.blf",
        {"a.mf4": b"MDF"},
        or_line="a.mf4: not an MF4 file that can be read: its first 64 bytes are not those of one",
    ),
    Row(
        "fewer references than logs",
        "chiplog diagnose a.log b.log --reference a.tum",
        "1 reference for 2 logs: expected one --reference for each log, in order, or none",
    ),
    Row(
        "a ROS recording as reference that is not there",
        "chiplog diagnose table.csv --reference gone.mcap",
        "gone.mcap: cannot read this reference: No such file or directory",
        {"table.csv": DRIVE},
    ),
    Row(
        "a table without positions as reference",
        "chiplog diagnose table.csv --reference gps.csv",
        "gps.csv: no positions among the columns t_s, altitude_m: expected latitude and longitude, "
        "or x and y with their unit, as in x_m and y_m",
        {"table.csv": DRIVE, "gps.csv": _columns("t_s,altitude_m")},
    ),
    Row(
        "a table of positions in no unit as reference",
        "chiplog diagnose table.csv --reference gps.csv",
        "gps.csv: x says no unit: expected it in the column's name, as in x_m",
        {"table.csv": DRIVE, "gps.csv": _columns("t_s,x,y")},
    ),
    Row(
        "a table of two positions as reference",
        "chiplog diagnose table.csv --reference gps.csv",
        "gps.csv: reference_x could be a_x_m as well as b_x_m: nothing in names, units or values "
        "tells them apart: expected one of them only",
        {"table.csv": DRIVE, "gps.csv": _columns("t_s,a_x_m,b_x_m,y_m")},
    ),
    Row(
        "a table as reference whose clock stands",
        "chiplog diagnose table.csv --reference gps.csv",
        "gps.csv: t_s says the same in row 20 and in the next: expected ascending stamps",
        {"table.csv": DRIVE, "gps.csv": _columns("t_s,x_m,y_m") + "1.9,2,2\n"},
    ),
    Row(
        "a table as reference whose quaternion is none",
        "chiplog diagnose table.csv --reference gps.csv",
        "gps.csv: row 2: the quaternion is not of length 1: expected its parts in columns that end "
        "in x, y, z and w",
        {"table.csv": DRIVE, "gps.csv": _columns("t_s,x_m,y_m,qx,qy,qz,qw")},
    ),
    Row(
        "a table as reference without a whole row",
        "chiplog diagnose table.csv --reference gps.csv",
        "gps.csv: fewer than two whole rows: expected a pose in each",
        {
            "table.csv": DRIVE,
            "gps.csv": "t_s,x_m,y_m\n" + "".join(f"{k}.0,{k},\n{k}.5,,{k}\n" for k in range(30)),
        },
    ),
    Row(
        "a reference that is not there",
        "chiplog diagnose table.csv --reference a.tum",
        "a.tum: cannot read this reference: No such file or directory",
        {"table.csv": DRIVE},
    ),
    Row(
        "a reference of one row",
        "chiplog diagnose table.csv --reference a.tum",
        "a.tum: 1 rows: expected at least two, each t x y z qx qy qz qw, eight numbers",
        {"table.csv": DRIVE, "a.tum": _poses("0")},
    ),
    Row(
        "a reference with a row of something else",
        "chiplog diagnose table.csv --reference a.tum",
        "a.tum:5: '4 1 2': expected t x y z qx qy qz qw, eight numbers",
        {"table.csv": DRIVE, "a.tum": _poses() + "4 1 2\n"},
    ),
    Row(
        "a reference with a value that is no number",
        "chiplog diagnose table.csv --reference a.tum",
        "a.tum:1: not a number (NaN or infinity): expected t x y z qx qy qz qw, eight numbers",
        {"table.csv": DRIVE, "a.tum": _poses(pose="0 nan 0 0 0 0 1")},
    ),
    Row(
        "a reference whose stamps go back",
        "chiplog diagnose table.csv --reference a.tum",
        "a.tum:3: the stamp does not come after the one before: expected ascending stamps "
        "(sort -n orders a file)",
        {"table.csv": DRIVE, "a.tum": _poses("0 2 1")},
    ),
    Row(
        "a reference whose quaternion is none",
        "chiplog diagnose table.csv --reference a.tum",
        "a.tum:1: the quaternion is not of length 1: expected t x y z qx qy qz qw, eight numbers",
        {"table.csv": DRIVE, "a.tum": _poses(pose="0 0 0 0 0 0 0")},
    ),
    Row(
        "a reference in milliseconds",
        "chiplog diagnose table.csv --reference a.tum",
        "a.tum lasts from 0.000 to 3000.000 s, table.csv from 0.000 to 2.990 s: expected stamps in "
        "seconds, not in milliseconds",
        {"table.csv": DRIVE, "a.tum": _poses("0 1000 2000 3000")},
    ),
    Row(
        "a reference of another time",
        "chiplog diagnose table.csv --reference a.tum",
        "a.tum lasts from 100.000 to 102.000 s, table.csv from 0.000 to 2.990 s: expected "
        "stamps of one clock that overlap by 2 s or more, or a drive that tells how far the clocks "
        "are apart",
        {"table.csv": DRIVE, "a.tum": _poses("100 101 102")},
    ),
)
