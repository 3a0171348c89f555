"""One log's likelihood: its blocks, prepared and searched."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final

import numpy as np

from gap_diagnosis.bus import bus_block
from gap_diagnosis.clock_setting import UNSET_S, UNTOLD
from gap_diagnosis.codes import codes_block
from gap_diagnosis.drive import DriveBlock, drive_block
from gap_diagnosis.drive.mistakes import COMMANDS, COUNTS
from gap_diagnosis.firmware import FirmwareBlock, firmware_block
from gap_diagnosis.granted import Granted
from gap_diagnosis.hypothesis import Block, Fit
from gap_diagnosis.lost_tracking import Lost
from gap_diagnosis.motion.blanks import odometry_of_one_part
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.bursts import Burst, beside_burst
from gap_diagnosis.motion.counters import unwrapped
from gap_diagnosis.motion.gross import looks_gross
from gap_diagnosis.motion.levels import is_louder
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.pushes import Pushes
from gap_diagnosis.motion.slack import about, slack_of, with_slack
from gap_diagnosis.motion.spells import lay_out_ways, levels_of_spell, spells
from gap_diagnosis.motion.standstill import Standstills
from gap_diagnosis.motion.unknown import (
    Alternative,
    Laid,
    alternatives,
    beyond_tolerance,
    lay_out,
    levels_beside,
    within_tolerance,
)
from gap_diagnosis.outliers import without_outliers
from gap_diagnosis.prepared import prepared
from gap_diagnosis.priors import Prior
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.reference_mistakes import Mistake, MistakeBlock
from gap_diagnosis.restarts import Restarts, with_restarts
from gap_diagnosis.traces import Trace, traces
from hil_harness.assembly import Wire
from hil_harness.effects.model import Effect
from hil_harness.robot import Robot

Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Analysis:
    """A log with its blocks.

    Attributes:
        recording: the log.
        motion: the block of wheels, gyro and reference; None where there is nothing to compare.
        blocks: all blocks, the motion's first.
        alternatives: what an unlisted cause in the motion could depend on, best first.
        unknown: log evidence of an unlisted cause by stage, less that of no effect.
        outliers: number of reference samples left out.
        lost: where the reference lost the robot, mended in the recording.
        late_s: by how much the reference's stamps were moved: its clock was never set.
        pushes: steps of the body that no wheel makes, if they are likelier than no effect.
        traces: by stage, what frames or codes show of a cause whether or not it is listed.
        burst: windows in which wheels lose their hold, if they are likelier than no effect.
        standstills: stretches in which counts stand while their wheels turn, likewise.
        has_burst: the burst is at work whatever else is: the motion's accounts are beside it, where
            no effect means no other one.
        restarts: where counts leapt, put back in the recording.
        mistake: of the reference's set-up, put right in the recording.
    """

    recording: Recording
    motion: MotionBlock | None
    blocks: tuple[Block, ...]
    alternatives: tuple[Alternative, ...]
    unknown: Mapping[str, float]
    outliers: int = 0
    burst: Burst | None = None
    traces: Mapping[str, Trace] = field(default_factory=dict)
    lost: Lost = field(default_factory=Lost)
    late_s: float = 0.0
    pushes: Pushes | None = None
    mistake: Mistake | None = None
    standstills: Standstills | None = None
    has_burst: bool = False
    restarts: Restarts = field(default_factory=Restarts)

    @property
    def as_ever(self) -> dict[str, float]:
        """How likely it is, by stage, that no unlisted cause is at work beside any other."""
        return {
            "reference": self.lost.as_ever,
            "wheel": _HARDLY if self.has_burst else 1.0,
            "encoder": self.restarts.as_ever,
        }

    def motion_of(self, effects: frozenset[str]) -> frozenset[str]:
        """Return those of some effects that the motion shows."""
        return frozenset() if self.motion is None else self.motion.moving(effects)

    @property
    def firmware(self) -> FirmwareBlock | None:
        """The block of the odometry frames, if there are any."""
        return next((one for one in self._whole if isinstance(one, FirmwareBlock)), None)

    @property
    def drive(self) -> DriveBlock | None:
        """The block of the commands, if there are any."""
        return next((one for one in self._whole if isinstance(one, DriveBlock)), None)

    @property
    def _whole(self) -> list[Block]:
        return [one.block if isinstance(one, Reduced) else one for one in self.blocks]


def analyse(
    recording: Recording,
    robot: Robot,
    wire: Wire,
    prior: Prior,
    *,
    progress: Progress = lambda step, share: None,
    without: frozenset[str] = frozenset(),
    library: Mapping[str, Effect] = MappingProxyType({}),
) -> Analysis:
    """Prepare and search all blocks of a log; *without* are effects that are not to be tried,
    *library* a user's own."""
    without = without | recording.granted.there_or_not
    motion, gross = None, False
    blocks: list[Block] = []
    others: list[Alternative] = []
    recording, restarts = with_restarts(recording, robot)
    # What a stale producer said again, only the ECU took for news; counts that then catch up look
    # like leaps of the reference.
    # A table has no frames, but with two clocks it tells of the ECU's.
    bus = bus_block(recording, robot, wire)
    received, recording = recording, recording if bus is None else bus.without_stale()
    ready = prepared(recording, robot, without)
    recording, mistake, late_s = ready.recording, ready.mistake, ready.late_s
    outliers = 0
    if recording.reference is not None or recording.gyro_rate_rad_s is not None:
        progress("wheels, gyro and reference", 0.05)
        recording, outliers = without_outliers(recording, robot)
        gross = looks_gross(recording, robot)
        model = MotionModel(
            recording,
            robot,
            prior,
            gross=gross,
            without=without | UNTOLD if late_s else without,
            library=library,
            late_up_to_s=UNSET_S if late_s else None,
        )
        motion, others = _beside_slack(
            MotionBlock(
                model, lambda share: progress("wheels, gyro and reference", 0.05 + 0.45 * share)
            ),
            gross=gross,
        )
        blocks.append(motion)
    as_received = replace(received, reference=recording.reference)
    progress("commands against wheels", 0.55)
    doubted = COMMANDS | COUNTS if motion is None else COUNTS if gross else COMMANDS
    drive = drive_block(unwrapped(recording, robot), robot, doubted, without)
    if drive is not None:
        blocks.append(drive)
    progress("bus and converter", 0.6)
    if bus is not None:
        blocks.append(bus)
    codes = codes_block(recording, robot)
    if codes is not None:
        # What is known to be stuck or to clip leaves its trace again.
        blocks.append(_without(codes, recording.granted.there_or_not))
    progress("odometry against replay", 0.65)
    firmware = firmware_block(as_received, robot, wire, without)
    if firmware is not None and not firmware.is_equal:
        part = odometry_of_one_part(as_received, restarts.t_s)
        if part is not as_received:
            firmware = firmware_block(part, robot, wire, without) or firmware
    if firmware is not None:
        blocks.append(
            firmware
            if firmware.knows_arrivals or not _is_disturbed(bus, recording.granted)
            else Reduced(firmware, firmware.effects - _LATE)
        )
    if mistake is not None:
        # No second mistake of the same kind is looked for.
        blocks = [_without(one, MistakeBlock(mistake).effects) for one in blocks]
        blocks.append(MistakeBlock(mistake))
    if not received.frames and all(one is bus for one in blocks):
        blocks = []  # a table's clock by itself says nothing of the robot
    progress("what no effect explains", 0.7)
    stood = None if motion is None else motion.standstills
    # A wheel that slides is counted: where counts stand, no contact is rough.
    burst = None if motion is None or stood is not None else motion.burst
    pushes = None if motion is None or gross else motion.pushes
    has_burst = False
    if motion is not None:
        windowed = [_rough(burst)] if burst is not None else []
        windowed += [_standing(stood)] if stood is not None else []
        others = _alternatives(motion, windowed, pushes, gross=gross, smooth=others)
        if burst is not None and not gross and _is_always_there(burst, motion, others):
            has_burst = True
            motion, others = _beside_slack(
                MotionBlock(
                    beside_burst(motion.model, burst),
                    lambda share: progress("beside wheels that lose hold", 0.7 + 0.1 * share),
                ),
                gross=gross,
            )
            blocks[0] = motion
            others = _alternatives(motion, gross=gross, smooth=others)
    seen = traces(blocks, without)
    return Analysis(
        as_received,
        motion,
        tuple(_without(one, without) for one in blocks),
        (*([_rough(burst)] if burst is not None and has_burst else []), *others),
        _unknown(others, seen, drive, firmware)
        | ({} if motion is None or not motion.is_gross else {"setup": motion.nameless}),
        outliers,
        burst,
        seen,
        ready.lost,
        late_s,
        pushes,
        mistake,
        stood,
        has_burst,
        restarts,
    )


_LATE: Final = frozenset({"missed_deadline"})
_DISTURBED: Final = 10.0


def _is_disturbed(bus: Block | None, granted: Granted) -> bool:
    """Tell whether frames came late or not at all: a replay then misses ticks of its own."""
    if bus is None:
        return False
    disturbing = {"frame_jitter", "frame_loss", "frame_reordering", "reception_stamp"}
    return not disturbing.isdisjoint(granted.values) or any(
        bus.fit(frozenset({effect})).log_evidence > _DISTURBED
        for effect in disturbing & bus.effects
    )


@dataclass(frozen=True)
class Reduced:
    """A block that keeps silent about some of its effects."""

    block: Block
    effects: frozenset[str]

    @property
    def name(self) -> str:
        """The block's name."""
        return self.block.name

    def fit(self, effects: frozenset[str]) -> Fit:
        """Fit as the block does."""
        return self.block.fit(effects)


def _without(block: Block, without: frozenset[str]) -> Block:
    return block if not block.effects & without else Reduced(block, block.effects - without)


def _beside_slack(motion: MotionBlock, *, gross: bool) -> tuple[MotionBlock, list[Alternative]]:
    """Return the block and its unlisted causes, what a healthy robot is off by free where that
    explains something: by itself, better than any listed effect does; or beside the best of these,
    where an unlisted cause explains more than they do, theirs and the rest."""
    found = _smooth(motion, gross=gross)
    if gross or motion.explained < _LITTLE:
        return motion, found
    model, levels = motion.model, motion.levels
    if motion.explained < within_tolerance(found):
        beside, left = model, found
    elif motion.explained < max(one.log_evidence for one in found):
        beside = about(model, motion.scan.likeliest)
        left = alternatives(beside, levels)
    else:
        return motion, found
    for _ in range(_SLACKS):
        if within_tolerance(left) < _LITTLE:
            break
        laid = lay_out(beside)
        best = max(left, key=lambda one: one.within)
        suiting = levels_beside(beside, best, levels, laid)
        levels = levels if suiting is None else suiting
        slack = slack_of(beside, laid, best, levels)
        model, beside = with_slack(model, slack), with_slack(beside, slack)
        left = alternatives(beside, levels)
    if model is motion.model:
        return motion, found
    healthy = MotionBlock(model)
    return healthy, _smooth(healthy, gross=gross)


_SLACKS: Final = 3
"""In so many ways at once a healthy robot may be off."""


def _alternatives(
    motion: MotionBlock,
    windowed: Sequence[Alternative] = (),
    pushes: Pushes | None = None,
    *,
    gross: bool,
    smooth: Sequence[Alternative] | None = None,
) -> list[Alternative]:
    """Return unlisted causes, relative to no effect: *smooth* ones, those of a while, *windowed*
    ones, pushes."""
    found = list(_smooth(motion, gross=gross) if smooth is None else smooth)
    found += [] if gross else _for_a_while(motion)
    tolerated = within_tolerance(found)
    if motion.explained < max(_LITTLE, tolerated):
        # What a healthy robot is off by, no listed effect explains as well.
        found = beyond_tolerance(found)
        motion.tolerated = max(tolerated, 0.0)
    found += [_dispersed(one, motion) for one in windowed]
    if pushes is not None:
        told = _at(motion, pushes.levels, [_stepping(pushes)])
        found += [_dispersed(one, motion) for one in told]
    return sorted(found, key=lambda one: -one.log_evidence)


def _smooth(motion: MotionBlock, *, gross: bool) -> list[Alternative]:
    """Return smooth functions of one variable, each at the noise levels that suit it best: those of
    the best account, or the described ones, or where a search from there ends beside the best of
    these causes; relative to no effect.

    Where a mistake of the set-up is *gross*, a straight line about it is no account of anything,
    and gets no levels.
    """
    laid = lay_out(motion.model)
    # Where a listed effect explains nearly all, its levels are far too low beside another cause.
    nothing = [motion.levels_of_nothing]
    found = _sought_from(motion, motion.levels, laid, elsewhere=nothing, gross=gross)
    described = motion.model.level_prior.median
    best = max((one.log_evidence for one in found), default=0.0)
    if not gross and best < max(motion.explained, _LITTLE) and is_louder(motion.levels, described):
        # There a reference may wander for minutes, or counts tremble, in the place of what an
        # unlisted cause explains; listed effects are sought from the described levels too. Noise
        # that is no louder than described takes nothing that those would show.
        found = _better(found, _sought_from(motion, described, laid))
    return [_dispersed(one, motion) for one in found]


def _for_a_while(motion: MotionBlock) -> list[Alternative]:
    """Return what begins and ends, at the noise levels of the best account or at those that suit
    the likeliest of these causes; relative to no effect."""
    laid = lay_out_ways(motion.model)
    at_first = spells(motion.model, motion.levels, laid)
    if not at_first:
        return []
    found = _at(motion, motion.levels, [one.cause for one in at_first.values()])
    nothing = motion.levels_of_nothing
    levels = levels_of_spell(motion.model, at_first, motion.levels, elsewhere=[nothing])
    if levels is not None:
        again = [one.cause for one in spells(motion.model, levels, laid).values()]
        found += _at(motion, levels, again)
    # At other levels another stage may leave no trace in any window.
    best: dict[str, Alternative] = {}
    for one in sorted(found, key=lambda one: one.log_evidence):
        best[one.stage] = one
    return [_dispersed(one, motion) for one in best.values()]


_LITTLE: Final = 3.0
"""What gains less [nat] explains nothing."""


def _dispersed(one: Alternative, motion: MotionBlock) -> Alternative:
    """Return an unlisted cause as it is worth where the log's surprises scatter."""
    evidence, likelihood = motion.dispersed(one.log_evidence, one.log_likelihood)
    within, _ = motion.dispersed(one.within, max(one.within, 0.0))
    return replace(one, log_evidence=evidence, log_likelihood=likelihood, within=within)


def _subject(one: Alternative) -> tuple[str, str]:
    return one.stage, one.variable


def _sought_from(
    motion: MotionBlock,
    start: Floats,
    laid: Laid,
    *,
    elsewhere: Sequence[Floats] = (),
    gross: bool = False,
) -> list[Alternative]:
    """Return unlisted causes at these noise levels, or at those that suit the best of them."""
    found = alternatives(motion.model, start, laid)
    levels = None
    if not gross and found:
        levels = levels_beside(motion.model, found[0], start, laid, elsewhere=elsewhere)
    here = _at(motion, start, found)
    if levels is None:
        return here
    return _better(here, _at(motion, levels, alternatives(motion.model, levels, laid)))


def _better(first: Sequence[Alternative], second: Sequence[Alternative]) -> list[Alternative]:
    """Return of each unlisted cause, found twice, the likelier account."""
    both = zip(sorted(first, key=_subject), sorted(second, key=_subject), strict=True)
    return [max(pair, key=lambda one: one.log_evidence) for pair in both]


def _at(motion: MotionBlock, levels: Floats, found: Sequence[Alternative]) -> list[Alternative]:
    """Return unlisted causes *found* at these noise levels, relative to no effect at its own, or at
    these where they suit it better: it must not lose for want of a search as long."""
    gain = min(motion.log_evidence_of_levels(levels), 0.0)
    return [
        replace(
            one,
            log_evidence=one.log_evidence + gain,
            log_likelihood=one.log_likelihood + gain,
            within=one.within + gain,
        )
        for one in found
    ]


def _rough(burst: Burst) -> Alternative:
    """Return rough windows of the contact as an unlisted cause."""
    return Alternative(
        "wheel", "time", burst.log_evidence, burst.log_likelihood, burst.share, burst.windows
    )


def _is_always_there(burst: Burst, motion: MotionBlock, others: Sequence[Alternative]) -> bool:
    """Tell whether listed effects act beside a burst that explains a log better than any of them,
    or any other unlisted cause."""
    told = motion.dispersed(burst.log_evidence, burst.log_likelihood)[0]
    rivals = [motion.explained, *(o.log_evidence for o in others if o.windows != burst.windows)]
    return bool(burst.beside) and told > max(rivals) + _FAR_BETTER


_FAR_BETTER: Final = 20.0
"""By so much [nat]: odds at which whatever else there is, the burst is there,"""
_HARDLY: Final = math.exp(-_FAR_BETTER)
"""and wheels that hold all the time are at most so likely."""


def _standing(stood: Standstills) -> Alternative:
    """Return counts that stand as an unlisted cause."""
    return Alternative(
        "encoder", "time", stood.log_evidence, stood.log_likelihood, stood.share, stood.windows
    )


def _stepping(pushes: Pushes) -> Alternative:
    """Return pushes of the body as an unlisted cause."""
    return Alternative(
        "wheel", "time", pushes.log_evidence, pushes.log_likelihood, pushes.share, pushes.windows
    )


def _unknown(
    others: list[Alternative],
    seen: Mapping[str, Trace],
    drive: DriveBlock | None,
    firmware: FirmwareBlock | None,
) -> dict[str, float]:
    stages: dict[str, list[float]] = {}
    for one in others:
        stages.setdefault(one.stage, []).append(one.log_evidence)
    found = {
        stage: float(np.logaddexp.reduce(values)) - float(np.log(len(values)))
        for stage, values in stages.items()
    }
    for stage, trace in seen.items():
        found[stage] = trace.beside(found.get(stage, -math.inf))
    if drive is not None:
        found["actuation"] = drive.unexplained().log_evidence
    if firmware is not None:
        found["firmware"] = -1e4 if firmware.is_equal else firmware.leftover().log_evidence
    return found
