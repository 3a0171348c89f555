"""DBC files and signal maps."""

from __future__ import annotations

from can_bus import shipped_path
from error_tables.row import DBC, WHEELS, Row

_SLOW_DBC = (
    shipped_path()
    .read_text(encoding="utf-8")
    .replace('BA_ "GenMsgCycleTime" BO_ 745 310;', 'BA_ "GenMsgCycleTime" BO_ 745 25;')
)

WIRE: tuple[Row, ...] = (
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
        {"mine.dbc": DBC[: DBC.index("BO_")]},
    ),
    Row(
        "a DBC with a number far too large",
        "chiplog run --dbc mine.dbc",
        "mine.dbc:3: SPEED: a length of 100000000 bytes: expected 0 to 64",
        {"mine.dbc": DBC.replace("SPEED: 8", "SPEED: 100000000")},
    ),
    Row(
        "a DBC without a map",
        "chiplog run --dbc mine.dbc",
        "mine.dbc has no ENCODER.left_count: a DBC with names of its own needs --signals "
        "map.toml, which says what its signals mean",
        {"mine.dbc": DBC},
    ),
    Row(
        "a map that is not there",
        "chiplog run --signals map.toml",
        "map.toml: no such file: expected a TOML file",
    ),
    Row(
        "a map without its table",
        "chiplog run --signals map.toml",
        "map.toml: left_count, right_count are missing: dead reckoning needs left_count = "
        '"MESSAGE.signal" under [signals]',
        {"map.toml": "schema = 1\n"},
    ),
    Row(
        "a DBC that breaks off within a statement",
        "chiplog run --dbc mine.dbc",
        "mine.dbc:4: this DBC file breaks off within a statement",
        {"mine.dbc": DBC[:-30]},
    ),
    Row(
        "an identifier that two messages share",
        "chiplog run --dbc mine.dbc",
        "mine.dbc:5: TORQUE has the identifier of SPEED: each needs its own",
        {"mine.dbc": DBC + 'BO_ 256 TORQUE: 8 A\n SG_ t : 0|16@1+ (1,0) [0|65535] "" B\n'},
    ),
    Row(
        "a signal that does not fit its message",
        "chiplog run --dbc mine.dbc",
        "mine.dbc:4: The signal v does not fit in message SPEED.",
        {"mine.dbc": DBC.replace("0|16@1+", "56|16@1+")},
    ),
    Row(
        "a signal with a factor of zero",
        "chiplog run --dbc mine.dbc",
        "mine.dbc:4: SPEED.v: factor 0.0 and offset 0.0: both must be finite and the factor not 0",
        {"mine.dbc": DBC.replace("(1,0)", "(0,0)")},
    ),
    Row(
        "a message longer than CAN FD has",
        "chiplog run --dbc mine.dbc",
        "mine.dbc:3: SPEED: a length of 800 bytes: expected 0 to 64",
        {"mine.dbc": DBC.replace("SPEED: 8", "SPEED: 800")},
    ),
    Row(
        "a role that does not exist",
        "chiplog run --signals map.toml",
        "map.toml:4: signals.gyroo: no such role: the nearest is gyro",
        {"map.toml": WHEELS + 'gyroo = "IMU.gyro_z_raw"\n'},
    ),
    Row(
        "a message that the DBC has not",
        "chiplog run --signals map.toml",
        'map.toml:4: gyro = "IMUU.gyro_z_raw": chiplog.dbc has no such message: the nearest is IMU',
        {"map.toml": WHEELS + 'gyro = "IMUU.gyro_z_raw"\n'},
    ),
    Row(
        "a signal that the message has not",
        "chiplog run --signals map.toml",
        'map.toml:4: gyro = "IMU.gyro_raw": IMU has no such signal: the nearest is gyro_z_raw',
        {"map.toml": WHEELS + 'gyro = "IMU.gyro_raw"\n'},
    ),
    Row(
        "a unit that does not fit its role",
        "chiplog run --signals map.toml",
        "map.toml:4: gyro: IMU.gyro_z_raw has unit m: expected none (adc_code), "
        "rad/s, mrad/s, deg/s, turn/s, rpm",
        {"map.toml": WHEELS + 'gyro = { signal = "IMU.gyro_z_raw", unit = "m" }\n'},
    ),
    Row(
        "a unit where the DBC gives one",
        "chiplog run --signals map.toml",
        'map.toml:4: v_command: unit = "km/h": the DBC gives COMMAND.v_m_s the '
        "unit m/s: expected no unit here",
        {"map.toml": WHEELS + 'v_command = { signal = "COMMAND.v_m_s", unit = "km/h" }\n'},
    ),
    Row(
        "a kind that does not fit its role",
        "chiplog run --signals map.toml",
        'map.toml:4: signals.gyro.kind = "wrapping_count": expected one of '
        '"counts", "adc_code", "physical"',
        {"map.toml": WHEELS + 'gyro = { signal = "IMU.gyro_z_raw", kind = "wrapping_count" }\n'},
    ),
    Row(
        "a converter code that counts backwards",
        "chiplog run --signals map.toml",
        "map.toml:4: gyro: invert = true: IMU.gyro_z_raw is a converter code: "
        "expected counts or a quantity",
        {"map.toml": WHEELS + 'gyro = { signal = "IMU.gyro_z_raw", invert = true }\n'},
    ),
    Row(
        "a signal mapped twice",
        "chiplog run --signals map.toml",
        "map.toml:3: right_count = ENCODER.left_count: already mapped as left_count",
        {"map.toml": WHEELS.replace("ENCODER.right", "ENCODER.left")},
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
            "mine.dbc": DBC.replace('"rpm"', '""') + ' SG_ w : 16|16@1+ (1,0) [0|65535] "" B\n',
            "map.toml": '[signals]\nleft_count = "SPEED.v"\nright_count = "SPEED.w"\n',
        },
    ),
)

_CAR = """VERSION ""
BU_: CAR ECU
BO_ 256 WHEELS: 8 CAR
 SG_ left : 0|16@1+ (1,0) [0|65535] "" ECU
 SG_ right : 16|16@1+ (1,0) [0|65535] "" ECU
BO_ 257 YAW: 8 CAR
 SG_ rate : 0|16@1- (0.01,0) [-327.68|327.67] "deg/s" ECU
 SG_ code : 16|12@1+ (1,0) [0|4095] "" ECU
BO_ 512 POSITION: 8 ECU
 SG_ x : 0|16@1- (0.1,0) [-1000|1000] "mm" CAR
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_ BO_ "GenMsgStartDelayTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 10;
BA_DEF_DEF_ "GenMsgStartDelayTime" 0;
"""
_CAR_WHEELS = '[signals]\nleft_count = "WHEELS.left"\nright_count = "WHEELS.right"\n'
_CAR_GYRO = _CAR_WHEELS + 'gyro = "YAW.rate"\n'
_E2E = 'BA_DEF_ BO_ "E2EProfile" STRING ;\nBA_DEF_DEF_ "E2EProfile" "P01_1A";\n'
_SHIPPED = shipped_path().read_text(encoding="utf-8")


def _dbc(when: str, text: str, line: str) -> Row:
    return Row(when, "chiplog run --dbc mine.dbc", line, {"mine.dbc": text})


def _car(when: str, dbc: str, signals: str, line: str) -> Row:
    return Row(
        when,
        "chiplog run --dbc mine.dbc --signals map.toml",
        line,
        {"mine.dbc": dbc, "map.toml": signals},
    )


WIRE += (
    _dbc(
        "a DBC that is too large",
        "\n" * (4 * 1024 * 1024 + 1),
        "mine.dbc: over 4 MiB: this is no DBC file",
    ),
    _dbc(
        "a signal that starts far outside",
        DBC.replace("0|16@1+", "99999|16@1+"),
        "mine.dbc:4: v: start bit 99999: expected 0 to 511",
    ),
    _dbc(
        "a signal of very many bits",
        DBC.replace("0|16@1+", "0|99999@1+"),
        "mine.dbc:4: v: a length of 99999 bits: expected 1 to 64",
    ),
    _dbc(
        "multiplexer ranges without end",
        DBC + "SG_MUL_VAL_ 256 v v 0-99999999;\n",
        "mine.dbc:5: v: with this the multiplexer ranges (SG_MUL_VAL_) of the file have "
        "100000000 values: expected 65536 at most",
    ),
    _dbc(
        "a message that stands twice",
        DBC + DBC[DBC.index("BO_") :].replace("256", "257"),
        "mine.dbc:3: SPEED stands twice in this file: each message once",
    ),
    _dbc(
        "a float of a length that floats have not",
        DBC.replace("0|16@1+", "0|8@1+") + "SIG_VALTYPE_ 256 v : 1;\n",
        "mine.dbc:4: SPEED.v: a float of 8 bits does not exist: 16, 32 or 64",
    ),
    _dbc(
        "a protection without room for CRC and counter",
        DBC + _E2E,
        "mine.dbc:3: SPEED: E2EProfile 'P01_1A' wants an 8-bit CRC signal in byte 0 and "
        "a 4-bit counter signal in the low half of byte 1",
    ),
    _dbc(
        "a data ID that is too large",
        DBC.replace("v : 0|16@1+", "n : 8|4@1+")
        + ' SG_ crc : 0|8@1+ (1,0) [0|255] "" B\n'
        + _E2E
        + 'BA_DEF_ BO_ "E2EDataId" INT 0 100000;\nBA_DEF_DEF_ "E2EDataId" 70000;\n',
        "mine.dbc:3: SPEED: E2EDataId = 70000: expected 0 to 65535",
    ),
    _dbc(
        "a protection that cannot be computed",
        _SHIPPED.replace("P01_1A", "P05"),
        "COMMAND: E2EProfile 'P05' cannot be computed here: only 'P01_1A' (AUTOSAR E2E "
        "Profile 1, variant 1A)",
    ),
    _dbc(
        "the shipped messages without their protection",
        "".join(line for line in _SHIPPED.splitlines(keepends=True) if "E2E" not in line),
        "mine.dbc: ENCODER has crc and tick_counter, but no E2E attributes: expected "
        "E2EProfile and E2EDataId, as in the shipped DBC",
    ),
    _car(
        "a start delay of a whole cycle",
        _CAR + 'BA_ "GenMsgStartDelayTime" BO_ 257 20;\n',
        _CAR_GYRO,
        "YAW: start delay 20000 µs: expected less than its cycle, 10000 µs",
    ),
    _car(
        "a sent message without a cycle time",
        _CAR + 'BA_ "GenMsgCycleTime" BO_ 257 0;\n',
        _CAR_GYRO,
        "YAW has no GenMsgCycleTime: expected one, for example 10 ms, to know how often it is sent",
    ),
    _car(
        "a tick that is too long",
        _CAR + 'BA_ "GenMsgCycleTime" BO_ 256 20000;\n',
        _CAR_WHEELS,
        "tick_period_us = 20000000: expected a whole number from 100 to 1000000, for example 10000",
    ),
    _car(
        "a wheel counter narrower than the robot's",
        _CAR.replace("0|16@1+ (1,0) [0|65535]", "0|12@1+ (1,0) [0|4095]"),
        _CAR_WHEELS,
        "WHEELS.left counts to 4095 and back to 0, the robot's encoder to 65535: "
        "expected encoder.counter_bits = 12 in robot.toml, or a wider signal",
    ),
    _car(
        "a wheel that is a float",
        _CAR.replace('left : 0|16@1+ (1,0) [0|65535] ""', 'left : 32|32@1- (1,0) [0|0] "rad"')
        + "SIG_VALTYPE_ 256 left : 1;\n",
        _CAR_WHEELS,
        "WHEELS.left is a float: a wheel needs a signal of whole numbers",
    ),
    _car(
        "counts with a factor",
        _CAR.replace("left : 0|16@1+ (1,", "left : 0|16@1+ (2,"),
        _CAR_WHEELS,
        "map.toml:2: left_count: WHEELS.left has factor 2 and offset 0: counts need a "
        'whole number with factor 1; a quantity needs unit = "…", one of none (counts), '
        "m, cm, mm, rad, mrad, deg, turn, m/s, cm/s, mm/s, km/h, mph, rad/s, mrad/s, deg/s, "
        "turn/s, rpm",
    ),
    _car(
        "a signal too narrow for the converter's codes",
        _CAR,
        _CAR_WHEELS + 'gyro = "YAW.code"\n',
        "YAW.code holds codes from 0 to 4095, the robot's ADC gives 0 to 65535: expected "
        "adc.bits = 12 in robot.toml, or a wider signal",
    ),
    _car(
        "a turn rate that cannot be zero",
        _CAR.replace("0|16@1- (0.01,0) [-327.68|327.67]", "0|16@1+ (0.01,10) [10|300]"),
        _CAR_GYRO,
        "YAW.rate: no turn at raw value -1000: expected it inside the signal's range, 0 to 29000",
    ),
    _car(
        "a position beyond its signal",
        _CAR,
        _CAR_WHEELS + 'odom_x = "POSITION.x"\n',
        "POSITION.x: 1.00216 m is raw value 10022, its range ends at 10000: expected a "
        "wider range in the DBC, or a value named SNA (VAL_) for what is beyond it",
    ),
    Row(
        "a map whose signals are no table",
        "chiplog run --signals map.toml",
        "map.toml:1: signals = 3: expected a table",
        {"map.toml": "signals = 3\n"},
    ),
    Row(
        "a kind of another role",
        "chiplog run --signals map.toml",
        'map.toml:2: left_count: kind = "adc_code": expected one of "counts", "physical"',
        {
            "map.toml": WHEELS.replace(
                '"ENCODER.left_count"', '{ signal = "ENCODER.left_count", kind = "adc_code" }'
            )
        },
    ),
    _car(
        "a wheel that gives its speed",
        _CAR.replace('(1,0) [0|65535] ""', '(0.001,0) [0|65] "m/s"'),
        _CAR_WHEELS,
        "WHEELS.left is a wheel's speed, which can only be read from a log: expected "
        "counts, an angle or a distance",
    ),
)
