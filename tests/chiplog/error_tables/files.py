"""Robot descriptions, scenarios and effects."""

from __future__ import annotations

from error_tables.row import Row

ROBOT_DESCRIPTION: tuple[Row, ...] = (
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
        "10000000, for example 2048",
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
)

SCENARIO: tuple[Row, ...] = (
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
        "seed = -1: expected a whole number from 0 to 2^128 − 1, such as 7",
    ),
)

EFFECTS: tuple[Row, ...] = (
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
        "effect gyro_bias.bias: expected NAME.PARAMETER=VALUE, for example gyro_bias.bias=0.005",
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
)

_SEGMENT = """name = "mine"
[[segments]]
v_m_s = 0.5
w_rad_s = 0.0
duration_s = 5.0
"""


def _scenario(when: str, text: str, line: str) -> Row:
    return Row(when, "chiplog run --scenario mine.toml", line, {"mine.toml": text})


def _effects(when: str, text: str, line: str) -> Row:
    return Row(when, "chiplog run --effects effects.toml", line, {"effects.toml": text})


ROBOT_DESCRIPTION += (
    Row(
        "a file that cannot be read",
        "chiplog run --robot robot.toml/robot.toml",
        "robot.toml/robot.toml: cannot be read: Not a directory",
        {"robot.toml": ""},
    ),
    Row(
        "a table that does not exist",
        "chiplog run --robot robot.toml",
        "robot.toml:1: encoders: unknown key: the nearest is encoder",
        {"robot.toml": "[encoders]\nticks_per_rev = 2048\n"},
    ),
    Row(
        "a file that is too large",
        "chiplog run --robot robot.toml",
        "robot.toml: larger than 256 KiB: expected a TOML file written by a person",
        {"robot.toml": "#" * (256 * 1024 + 1)},
    ),
    Row(
        "a number of very many digits",
        "chiplog run --robot robot.toml",
        "robot.toml: a number of over 4300 digits: expected fewer",
        {"robot.toml": "schema = " + "9" * 5000 + "\n"},
    ),
    Row(
        "more than one problem",
        "chiplog run --robot robot.toml",
        "robot.toml:1: schema = 2: expected 1 (and 1 more problem)",
        {"robot.toml": "schema = 2\n[wheels]\nradius_m = 'wide'\n"},
    ),
)

SCENARIO += (
    _scenario(
        "a scenario without segments",
        'name = "mine"\nsegments = []\n',
        "mine.toml:2: segments = []: expected a list of 1 to 10000 values, each a table "
        "with v_m_s, w_rad_s, duration_s, ramp_s",
    ),
    _scenario(
        "a ramp longer than its segment",
        _SEGMENT + "ramp_s = 6.0\n",
        "mine.toml:6: segments[1]: a ramp of 6 s does not fit into 5 s: expected ramp_s "
        "of at most 5",
    ),
    _scenario(
        "a duration that cuts segments off",
        _SEGMENT.replace("[[seg", "duration_s = 2.0\n[[seg"),
        "mine.toml:2: duration_s = 2 cuts off segments of 5 s: expected at least 5, or none",
    ),
    _scenario(
        "segments that last too long",
        _SEGMENT[:14] + 2 * _SEGMENT[14:].replace("5.0", "400000.0"),
        "mine.toml:2: segments last 800000 s: expected at most 604800",
    ),
    _scenario(
        "a speed that its frame cannot carry",
        _SEGMENT.replace("0.5", "8.0"),
        "scenario mine: COMMAND.v_m_s = 7.999999999999963 m/s: expected "
        "-7.999999046325684 to 7.999999046325684 m/s",
    ),
    Row(
        "a random scenario of a seed below zero",
        "chiplog run --scenario random --seed -1",
        "seed -1: expected a whole number from 0 to 2^64 - 1",
    ),
)

EFFECTS += (
    _effects(
        "an effect in a file that is no table",
        "gyro_bias = 0.005\n",
        "effects.toml:1: gyro_bias = 0.005: expected a table per effect, for example "
        "[gyro_bias] with bias = 0.005",
    ),
    _effects(
        "an unknown parameter in a file",
        "[gyro_bias]\nbais = 0.005\n",
        "effects.toml:2: gyro_bias.bais: gyro_bias has no such parameter: the nearest is bias",
    ),
    _effects(
        "a value in a file beyond its range",
        "[gyro_bias]\nbias = 5000.0\n",
        "effects.toml:2: gyro_bias.bias = 5000.0: expected a number from -1000 to 1000 [rad/s]",
    ),
    _scenario(
        "effects of a scenario that are no table",
        "effects = 3\n" + _SEGMENT,
        "mine.toml:1: effects = 3: expected a table per effect, for example [gyro_bias] "
        "with bias = 0.005",
    ),
)
