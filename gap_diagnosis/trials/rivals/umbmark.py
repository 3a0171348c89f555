"""Rival 3: UMBmark calibration: wheel diameters and wheelbase, and nothing else.

Borenstein and Feng, *Measurement and correction of systematic odometry errors in mobile robots*
(IEEE Transactions on Robotics and Automation 12, 1996): errors of type A (each turn is off by a
share of its angle: the wheelbase) and of type B (each straight way bends: the diameters), told
apart because a robot drives both ways round. Their square with measured ends is generalised to the
turns and straight ways of any drive with a measured heading; the mean diameter comes from the
length of straight ways, as theirs does from a tape.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.explanations.variant import Setting
from gap_diagnosis.gap.manoeuvres import REST, kinds_of
from gap_diagnosis.prediction import Prediction
from gap_diagnosis.recording import Floats
from gap_diagnosis.trials.rivals.door import Job, answer, job_of, named

_PIECE_S: Final = 2.0
"""Ways and turns are cut into pieces this long: each is one equation."""
_CERTAIN: Final = 2.0
"""So many standard deviations a correction must differ from none."""
_LEAST_M: Final = 0.1
_STRAIGHT_RAD: Final = 0.03
"""So little a straight way may bend: its chord is its length to 1 in 25,000."""


@dataclass(frozen=True)
class Corrections:
    """What a calibration says: radius, mismatch and wheelbase, values and standard deviations."""

    values: dict[str, float]
    sds: dict[str, float]


def diagnose(log: Path, robot: Path, reference: Path, without: Sequence[str]) -> dict[str, Any]:
    """Return OUT.json; all probability is on the corrections that are beyond tolerance."""
    job = job_of(log, robot, reference, without)
    found = calibrate(job)
    limits = job.robot.tolerance
    beyond = {
        "radius_scale": limits.radius_scale,
        "radius_mismatch": limits.radius_mismatch,
        "wheelbase_scale": limits.wheelbase_scale,
    }
    told = [
        effect
        for effect, limit in sorted(beyond.items())
        if effect not in job.without
        and abs(found.values[effect]) > max(limit, _CERTAIN * found.sds[effect])
    ]
    if not told:
        return answer(job, [((), 1.0)])
    settings: list[Setting] = []
    parameters = {}
    for effect in told:
        (variant,) = EXPLAINED[effect].variants(job.motion)
        (name,) = variant.coefficients
        settings.append((variant, (found.values[effect],)))
        parameters.update(named(effect, {name: (found.values[effect], found.sds[effect])}))
    return answer(job, [(tuple(told), 1.0), ((), 0.0)], settings, parameters)


def calibrate(job: Job) -> Corrections:
    """Fit type A and type B errors to the turns, and the radius to the straight ways."""
    turned, measured, way, length = _pieces(job)
    wheelbase_m = job.robot.plant.wheels.wheelbase_m
    # Measured turn = counted turn (1 − wheelbase) + mismatch · way / wheelbase.
    (wheelbase, mismatch), sds = _least_squares(
        np.column_stack([-turned, way / wheelbase_m]), measured - turned
    )
    straight = (np.abs(turned) < _STRAIGHT_RAD) & (np.abs(way) > _LEAST_M)
    scale, scale_sd = 0.0, math.inf
    if np.count_nonzero(straight) > 1:
        (scale,), (scale_sd,) = _least_squares(
            np.abs(way[straight])[:, None], length[straight] - np.abs(way[straight])
        )
    return Corrections(
        {"radius_scale": scale, "radius_mismatch": mismatch, "wheelbase_scale": wheelbase},
        {"radius_scale": scale_sd, "radius_mismatch": sds[1], "wheelbase_scale": sds[0]},
    )


def _pieces(job: Job) -> tuple[Floats, Floats, Floats, Floats]:
    """Return of each piece: turn as counted, turn as measured, way as counted, way as measured."""
    reference, motion = job.recording.reference, job.motion
    assert reference is not None  # every case of a trial has one
    kinds = kinds_of(job.recording, job.robot)
    prediction = Prediction(motion)
    counted = np.cumsum(prediction.turn_rad)
    way = np.cumsum(prediction.forward_m)
    heading = reference.heading_rad
    t_s = reference.t_s - job.delay_s
    inside = (motion.t_s >= t_s[0]) & (motion.t_s <= t_s[-1])
    x_m, y_m = (np.interp(motion.t_s, t_s, v) for v in (reference.x_m, reference.y_m))
    if heading is None:
        raise ValueError(f"{job.recording.name}: expected a reference with headings")
    seen = np.interp(motion.t_s, t_s, heading)
    every = max(1, round(_PIECE_S / motion.tick_s))
    rows = []
    for first in range(0, len(kinds) - every, every):
        last = first + every
        piece = slice(first, last + 1)
        good = job.sides.fit[piece].all() and inside[piece].all()
        if not good or np.all(kinds[piece] == REST):
            continue
        turn = counted[last] - counted[first]
        chord = math.hypot(x_m[last] - x_m[first], y_m[last] - y_m[first])
        rows.append((turn, seen[last] - seen[first], way[last] - way[first], chord))
    turned, measured, gone, length = np.array(rows).reshape(-1, 4).T
    return turned, measured, gone, length


def _least_squares(matrix: Floats, right: Floats) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return values and their standard deviations."""
    values = np.linalg.lstsq(matrix, right, rcond=None)[0]
    left = right - matrix @ values
    spread = float(left @ left) / max(len(right) - matrix.shape[1], 1)
    covariance = np.linalg.pinv(matrix.T @ matrix) * spread
    sds = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return tuple(values.tolist()), tuple(sds.tolist())
