"""The pictures of a run: trajectories, error norms, what fixed point costs, the status word."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from chiplog.pages import quantities as q
from chiplog.pages.drawing import BLUE, GREEN, INK, ORANGE, ROSE, Picture, picture
from chiplog.pages.findings import is_ours
from chiplog.pages.plots import Curve, Floats, Track, draw_map, draw_over_time, draw_timeline
from hil_harness.results import Poses, RunResult

_COLOURS = (BLUE, ORANGE, GREEN, ROSE)


def trajectories(result: RunResult) -> Picture:
    """Draw truth, float and firmware seen from above; for the lesson, truth and both estimators."""
    tracks = [Track("truth", INK, result.truth, width=1.6)]
    if is_lesson(result):
        tracks += [Track(*named) for named in _estimates(result) if _has_position(named[2])]
        caption = (
            "Seen from above, one scale on both axes. Both estimators run in fixed point on the "
            "same accepted counts."
        )
    else:
        caption = "Seen from above, one scale on both axes."
        if _has_position(result.firmware):
            tracks.append(Track("firmware", BLUE, result.firmware, width=4.0))
            caption += " Where float lies within the firmware's line, they agree to the eye."
        tracks.append(Track("float", ORANGE, result.float_twin, width=1.3))
    return picture(
        "trajectories",
        "The way it went",
        caption,
        lambda canvas: draw_map(canvas, tracks),
        alt="Map of the run. "
        + " ".join(
            f"{track.label} ends at x {q.length(track.end[0])}, y {q.length(track.end[1])}."
            for track in tracks
        ),
    )


def error_norms(result: RunResult) -> Picture | None:
    """Draw the distance of the firmware, or of the lesson's estimators, from the truth.

    None where none of them has a position.
    """
    named = _estimates(result) if is_lesson(result) else [("firmware", BLUE, result.firmware)]
    named = [entry for entry in named if _has_position(entry[2])]
    if not named:
        return None
    curves = [Curve(name, colour, _distance(pose, result.truth)) for name, colour, pose in named]
    return picture(
        "error-norms",
        "How far from the truth",
        "Distance between the estimated and the true position.",
        lambda canvas: draw_over_time(
            canvas, result.time_s, [curves], ["position error"], ["m"], height_px=300
        ),
        alt=_alt_of_ends("Position error over time.", curves, "m"),
    )


def is_lesson(result: RunResult) -> bool:
    """Tell whether a run is the textbook lesson, whose subject is its two estimators."""
    return result.scenario == "lesson" and bool(result.estimators)


def _estimates(result: RunResult) -> list[tuple[str, str, Poses]]:
    """Return (name, colour, poses) of the estimators, and of a firmware that is neither."""
    named = {name: estimate.firmware for name, estimate in result.estimators.items()}
    if not any(np.array_equal(result.firmware, poses) for poses in named.values()):
        named["firmware"] = result.firmware
    return [
        (name, colour, poses)
        for colour, (name, poses) in zip(_COLOURS, named.items(), strict=False)
    ]


def arithmetic_errors(result: RunResult) -> Picture | None:
    """Draw firmware − float over time: what the integers cost, component by component.

    None where the firmware has no position.
    """
    if not _has_position(result.firmware):
        return None
    part = result.errors.arithmetic
    position = [Curve("x", BLUE, part[:, 0]), Curve("y", ORANGE, part[:, 1])]
    heading = [Curve("heading", GREEN, part[:, 2])]
    return picture(
        "arithmetic",
        "What fixed point costs" if is_ours(result) else "Firmware against float",
        "Firmware minus its float64 twin on the same counts and decisions: arithmetic alone."
        if is_ours(result)
        else "The firmware under test minus the float twin on the same counts.",
        lambda canvas: draw_over_time(
            canvas,
            result.time_s,
            [position, heading],
            ["position", "heading"],
            ["m", "rad"],
            height_px=400,
            width=1.1,
        ),
        alt=_alt_of_ends("Firmware minus float over time.", position, "m")
        + _alt_of_ends("", heading, "rad"),
    )


def status_timeline(
    result: RunResult, bits: Mapping[str, int], *, quiet: Sequence[str] = ()
) -> Picture | None:
    """Draw when each status bit was set; None when none but `quiet` ones ever was."""
    rows = {
        name: (result.status & bit) != 0
        for name, bit in bits.items()
        if name not in quiet and np.any(result.status & bit)
    }
    if not rows:
        return None
    ever = {name: float(np.mean(on)) for name, on in rows.items()}
    return picture(
        "status",
        "Status word",
        "When each status bit was set. Bits that are not listed never were.",
        lambda canvas: draw_timeline(canvas, result.time_s, result.duration_s, rows),
        alt="Share of the run each status bit was set: "
        + ", ".join(f"{name} {q.share(part)}" for name, part in ever.items()),
    )


def _alt_of_ends(title: str, curves: Sequence[Curve], unit: str) -> str:
    ends = " ".join(
        f"{curve.label} ends at {q.prefixed(float(curve.values[-1]), unit)}."
        for curve in curves
        if len(curve.values)
    )
    return f"{title} {ends} "


def _has_position(poses: Poses) -> bool:
    """Tell whether there is anything to draw: a silent firmware's poses are all NaN."""
    return bool(np.isfinite(poses[:, :2]).all(axis=1).any())


def _distance(estimate: Poses, truth: Poses) -> Floats:
    difference = estimate[:, :2] - truth[:, :2]
    return np.asarray(np.hypot(difference[:, 0], difference[:, 1]))
