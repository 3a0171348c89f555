"""What lies behind the sensors, simulated with and without effects: the drive and the program."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.block_sums import Effects
from gap_diagnosis.drive.block import DriveBlock
from gap_diagnosis.drive.leftover import Dependence
from gap_diagnosis.drive.shapes import drive_beside_described
from gap_diagnosis.firmware import FirmwareBlock, firmware_block, lacks_the_gyro, replayed_pose
from gap_diagnosis.gap.drive_floor import DriveNoise
from gap_diagnosis.gap.drive_path import commanded_path, late_s_of
from gap_diagnosis.gap.on_recording import Replayed
from gap_diagnosis.recording import Floats, Recording
from hil_harness.assembly import Wire
from hil_harness.effects import catalogue
from hil_harness.robot import Robot


@dataclass(frozen=True)
class Downstream:
    """One downstream signal.

    Attributes:
        replayed: as described, and with all effects on.
        effects: the winning ones that bend it.
        path: x_m, y_m, heading_rad at the ticks with some of them on, float64[n, 3]; None where
            that cannot be simulated.
    """

    replayed: Replayed
    effects: Effects
    path: Callable[[Effects], Floats | None]


def driven(
    analysis: Analysis,
    effects: Effects,
    where: Recording,
    robot: Robot,
    kept: NDArray[np.bool_] | None,
) -> Downstream | None:
    """Return where commands lead through the described and the explained drive.

    Its values are fitted on the ticks *kept* (bool[n]) of the diagnosed log; None: on all of them.
    """
    block = next((one for one in analysis.blocks if isinstance(one, DriveBlock)), None)
    if block is None:
        return None
    robot = block.robot
    data = drive_beside_described(where, robot)
    if data is None:
        return None
    stages = catalogue()
    own = frozenset(
        e for e in effects & block.effects if e in stages and stages[e].stage == "actuation"
    )
    if own and kept is not None:
        block = block.only(_blocks(analysis, block, kept))
    noise = DriveNoise.of(data, block.levels_with(own))
    values = {
        key: float(one.value)
        for key, one in block.fit(own).parameters.items()
        if isinstance(one.value, int | float)
    }

    if where is not analysis.recording:
        values = _in_another_log(values)

    # Clocks are mapped first: by how much a row of a table is late is no part of the gap.
    late_s = 0.0 if "drive_delay" in own else late_s_of(data, robot, values)
    commanded = commanded_path(where, robot, late_s=late_s)
    if commanded is None:
        return None

    def path(some: Effects) -> Floats | None:
        chosen = {key: value for key, value in values.items() if key.partition(".")[0] in some}
        return commanded_path(where, robot, chosen, late_s=late_s)

    after = path(own) if own else None
    return Downstream(Replayed(before=commanded, after=after, noise=noise), own, path)


def _in_another_log(values: Mapping[str, float]) -> dict[str, float]:
    """Return the values with which effects act in another log: what began on the way goes on, and
    what ended is over."""
    over = {key.partition(".")[0] for key in values if key.endswith(".stop_s")}
    return {
        key: value
        for key, value in values.items()
        if key.partition(".")[0] not in over and not key.endswith(".start_s")
    }


def driven_by(
    analysis: Analysis, block: DriveBlock, one: Dependence, robot: Robot, kept: NDArray[np.bool_]
) -> Replayed | None:
    """Return where commands lead through the described drive, and through one that does what the
    leftover goes with, fitted on the ticks *kept* (bool[n])."""
    where = analysis.recording
    data = drive_beside_described(where, robot)
    if data is None:
        return None
    late_s = late_s_of(data, robot, {})
    before = commanded_path(where, robot, late_s=late_s)
    if before is None:
        return None
    model = block.stand_in(one, _blocks(analysis, block, kept))
    after = commanded_path(where, robot, added=model.angle, late_s=late_s)
    return Replayed(before, after, DriveNoise.of(data, model.levels))


def reprogrammed_by(
    analysis: Analysis,
    block: FirmwareBlock,
    variable: str,
    robot: Robot,
    wire: Wire,
    kept: NDArray[np.bool_],
) -> Replayed | None:
    """Return the odometry that the described program computes, and that of one that does what the
    leftover goes with, fitted on the ticks *kept* (bool[n])."""
    before = replayed_pose(analysis.recording, robot, wire)
    after = block.stand_in(before, variable, kept)
    return None if after is None else Replayed(before, after)


def _blocks(analysis: Analysis, block: DriveBlock, kept: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the drive's blocks on the ticks *kept*: bool[m]."""
    place = np.searchsorted(analysis.recording.t_s, block.data.time_s)
    return np.asarray(kept[np.minimum(place, len(kept) - 1)])


def reprogrammed(
    analysis: Analysis,
    effects: Effects,
    where: Recording,
    robot: Robot,
    wire: Wire,
    *,
    is_other_log: bool,
) -> Downstream | None:
    """Return the odometry that the described and the explained program compute; None where the log
    has no odometry frames, or not what they were made from. The program that was found in the
    diagnosed log runs on *where*.

    It is the same to the last digit in every part of a log: nothing is held out of it.
    """
    block = analysis.firmware
    is_blind = (block is None or is_other_log) and lacks_the_gyro(where, robot)
    if where.odometry_x_m is None or is_blind:
        return None
    before = replayed_pose(where, robot, wire)
    own = frozenset() if block is None else effects & block.effects
    there = firmware_block(where, robot, wire) if is_other_log and len(own) in (1, 2) else None

    def path(some: Effects) -> Floats | None:
        if not some:
            return before
        if block is None or len(some) > 2 or (is_other_log and there is None):
            return None
        return block.explained(some, there)

    return Downstream(Replayed(before=before, after=path(own) if own else None), own, path)
