"""Sizes that no effect has explain nothing, however well they fit."""

from __future__ import annotations

from types import SimpleNamespace
from typing import cast

import numpy as np

from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.priors import default_prior

MINUTE = SimpleNamespace(
    motion=SimpleNamespace(t_s=np.linspace(0.0, 60.0, 6001)), has_reference=True
)
SEARCH = cast(Scan, SimpleNamespace(model=SimpleNamespace(prior=default_prior(), nodes=MINUTE)))


def term(effect: str) -> Term:
    variant = Variant(effect, lambda prediction, **size: None, ("scale",))
    return Term(variant, (((0, 1.0),),), (0.002,))


def against(sizes: list[float]) -> float:
    terms = [term("radius_scale"), term("reference_scale")]
    return Scan._beyond_belief(SEARCH, terms, sizes)


def test_wheels_that_stand_still_in_a_room_twice_as_large_are_not_believed() -> None:
    assert against([-1.04, 1.04]) > 1e5
    assert against([-0.02, 1.04]) > 1e5


def test_sizes_that_occur_are_weighed_by_the_data_alone() -> None:
    assert against([-0.05, 0.02]) == 0.0


def test_a_wheel_does_not_slip_by_more_than_all_of_its_way() -> None:
    """It would drive backwards: its counts have the wrong sign."""
    variant = Variant("one_sided_slip", lambda prediction, **size: None, ("ratio",))
    slip = Term(variant, (((0, 1.0),),), (0.005,))
    assert Scan._beyond_belief(SEARCH, [slip], [1.9]) > 1e5
    assert Scan._beyond_belief(SEARCH, [slip], [0.9]) == 0.0


def test_what_cannot_be_negative_is_not_believed_to_be() -> None:
    variant = Variant("lateral_slip", lambda prediction, **size: None, ("c",), is_positive=True)
    slip = Term(variant, (((0, 1.0),),), (0.002,))
    assert Scan._beyond_belief(SEARCH, [slip], [-0.3]) > 1e5
    assert Scan._beyond_belief(SEARCH, [slip], [0.3]) == 0.0


def test_what_acts_all_the_time_otherwise_does_not_act_for_a_moment() -> None:
    def windowed(effect: str, stop_s: float) -> Term:
        window = {"start_s": 6.0, "stop_s": stop_s}
        act = Variant(effect, lambda prediction, **size: None, ("size",), fixed=window)
        return Term(act, (((0, 1.0),),), (0.0005,))

    assert Scan._beyond_belief(SEARCH, [windowed("missed_ticks", 6.5)], [0.04]) > 1e5
    assert Scan._beyond_belief(SEARCH, [windowed("missed_ticks", 16.0)], [0.04]) == 0.0
    assert Scan._beyond_belief(SEARCH, [windowed("one_sided_slip", 6.5)], [0.04]) == 0.0
