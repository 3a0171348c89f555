"""What is asked wrongly of a diagnosis."""

from __future__ import annotations

from error_tables.row import Row

DIAGNOSIS: tuple[Row, ...] = (
    Row(
        "a held-out trajectory without its log",
        "chiplog diagnose run.log --holdout-reference b.tum",
        "--holdout-reference without --holdout: expected the log it belongs to",
    ),
    Row(
        "a log held out from itself",
        "chiplog diagnose run.log --holdout run.log",
        "--holdout run.log: the fit sees this log too: expected one that it never saw",
    ),
    Row(
        "a result into a folder that is not there",
        "chiplog diagnose run.log --json out/OUT.json",
        "out/OUT.json: there is no folder out: make it first",
    ),
    Row(
        "a result that is a folder",
        "chiplog diagnose run.log --html .",
        ".: is a folder: expected the name of a file",
    ),
    Row(
        "a known effect that another log cannot be held against",
        "chiplog diagnose run.log --effects explained.toml",
        "explained.toml: one_sided_slip cannot be known beforehand: start_s is a time of one log: "
        "expected the file without it",
        {"explained.toml": '[one_sided_slip]\nside = "left"\nratio = 0.03\nstart_s = 12.0\n'},
    ),
    Row(
        "a known mistake of the set-up",
        "chiplog diagnose run.log --effects explained.toml",
        "explained.toml: setup_sign cannot be known beforehand: a mistake of the set-up is to be "
        "put right: expected the file without it",
        {"explained.toml": '[setup_sign]\nsignal = "gyro"\n'},
    ),
    Row(
        "a known effect whose interval is none",
        "chiplog diagnose run.log --effects explained.toml",
        "explained.toml:3: gyro_bias.bias_ci95 = [0.01, 0.02]: expected a 95 % interval "
        "[low, high] around 0.005",
        {"explained.toml": "[gyro_bias]\nbias = 0.005\nbias_ci95 = [0.01, 0.02]\n"},
    ),
    Row(
        "a bound without its sign",
        "chiplog diagnose run.log --fail-if 'position 5 mm'",
        "'position 5 mm': expected METRIC > NUMBER UNIT [per NUMBER UNIT], for example "
        '"position > 5 mm per 10 m"',
    ),
    Row(
        "a bound on what is no metric",
        "chiplog diagnose run.log --fail-if 'speed > 5 mm'",
        "'speed': no such metric: expected position, heading, drive, firmware, turn, timing",
    ),
    Row(
        "a bound without a number",
        "chiplog diagnose run.log --fail-if 'position > five mm'",
        "'five mm': expected NUMBER UNIT [per NUMBER UNIT], for example "
        '"position > 5 mm per 10 m"',
    ),
    Row(
        "a bound without end",
        "chiplog diagnose run.log --fail-if 'position > 1e999 mm'",
        '1e999: expected a finite number, for example "position > 5 mm per 10 m"',
    ),
    Row(
        "a bound in a unit of something else",
        "chiplog diagnose run.log --fail-if 'position > 5 deg'",
        "'deg': no unit of position: expected m, cm, mm, µm, um",
    ),
    Row(
        "a bound per something that is no length or time",
        "chiplog diagnose run.log --fail-if 'position > 5 mm per lap'",
        "per 'lap': expected a length or a time: m, cm, mm, µm, um, s, ms, µs, us, min, km",
    ),
    Row(
        "a bound per nothing",
        "chiplog diagnose run.log --fail-if 'position > 5 mm per 0 m'",
        "per 0 m: expected more than 0",
    ),
)
