"""Logs and output folders."""

from __future__ import annotations

from error_tables.row import WHEELS, Row

_FRAMES = "(0.000000) vcan0 123#0011\n"
_ODOMETRY = (
    "no odometry frames: expected ODOMETRY_X, ODOMETRY_Y, ODOMETRY_HEADING, ODOMETRY_VELOCITY, "
    "STATUS in the log, to compare the replay with"
)

LOGS: tuple[Row, ...] = (
    Row(
        "a log that is not there",
        "chiplog replay bus.log",
        "bus.log: cannot read this log: No such file or directory",
    ),
    Row(
        "a truncated log",
        "chiplog replay bus.log",
        "bus.log:2: '(0.010000) vcan0 0C': expected (seconds.microseconds) channel id#data, "
        "for example (0.010000) vcan0 123#00FF",
        {"bus.log": _FRAMES + "(0.010000) vcan0 0C"},
    ),
    Row(
        "a corrupt binary log",
        "chiplog replay bus.blf",
        "bus.blf: truncated or corrupt BLF file after 0 frames: unpack requires a buffer of 72 "
        "bytes",
        {"bus.blf": b"LOGG" + bytes(20)},
    ),
    Row(
        "a damaged ASC log",
        "chiplog replay bus.asc",
        "bus.asc:2: 'bas#!': expected a line of an ASC log",
        {"bus.asc": "date Mon Jan 01 00:00:00.000 2024\nbas#!\n"},
    ),
    Row(
        "a log without odometry",
        "chiplog replay bus.log",
        f"bus.log: {_ODOMETRY}",
        {"bus.log": _FRAMES},
    ),
    Row(
        "a folder in place of a log",
        "chiplog replay .",
        ".: cannot read this log: Is a directory",
    ),
    Row(
        "a file that is no log",
        "chiplog replay notes.txt",
        "notes.txt: not a log that can be read here: candump .log, .asc or .blf",
        {"notes.txt": "hello\n"},
    ),
    Row(
        "a log to write with an unknown ending",
        "chiplog node plant --interface udp_multicast --log bus.txt",
        "bus.txt: a log ends in .log, .asc, .blf, not '.txt'",
    ),
    Row(
        "a log to write in a folder that is not there",
        "chiplog node plant --interface udp_multicast --log nowhere/bus.log",
        "nowhere/bus.log: cannot create this log: No such file or directory",
    ),
    Row(
        "a replay without an odometry role",
        "chiplog replay bus.log --signals map.toml",
        'map.toml: odom_x is missing: a replay needs odom_x = "MESSAGE.signal" under [signals]',
        {"bus.log": _FRAMES, "map.toml": WHEELS},
    ),
)

OUTPUT: tuple[Row, ...] = (
    Row(
        "a file in place of the output folder",
        "chiplog run --out taken",
        "taken: is a file: --out expects a folder, new or of an earlier run",
        {"taken": ""},
    ),
    Row(
        "a folder that holds somebody else's files",
        "chiplog run --out .",
        "bus.log: no run of chiplog wrote this folder (it has no summary.json of ours), so "
        "nothing is overwritten; name another folder with --out",
        {"bus.log": "mine"},
    ),
    Row(
        "a result file in a folder that is not there",
        "chiplog effects --json nowhere/effects.json",
        "nowhere/effects.json: no such file or directory",
    ),
    Row(
        "a start in a folder that holds one",
        "chiplog init .",
        "robot.toml: exists already and nothing is overwritten; choose another "
        "folder or move it away",
        {"robot.toml": ""},
    ),
    Row(
        "a file in place of a folder to start in",
        "chiplog init taken",
        "taken: is a file; expected a folder, which may not exist yet",
        {"taken": ""},
    ),
    Row(
        "a file in place of the folder for the laws",
        "chiplog laws --out taken",
        "taken: is a file: --out expects a folder",
        {"taken": ""},
    ),
)
