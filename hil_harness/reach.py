"""Whether the firmware's position holds what a drive is going to ask of it, before it is driven."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from firmware_model import FirmwareError, KernelConfig
from firmware_model.build_scales import exact
from firmware_model.counting import NOISE_DEVIATIONS, require_told_apart
from firmware_model.reach import Demand, position_reach, require_position_holds
from hil_harness.assembly import RunConfig, Wire, commands_on_the_wire
from hil_harness.effects import Settings
from hil_harness.effects.setup_mistakes import SensorMistakes
from hil_harness.errors import HarnessError
from hil_harness.robot import Robot
from hil_harness.scenarios import Scenario
from hil_harness.wheel_counter import over_the_bus, rounding_ticks
from sim_plant import simulate

Counts = NDArray[np.int64]


def require_run_fits(config: RunConfig, wire: Wire, kernel: KernelConfig, ticks: int) -> None:
    """Refuse a run that carries x or y beyond their word; `config.force` takes it.

    Raises HarnessError with file, line, field, value and what would be right.
    """
    if not config.force:
        require_drive_fits(
            config.scenario,
            config.robot,
            wire,
            kernel,
            ticks=ticks,
            settings=config.settings(),
            seed=config.seed_in_use,
        )


def require_drive_fits(
    scenario: Scenario,
    robot: Robot,
    wire: Wire,
    kernel: KernelConfig,
    *,
    ticks: int,
    settings: Settings,
    seed: int,
) -> None:
    """Refuse a scenario whose wheels carry x or y beyond their word.

    What the firmware believes in so many ticks at most is enough for wide words. For others the
    robot is driven beforehand, without a bus: no frame that is late or lost lengthens the way that
    the counters tell. A counter that may take one way of a wheel for the other tells none, however
    wide the word is.

    Raises HarnessError.
    """
    require_counters_tell(robot, wire, kernel, ticks)
    if position_reach(kernel, Demand.believed(kernel, ticks)) <= kernel.position_high_q:
        return
    runs = simulate(
        robot.plant,
        settings.plant_over_time,
        commands_on_the_wire(scenario, ticks, wire),
        [seed],
        tick_period_us=wire.tick_period_us,
        encoder_model=scenario.encoder_model,
        noise=scenario.noise,
        drive=scenario.drive,
        outputs="odometry",
    )
    left, right, _ = SensorMistakes(settings.setup, robot.plant).apply_columns(
        runs.left_count[0], runs.right_count[0], runs.gyro_code[0]
    )
    left = over_the_bus(wire.signal_map["left_count"], robot.plant, left)
    right = over_the_bus(wire.signal_map["right_count"], robot.plant, right)
    require_counts_fit(robot, kernel, left, right)


def require_counters_tell(robot: Robot, wire: Wire, kernel: KernelConfig, ticks: int) -> None:
    """Refuse counters too narrow for the described wheels with their noise, over the longest gap.

    Raises HarnessError.
    """
    wheels = [wire.signal_map["left_count"], wire.signal_map["right_count"]]
    rounding = Fraction(max(rounding_ticks(one, robot.plant) for one in wheels))
    noise = 2 * NOISE_DEVIATIONS * Fraction(robot.plant.encoder.noise_ticks)
    rate = min(exact(kernel.constants).fastest_ticks, Fraction(kernel.max_step_ticks))
    try:
        require_told_apart(kernel, rate, noise + rounding, ticks)
    except FirmwareError as error:
        raise HarnessError(f"{robot.where(str(error))}: {error}") from error


def require_counts_fit(robot: Robot, kernel: KernelConfig, left: Counts, right: Counts) -> None:
    """Refuse counters, each int64[ticks] or int64[runs, ticks], that tell of too long a way.

    Raises HarnessError.
    """
    half = 1 << (kernel.counter_bits - 1)
    each = [(np.diff(count, axis=-1) + half) % (2 * half) - half for count in (left, right)]
    counts = int(np.abs(each[0] + each[1]).sum(axis=-1).max(initial=0))
    turn_counts = Fraction(int(np.abs(each[1] - each[0]).max(initial=0)))
    way_m = float(counts * exact(kernel.constants).half_tick_m)
    asked = Demand.believed(kernel, left.shape[-1])
    reach = position_reach(kernel, replace(asked, counts=counts, turn_counts=turn_counts))
    try:
        require_position_holds(kernel, reach, f"{way_m:.4g} m by the wheels")
    except FirmwareError as error:
        raise HarnessError(f"{robot.where(str(error))}: {error}") from error
