"""Run results made by hand, for pages and tables that need no simulation."""

from __future__ import annotations

import numpy as np

from hil_harness.results import BusStatistics, Estimate, Poses, RunResult, Timing

TICK_PERIOD_US = 10_000


def track(ticks: int, rate_bias_rad_s: float, speed_scale: float = 1.0) -> Poses:
    """Return the lesson's path as an estimator with these two errors sees it, float64[n, 3]."""
    dt_s = TICK_PERIOD_US * 1e-6
    time_s = np.arange(ticks) * dt_s
    rate = 0.10 * np.sin(2 * np.pi * time_s / 20) + rate_bias_rad_s
    heading = np.concatenate([[0.0], np.cumsum(rate[:-1] * dt_s)])
    step = 0.6 * dt_s * speed_scale
    x = np.concatenate([[0.0], np.cumsum(step * np.cos(heading[:-1]))])
    y = np.concatenate([[0.0], np.cumsum(step * np.sin(heading[:-1]))])
    return np.column_stack([x, y, heading])


def run_result(
    *, ticks: int = 6000, estimators: bool = True, interrupted: bool = False, time: str = "lockstep"
) -> RunResult:
    """Return a plausible run: a gyro bias, a firmware that wanders a few nanometres from float."""
    truth = track(ticks, 0.0)
    float_twin = track(ticks, 0.005, 1.004)
    wobble = 2e-9 * np.sqrt(np.arange(ticks))[:, None] * np.array([1.0, -0.6, 0.1])
    wobble += 5e-9 * np.sin(np.arange(ticks) / 300)[:, None] * np.array([1.0, 1.0, 0.2])
    firmware = float_twin + wobble
    wheels = track(ticks, 0.0062, 1.005)
    status = np.ones(ticks, dtype=np.int64)
    status[ticks // 3 : ticks // 3 + ticks // 12] |= 8
    return RunResult(
        scenario="lesson",
        seed=7,
        time=time,
        tick_period_us=TICK_PERIOD_US,
        time_s=np.arange(ticks) * TICK_PERIOD_US / 1e6,
        stamp_us=np.arange(ticks) * TICK_PERIOD_US,
        truth=truth,
        float_twin=float_twin,
        firmware=firmware,
        estimators={
            "wheel only": Estimate(wheels + wobble, wheels),
            "gyro heading": Estimate(firmware, float_twin),
        }
        if estimators
        else {},
        status=status,
        kernel_state={"x_m_q32": 123_456_789_012, "heading_turn_q32": -98_765},
        bus=BusStatistics(
            frames=5 * ticks,
            load=0.1234,
            rejected={"length": 0, "crc": 3, "counter": 1, "range": 0, "age": 0, "unknown_id": 0},
            frames_by_message={"ENCODER": ticks, "IMU": ticks, "ODOMETRY_X": ticks},
        ),
        timing=Timing(2, 31.0, 120.0, 480.0),
        wall_s=0.4,
        interrupted=interrupted,
        configuration={"robot": "robot.toml", "effects": ["gyro_bias.bias = 0.005 rad/s"]},
    )


STATUS_BITS = {"INITIALISED": 1, "STANDSTILL": 2, "GYRO_STALE": 8}
