"""What the full trial has, and what a smaller one says that it lacks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gap_diagnosis.trials.full import (
    CALIBRATION,
    EACH_EFFECT,
    FULL,
    NULLS,
    full_counts,
    newness,
    tally,
)
from gap_diagnosis.trials.plan import Counts, planned
from gap_diagnosis.trials.sizes import SIZES


@pytest.mark.parametrize("seed", range(8))
def test_a_full_trial_has_as_many_cases_of_every_kind_as_it_needs(seed: int) -> None:
    found = tally(planned(FULL, np.random.default_rng(seed)))
    assert found.effects.keys() == SIZES.keys()
    assert min(found.effects.values()) >= EACH_EFFECT
    assert {name: NULLS[name] for name in found.nulls if found.nulls[name] < NULLS[name]} == {}
    assert found.calibration >= CALIBRATION
    assert found.lacking == []


def test_however_the_prior_is_drawn_each_effect_has_its_cases() -> None:
    """A case of the prior is any effect or none; the cases of the other strata are each in turn."""
    plan = [one for one in planned(FULL, np.random.default_rng(1)) if one.stratum != "prior"]
    assert min(tally(plan).effects.values()) >= EACH_EFFECT


def test_a_smaller_trial_has_the_same_proportions() -> None:
    assert full_counts(FULL.cases) == FULL
    half = full_counts(FULL.cases // 2)
    assert half == replace(FULL, cases=4200, nulls=1000, pairs=120, withheld=200, other_engine=200)


def test_what_a_trial_lacks_is_told_by_kind_not_by_the_sum_of_its_cases() -> None:
    many = Counts(9000, nulls=8000, pairs=0, strata=("field",), new_share=0.0)
    (effects, *nulls, calibration) = tally(planned(many, np.random.default_rng(1))).lacking
    assert effects.startswith("40 cases of each effect alone: 82 of 82 have fewer")
    assert nulls == [
        f"400 nulls, {name}: 0" for name in ("new drive", "new noise", "new robot", "other engine")
    ]
    assert calibration == "3,000 cases for the calibration: 0"


def test_a_null_that_is_new_in_two_ways_counts_in_both_and_is_not_familiar() -> None:
    plan = planned(Counts(300, nulls=300, pairs=0, strata=("field",)), np.random.default_rng(1))
    both = [one for one in plan if len(newness(one)) == 2]
    found = tally(both)
    assert both
    assert sum(found.nulls.values()) == 2 * len(both)
    assert found.nulls["familiar"] == 0
