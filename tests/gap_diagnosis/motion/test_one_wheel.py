"""A wheel of another size is one cause, though two numbers of the catalogue say it."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import diagnosis_samples as samples
import pytest
from full_size import at_full_size
from motion_cases import ROBOT, WIRE, moved_only, without_others

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.facts import sizes_of_wheels
from gap_diagnosis.priors import WHEELS, default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario


def diagnosed(effects, seed, size):
    log = synthetic_recording(
        ROBOT,
        WIRE,
        replace(scenario("random"), duration_s=40.0),
        effects,
        seed,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=5e-4,
    )
    few = without_others(size, WHEELS | {"missed_ticks", "payload", "ticks_per_rev"})
    return diagnose_recordings([moved_only(log)], ROBOT, WIRE, without=few).diagnosis


def test_both_sizes_of_wheels_are_as_likely_as_one_effect_and_any_other_pair_is_not():
    prior = default_prior()
    even = dict.fromkeys((*WHEELS, "gyro_bias", "gyro_scale"), math.log(1 / 40))
    single = prior.log_probability_of({"gyro_bias"}, even)
    both = prior.log_probability_of(WHEELS, even)
    pair = prior.log_probability_of({"gyro_bias", "gyro_scale"}, even)
    assert both == pytest.approx(math.log(math.exp(single) + math.exp(pair)))
    beside = prior.log_probability_of(WHEELS | {"gyro_bias"}, even)
    assert math.exp(beside - pair) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize(("side", "sign"), [("right", 1.0), *at_full_size(("left", -1.0))])
def test_a_larger_wheel_is_told_as_one_and_each_wheels_size_is_said(side, sign, size):
    """Beside a scale that comes from the counts of a turn it was 0.3, and 0.3 the mismatch."""
    larger = 0.012
    effects = [
        EffectSetting("radius_scale", (("scale", larger / 2),)),
        EffectSetting("radius_mismatch", (("mismatch", sign * larger),)),
    ]
    found = diagnosed(effects, 4, size)
    assert found.which[0].effects == tuple(sorted(WHEELS))
    assert found.which[0].probability > 0.85
    (said,) = (note for note in found.notes if note.startswith("radius_scale and radius_mismatch"))
    said_percent = dict(re.findall(r"(left|right) ([+-][\d.]+) %", said))
    assert {one: float(size) for one, size in said_percent.items()} == {
        one: pytest.approx(100 * larger if one == side else 0.0, abs=0.1)
        for one in ("left", "right")
    }


@pytest.mark.parametrize("seed", [7, *at_full_size(6, 8, 9)])
def test_a_mismatch_alone_stays_one(seed, size):
    found = diagnosed([EffectSetting("radius_mismatch", (("mismatch", 0.005),))], seed, size)
    assert found.verdict == "radius_mismatch"
    assert found.which[0].probability > 0.6


def test_of_wheels_whose_sizes_differ_for_a_while_no_size_is_said():
    """One that grew at 30 s was told beside the other's mean, as if both were so all along."""
    mean, apart = samples.number(0.006, 1e-4), samples.number(0.012, 1e-4)
    sizes = {"radius_scale.scale": mean, "radius_mismatch.mismatch": apart}
    leading = samples.single("radius_scale").which[0].model_copy(update={"parameters": sizes})
    assert len(sizes_of_wheels(leading)) == 1
    ends = {"radius_mismatch.start_s": samples.number(30.0, 0.1, "s")}
    assert sizes_of_wheels(leading.model_copy(update={"parameters": sizes | ends})) == ()
