"""Every kind of message a user can meet: what provokes it, the command, and the line.

The table in docs/reference/errors.md is written from these rows, and each row is a test:

    python tests/chiplog/error_rows.py > docs/reference/errors.md
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field

Content = str | bytes


@dataclass(frozen=True)
class Row:
    """One message: when it comes, files that provoke it, the command, the line on stderr.

    `or_line` is what machines say that have what this one lacks. `breaks_after_frames` makes the
    bus fail under way.
    """

    when: str
    command: str
    line: str
    files: Mapping[str, Content] = field(default_factory=dict)
    or_line: str = ""
    breaks_after_frames: int | None = None

    @property
    def words(self) -> list[str]:
        """The command's words after `chiplog`."""
        return shlex.split(self.command)[1:]

    @property
    def slug(self) -> str:
        """A name for the test."""
        return self.when.replace(" ", "-")


_DBC = """VERSION ""
BU_: A B
BO_ 256 SPEED: 8 A
 SG_ v : 0|16@1+ (1,0) [0|65535] "rpm" B
"""
_FRAMES = "(0.000000) vcan0 123#0011\n"
_ODOMETRY = (
    "no odometry frames: expected ODOMETRY_X, ODOMETRY_Y, ODOMETRY_HEADING, ODOMETRY_VELOCITY, "
    "STATUS in the log, to compare the replay with"
)
_NO_VCAN = "as root: modprobe vcan; ip link add dev vcan7 type vcan; ip link set up vcan7"
_IN_PROCESS = (
    "--interface virtual lives inside one process, where no other node could hear this one: use "
    "udp_multicast (this host), socketcan (vcan0, can0) or your adapter's"
)

SECTIONS: Mapping[str, tuple[Row, ...]] = {
    "Usage": (
        Row(
            "a command that does not exist",
            "chiplog rnu",
            "no such command 'rnu'; did you mean 'run'? (see chiplog --help)",
        ),
        Row(
            "an option that does not exist",
            "chiplog run --scenrio lesson",
            "no such option --scenrio; did you mean --scenario? (see chiplog run --help)",
        ),
        Row(
            "a word where a number belongs",
            "chiplog run --seed seven",
            "--seed 'seven': expected a whole number (see chiplog run --help)",
        ),
        Row(
            "a value that is not one of a few",
            "chiplog run --time fast",
            "--time 'fast': expected one of lockstep, real (see chiplog run --help)",
        ),
        Row(
            "an option without its value",
            "chiplog run --seed",
            "option '--seed' requires an argument (see chiplog --help)",
        ),
        Row(
            "an argument that is missing",
            "chiplog schema",
            "missing argument 'SUBJECT'; choose from: robot (see chiplog schema --help)",
        ),
        Row(
            "an argument too many",
            "chiplog run lesson",
            "unexpected argument (lesson) (see chiplog run --help)",
        ),
    ),
    "Robot description": (
        Row(
            "a file that is not there",
            "chiplog run --robot missing.toml",
            "missing.toml: no such file: expected a TOML file",
        ),
        Row(
            "a folder in place of a file",
            "chiplog run --robot .",
            ".: is a folder: expected a TOML file",
        ),
        Row(
            "a truncated TOML file",
            "chiplog run --robot robot.toml",
            "robot.toml:1: not a TOML file: expected ']' at the end of a table declaration near "
            "`[encoder`",
            {"robot.toml": "[encoder\nticks_per_rev = 2048\n"},
        ),
        Row(
            "a file that is not text",
            "chiplog run --robot robot.toml",
            "robot.toml:1: byte 0xFF is not UTF-8: expected a TOML file saved as UTF-8",
            {"robot.toml": b"\xff\xfe\x00"},
        ),
        Row(
            "text in place of a number",
            "chiplog run --robot robot.toml",
            'robot.toml:2: encoder.ticks_per_rev = "2048 ticks": expected a whole number from 1 to '
            "65535, for example 2048",
            {"robot.toml": '[encoder]\nticks_per_rev = "2048 ticks"\n'},
        ),
        Row(
            "a number out of its range",
            "chiplog run --robot robot.toml",
            "robot.toml:2: wheels.radius_m = -0.05: expected a number from 0.001 to 10, for "
            "example 0.05025",
            {"robot.toml": "[wheels]\nradius_m = -0.05\n"},
        ),
        Row(
            "a key that does not exist",
            "chiplog run --robot robot.toml",
            "robot.toml:2: encoder.tick_per_rev: unknown key: the nearest is ticks_per_rev",
            {"robot.toml": "[encoder]\ntick_per_rev = 2048\n"},
        ),
    ),
    "Scenario": (
        Row(
            "a scenario that does not exist",
            "chiplog run --scenario lesosn",
            "no such scenario: lesosn: the nearest is lesson; a file ends in .toml",
        ),
        Row(
            "a scenario file that is not there",
            "chiplog run --scenario mine.toml",
            "mine.toml: no such file: expected a TOML file",
        ),
        Row(
            "a scenario file that lacks something",
            "chiplog run --scenario mine.toml",
            'mine.toml: name is missing: expected letters, digits, - and _, for example "two_arcs" '
            "(and 2 more problems)",
            {"mine.toml": "description = 3\n"},
        ),
        Row(
            "no time at all",
            "chiplog run --duration-s 0",
            "--duration-s 0: expected a positive number of seconds",
        ),
        Row(
            "more time than fits in memory",
            "chiplog run --duration-s 1e9",
            "a run of 100000000000 ticks of 10000 µs: expected 1 to 10000000",
        ),
        Row(
            "a seed below zero",
            "chiplog run --seed -1",
            "seed = -1: expected a whole number from 0 to 2^64 − 1, such as 7",
        ),
    ),
    "Effects": (
        Row(
            "an effect that does not exist",
            "chiplog run --effect gyro_bais.bias=0.005",
            "effect gyro_bais.bias=0.005: no such effect: the nearest is gyro_bias",
        ),
        Row(
            "a parameter that does not exist",
            "chiplog run --effect gyro_bias.bais=0.005",
            "effect gyro_bias.bais=0.005: gyro_bias has no such parameter: the nearest is bias",
        ),
        Row(
            "an effect without a value",
            "chiplog run --effect gyro_bias.bias",
            "effect gyro_bias.bias: expected NAME.PARAMETER=VALUE, for example "
            "gyro_bias.bias=0.005",
        ),
        Row(
            "an effect whose value is no number",
            "chiplog run --effect gyro_bias.bias=lots",
            "effect gyro_bias.bias=lots: expected a number from -1000 to 1000 [rad/s]",
        ),
        Row(
            "a choice that does not exist",
            "chiplog run --effect one_sided_slip.side=top",
            "effect one_sided_slip.side=top: expected one of left, right, both",
        ),
        Row(
            "an effect given twice",
            "chiplog run --effect gyro_bias.bias=1 --effect gyro_bias.bias=2",
            "effect gyro_bias.bias is given twice",
        ),
        Row(
            "an unknown effect in a file",
            "chiplog run --effects effects.toml",
            "effects.toml:1: gyro_bais: no such effect: the nearest is gyro_bias",
            {"effects.toml": "[gyro_bais]\nbias = 0.005\n"},
        ),
        Row(
            "asking about an effect that does not exist",
            "chiplog effects gyro_bais",
            "no such effect 'gyro_bais'; did you mean gyro_bias?",
        ),
    ),
    "DBC and signal map": (
        Row(
            "a DBC that is not there",
            "chiplog run --dbc missing.dbc",
            "missing.dbc: cannot read this DBC file: No such file or directory",
        ),
        Row(
            "a DBC that is something else",
            "chiplog run --dbc mine.dbc",
            "mine.dbc:1: invalid DBC syntax at column 1: >>!<<this is no DBC",
            {"mine.dbc": "this is no DBC\n"},
        ),
        Row(
            "a DBC that ends before its first message",
            "chiplog run --dbc mine.dbc",
            "mine.dbc:1: no message (BO_) in this DBC file: is it truncated?",
            {"mine.dbc": _DBC[: _DBC.index("BO_")]},
        ),
        Row(
            "a DBC with a number far too large",
            "chiplog run --dbc mine.dbc",
            "mine.dbc:3: SPEED: a length of 100000000 bytes: expected 0 to 64",
            {"mine.dbc": _DBC.replace("SPEED: 8", "SPEED: 100000000")},
        ),
        Row(
            "a DBC without a map",
            "chiplog run --dbc mine.dbc",
            "mine.dbc has no ENCODER.left_count: a DBC with names of its own needs --signals "
            "map.toml, which says what its signals mean",
            {"mine.dbc": _DBC},
        ),
        Row(
            "a map that is not there",
            "chiplog run --signals map.toml",
            "map.toml: no such file: expected a TOML file",
        ),
        Row(
            "a map without its table",
            "chiplog run --signals map.toml",
            "map.toml: signals is missing: expected a table [signals]",
            {"map.toml": "schema = 1\n"},
        ),
    ),
    "Firmware under test": (
        Row(
            "a kind of device that does not exist",
            "chiplog run --device banana",
            "device 'banana': expected python:FILE.py:CLASS, lib:FILE.so, process:COMMAND, or none "
            "(the ECU is on the bus already)",
        ),
        Row(
            "a Python file that is not there",
            "chiplog run --device python:node.py:Node",
            "device python:node.py: no such file",
        ),
        Row(
            "a Python class that is not there",
            "chiplog run --device python:node.py:Nod",
            "device python:node.py:Nod: node.py has no class 'Nod'",
            {"node.py": "class Node:\n    pass\n"},
        ),
        Row(
            "a Python class that is no node",
            "chiplog run --device python:node.py:Node",
            "device Node: has no step(now_us, frames); a device returns from it the frames that it "
            "sends",
            {"node.py": "class Node:\n    pass\n"},
        ),
        Row(
            "a shared library that is not there",
            "chiplog run --device lib:node.so",
            "device lib:node.so: no such file",
        ),
        Row(
            "a program that is not there",
            "chiplog run --device process:./node",
            "device process:./node: cannot be started: No such file or directory",
        ),
        Row(
            "an ECU that cannot reach the bus",
            "chiplog run --device none",
            "device none: no ECU can reach the in-process interface 'virtual'; use --interface "
            "socketcan, udp_multicast or your hardware",
        ),
    ),
    "Bus": (
        Row(
            "an interface without a channel",
            "chiplog run --interface socketcan",
            "--interface socketcan needs a channel: expected --channel vcan0",
        ),
        Row(
            "a CAN interface that is not there",
            "chiplog run --interface socketcan --channel vcan7",
            f"socketcan: this kernel has no SocketCAN; {_NO_VCAN}",
            or_line=f"socketcan: there is no network interface 'vcan7'; {_NO_VCAN}",
        ),
        Row(
            "a multicast group that is none",
            "chiplog run --interface udp_multicast --channel 10.0.0.1",
            "udp_multicast channel '10.0.0.1': expected an IPv4 multicast group, for example "
            "239.74.163.2",
        ),
        Row(
            "simulated time on a real bus",
            "chiplog run --interface udp_multicast --time lockstep",
            "--time lockstep --interface udp_multicast: that bus has no simulated clock; expected "
            "--interface virtual, or --time real",
        ),
        Row(
            "a bus argument that is none",
            "chiplog run --bus-arg interface_ip",
            "--bus-arg 'interface_ip': expected KEY=VALUE, for example interface_ip=127.0.0.1",
        ),
        Row(
            "a node alone on an in-process bus",
            "chiplog node plant --interface virtual",
            _IN_PROCESS,
        ),
        Row(
            "a bus that goes away under way",
            "chiplog run --channel bench",
            "the bus 'Virtual bus channel bench' went away: cannot send: adapter unplugged",
            breaks_after_frames=500,
        ),
    ),
    "Logs": (
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
    ),
    "Output": (
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
    ),
}

_HEAD = """# Error messages and exit statuses

| status | meaning |
|---|---|
| 0 | done; a verdict of any kind is an answer, not an error |
| 1 | done, and the answer to what was asked is no: a replay that differs, a law violated |
| 2 | bad usage or bad input: one line on standard error says what, where and what to do |
| 130 | interrupted by Ctrl-C: what was recorded so far is complete and readable |

Every message is one line that begins with `chiplog:`. `--debug`, anywhere on the command line, adds
the traceback. Each line below is printed by a test of this repository, word for word.
"""


def page() -> str:
    """Return docs/reference/errors.md."""
    parts = [_HEAD]
    for section, rows in SECTIONS.items():
        parts.append(f"## {section}\n\n| what is wrong | for example | message |\n|---|---|---|")
        parts += [
            f"| {_cell(row.when)} | `{_cell(row.command)}` | {_messages(row)} |" for row in rows
        ]
        parts.append("")
    return "\n".join(parts).rstrip("\n") + "\n"


def _messages(row: Row) -> str:
    lines = filter(None, (row.line, row.or_line))
    return "<br>or ".join(f"`chiplog: {_cell(line)}`" for line in lines)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    print(page(), end="")
