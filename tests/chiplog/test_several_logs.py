"""Several logs given to `chiplog diagnose` at once, from files to exit status."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import Chiplog

from gap_diagnosis.result import Diagnosis

pytestmark = pytest.mark.usefixtures("no_pictures")

BOUND_RAD = 0.02
"""Wheels 2 % apart turn the lesson's figure of eight, 0.4 m/s on an axle of 0.3 m, by 0.13 rad more
in 5 s than the gyro says; the gyro's noise is 50 times less."""


def test_a_bound_is_held_against_every_log_and_the_gap_told_over_all(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    for name, mismatch in (("good", 0.0), ("bad", 0.02)):
        words = (
            f"run --scenario figure8 --duration-s 30 --effect radius_mismatch.mismatch={mismatch}"
        )
        assert chiplog(*words.split(), "--out", name).status == 0
    said = chiplog(
        "diagnose", "good/bus.log", "bad/bus.log", "--json", "OUT.json",
        "--fail-if", f"turn > {BOUND_RAD} rad",
    )  # fmt: skip
    assert said.status == 1
    assert "turn in bus.log (log 2): " in said.out
    found = Diagnosis.from_json((tmp_path / "OUT.json").read_text(encoding="utf-8"))
    good, bad = (log.metrics["turn_difference_rad"] for log in found.logs)
    assert good.before < BOUND_RAD < bad.before
    assert found.gap is not None
    both = found.gap.all["turn_difference_rad"]
    assert both.windows == good.windows + bad.windows
    squares = sum(one.windows * one.before**2 for one in (good, bad))
    assert both.before == pytest.approx((squares / both.windows) ** 0.5)
    assert any("over the windows of 2 logs together" in note for note in found.notes)
