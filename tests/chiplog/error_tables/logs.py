"""Logs and output folders."""

from __future__ import annotations

import struct
import zlib

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
        "bus.blf: truncated or corrupt BLF file after 0 frames: a header of 72 bytes is missing",
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
        "notes.txt: not a log that can be read here: candump .log, .asc, .blf or .mf4",
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

_ASC = "date Mon Jan 01 00:00:00.000 2024\nbase hex  timestamps absolute\n"
_SLOW = """VERSION ""
BU_: CAR ECU
BO_ 256 WHEELS: 8 CAR
 SG_ left : 0|16@1+ (1,0) [0|65535] "" ECU
 SG_ right : 16|16@1+ (1,0) [0|65535] "" ECU
BO_ 512 POSITION: 8 ECU
 SG_ x : 0|16@1- (0.1,0) [-1000|1000] "mm" CAR
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 10;
"""
_SLOW_MAP = """[signals]
left_count = "WHEELS.left"
right_count = "WHEELS.right"
odom_x = "POSITION.x"
"""
_SLOW_REPLAY = "chiplog replay bus.log --dbc mine.dbc --signals map.toml"


def _blf(*containers: bytes, size: int = 0) -> bytes:
    """Return a BLF file that says it has `size` bytes."""
    head = struct.pack("<4sL", b"LOGG", 144) + bytes(8) + struct.pack("<Q", size)
    return head.ljust(144, b"\0") + b"".join(containers)


def _container(content: bytes, *, deflated: bool = False) -> bytes:
    stored = zlib.compress(content) if deflated else content
    head = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(stored), 10)
    return head + struct.pack("<HxxxxxxLxxxx", 2 * deflated, len(content)) + stored


def _frame(identifier: int) -> bytes:
    head = struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 48, 1, 2, 0, 0, 0)
    return head + struct.pack("<HBBL8s", 1, 0, 8, identifier, bytes(8))


def _log(when: str, name: str, content: str | bytes, line: str) -> Row:
    return Row(when, f"chiplog replay {name}", line, {name: content})


LOGS += (
    _log(
        "a log whose last line is not ended",
        "bus.log",
        _FRAMES.rstrip("\n"),
        "bus.log:1: '(0.000000) vcan0 123#0011': expected an end of line: the log breaks off here",
    ),
    _log(
        "a log with an endless line",
        "bus.log",
        "x" * 2000,
        "bus.log:1: a line of over 1000 characters: not a CAN log",
    ),
    _log(
        "an identifier that is too large",
        "bus.log",
        "(0.000000) vcan0 FFF#0011\n",
        "bus.log:1: '(0.000000) vcan0 FFF#0011': expected a standard identifier up to 7FF",
    ),
    _log(
        "a length that no frame has",
        "bus.log",
        "(0.000000) vcan0 123##0" + "00" * 9 + "\n",
        "bus.log:1: '(0.000000) vcan0 123##0000000000000000000': expected a CAN FD "
        "length (0 to 8, 12, 16, 20, 24, 32, 48, 64)",
    ),
    _log(
        "an ASC log with a broken event",
        "bus.asc",
        _ASC + "0.1 1 123 Rx d Q 00\n",
        "bus.asc:3: '0.1 1 123 Rx d Q 00': expected an ASC event",
    ),
    _log(
        "an ASC log with a frame that is none",
        "bus.asc",
        _ASC + "0.1 1 123 Rx d 8 00\n",
        "bus.asc:3: '0.1 1 123 Rx d 8 00': expected as many data bytes as its length says",
    ),
    _log(
        "a BLF log with a frame that is none",
        "bus.blf",
        _blf(_container(_frame(0xFFF))),
        "bus.blf: frame 1: identifier FFF, length 8, 8 bytes, 0 s: expected a standard "
        "identifier up to 7FF",
    ),
    _log(
        "a BLF log cut at its end",
        "bus.blf",
        _blf(_container(3 * _frame(0x123)), size=9999),
        "bus.blf: truncated BLF file after 3 frames: 320 of 9999 bytes",
    ),
    _log(
        "a BLF log that would fill the memory",
        "bus.blf",
        _blf(_container(bytes(65 << 20), deflated=True)),
        "bus.blf: a container of over 64 MiB: not a BLF file that can be read here",
    ),
    _log(
        "a BLF log with an object of no size",
        "bus.blf",
        _blf(_container(struct.pack("<4sHHLL", b"LOBJ", 32, 1, 0, 2) + bytes(100))),
        "bus.blf: an object of 0 bytes: expected 16 to 1048576",
    ),
    Row(
        "a real-time log with slow odometry",
        _SLOW_REPLAY,
        "bus.log: POSITION comes every 20000 µs, a tick lasts 10000 µs, and the stamps "
        "are not those of whole ticks from 0 on: expected the log of a lockstep run, or odometry "
        "at every tick",
        {
            "bus.log": "(0.001234) vcan0 200#0000000000000000\n",
            "mine.dbc": _SLOW + 'BA_ "GenMsgCycleTime" BO_ 512 20;\n',
            "map.toml": _SLOW_MAP,
        },
    ),
    Row(
        "an odometry frame of another length",
        _SLOW_REPLAY,
        "bus.log: POSITION at tick 0: 1 bytes: expected 8",
        {
            "bus.log": "(0.000000) vcan0 100#0000000000000000\n(0.000000) vcan0 200#00\n",
            "mine.dbc": _SLOW,
            "map.toml": _SLOW_MAP,
        },
    ),
    Row(
        "a log to write on a full disk",
        "chiplog node plant --interface udp_multicast --log bus.log --duration-s 0.2",
        "bus.log: cannot write this log: No space left on device",
        links={"bus.log": "/dev/full"},
    ),
)

LOGS += (
    _log(
        "a BLF log whose objects do not follow each other",
        "bus.blf",
        _blf(_container(b"no object here" + bytes(20))),
        "bus.blf: truncated or corrupt BLF file after 0 frames: no object where one should begin",
    ),
    _log(
        "a BLF log with an object too small for its frame",
        "bus.blf",
        _blf(_container(struct.pack("<4sHHLLLHHQ", b"LOBJ", 32, 1, 40, 1, 2, 0, 0, 0) + bytes(8))),
        "bus.blf: truncated or corrupt BLF file after 0 frames: an object of 40 bytes is too small "
        "for a frame",
    ),
    Row(
        "an export to a file of another kind",
        "chiplog export bus.log --to way.csv",
        "--to way.csv: expected a file that ends in .mcap or .tum",
    ),
    Row(
        "an export with a wheel's error below zero",
        "chiplog export bus.log --to way.tum --contact-noise-mm -1",
        "--contact-noise-mm -1: expected 0 to 1000",
    ),
    Row(
        "an export of a log without odometry",
        "chiplog export bus.log --to way.tum",
        "bus.log: no odometry frames: expected ODOMETRY_X, ODOMETRY_Y, ODOMETRY_HEADING in the log",
        {"bus.log": _FRAMES},
    ),
)
