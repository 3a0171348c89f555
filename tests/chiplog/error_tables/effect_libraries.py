"""A user's own effects, and effects where they cannot act."""

from __future__ import annotations

from error_tables.row import Row

_EFFECT = """from hil_harness.effects import Effect, Settings
EFFECTS = [
    Effect(
        name="NAME",
        stage="gyro",
        signature="Nothing.",
        parameters=(),
        apply=lambda settings, values: settings,
    )
]
"""

EFFECT_LIBRARIES: tuple[Row, ...] = (
    Row(
        "an effect library that is not there",
        "chiplog effects --effect-library mine.py",
        "mine.py: cannot read this effect library: No such file or directory",
    ),
    Row(
        "an effect library that is not text",
        "chiplog effects --effect-library mine.py",
        "mine.py: not a text: expected a Python file in UTF-8",
        {"mine.py": b"\xff\xfe"},
    ),
    Row(
        "an effect library as large as data",
        "chiplog effects --effect-library mine.py",
        "mine.py: larger than 1 MiB: expected a short Python file",
        {"mine.py": "#" * ((1 << 20) + 1)},
    ),
    Row(
        "an effect library that is no Python",
        "chiplog effects --effect-library mine.py",
        "mine.py:1: '[' was never closed: expected a Python file",
        {"mine.py": "EFFECTS = [\n"},
    ),
    Row(
        "an effect library that does not run",
        "chiplog effects --effect-library mine.py",
        "mine.py:2: ZeroDivisionError: division by zero: expected a file that runs",
        {"mine.py": "\nEFFECTS = 1 / 0\n"},
    ),
    Row(
        "an effect library without effects",
        "chiplog effects --effect-library mine.py",
        "mine.py: no list EFFECTS: expected EFFECTS = [Effect(...)], with Effect from "
        "hil_harness.effects; see docs/how-to/my-effect.md",
        {"mine.py": "x = 1\n"},
    ),
    Row(
        "an effect library with something else in its list",
        "chiplog effects --effect-library mine.py",
        "mine.py: EFFECTS[0] is of type int: expected EFFECTS = [Effect(...)], with Effect "
        "from hil_harness.effects; see docs/how-to/my-effect.md",
        {"mine.py": "EFFECTS = [3]\n"},
    ),
    Row(
        "an effect of one's own that has a name of ours",
        "chiplog effects --effect-library mine.py",
        "mine.py: effect 'gyro_bias': there is an effect of that name: expected another",
        {"mine.py": _EFFECT.replace("NAME", "gyro_bias")},
    ),
    Row(
        "an effect of one's own with a name of other letters",
        "chiplog effects --effect-library mine.py",
        "mine.py: effect 'Fog bank': expected a name of small letters, digits and _, for "
        "example battery_sag",
        {"mine.py": _EFFECT.replace("NAME", "Fog bank")},
    ),
    Row(
        "an effect of one's own explained where no prediction holds its data",
        "chiplog effects --effect-library mine.py",
        "mine.py: effect 'drag': explain in stage bus: expected one of stage wheel, encoder, gyro, "
        "reference, whose data a prediction holds, or no explain: the effect is then simulated and "
        "not diagnosed",
        {
            "mine.py": _EFFECT.replace("NAME", "drag")
            .replace("gyro", "bus")
            .replace("settings,\n    )", "settings,\n        explain=lambda p: None,\n    )")
        },
    ),
    Row(
        "a clock's rate for a part of the time",
        "chiplog run --effect clock_skew.skew=0.001 --effect clock_skew.start_s=3",
        "effect clock_skew.start_s: a clock has one rate for the whole log: expected no "
        "start_s and no stop_s",
    ),
    Row(
        "a mistake of the set-up for a part of the time",
        "chiplog run --effect setup_wheels_swapped.start_s=3",
        "effect setup_wheels_swapped.start_s: a mistake of the set-up holds for the whole log: "
        "expected no start_s and no stop_s",
    ),
    Row(
        "a frame to disturb that the DBC has not",
        "chiplog run --effect frame_jitter.sigma=0.001 --effect frame_jitter.frame=IMO",
        "frame = IMO: chiplog.dbc has no such message: expected sensors or one of ENCODER, "
        "IMU, ODOMETRY_X, ODOMETRY_Y, ODOMETRY_HEADING, COMMAND, ODOMETRY_VELOCITY, STATUS, "
        "REFERENCE_POSE, ENVIRONMENT",
    ),
    Row(
        "an effect of the bus in real time",
        "chiplog run --time real --effect clock_skew.skew=0.001",
        "an effect of stage bus needs simulated time: expected --time lockstep, or a bus that "
        "does this by itself",
    ),
    Row(
        "an effect of the firmware on a device",
        "chiplog run --device process:cat --effect stale_heading.cycles=1",
        "an effect of stage firmware changes Chiplog's own firmware: expected no --device",
    ),
)
