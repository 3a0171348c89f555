"""Every kind of message a user can meet: what provokes it, the command, and the line.

The table in docs/reference/errors.md is written from these rows, and each row is a test:

    python tests/chiplog/error_rows.py > docs/reference/errors.md
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field

from can_bus import shipped_path

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
_WHEELS = """[signals]
left_count = "ENCODER.left_count"
right_count = "ENCODER.right_count"
"""
_STEP = "class Node:\n    def step(self, now_us, frames):\n        "
_SLOW_DBC = (
    shipped_path()
    .read_text(encoding="utf-8")
    .replace('BA_ "GenMsgCycleTime" BO_ 745 310;', 'BA_ "GenMsgCycleTime" BO_ 745 25;')
)
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
        Row(
            "an empty folder name",
            "chiplog run --out ''",
            "empty word '' after --out: expected a name or a value",
        ),
        Row(
            "an empty folder name to start in",
            "chiplog init ''",
            "empty word '' after init: expected a name or a value",
        ),
        Row(
            "a bit rate of nothing",
            "chiplog run --bitrate 0",
            "--bitrate 0: expected a whole number from 1 to 1000000 [bit/s]",
        ),
        Row(
            "a bit rate that classic CAN has not",
            "chiplog node plant --interface socketcan --bitrate 1000001",
            "--bitrate 1000001: expected a whole number from 1 to 1000000 [bit/s]",
        ),
        Row(
            "a scenario for the firmware",
            "chiplog node firmware --interface udp_multicast --scenario square",
            "node firmware --scenario: scenario, effects and seed are the plant's; give them to "
            "chiplog node plant",
        ),
        Row(
            "a seed for the firmware",
            "chiplog node firmware --interface udp_multicast --seed 0",
            "node firmware --seed: scenario, effects and seed are the plant's; give them to "
            "chiplog node plant",
        ),
        Row(
            "an effect for the firmware",
            "chiplog node firmware --interface udp_multicast --effect gyro_bias.bias=1",
            "node firmware --effect: scenario, effects and seed are the plant's; give them to "
            "chiplog node plant",
        ),
        Row(
            "a file of effects for the firmware",
            "chiplog node firmware --interface udp_multicast --effects effects.toml",
            "node firmware --effects: scenario, effects and seed are the plant's; give them to "
            "chiplog node plant",
        ),
        Row(
            "a law that does not exist",
            "chiplog laws gyro_bais_heading",
            "no such law 'gyro_bais_heading'; did you mean gyro_bias_heading?",
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
        Row(
            "a schema of another version",
            "chiplog run --robot robot.toml",
            "robot.toml:1: schema = 2: expected 1",
            {"robot.toml": "schema = 2\n"},
        ),
        Row(
            "a key given twice",
            "chiplog run --robot robot.toml",
            "robot.toml:3: not a TOML file: cannot overwrite a value near `ticks_per_rev = 4096`",
            {"robot.toml": "[encoder]\nticks_per_rev = 2048\nticks_per_rev = 4096\n"},
        ),
        Row(
            "a file nested too deep",
            "chiplog run --robot robot.toml",
            "robot.toml:1: tables or lists are nested too deeply: expected at most 32 levels",
            {"robot.toml": "a = " + "[" * 200 + "]" * 200 + "\n"},
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
        Row(
            "a DBC that breaks off within a statement",
            "chiplog run --dbc mine.dbc",
            "mine.dbc:4: this DBC file breaks off within a statement",
            {"mine.dbc": _DBC[:-30]},
        ),
        Row(
            "an identifier that two messages share",
            "chiplog run --dbc mine.dbc",
            "mine.dbc:5: TORQUE has the identifier of SPEED: each needs its own",
            {"mine.dbc": _DBC + 'BO_ 256 TORQUE: 8 A\n SG_ t : 0|16@1+ (1,0) [0|65535] "" B\n'},
        ),
        Row(
            "a signal that does not fit its message",
            "chiplog run --dbc mine.dbc",
            "mine.dbc:4: The signal v does not fit in message SPEED.",
            {"mine.dbc": _DBC.replace("0|16@1+", "56|16@1+")},
        ),
        Row(
            "a signal with a factor of zero",
            "chiplog run --dbc mine.dbc",
            "mine.dbc:4: SPEED.v: factor 0.0 and offset 0.0: both must be finite "
            "and the factor not 0",
            {"mine.dbc": _DBC.replace("(1,0)", "(0,0)")},
        ),
        Row(
            "a message longer than CAN FD has",
            "chiplog run --dbc mine.dbc",
            "mine.dbc:3: SPEED: a length of 800 bytes: expected 0 to 64",
            {"mine.dbc": _DBC.replace("SPEED: 8", "SPEED: 800")},
        ),
        Row(
            "a role that does not exist",
            "chiplog run --signals map.toml",
            "map.toml:4: signals.gyroo: no such role: the nearest is gyro",
            {"map.toml": _WHEELS + 'gyroo = "IMU.gyro_z_raw"\n'},
        ),
        Row(
            "a message that the DBC has not",
            "chiplog run --signals map.toml",
            'map.toml:4: gyro = "IMUU.gyro_z_raw": chiplog.dbc has no such message: '
            "the nearest is IMU",
            {"map.toml": _WHEELS + 'gyro = "IMUU.gyro_z_raw"\n'},
        ),
        Row(
            "a signal that the message has not",
            "chiplog run --signals map.toml",
            'map.toml:4: gyro = "IMU.gyro_raw": IMU has no such signal: the nearest is gyro_z_raw',
            {"map.toml": _WHEELS + 'gyro = "IMU.gyro_raw"\n'},
        ),
        Row(
            "a unit that does not fit its role",
            "chiplog run --signals map.toml",
            "map.toml:4: gyro: IMU.gyro_z_raw has unit m: expected none (adc_code), "
            "rad/s, mrad/s, deg/s, turn/s, rpm",
            {"map.toml": _WHEELS + 'gyro = { signal = "IMU.gyro_z_raw", unit = "m" }\n'},
        ),
        Row(
            "a unit where the DBC gives one",
            "chiplog run --signals map.toml",
            'map.toml:4: v_command: unit = "km/h": the DBC gives COMMAND.v_m_s the '
            "unit m/s: expected no unit here",
            {"map.toml": _WHEELS + 'v_command = { signal = "COMMAND.v_m_s", unit = "km/h" }\n'},
        ),
        Row(
            "a kind that does not fit its role",
            "chiplog run --signals map.toml",
            'map.toml:4: signals.gyro.kind = "wrapping_count": expected one of '
            '"counts", "adc_code", "physical"',
            {
                "map.toml": _WHEELS
                + 'gyro = { signal = "IMU.gyro_z_raw", kind = "wrapping_count" }\n'
            },
        ),
        Row(
            "a converter code that counts backwards",
            "chiplog run --signals map.toml",
            "map.toml:4: gyro: invert = true: IMU.gyro_z_raw is a converter code: "
            "expected counts or a quantity",
            {"map.toml": _WHEELS + 'gyro = { signal = "IMU.gyro_z_raw", invert = true }\n'},
        ),
        Row(
            "a signal mapped twice",
            "chiplog run --signals map.toml",
            "map.toml:3: right_count = ENCODER.left_count: already mapped as left_count",
            {"map.toml": _WHEELS.replace("ENCODER.right", "ENCODER.left")},
        ),
        Row(
            "a wheel that is not mapped",
            "chiplog run --signals map.toml",
            "map.toml: right_count is missing: dead reckoning needs right_count = "
            '"MESSAGE.signal" under [signals]',
            {"map.toml": '[signals]\nleft_count = "ENCODER.left_count"\n'},
        ),
        Row(
            "a signal without its message",
            "chiplog run --signals map.toml",
            'map.toml:2: signals.left_count = "left_count": expected '
            '"MESSAGE.signal" of the DBC or a table with signal, kind, unit, invert',
            {"map.toml": '[signals]\nleft_count = "left_count"\n'},
        ),
        Row(
            "a cycle that is no multiple of the tick",
            "chiplog run --dbc mine.dbc --duration-s 1",
            "ENVIRONMENT: cycle 25000 µs, start delay 50000 µs: both must be "
            "multiples of the tick period, 10000 µs (the wheel counter's cycle)",
            {"mine.dbc": _SLOW_DBC},
        ),
        Row(
            "a wheel message without a cycle time",
            "chiplog run --dbc mine.dbc --signals map.toml",
            "SPEED has no GenMsgCycleTime: expected one, for example 10 ms, as the "
            "left wheel's message sets the tick period",
            {
                "mine.dbc": _DBC.replace('"rpm"', '""')
                + ' SG_ w : 16|16@1+ (1,0) [0|65535] "" B\n',
                "map.toml": '[signals]\nleft_count = "SPEED.v"\nright_count = "SPEED.w"\n',
            },
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
        Row(
            "a Python step that raises",
            "chiplog run --device python:node.py:Node",
            "device Node: raised ZeroDivisionError: division by zero (node.py:3) at 0.000000 s",
            {"node.py": _STEP + "return 1 / 0\n"},
        ),
        Row(
            "a Python step that returns something else",
            "chiplog run --device python:node.py:Node",
            "device Node: step returned int at 0.000000 s; expected a list of "
            "can.Message, which may be empty",
            {"node.py": _STEP + "return 7\n"},
        ),
        Row(
            "a Python step whose list holds something else",
            "chiplog run --device python:node.py:Node",
            "device Node: step returned a int at 0.000000 s where a can.Message was expected",
            {"node.py": _STEP + "return [7]\n"},
        ),
        Row(
            "a Python file that raises",
            "chiplog run --device python:node.py:Node",
            "device python:node.py: importing it raised ZeroDivisionError: division "
            "by zero (node.py:1)",
            {"node.py": "1 / 0\n"},
        ),
        Row(
            "a Python class that raises",
            "chiplog run --device python:node.py:Node",
            "device python:node.py:Node: creating it raised OSError: no licence (node.py:3)",
            {
                "node.py": "class Node:\n    def __init__(self):\n"
                "        raise OSError('no licence')\n"
            },
        ),
        Row(
            "a Python file without a class",
            "chiplog run --device python:node.py",
            "device python:node.py: expected python:FILE.py:CLASS or python:PACKAGE.MODULE:CLASS",
        ),
        Row(
            "a library that is something else",
            "chiplog run --device lib:node.so",
            "device lib:node.so: cannot be loaded: node.so: file too short",
            {"node.so": "no library"},
        ),
        Row(
            "a program that ends at once",
            "chiplog run --device \"process:sh -c 'exit 3'\"",
            "device sh: ended with exit status 3 at 0.000000 s",
        ),
        Row(
            "a program that says something else",
            "chiplog run --device \"process:sh -c 'read line; echo hello; echo done; cat'\"",
            "device sh: said 'hello' at 0.000000 s; expected a frame like "
            "200#A3C10000D4000000, or done (other output belongs on standard error)",
        ),
        Row(
            "a program that does not answer",
            'chiplog run --device "process:sleep 60"',
            "device sleep: did not answer within 10 s at 0.000000 s; a tick ends "
            "with the line done, flushed",
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
        Row(
            "an interface that does not exist",
            "chiplog run --interface banana --channel 0",
            "no interface 'banana': python-can knows canalystii, cantact, etas, "
            "gs_usb, iscan, ixxat, kvaser, neousys, neovi, nican, nixnet, pcan, "
            "robotell, seeedstudio, serial, slcan, socketcan, socketcand, systec, "
            "udp_multicast, usb2can, vector, virtual",
        ),
        Row(
            "an argument that the interface has not",
            "chiplog run --interface udp_multicast --bus-arg colour=red",
            "udp_multicast has no argument 'colour': it has port, interface_ip, hop_limit",
        ),
        Row(
            "an adapter that cannot be opened",
            "chiplog run --interface slcan --channel /dev/none",
            "cannot open slcan channel '/dev/none': The serial module is not installed",
        ),
        Row(
            "a port that does not exist",
            "chiplog run --interface udp_multicast --bus-arg port=99999",
            "udp_multicast port 99999: expected 1 to 65535",
        ),
        Row(
            "an address that is none",
            "chiplog run --interface udp_multicast --bus-arg interface_ip=here",
            "udp_multicast interface_ip 'here': expected an IPv4 address of this host",
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
            {"bus.log": _FRAMES, "map.toml": _WHEELS},
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
