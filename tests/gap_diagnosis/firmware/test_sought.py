"""The value of a constant that gives a record's bits is among those that do."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from gap_diagnosis.firmware.candidates import RealParameter
from gap_diagnosis.firmware.sought import Sought
from gap_diagnosis.firmware.workbench import Workbench

SCALE = RealParameter(
    {"firmware_constant.constant": "wheelbase"},
    "firmware_constant.scale",
    "constant_scale",
    {"constant": "wheelbase"},
    -0.5,
    0.5,
    0.0,
    1e-5,
    0.5,
)
FOUND = 0.1


@dataclass(frozen=True)
class Known(Sought):
    """A search of which it is known between which values no kernel gives the record."""

    hole: tuple[float, float] = (0.0, 0.0)

    def _is_equal(self, value: float) -> bool:
        low, high = self.hole
        return abs(value - FOUND) <= 1e-9 and not low < value < high


@pytest.mark.parametrize("hole", [(0.0, 0.0), (FOUND - 4e-10, FOUND - 1e-12)])
def test_a_value_that_gives_the_bits_is_told_though_not_all_around_it_do(
    hole: tuple[float, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 46 wheelbases that lie among those that give a blend's record 38 do, the middle not:
    a constant known to ten digits was an unlisted program (0.96)."""
    search = Known(object.__new__(Workbench), SCALE, {}, {}, hole)
    # From the value outwards the search steps over what is narrow.
    monkeypatch.setattr(
        "gap_diagnosis.firmware.sought.cell_about",
        lambda *_: (FOUND - 1e-9, FOUND + 6e-10),
    )
    (candidate,) = search._whole([FOUND])
    told = candidate.values["firmware_constant.scale"]
    assert isinstance(told, float)
    assert search._is_equal(told)
