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
        "map.toml: signals is missing: expected a table [signals]",
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
