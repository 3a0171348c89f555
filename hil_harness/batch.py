"""The batch path: the same plant and kernel over arrays of runs, with no bus in between.

For equal commands, seeds and effects the counts, and so the odometry, are those of the bus path,
bit for bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from firmware_model import BatchRuns, KernelConfig, run_batch
from hil_harness.assembly import Wire, commands_on_the_wire
from hil_harness.effects import EffectSetting, apply_effects, combine_effects
from hil_harness.laws.statistics import Split, split_error
from hil_harness.nodes import firmware_config
from hil_harness.reach import require_counts_fit
from hil_harness.results import Poses
from hil_harness.robot import Robot
from hil_harness.scenarios import Scenario
from sim_plant import PlantRuns, simulate


@dataclass(frozen=True)
class BatchResult:
    """Many runs of one scenario.

    `truth` is float64[runs, ticks, 3] (or [1, ticks, 3] where all runs share it); `plant` holds the
    raw counts, `firmware` the kernel's runs over them.
    """

    config: KernelConfig
    plant: PlantRuns
    firmware: BatchRuns

    @property
    def truth(self) -> Poses:
        """The true poses."""
        return self.plant.truth

    def split_final_error(self) -> dict[str, Split]:
        """Split the final error of many seeds into systematic part (mean) and random part (spread).

        One entry each for x_m, y_m and heading_rad, with 95 % intervals. Raises FirmwareError for a
        batch without history, ValueError for fewer than two runs.
        """
        error = self.firmware.pose_m_rad()[:, -1] - self.truth[:, -1]
        return {
            name: split_error(error[:, column], f"final error of {name}", unit)
            for column, (name, unit) in enumerate(
                (("x_m", "m"), ("y_m", "m"), ("heading_rad", "rad"))
            )
        }

    def final_position_error_m(self) -> NDArray[np.float64]:
        """Distance between the firmware's final position and the truth: float64[runs]."""
        finals = self.firmware.final_states
        x_m, y_m = (
            np.ldexp(finals[name].astype(np.float64), -self.config.position_frac_bits)
            for name in ("x_m_q", "y_m_q")
        )
        truth = self.truth[:, -1]
        return np.asarray(np.hypot(x_m - truth[:, 0], y_m - truth[:, 1]))


def simulate_batch(
    scenario: Scenario,
    robot: Robot,
    wire: Wire,
    seeds: Sequence[int],
    *,
    ticks: int | None = None,
    effects: tuple[EffectSetting, ...] = (),
    outputs: Literal["all", "odometry"] = "all",
) -> PlantRuns:
    """Return the counts of many runs of a scenario, one per seed.

    `outputs="odometry"` leaves out what dead reckoning does not read.
    """
    period_us = wire.tick_period_us
    tick_count = scenario.tick_count(period_us) if ticks is None else ticks
    settings = apply_effects(combine_effects(scenario.effects, effects))
    return simulate(
        robot.plant,
        settings.plant_over_time,
        commands_on_the_wire(scenario, tick_count, wire),
        seeds,
        tick_period_us=period_us,
        encoder_model=scenario.encoder_model,
        noise=scenario.noise,
        drive=scenario.drive,
        outputs=outputs,
    )


def run_scenario_batch(
    scenario: Scenario,
    robot: Robot,
    wire: Wire,
    seeds: Sequence[int],
    *,
    ticks: int | None = None,
    effects: tuple[EffectSetting, ...] = (),
    twin: bool = True,
    history: bool = True,
    force: bool = False,
) -> BatchResult:
    """Run plant and firmware over many seeds; `force` takes words that overflow, and counts.

    Raises HarnessError, PlantError or FirmwareError for what does not fit together.
    """
    robot.require_tick(wire.tick_period_us, wire.database.path.name)
    plant = simulate_batch(
        scenario, robot, wire, seeds, ticks=ticks, effects=effects, outputs="odometry"
    )
    config = firmware_config(robot, wire.signal_map, wire.tick_period_us, allow_overflow=force)
    if not force:
        require_counts_fit(robot, config, plant.left_count, plant.right_count)
    firmware = run_batch(
        config, plant.left_count, plant.right_count, plant.gyro_code, twin=twin, history=history
    )
    return BatchResult(config, plant, firmware)
