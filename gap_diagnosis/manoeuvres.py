"""Short drives that tell effects apart, and what each would let a robot's log see."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import as_file, files
from typing import Final

import numpy as np

from gap_diagnosis.explanations import EXPLAINED
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import Prior
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.visibility import Sight, sight_of
from hil_harness.assembly import Wire
from hil_harness.robot import Robot
from hil_harness.scenarios import Scenario, load_scenario

_FOLDER: Final = "data/manoeuvres"
_SEED: Final = 1
_KEPT: Final = 24
"""Models of manoeuvres that a process keeps, some 10 MB each: the menu for two kinds of robot."""
_MANY: Final = frozenset(
    {
        "adc_stuck_bit",
        "encoder_eccentricity",
        "gyro_saturation",
        "missed_ticks",
        "one_sided_slip",
        "wheel_eccentricity",
    }
)
"""Effects with many variants: left out where they are not in question."""


@dataclass(frozen=True)
class Manoeuvre:
    """A drive of about a minute.

    Attributes:
        file: the scenario file's name.
        text: its content.
        scenario: what it says; its description is the sentence for a person.
    """

    file: str
    text: str
    scenario: Scenario


@dataclass(frozen=True)
class Equipment:
    """What a log of the next drive would hold.

    Attributes:
        reference_hz: samples a second; None: there is no reference.
        has_heading, has_gyro: which channels there are.
    """

    reference_hz: float | None
    has_heading: bool
    has_gyro: bool


@cache
def manoeuvres() -> tuple[Manoeuvre, ...]:
    """Return all manoeuvres, by name."""
    found = []
    folder = files("gap_diagnosis") / _FOLDER
    for one in sorted(folder.iterdir(), key=lambda each: each.name):
        if one.name.endswith(".toml"):
            with as_file(one) as path:
                text = one.read_text(encoding="utf-8")
                found.append(Manoeuvre(one.name, text, load_scenario(path)))
    return tuple(found)


def equipment_of(recording: Recording) -> Equipment:
    """Return what the next drive's log will hold if this one's equipment is used again."""
    reference = recording.reference
    has_gyro = recording.gyro_rate_rad_s is not None
    if reference is None or len(reference.t_s) < 2:
        return Equipment(None, False, has_gyro)
    rate_hz = 1.0 / max(float(np.median(np.diff(reference.t_s))), 1e-3)
    return Equipment(float(f"{rate_hz:.2g}"), reference.heading_rad is not None, has_gyro)


@dataclass(frozen=True)
class Described:
    """What is known of the robot before any log."""

    robot: Robot
    wire: Wire
    prior: Prior


def sights(
    described: Described, equipment: Equipment, levels: Floats, effects: frozenset[str]
) -> Iterator[tuple[Manoeuvre, Sight]]:
    """Yield each manoeuvre with what its log would see of *effects* at these noise levels."""
    without = _MANY & frozenset(EXPLAINED) - effects
    told = f"{described.robot!r} {described.wire.signal_map!r}"
    for manoeuvre in manoeuvres():
        key = (manoeuvre.file, equipment, without, told, id(described.prior))
        model = _model(key, manoeuvre, described)
        yield manoeuvre, sight_of(model.columns, model.gram(levels), described.prior)


_Key = tuple[str, Equipment, frozenset[str], str, int]
_MODELS: Final[dict[_Key, MotionModel]] = {}
"""Models of manoeuvres: they depend on the robot, its bus and equipment, not on a log. Each holds
its prior, so that no other has its id."""


def _model(key: _Key, manoeuvre: Manoeuvre, described: Described) -> MotionModel:
    if key not in _MODELS:
        if len(_MODELS) >= _KEPT:
            _MODELS.clear()
        _, equipment, without, *_ = key
        driven = _driven(manoeuvre, equipment, described.robot, described.wire)
        _MODELS[key] = MotionModel(driven, described.robot, described.prior, without=without)
    return _MODELS[key]


def _driven(manoeuvre: Manoeuvre, equipment: Equipment, robot: Robot, wire: Wire) -> Recording:
    rate_hz = equipment.reference_hz
    noise = None if rate_hz is None else ReferenceNoise(rate_hz=rate_hz)
    recording = synthetic_recording(robot, wire, manoeuvre.scenario, (), _SEED, reference=noise)
    if recording.reference is not None and not equipment.has_heading:
        recording = replace(recording, reference=replace(recording.reference, heading_rad=None))
    if not equipment.has_gyro:
        recording = replace(recording, gyro_code=None, gyro_rate_rad_s=None)
    return recording
