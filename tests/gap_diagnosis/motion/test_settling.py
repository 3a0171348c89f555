"""The search ends after a bounded number of fits, whatever the log."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import pytest
from motion_cases import ROBOT, WIRE, model_of

from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

WINDOW = (("start_s", 21.59), ("stop_s", 31.81))
SLIP = EffectSetting("one_sided_slip", (("side", "left"), ("ratio", 0.1), *WINDOW))
WHEELS = (
    EffectSetting("radius_mismatch", (("mismatch", 0.01),)),
    EffectSetting("wheelbase_scale", (("scale", 0.02),)),
)
GYRO = (
    EffectSetting("gyro_scale", (("scale", 0.03),)),
    EffectSetting("gyro_bias", (("bias", 0.01),)),
)


RIVALS = ("radius_scale", "turn_scrub")
"""What is sought beside them."""


def drive_with(*effects: EffectSetting) -> MotionModel:
    """Return the log of a drive of 40 s, by a library of what is in it and of a few rivals."""
    recording = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("calibration"),
        effects,
        7,
        reference=ReferenceNoise(),
        duration_s=40.0,
    )
    return model_of(recording, *(one.effect for one in effects), *RIVALS)


def test_no_part_is_fitted_twice_from_where_the_same_fit_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After a window had moved, every part of its set was fitted, and then once more."""
    begun: Counter[Any] = Counter()
    fit = Scan._fit

    def counted(self: Scan, terms: Any, levels: Any, start: Any, others: float) -> None:
        begun[tuple(id(one.variant) for one in terms), tuple(start), levels.tobytes()] += 1
        fit(self, terms, levels, start, others)

    monkeypatch.setattr(Scan, "_fit", counted)
    Scan(drive_with(SLIP, *WHEELS))
    assert len(begun) > 3
    assert max(begun.values()) == 1


@pytest.mark.full_size
def test_what_stretches_contradict_is_not_fitted_with_all_its_parts_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A wheel on ice, of which no listed effect is an account, had the search contradict ten sets,
    each after a fit of all its parts, at other windows and beside other effects."""
    contradicted: list[frozenset[str]] = []
    surrounded_after: list[int] = []
    parts_of = Scan._parts_of

    def contradicting(model: MotionModel, terms: Any, fit: Any) -> dict[str, float]:
        contradicted.append(frozenset(one.variant.effect for one in terms))
        return dict.fromkeys(contradicted[-1], 1e9)

    def counted(self: Scan, head: Any) -> Any:
        parts = parts_of(self, head)
        surrounded_after.extend(len(contradicted) for _ in parts)
        return parts

    monkeypatch.setattr("gap_diagnosis.motion.scan.excess", contradicting)
    monkeypatch.setattr(Scan, "_parts_of", counted)
    Scan(drive_with(*WHEELS, *GYRO))
    assert len(contradicted) > 3
    assert surrounded_after.count(2) + surrounded_after.count(3) == 0


def test_the_best_few_single_effects_are_fitted_whatever_straight_lines_say_of_them() -> None:
    """Along chords to its usual sizes a play of 0.15 rad gained 156 nats of 2,600, less than pairs
    of what it was not; only these were fitted, and an unlisted cause was likelier (1.0)."""
    without = frozenset(EXPLAINED) - {"gyro_bias", "lateral_slip", "radius_mismatch"}
    scan = Scan(MotionModel(drive_with(*WHEELS).recording, ROBOT, default_prior(), without=without))
    gain = {
        effects: 1e4 if len(effects) > 1 else 1.0 + len(min(effects, default=""))
        for effects in scan.found
    }
    scan.found = {
        effects: replace(one, log_evidence=gain[effects]) for effects, one in scan.found.items()
    }
    asked = [one.effects for one in scan._to_refit()]
    assert {one for one in asked if len(one) == 1} == {
        frozenset({one}) for one in ("gyro_bias", "lateral_slip", "radius_mismatch")
    }
