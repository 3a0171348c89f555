"""What is typed wrong."""

from __future__ import annotations

from error_tables.row import Row

USAGE: tuple[Row, ...] = (
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
        "missing argument 'SUBJECT'; choose from: robot, diagnosis (see chiplog schema --help)",
    ),
    Row(
        "an argument too many",
        "chiplog run lesson",
        "unexpected argument (lesson) (see chiplog run --help)",
    ),
    Row(
        "a kernel that there is not",
        "chiplog run --kernel fast",
        "--kernel 'fast': expected one of compiled, python, c99 (see chiplog run --help)",
    ),
    Row(
        "exported C that would replace a file of yours",
        "chiplog export-c --out .",
        "chiplog_firmware.h: exists already and differs from what would be written; "
        "choose another folder or move it away",
        {"chiplog_firmware.h": "/* mine */\n"},
    ),
    Row(
        "a mission of no time",
        "chiplog ranges --mission-s 0",
        "mission = 0 s: expected more than 0, at most a year",
    ),
    Row(
        "a speed beyond the robot's",
        "chiplog ranges --speed-m-s 9",
        "speed = 9 m/s: expected more than 0, at most 1.5075 m/s, what "
        "drive.max_wheel_rate_rad_s and the radius give",
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
)
