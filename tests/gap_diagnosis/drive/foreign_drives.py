"""Motors that no described drive follows exactly: another engine's, a loop, a rough floor."""

from dataclasses import replace

import numpy as np
from drive_recordings import DURATION_S, ROBOT, WIRE, drive_scenario, recording_of
from scipy.signal import lfilter

from gap_diagnosis.recording import Recording
from hil_harness.assembly import commands_on_the_wire
from hil_harness.robot import Robot
from hil_harness.scenarios import Scenario

TICKS_PER_RAD = ROBOT.plant.encoder.ticks_per_rev / (2 * np.pi)


def commanded_rates(seed: int, duration_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return commands float64[n, 2] and wheel rates float64[n, 2] of a random drive."""
    return rates_of(drive_scenario(seed, duration_s), duration_s)


def rates_of(scenario: Scenario, duration_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Return commands float64[n, 2] and wheel rates float64[n, 2] of a drive."""
    commands = commands_on_the_wire(scenario, round(duration_s / 0.01), WIRE)
    wheels = ROBOT.plant.wheels
    turn = 0.5 * commands[:, 1] * wheels.wheelbase_m
    rates = np.stack([commands[:, 0] - turn, commands[:, 0] + turn], axis=1) / wheels.radius_m
    return commands, rates


def second_order(seed: int, duration_s: float = DURATION_S) -> Recording:
    """A motor with inductance: two lags of 25 ms in place of one of 50 ms."""
    commands, target = commanded_rates(seed, duration_s)
    return _turned(commands, _lagged(_lagged(target, 0.025), 0.025), seed)


def velocity_loop(seed: int, duration_s: float = DURATION_S) -> Recording:
    """A PI loop about a slow motor that overshoots a little."""
    commands, target = commanded_rates(seed, duration_s)
    rate = np.zeros(2)
    integral = np.zeros(2)
    rates = np.zeros_like(target)
    for k in range(len(target)):
        for _ in range(5):
            error = target[k] - rate
            integral += 0.002 * error
            rate = rate + 0.002 * (4.0 * error + 25.0 * integral - 0.2 * rate) / 0.2
        rates[k] = rate
    return _turned(commands, rates, seed)


def disturbed(seed: int, duration_s: float = DURATION_S, level: float = 0.05) -> Recording:
    """The described motor under a load that changes its rate by 5 %, coloured over 0.3 s."""
    commands, target = commanded_rates(seed, duration_s)
    rates = _lagged(target, ROBOT.plant.drive.time_constant_s)
    random = np.random.default_rng(seed)
    keep = np.exp(-0.01 / 0.3)
    error = np.zeros(2)
    for k in range(len(rates)):
        error = keep * error + level * np.sqrt(1 - keep**2) * random.standard_normal(2)
        rates[k] *= 1 + error
    return _turned(commands, rates, seed)


def another_track(seed: int, share: float) -> Recording:
    """The described motors under a controller that takes this share of the track for the robot's:
    all turns are so much less than told."""
    commands, told = commanded_rates(seed, DURATION_S)
    turn = 0.5 * (1.0 - share) * (told[:, 1] - told[:, 0])
    less = told + np.stack([turn, -turn], axis=1)
    return _turned(commands, _lagged(less, ROBOT.plant.drive.time_constant_s), seed)


def weak_motors(scenario: Scenario, seed: int) -> Recording:
    """Motors of little torque: friction hinders them where they speed up and helps them where they
    slow down, by a twentieth of the torque."""
    commands, target = rates_of(scenario, min(scenario.duration_s, 60.0))
    rates, rate = np.zeros_like(target), np.zeros(2)
    for k in range(len(target)):
        for _ in range(5):
            torque = np.clip((target[k] - rate) / 0.05, -3.3, 3.3)
            rate = rate + 0.002 * (torque - 0.165 * np.tanh(rate / 0.05))
        rates[k] = rate
    return _turned(commands, rates, seed)


def table_with_lost_rows(seed: int, share: float) -> Recording:
    """The described motor, told something new in every row of 30 ms; a share of the rows is lost,
    counts and commands, and the command before stands in their place."""
    wheels, lag_s = ROBOT.plant.wheels, ROBOT.plant.drive.time_constant_s
    random = np.random.default_rng(seed)
    time_s = 0.03 * np.arange(1300)
    corners_s = np.arange(0.0, 42.0, 2.0)
    begun = np.clip(time_s - 1.0, 0.0, 1.0)
    speed = begun * np.interp(time_s, corners_s, random.uniform(-0.1, 0.6, len(corners_s)))
    turning = begun * np.interp(time_s, corners_s, random.uniform(-1.0, 1.0, len(corners_s)))
    rim = 0.5 * turning * wheels.wheelbase_m
    told = np.stack([speed - rim, speed + rim], axis=1) / wheels.radius_m
    kept = np.exp(-0.03 / lag_s)
    angle, rate = np.zeros((len(told), 2)), np.zeros(2)
    for k in range(len(told) - 1):
        angle[k + 1] = angle[k] + 0.03 * told[k] + lag_s * (1 - kept) * (rate - told[k])
        rate = told[k] + kept * (rate - told[k])
    counts = np.floor(angle * TICKS_PER_RAD + 0.2 * random.standard_normal(angle.shape))
    lost = random.random(len(told)) < share
    lost[0] = False
    latest = np.maximum.accumulate(np.where(lost, 0, np.arange(len(told))))
    counts[lost] = np.nan
    made = recording_of(np.stack([speed, turning], axis=1)[latest], counts[:, 0], counts[:, 1])
    return replace(made, tick_period_s=0.03, t_s=time_s, stamp_s=time_s)


def table_of_even_wheels(seed: int, robot: Robot) -> Recording:
    """Ten minutes of a robot whose wheels run even to 0.07 % and 2.5 ms late, in rows of 50 ms;
    every few seconds it is told something new, at once."""
    plant, step_s = robot.plant, 0.005
    random = np.random.default_rng(seed)
    steps = round(600.0 / step_s)
    commands = np.zeros((steps, 2))
    at = 800
    while at < steps - 800:
        until = at + 10 * int(random.uniform(30.0, 140.0))
        told = random.uniform(0.15, 0.5), random.uniform(0.5, 2.0) * random.choice([-1.0, 1.0])
        kind = random.choice(4, p=[0.4, 0.35, 0.15, 0.1])
        commands[at:until] = np.array([(1, 0), (1, 1), (0, 1), (0, 0)])[kind] * told
        at = until
    rim = 0.5 * commands[:, 1] * plant.wheels.wheelbase_m
    target = np.stack([commands[:, 0] - rim, commands[:, 0] + rim], axis=1) / plant.wheels.radius_m
    share = 1.0 - np.exp(-step_s / plant.drive.time_constant_s)
    rates = lfilter([0.0, share], [1.0, share - 1.0], target, axis=0)
    rates *= 1.0 + lfilter([1e-4], [1.0, -0.99], random.standard_normal(rates.shape), axis=0)
    angle = np.cumsum(step_s * rates, axis=0) - step_s * rates
    rows = slice(None, None, 10)
    counts = np.floor(angle[rows] * plant.encoder.ticks_per_rev / (2 * np.pi) + 0.3)
    made = recording_of(commands[rows], counts[:, 0], counts[:, 1])
    row_s = 0.05 * np.arange(len(counts))
    return replace(made, tick_period_s=0.05, t_s=row_s, stamp_s=row_s)


def table_of_executed_commands(seed: int) -> Recording:
    """The described motor in ticks of 10 ms, told something new in each; every fifth tick a row,
    with the command that was carried out in it."""
    random = np.random.default_rng(seed)
    time_s = 0.01 * np.arange(6000)
    corners_s = np.arange(0.0, 62.0, 1.0)
    speed, turning = (
        np.interp(time_s, corners_s, random.uniform(low, high, len(corners_s)))
        for low, high in ((-0.1, 0.5), (-1.0, 1.0))
    )
    commands = np.minimum(time_s, 1.0)[:, np.newaxis] * np.stack([speed, turning], axis=1)
    wheels = ROBOT.plant.wheels
    rim = 0.5 * commands[:, 1] * wheels.wheelbase_m
    told = np.stack([commands[:, 0] - rim, commands[:, 0] + rim], axis=1) / wheels.radius_m
    angle = 0.01 * np.cumsum(_lagged(told, ROBOT.plant.drive.time_constant_s), axis=0)
    counts = np.floor(angle * TICKS_PER_RAD)[4::5]
    made = recording_of(commands[4::5], counts[:, 0], counts[:, 1])
    row_s = 0.05 * np.arange(len(counts))
    return replace(made, tick_period_s=0.05, t_s=row_s, stamp_s=row_s)


def _lagged(target: np.ndarray, lag_s: float) -> np.ndarray:
    share = 1 - np.exp(-0.01 / lag_s)
    rates = np.zeros_like(target)
    rate = np.zeros(2)
    for k in range(len(target)):
        rate = rate + share * (target[k] - rate)
        rates[k] = rate
    return rates


def _turned(commands: np.ndarray, rates: np.ndarray, seed: int) -> Recording:
    angle = np.concatenate((np.zeros((1, 2)), np.cumsum(rates[:-1] * 0.01, axis=0)))
    noise = 0.2 * np.random.default_rng(seed + 1000).standard_normal(angle.shape)
    counts = np.floor(angle * TICKS_PER_RAD + noise)
    return recording_of(commands, counts[:, 0], counts[:, 1])


def logged_a_row_late(recording: Recording, late_s: float) -> Recording:
    """A recording of which the commands of the last *late_s* stand one row late, as where the clock
    that they are sent by drifts past the one that rows are written by."""
    rows = len(recording.tick)
    late = recording.t_s > recording.t_s[-1] - late_s
    from_row = np.where(late, np.maximum(np.arange(rows) - 1, 0), np.arange(rows))
    assert recording.v_command_m_s is not None
    assert recording.w_command_rad_s is not None
    return replace(
        recording,
        v_command_m_s=recording.v_command_m_s[from_row],
        w_command_rad_s=recording.w_command_rad_s[from_row],
    )
