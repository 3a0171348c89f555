"""Diagnoses made by hand: what the pages, files and commands around a diagnosis are tested with."""

from __future__ import annotations

from typing import Any

import numpy as np

from gap_diagnosis.pictures import HeldOutPath, Pictures, Report, ResidualMap, ResidualSeries
from gap_diagnosis.result import Diagnosis, sort_candidates
from gap_diagnosis.result_parts import (
    Advice,
    Candidate,
    ChoiceEstimate,
    Dependence,
    Gap,
    InputFile,
    LogFacts,
    Metric,
    Modelled,
    NumberEstimate,
    Segment,
    Structure,
    Unknown,
    Waterfall,
    WaterfallStep,
    Where,
)

SHA256 = "0" * 64
SCENARIO = 'schema = 1\nname = "spin"\n'


def number(estimate: float, sd: float, unit: str = "1") -> NumberEstimate:
    return NumberEstimate(
        estimate=estimate,
        unit=unit,
        sd=sd,
        ci50=(estimate - 0.674 * sd, estimate + 0.674 * sd),
        ci80=(estimate - 1.282 * sd, estimate + 1.282 * sd),
        ci95=(estimate - 1.96 * sd, estimate + 1.96 * sd),
    )


def candidate(*effects: str, probability: float, **more: Any) -> Candidate:
    more.setdefault("group_probability", probability)
    return Candidate(effects=tuple(sorted(effects)), probability=probability, **more)


def gap(before: float = 0.0481, after: float = 0.0023, floor: float = 0.0020) -> Gap:
    heading = Metric(
        unit="rad", before=0.02, after=0.001, floor=0.0009, windows=6, window_m=5.0, window_s=9.0
    )
    position = Metric(
        unit="m",
        before=before,
        after=after,
        floor=floor,
        closed=(before - after) / (before - floor),
        ci95=(0.97, 1.01),
        windows=6,
        window_m=5.0,
        window_s=9.0,
    )
    return Gap(
        metric="odometry_position_m",
        held_out="stretches",
        all={"odometry_position_m": position, "odometry_heading_rad": heading},
        **position.model_dump(),
    )


def diagnosis(**changes: Any) -> Diagnosis:
    """Return: two effects, told apart from all but one other set."""
    which = sort_candidates(
        [
            candidate(
                "radius_mismatch",
                "radius_scale",
                probability=0.81,
                group_probability=0.93,
                parameters={
                    "radius_mismatch.mismatch": number(-0.004, 0.0001),
                    "radius_scale.scale": number(-0.005, 0.0002),
                },
                ambiguous_with=(("radius_mismatch", "ticks_per_rev"),),
                separation=512.0,
                pareto_k=0.31,
            ),
            candidate(
                "radius_mismatch",
                "ticks_per_rev",
                probability=0.12,
                group_probability=0.93,
                parameters={
                    "radius_mismatch.mismatch": number(-0.004, 0.0001),
                    "ticks_per_rev.scale": number(0.005, 0.0002),
                },
                ambiguous_with=(("radius_mismatch", "radius_scale"),),
            ),
            candidate(
                "one_sided_slip",
                probability=0.05,
                parameters={
                    "one_sided_slip.side": ChoiceEstimate(
                        estimate="left", probabilities={"left": 0.9, "right": 0.1}
                    ),
                    "one_sided_slip.ratio": number(0.03, 0.01),
                },
                windows=((12.0, 20.5),),
            ),
            candidate("unknown", probability=0.01),
            candidate("no_gap", probability=0.0),
        ]
    )
    content: dict[str, Any] = {
        "verdict": "radius_mismatch+radius_scale",
        "stage": "wheel",
        "stage_probabilities": {"none": 0.0, "wheel": 0.88, "encoder": 0.12},
        "which": which,
        "other": 0.01,
        "where": Where(
            stages={"wheel": 1.04, "gyro": -0.04},
            segments=(
                Segment(start_s=0, stop_s=20, kind="straight", stage="wheel", share=0.7),
                Segment(start_s=20, stop_s=60, kind="arc", stage="gyro", share=0.3),
            ),
        ),
        "gap": gap(),
        "waterfall": Waterfall(
            metric="odometry_position_m",
            unit="m",
            before=0.0481,
            steps=(
                WaterfallStep(effect="radius_mismatch", reduction=0.0300),
                WaterfallStep(effect="radius_scale", reduction=0.0158),
            ),
            after=0.0023,
            floor=0.0020,
        ),
        "structure": Structure(
            detectable={"radius_scale": 0.0004, "lateral_slip": None},
            groups=(("radius_scale", "ticks_per_rev"), ("frame_latency", "reference_time_offset")),
        ),
        "advice": (
            Advice(
                separates=(("radius_scale",), ("ticks_per_rev",)),
                scenario_file="radius_scale-or-ticks_per_rev.toml",
                sentence="Turn one wheel by hand through ten full turns and read its counter.",
                expected_gain=0.9,
                scenario=SCENARIO,
            ),
        ),
        "assumptions": ("Contact noise between 0.1 and 3 mm/√m.",),
        "notes": ("The log has no odometry frames: the firmware was not replayed.",),
        "logs": (LogFacts(name="run.log", duration_s=60.0, ticks=6000, distance_m=36.0),),
        "inputs": (InputFile(role="log", name="run.log", sha256=SHA256),),
        "version": "0.1.0",
        "seconds": 4.2,
    }
    return Diagnosis(**(content | changes))


def single(effect: str = "wheelbase_scale", **parameters: Any) -> Diagnosis:
    """Return: one effect, sure."""
    which = (
        candidate(
            effect,
            probability=0.98,
            parameters={f"{effect}.{name}": value for name, value in parameters.items()},
        ),
        candidate("unknown", probability=0.02),
        candidate("no_gap", probability=0.0),
    )
    return diagnosis(verdict=effect, which=which, other=0.0, waterfall=None)


def nothing() -> Diagnosis:
    """Return: no gap, and nothing held out."""
    return diagnosis(
        verdict="no_gap",
        stage="none",
        stage_probabilities={"none": 0.95, "wheel": 0.05},
        which=(
            candidate("no_gap", probability=0.95),
            candidate("wheelbase_scale", probability=0.03),
            candidate("unknown", probability=0.02),
        ),
        other=0.0,
        gap=None,
        waterfall=None,
        where=Where(stages={}),
        advice=(),
    )


def unlisted() -> Diagnosis:
    """Return: a gap that no effect explains."""
    return diagnosis(
        verdict="unknown",
        which=(
            candidate("unknown", probability=0.9),
            candidate("wheelbase_scale", probability=0.1),
            candidate("no_gap", probability=0.0),
        ),
        other=0.0,
        waterfall=None,
        unknown=Unknown(
            stage="wheel",
            windows=((10.0, 30.0),),
            depends_on=(Dependence(variable="wheel_angle_left", share=0.8),),
            closes=0.9,
            modelled=Modelled(
                variable="wheel_angle_left",
                metric="odometry_position_m",
                unit="m",
                before=0.048,
                after=0.0066,
                floor=0.002,
                closed=0.9,
                ci95=(0.8, 0.95),
                windows=4,
            ),
        ),
    )


def pictures(points: int = 500) -> Pictures:
    time_s = np.linspace(0.0, 60.0, points)
    circle = np.column_stack([np.cos(time_s / 10), np.sin(time_s / 10)])
    error = 0.001 * time_s
    error[5] = np.nan
    return Pictures(
        residuals=(
            ResidualSeries("wheel", "reference − wheels, along x", "m", time_s, error, error / 20),
            ResidualSeries("gyro", "gyro heading − wheel heading", "rad", time_s, error / 9),
        ),
        residual_map=ResidualMap(
            np.linspace(0.0, 60.0, 7),
            ("wheel", "gyro"),
            np.array([[0.1, 0.2, 0.3, 0.1, 0.1, 0.2], [0, 0, 1.0, 0, 0, 0]]),
        ),
        paths=(HeldOutPath("20 to 40 s", circle, 1.05 * circle, 1.002 * circle),),
    )


def report(**changes: Any) -> Report:
    return Report(diagnosis(**changes), pictures())
