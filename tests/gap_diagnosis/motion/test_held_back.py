"""No set of effects wins on straight lines that nobody followed."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np

from gap_diagnosis.motion.scan import Found, Scan


def found(evidence: float, *effects: str, fitted: bool = False) -> Found:
    again = cast(Any, SimpleNamespace()) if fitted else None
    return Found(frozenset(effects), (), evidence, evidence + 3.0, np.ones(9), again)


def test_a_set_that_was_never_fitted_again_does_not_win() -> None:
    """A line beside which every other effect shines cannot be followed for all of them."""
    scan = Scan.__new__(Scan)
    sets = [
        found(0.0),
        found(2.0, "radius_scale", fitted=True),
        found(58.0, "gyro_bias", "turn_scrub"),
        found(-1.0, "gyro_scale"),
    ]
    scan.found = {one.effects: one for one in sets}
    scan._hold_back_the_unfitted()
    best = max(scan.found.values(), key=lambda one: one.log_evidence)
    assert best.effects == {"radius_scale"}
    held = scan.found[frozenset({"gyro_bias", "turn_scrub"})]
    assert held.log_likelihood - held.log_evidence == 3.0
    assert scan.found[frozenset({"gyro_scale"})].log_evidence == -1.0
