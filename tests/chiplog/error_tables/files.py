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
        "seed = -1: expected a whole number from 0 to 2^64 − 1, such as 7",
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
