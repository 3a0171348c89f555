"""The drive's block of a log; of a drive that nobody described, with the lag and delay it shows."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from gap_diagnosis.drive.block import DriveBlock
from gap_diagnosis.drive.mistakes import COMMANDS, COUNTS
from gap_diagnosis.drive.shapes import drive_beside_described
from gap_diagnosis.recording import Recording
from hil_harness.robot import Robot

_ANSWERS: Final = frozenset({"drive_delay", "drive_lag"})
_PROMPT_S: Final = 1e-3


def drive_block(
    recording: Recording,
    robot: Robot,
    doubted: frozenset[str] = COMMANDS | COUNTS,
    without: frozenset[str] = frozenset(),
) -> DriveBlock | None:
    """Return the block, or None where the log holds no commands or no motion.

    *doubted*: the signals of which a mistake of the set-up may be. *without*: effects that nobody
    will ask for, so that they explain nothing away.
    """
    block = _beside_its_manner(recording, robot, doubted, without)
    if block is None or robot.describes_drive or not block.answers_otherwise():
        return block
    answers = as_it_answers(recording, robot)
    return _beside_its_manner(recording, answers, doubted, without, answers) or block


def _beside_its_manner(
    recording: Recording,
    robot: Robot,
    doubted: frozenset[str],
    without: frozenset[str],
    answers: Robot | None = None,
) -> DriveBlock | None:
    data = drive_beside_described(recording, robot)
    if data is None:
        return None
    block = DriveBlock(data, robot, doubted, without, answers=answers)
    own = block.manner()
    return block if own is None else DriveBlock(data, robot, doubted, without, own, answers)


def as_it_answers(recording: Recording, robot: Robot) -> Robot:
    """Return the robot with the lag and the delay that a log shows of its drive; as it is where the
    log shows nothing of it."""
    prompt = _answering(robot, _PROMPT_S, 0.0)
    data = drive_beside_described(recording, prompt)
    if data is None:
        return robot
    known = DriveBlock(data, prompt, frozenset()).fit(_ANSWERS).parameters
    lag_s, delay_s = (
        float(known[key].value) for key in ("drive_lag.time_constant", "drive_delay.delay")
    )
    return _answering(robot, _PROMPT_S + lag_s, delay_s)


def _answering(robot: Robot, lag_s: float, delay_s: float) -> Robot:
    drive = robot.plant.drive.model_copy(update={"time_constant_s": lag_s, "delay_s": delay_s})
    return replace(robot, plant=robot.plant.model_copy(update={"drive": drive}))
