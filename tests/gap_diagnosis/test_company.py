"""Unlisted causes beside listed effects: of a block that a set speaks for, no more than is left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import pytest

from gap_diagnosis.company import Company
from gap_diagnosis.hypothesis import Fit

TICKS, PAYLOAD = "ticks_per_rev", "payload"


@dataclass(frozen=True)
class Told:
    """A block whose evidence of each set is given."""

    name: str
    told: Mapping[frozenset[str], float]

    @property
    def effects(self) -> frozenset[str]:
        return frozenset().union(*self.told)

    def fit(self, effects: frozenset[str]) -> Fit:
        evidence = self.told[effects] if effects else 0.0
        return Fit(tuple(sorted(effects)), evidence, evidence)


def test_what_a_set_says_of_the_drive_is_not_said_again_by_an_unlisted_one() -> None:
    """Ticks twice too many are no size of the effect; beside a payload that makes room for it the
    motion no longer denies them, and the drive's word counts for the set already."""
    motion = {
        frozenset({TICKS}): -1e6,
        frozenset({PAYLOAD}): -1e6,
        frozenset({TICKS, PAYLOAD}): 12_600.0,
    }
    drive = {frozenset({TICKS}): 6_500.0}
    logs = [[Told("motion", motion), Told("drive", drive)]]
    company = Company(logs, {"actuation": 6_170.0})
    assert company.of(frozenset({TICKS, PAYLOAD})) < 1.0
    # What is denied says nothing of the drive; the unlisted cause does.
    assert company.of(frozenset({TICKS})) == pytest.approx(6_170.0)
