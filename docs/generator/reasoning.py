"""The worked case of docs/explanation/how-a-diagnosis-reasons.md, drawn from its diagnosis."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.pictures import Report
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness import load_robot, load_wire
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

_CAUSES = (
    EffectSetting("gyro_bias", (("bias", 0.004),)),
    EffectSetting("lateral_slip", (("compliance", 0.02),)),
)
_BEFORE, _AFTER, _PLAIN = "#b3412e", "#1f6f8b", "#888888"
_CHANNELS = ("reference − wheels, along x", "gyro heading − wheel heading")


def diagnosed() -> Report:
    """Drive a robot whose gyro is biased and which slips sideways, and diagnose it."""
    robot, wire = load_robot(), load_wire()
    recording = synthetic_recording(
        robot,
        wire,
        replace(scenario("calibration"), effects=()),
        _CAUSES,
        7,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
    )
    return diagnose_recordings([recording], robot, wire)


def draw_reasoning(target: Path) -> None:
    """Diagnose the worked case and draw it to `target`."""
    report = diagnosed()
    mpl.rcParams.update({"svg.hashsalt": "chiplog", "font.size": 9})
    figure = Figure(figsize=(9.0, 6.2), layout="constrained")
    grid = figure.subplots(2, 2)
    _draw_residuals(list(grid[0]), report)
    _draw_separations(grid[1, 0], report)
    _draw_gap(grid[1, 1], report)
    figure.savefig(target, metadata={"Date": None})


def _draw_residuals(places: list[Axes], report: Report) -> None:
    for letter, place, name in zip("AB", places, _CHANNELS, strict=True):
        one = next(series for series in report.pictures.residuals if series.name == name)
        factor, unit = (1000, "mm") if one.unit == "m" else (np.degrees(1), "°")
        place.plot(one.t_s, one.value * factor, color=_BEFORE, label="as described")
        if one.explained is not None:
            place.plot(one.t_s, one.explained * factor, color=_AFTER, label="explained")
        place.set(title=f"{letter}  {name}", xlabel="time [s]", ylabel=unit)
        place.legend(frameon=False)
        place.spines[["top", "right"]].set_visible(False)


def _draw_separations(place: Axes, report: Report) -> None:
    named = [one for one in report.diagnosis.which if one.separation][:6][::-1]
    values = [one.separation or 0.0 for one in named]
    place.barh(
        ["\n".join(one.effects) for one in named],
        values,
        color=[_AFTER if one is named[-1] else _PLAIN for one in named],
    )
    place.set(title="C  how much better than no effect", xlabel="separation")
    place.tick_params(axis="y", labelsize=7)
    place.spines[["top", "right"]].set_visible(False)


def _draw_gap(place: Axes, report: Report) -> None:
    gap = report.diagnosis.gap
    assert gap is not None
    assert gap.after is not None
    assert gap.floor is not None
    values = [1000 * value for value in (gap.before, gap.after, gap.floor)]
    bars = place.bar(["before", "after", "floor"], values, color=[_BEFORE, _AFTER, _PLAIN])
    place.bar_label(bars, fmt="%.1f mm")
    place.margins(y=0.15)
    place.set(title="D  position error, held-out stretches", ylabel="RMS [mm]")
    place.spines[["top", "right"]].set_visible(False)
