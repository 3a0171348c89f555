"""Drives whose structure is known by reasoning."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from types import MappingProxyType

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.imitation import Effects
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.structure import Visible, alike, sights_of, twins_on, visible
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.visibility import Sights
from hil_harness import load_robot, load_wire
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

ROBOT = load_robot()
WIRE = load_wire()
PRIOR = default_prior()
CONTACT = 5e-4


def drive(
    name: str,
    *effects: EffectSetting,
    reference: bool = True,
    heading: bool = True,
    duration_s: float | None = None,
) -> Recording:
    """Return a drive with contact noise, its own effects replaced by *effects*."""
    recording = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario(name), effects=()),
        effects,
        3,
        reference=ReferenceNoise() if reference else None,
        contact_noise_m_per_sqrt_m=CONTACT,
        duration_s=duration_s,
    )
    if recording.reference is not None and not heading:
        recording = replace(recording, reference=replace(recording.reference, heading_rad=None))
    return recording


@cache
def model_of(name: str, reference: bool = True, heading: bool = True) -> MotionModel:
    return MotionModel(drive(name, reference=reference, heading=heading), ROBOT, PRIOR)


@cache
def sights(*names: str, reference: bool = True, heading: bool = True) -> Sights:
    """Return what drives see together, at the noise levels that suit the first."""
    models = [model_of(name, reference, heading) for name in names]
    return sights_of([(one, models[0].no_effect_levels) for one in models])


@cache
def seen(
    *names: str, reference: bool = True, heading: bool = True
) -> MappingProxyType[str, Visible | None]:
    return MappingProxyType(visible(sights(*names, reference=reference, heading=heading)))


@cache
def groups(*names: str, reference: bool = True, heading: bool = True) -> tuple[Effects, ...]:
    """Return the groups, with twins that hold on such logs."""
    found = seen(*names, reference=reference, heading=heading)
    twins = twins_on([model_of(name, reference, heading).recording for name in names])
    return tuple(alike(sights(*names, reference=reference, heading=heading), found, twins))


def motion_of(recording: Recording, *few: str) -> MotionBlock:
    """Return the motion as a library of few effects tells it, or one of all."""
    without = frozenset(EXPLAINED).difference(few) if few else frozenset[str]()
    return MotionBlock(MotionModel(recording, ROBOT, PRIOR, without=without))


def analysis_of(recording: Recording, *few: str) -> Analysis:
    """Return the analysis of the motion alone, by a library of few effects or of all."""
    block = motion_of(recording, *few)
    return Analysis(recording, block, (block,), (), {})
