"""What a study can be asked wrongly, and what no study can do."""

from __future__ import annotations

from error_tables.row import Row

STUDIES: tuple[Row, ...] = (
    Row(
        "a requirement in another form",
        "chiplog study --meet 'within 5 mm'",
        "--meet 'within 5 mm': expected the form \"arithmetic position 5 mm after 100 m\"",
    ),
    Row(
        "a requirement in a unit that it does not have",
        "chiplog study --meet 'position 5 deg after 100 m'",
        "--meet 'position 5 deg after 100 m': position in 'deg': expected one of m, cm, mm, "
        "um, µm, nm",
    ),
    Row(
        "a requirement after what is neither way nor time",
        "chiplog study --meet 'position 5 mm after 3 laps'",
        "'position 5 mm after 3 laps': after so many 'laps': expected one of m, km, s, min, h",
    ),
    Row(
        "a course too long",
        "chiplog study --after '5000 km'",
        "'5000 km': expected at most 1e+06 m, or a week",
    ),
    Row(
        "a requirement without a size",
        "chiplog study --meet 'position -5 mm after 100 m'",
        "'position -5 mm after 100 m': '-5': expected a number above 0",
    ),
    Row(
        "a course in another form",
        "chiplog study --after far",
        "--after 'far': expected a distance or a time, such as '100 m'",
    ),
    Row(
        "a course beside a requirement that has one",
        "chiplog study --meet 'position 5 mm after 100 m' --after '50 m'",
        "--after '50 m': --meet says how far: expected only one of them",
    ),
    Row(
        "a sweep without values",
        "chiplog study --sweep trig.entries",
        "--sweep 'trig.entries': expected FIELD=VALUE,VALUE,… as in position.frac_bits=12,16,20",
    ),
    Row(
        "a sweep of what is no field",
        "chiplog study --sweep wheels=1,2",
        "--sweep 'wheels=1,2': no axis 'wheels': expected one of tick_rate_hz, adc.bits, "
        "rounding, overflow, carry_remainder, or a field of [firmware]",
    ),
    Row(
        "a sweep with a value twice",
        "chiplog study --sweep mode=gyro,wheel,gyro",
        "--sweep 'mode=gyro,wheel,gyro': a value stands twice: expected each once",
    ),
    Row(
        "a field swept twice",
        "chiplog study --sweep mode=gyro --sweep mode=wheel",
        "--sweep 'mode=wheel': mode stands twice: expected each axis once",
    ),
    Row(
        "a sweep of too many configurations",
        "chiplog study --sweep standstill.ticks=1..60000 --sweep mode=gyro,wheel",
        "--sweep: 120000 configurations: expected 1 to 100000",
    ),
    Row(
        "a swept value that its field does not take",
        "chiplog study --sweep position.frac_bits=16,64",
        "firmware.position.frac_bits = 64: expected less than or equal to 48",
    ),
    Row(
        "a format that C does not have",
        "chiplog study --sweep position.word_bits=64,128",
        "firmware.position.word_bits = 128: expected at most 64, as many as there are in C; only "
        "--kernel python holds more, by --force (with position.word_bits = 128)",
    ),
    Row(
        "a tick rate without a whole period",
        "chiplog study --sweep tick_rate_hz=30",
        "tick_rate_hz = 30: expected 1 to 10000 whose period is a whole number of µs",
    ),
    Row(
        "a converter that there is not",
        "chiplog study --sweep adc.bits=12,24",
        "adc.bits = 24: expected a whole number from 8 to 16",
    ),
    Row(
        "a swept format that overflows",
        "chiplog study --sweep step.frac_bits=28,38",
        "firmware.step.frac_bits = 38: the longest step of a tick, 0.01927 m, does not fit "
        "32 bits: expected at most 36 (with step.frac_bits = 38)",
    ),
    Row(
        "a course that overflows the position",
        "chiplog study --sweep position.word_bits=32 --sweep position.frac_bits=16,28 "
        "--after '100 m'",
        "firmware.position.word_bits = 32: 100 m do not fit with 28 fraction bits: expected "
        "at least 36 bits (with position.word_bits = 32, position.frac_bits = 28)",
    ),
    Row(
        "a swept constant that rounds to zero",
        "chiplog study --sweep step.frac_bits=2 --sweep step.constant_frac_bits=5",
        "firmware.step.constant_frac_bits = 5: the constant 7.708e-05 m rounds to zero: "
        "expected at least 14 (with step.frac_bits = 2, step.constant_frac_bits = 5)",
    ),
    Row(
        "a sine table that does not fit",
        "chiplog study --sweep trig.entries=1024,65536",
        "firmware.trig.entries = 65536: a table of 262148 bytes does not fit --table-bytes "
        "65536: expected at most 8192 (with trig.entries = 65536)",
    ),
    Row(
        "a CORDIC table that does not fit",
        "chiplog study --sweep trig.method=cordic --sweep trig.iterations=30 --table-bytes 130",
        "firmware.trig.iterations = 30: a table of 248 bytes does not fit --table-bytes 130: "
        "expected at most 15 (with trig.method = cordic, trig.iterations = 30)",
    ),
    Row(
        "a study of a drive that gets nowhere",
        "chiplog study --scenario spin --sweep mode=gyro",
        "--scenario spin: drives 0 m in a lap and never reaches 100 m: expected a scenario "
        "that drives, or a course in seconds",
    ),
    Row(
        "a study of more ticks than there is time",
        "chiplog study --after '7000 min' --scenario lesson --sweep tick_rate_hz=1000",
        "420000 s of lesson take 420000001 ticks of 1000 µs: expected 1 to 50000000",
    ),
    Row(
        "a study of a robot that is slower than its drive",
        "chiplog study --robot robot.toml --scenario straight --seeds 1 --sweep mode=gyro",
        "--scenario straight: the robot does not reach 100 m in 27601 ticks: expected one "
        "that is as fast as it is told to be",
        {"robot.toml": "[drive]\nmax_wheel_rate_rad_s = 6.0\n"},
    ),
    Row(
        "a scenario studied twice",
        "chiplog study --scenario lesson --scenario lesson",
        "--scenario lesson: stands twice: expected each name once",
    ),
    Row(
        "a margin of less than one",
        "chiplog study --margin 0.5",
        "--margin 0.5: expected 1 to 1000000",
    ),
    Row(
        "a study of no seeds",
        "chiplog study --seeds 0",
        "--seeds 0: expected a whole number from 1 to 100000",
    ),
    Row(
        "a file where a study goes",
        "chiplog study --sweep mode=gyro --out robot.toml",
        "robot.toml: is a file: --out expects a folder, new or of a study",
        {"robot.toml": "schema = 1\n"},
    ),
    Row(
        "a study's file that is none",
        "chiplog study --sweep mode=gyro --out .",
        "runs.jsonl:1: no line of a study: expected the file as it was written, or another --out",
        {"runs.jsonl": "{}\n"},
    ),
)
