"""How far the gap shrinks if what an unlisted cause goes with is modelled.

The stand-in that weighed the cause is fitted on one part of the log and tried on the rest, as a
listed explanation is. Where there is none, or no rest, nothing is claimed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, cast, get_args

import numpy as np
from numpy.typing import NDArray

from can_bus import SENSORS
from gap_diagnosis.analysis import Analysis
from gap_diagnosis.downstream import driven_by, reprogrammed_by
from gap_diagnosis.drive.block import DriveBlock
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.firmware import FirmwareBlock
from gap_diagnosis.gap.metrics import clock_skew_of
from gap_diagnosis.gap.on_recording import Replayed
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.stand_in import stand_in
from gap_diagnosis.motion.unknown import Alternative
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.result_parts import Gap, Metric, Modelled, StageOrNone, Variable
from hil_harness.assembly import Wire
from hil_harness.robot import Robot

LEAST_SHARE: Final = 0.02
"""What explains less of the leftover is nothing that it goes with."""
ANOTHER_LOG: Final = "another log was held out, and a function of this log's variables is of it"
NO_GAP_MEASURED: Final = "no gap was measured"
_NEAREST: Final = {"reversal": "direction"}
"""What a leftover goes with, by the name of the listed variable that is nearest to it."""
_PRACTICAL: Final = 1.0
"""Of a leftover of the odometry, over the floor below which no one would speak of a gap."""
_MODELLED: Final = ("wheel", "encoder", "gyro", "reference")


def unseen_dropped(recording: Recording, kept: NDArray[np.bool_]) -> Recording:
    """Return a recording without the reference's samples outside the ticks *kept*, bool[n].

    A model that leaves them out of its fit has followed them all the same, to know about where the
    robot was; what a leftover goes with is a function of that.
    """
    reference = recording.reference
    if reference is None:
        return recording
    place = np.clip(np.searchsorted(recording.t_s, reference.t_s), 0, len(kept) - 1)
    seen = kept[place]
    heading = reference.heading_rad
    return replace(
        recording,
        reference=replace(
            reference,
            t_s=reference.t_s[seen],
            x_m=reference.x_m[seen],
            y_m=reference.y_m[seen],
            heading_rad=None if heading is None else heading[seen],
        ),
    )


def known_variable(name: str) -> Variable | None:
    """Return the listed variable that *name* is or comes nearest to."""
    listed = _NEAREST.get(name, name)
    return cast(Variable, listed) if listed in get_args(Variable) else None


@dataclass(frozen=True)
class Model:
    """A model of what an unlisted cause goes with, fitted on a part of the log.

    Attributes:
        variable: of which it is a function.
        settings, drawn: what acts, with its best sizes and with draws of them.
        levels: noise levels beside it, float64[levels].
        drive: where commands lead without it and with it, where it acts there; else None.
        firmware: the odometry that is computed without it and with it; else None.
        clock_skew: by how much the ECU's clock is fast; None where it acts elsewhere.
    """

    variable: Variable
    settings: list[Setting]
    drawn: list[list[Setting]]
    levels: Floats
    drive: Replayed | None = None
    firmware: Replayed | None = None
    clock_skew: float | None = None


def modelled_on(
    fit_side: MotionModel,
    analysis: Analysis,
    stage: StageOrNone,
    wire: Wire,
    kept: NDArray[np.bool_],
) -> tuple[Model | None, str | None]:
    """Return the model of the leftover in a stage by what *fit_side* sees, on the ticks *kept*
    (bool[n]), or why there is none."""
    if stage == "firmware" and analysis.firmware is not None:
        return _of_the_program(analysis, analysis.firmware, fit_side.robot, wire, kept)
    if stage == "actuation" and analysis.drive is not None:
        return _of_the_drive(analysis, analysis.drive, fit_side, kept)
    seen = analysis.traces.get(stage)
    frames = analysis.recording.frames
    if seen is not None and seen.is_of_clock and frames and analysis.motion is not None:
        skew = clock_skew_of(frames, analysis.recording.t_s, kept)
        return Model("time", [], [], analysis.motion.levels, clock_skew=skew), None
    if stage == "bus" and seen is not None and seen.frame is not None:
        return None, f"it shows in {_frames(seen.frame)}, and nothing stands in for what frames do"
    if stage not in _MODELLED:
        return None, f"nothing stands in for an unlisted cause in stage {stage}"
    own = [one for one in analysis.alternatives if one.stage == stage]
    if own and own[0].windows and own[0].log_evidence > 0:
        return None, "it acts in windows of its own, and nothing says when it will"
    chosen = _likeliest(own)
    variable = None if chosen is None else known_variable(chosen.variable)
    if analysis.motion is None or chosen is None or variable is None:
        return None, "it goes with no variable"
    found = stand_in(fit_side, chosen, analysis.motion.levels)
    if found is None:
        return None, f"{variable.replace('_', ' ')} hardly varies"
    return Model(variable, [found.best], [[one] for one in found.drawn], found.levels), None


def _of_the_drive(
    analysis: Analysis, block: DriveBlock, fit_side: MotionModel, kept: NDArray[np.bool_]
) -> tuple[Model | None, str | None]:
    chosen = next((one for one in block.goes_with if one.share >= LEAST_SHARE), None)
    variable = None if chosen is None else known_variable(chosen.variable)
    if analysis.motion is None or chosen is None or variable is None:
        return None, "it goes with no variable"
    found = driven_by(analysis, block, chosen, fit_side.robot, kept)
    if found is None:
        return None, "the commands lead nowhere"
    return Model(variable, [], [], analysis.motion.levels, found), None


def _of_the_program(
    analysis: Analysis, block: FirmwareBlock, robot: Robot, wire: Wire, kept: NDArray[np.bool_]
) -> tuple[Model | None, str | None]:
    left = block.leftover()
    if left.size < _PRACTICAL:
        return None, "it moves the odometry by less than makes a difference"
    goes_with = (name for name, share in left.depends_on if share >= LEAST_SHARE)
    chosen = next(goes_with, None)
    variable = None if chosen is None else known_variable(chosen)
    if analysis.motion is None or chosen is None or variable is None:
        return None, "it goes with no variable"
    found = reprogrammed_by(analysis, block, chosen, robot, wire, kept)
    if found is None:
        return None, "what is not held out says too little of it"
    return Model(variable, [], [], analysis.motion.levels, firmware=found), None


def _frames(name: str) -> str:
    return "the sensors' frames" if name == SENSORS else f"frames {name}"


def _likeliest(own: Sequence[Alternative]) -> Alternative | None:
    """Return what the leftover depends on first, as the answer lists it."""
    telling = [one for one in own if one.log_evidence > 0 and one.share >= LEAST_SHARE]
    return max(telling, key=lambda one: one.log_evidence, default=None)


def told_apart(
    metrics: Mapping[str, Metric], with_model: Gap, variable: Variable
) -> tuple[Gap, Modelled | None, str | None]:
    """Return the gap without the model, which is no verdict, and the gap with it, in one metric and
    on the same windows; and why no share of it closes, if none does."""
    name = with_model.metric
    gap = Gap(metric=name, held_out=with_model.held_out, all=dict(metrics), **dict(metrics[name]))
    if with_model.windows < gap.windows:
        return gap, None, "it moves the robot too little in some windows to compare them"
    why_not = None
    if with_model.closed is None:
        near = with_model.floor is not None
        why_not = "the gap is too close to its floor" if near else "its floor is not known"
    measured = {field: getattr(with_model, field) for field in Metric.model_fields}
    return gap, Modelled(variable=variable, metric=name, **measured), why_not
