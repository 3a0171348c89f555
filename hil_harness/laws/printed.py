"""The lesson's printed numbers, in plain float and through our plant and firmware."""

from __future__ import annotations

import math

import numpy as np
from scipy import stats

from hil_harness.laws.bench import Bench
from hil_harness.laws.law import Check, Evidence, Law
from hil_harness.laws.picture import Panel, Series, law, line, thinned
from hil_harness.laws.statistics import FALSE_ALARM
from hil_harness.lesson import LessonParameters, LessonRun, run_lesson
from sim_plant import Mechanisms

SEED = 7
PRINTED_M = 1e-9
ROUNDED_M = 5e-7
ROUNDED_DEG = 5e-7
COUNTER_WHEEL_M = 6.850275
COUNTER_GYRO_M = 5.280128


def _printed(bench: Bench) -> Evidence:
    run = run_lesson()
    after = run_lesson(gyro_heading="after")
    counter = run_lesson(encoder="lesson_counter")
    real = run_lesson(encoder="counter")
    checks = [
        _length("lesson_wheel_m", 6.850364433010, run.wheel_position_error_m, PRINTED_M),
        _length("lesson_gyro_m", 5.280131440064, run.gyro_position_error_m, PRINTED_M),
        _length("lesson_gyro_after_m", 5.281874284, after.gyro_position_error_m, PRINTED_M),
        _angle("lesson_wheel_deg", 21.043427, run.wheel_heading_error_rad),
        _angle("lesson_gyro_deg", 17.215566, run.gyro_heading_error_rad),
        _length(
            "lesson_counter_wheel_m", COUNTER_WHEEL_M, counter.wheel_position_error_m, ROUNDED_M
        ),
        _length("lesson_counter_gyro_m", COUNTER_GYRO_M, counter.gyro_position_error_m, ROUNDED_M),
        _length("lesson_real_counter_wheel_m", 8.581812, real.wheel_position_error_m, ROUNDED_M),
        _length("lesson_real_counter_gyro_m", 5.281302, real.gyro_position_error_m, ROUNDED_M),
        *_through_the_firmware(bench),
    ]
    time_s = LessonParameters().time_s
    return Evidence(
        tuple(checks),
        (
            Panel(
                "Three trajectories",
                "x [m]",
                "y [m]",
                (
                    _track("wheel only", run.wheel, 1),
                    _track("gyro heading", run.gyro, 2),
                    law("truth", thinned(run.truth[:, 0]), thinned(run.truth[:, 1])),
                ),
                is_map=True,
            ),
            Panel(
                "How far from the truth",
                "time [s]",
                "position error [m]",
                tuple(_errors(time_s, run)),
            ),
        ),
        "The lesson as printed: seed 7, 60 s, both estimators on the same data. It has no law to "
        "break; the table of choices shows what moves its numbers.",
    )


def _through_the_firmware(bench: Bench) -> list[Check]:
    """Run the lesson on our plant with its own noise, and through the integer firmware."""
    end_s = (LessonParameters().sample_count - 1) * bench.tick_s
    journey = bench.drive(
        bench.lesson_commands(end_s),
        Mechanisms(
            radius_scale=1 / 1.005 - 1,
            radius_mismatch=-0.004,
            wheelbase_scale=1 / 0.995 - 1,
            gyro_bias_rad_s=0.005,
            gyro_noise_rad_per_sqrt_s=0.002 * math.sqrt(bench.tick_s),
        ),
        first_seed=SEED,
        encoder_model="lesson_counter",
        noise_ticks=0.2,
        noise="lesson",
    )
    end = journey.truth[0, -1]
    twin = bench.float_odometry(journey, "wheel", "midpoint")[0, -1] - end
    wheel = bench.odometry(journey, "wheel", "midpoint")[0, -1] - end
    gyro = bench.odometry(journey, "gyro", "euler_before")[0, -1] - end
    # The ADC rounds each sample by a uniform fraction of a code: a heading that walks with this
    # density, and a position that it carries away by v·density·√(t³/3).
    rounding_rad = bench.gyro_rad_s_per_lsb * math.sqrt(bench.tick_s / 12)
    strayed_m = 0.6 * rounding_rad * math.sqrt(end_s**3 / 3)
    return [
        Check(
            law="lesson_twin_wheel_m",
            predicted=COUNTER_WHEEL_M,
            measured=math.hypot(twin[0], twin[1]),
            tolerance=ROUNDED_M,
            unit="m",
            derivation="half of the last of six decimals: plant and float64 twin are the lesson",
        ),
        Check(
            law="lesson_firmware_wheel_m",
            predicted=COUNTER_WHEEL_M,
            measured=math.hypot(wheel[0], wheel[1]),
            tolerance=ROUNDED_M + bench.arithmetic_m(0.6 * end_s),
            unit="m",
            derivation="six printed decimals, and the firmware's sine table and rounding",
        ),
        Check(
            law="lesson_firmware_gyro_m",
            predicted=COUNTER_GYRO_M,
            measured=math.hypot(gyro[0], gyro[1]),
            tolerance=float(stats.norm.isf(FALSE_ALARM / 2)) * strayed_m,
            unit="m",
            derivation="the ADC's rounding walks in heading: v·(LSB/√12)·√T·√(t³/3)",
            false_alarm=FALSE_ALARM,
        ),
    ]


def _length(name: str, printed_m: float, error_m: np.ndarray, tolerance_m: float) -> Check:
    derivation = (
        "1e-9 m asked for; the order of summation moves it by less than 3e-11 m"
        if tolerance_m == PRINTED_M
        else "half of the last of six decimals"
    )
    return Check(name, printed_m, float(error_m[-1]), tolerance_m, "m", derivation)


def _angle(name: str, printed_deg: float, error_rad: np.ndarray) -> Check:
    measured_deg = math.degrees(error_rad[-1])
    return Check(
        name, printed_deg, measured_deg, ROUNDED_DEG, "°", "half of the last of six decimals"
    )


def _track(label: str, pose: np.ndarray, colour: int) -> Series:
    return line(label, thinned(pose[:, 0]), thinned(pose[:, 1]), colour)


def _errors(time_s: np.ndarray, run: LessonRun) -> list[Series]:
    return [
        line("wheel only", thinned(time_s), thinned(run.wheel_position_error_m), 1),
        line("gyro heading", thinned(time_s), thinned(run.gyro_position_error_m), 2),
    ]


LAWS = (
    Law(
        name="lesson",
        title="The lesson's printed numbers",
        formula="6.850364433010 m wheel only, 5.280131440064 m gyro heading",
        validity="seed 7, encoder and headings as printed; in float, and through plant and "
        "firmware",
        source="the lesson; Borenstein, Everett & Feng 1996",
        measure=_printed,
    ),
)
