"""Whether a position holds what the counters of a study's drives tell, before they are run.

A plain scenario is driven by the described robot: its envelope is proof enough. One with effects,
or whose encoder adds its noise up, lets the counters tell of more than the way: its drives are made
beforehand, without a kernel, where the word is not wide enough for whatever is believed.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction

import numpy as np

from firmware_model import FirmwareError
from firmware_model.build_scales import exact
from firmware_model.reach import Demand, position_reach, require_position_holds
from hil_harness.scenarios import Scenario
from precision_study.errors import StudyError
from precision_study.study.drives import drive_in_blocks, seed_blocks
from precision_study.study.engine import Study
from precision_study.study.space import Point, build

Told = tuple[int, int, int]
"""Ticks, Σ|left + right| and largest |right − left| of the worst drive [encoder ticks]."""


def require_drives_fit(study: Study) -> None:
    """Refuse a study in which the counters of a drive tell of more than a position holds.

    Raises:
        StudyError: field, value and what would be right, for the first such configuration.
    """
    if study.force:
        return
    for scenario in study.scenarios:
        if scenario.effects == () and scenario.encoder_model == "counter":
            continue
        told: dict[tuple[int, str], Told] = {}
        for point in study.points:
            config = build(point, study.robot)
            most = study.ticks(scenario, point)
            if position_reach(config, Demand.believed(config, most)) <= config.position_high_q:
                continue
            drive = point.tick_period_us, point.plant.model_dump_json()
            if drive not in told:
                told[drive] = _told(study, scenario, point)
            ticks, counts, turn_counts = told[drive]
            asked = Demand.believed(config, ticks)
            asked = replace(asked, counts=counts, turn_counts=Fraction(turn_counts))
            way_m = float(counts * exact(config.constants).half_tick_m)
            way = f"{way_m:.4g} m by the wheels on {scenario.name}"
            try:
                require_position_holds(config, position_reach(config, asked), way)
            except FirmwareError as error:
                where = f" (with {point.words})" if point.values else ""
                raise StudyError(f"{error}{where}") from None


def _told(study: Study, scenario: Scenario, point: Point) -> Told:
    """Return what the counters tell over all seeds."""
    half = 1 << (point.plant.encoder.counter_bits - 1)
    most_ticks = most_counts = most_turn = 0
    for seeds in seed_blocks(study.seeds, study.ticks(scenario, point)):
        ticks = np.zeros(len(seeds), dtype=np.int64)
        counts = np.zeros(len(seeds), dtype=np.int64)
        last = None
        for part in drive_in_blocks(
            scenario, point.plant, study.wire, point.tick_period_us, study.course, seeds
        ):
            both = np.stack([part.left, part.right])
            begins = both[:, :, :1] if last is None else last
            steps = np.diff(np.concatenate([begins, both], axis=2), axis=2)
            steps = (steps + half) % (2 * half) - half
            counts += np.abs(steps.sum(axis=0)).sum(axis=1)
            ticks += steps.shape[2]
            most_turn = max(most_turn, int(np.abs(steps[1] - steps[0]).max(initial=0)))
            last = both[:, :, -1:]
        most_ticks = max(most_ticks, int(ticks.max(initial=0)))
        most_counts = max(most_counts, int(counts.max(initial=0)))
    return most_ticks, most_counts, most_turn
