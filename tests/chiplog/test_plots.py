"""Labels beside curves keep apart without leaving their curves more than they must."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chiplog.pages.plots import _scale_of, _spread, _thinned

GAP_PX = 15.0
_ROUNDING = 1e-6

positions = st.lists(st.floats(0, 1000), max_size=8).map(sorted)


@given(positions)
def test_labels_are_a_line_apart(given_px: list[float]) -> None:
    assert all(np.diff(_spread(given_px, GAP_PX)) >= GAP_PX - _ROUNDING)


@given(positions)
def test_labels_that_are_apart_already_stay(given_px: list[float]) -> None:
    apart = [position + rank * GAP_PX for rank, position in enumerate(given_px)]
    assert _spread(apart, GAP_PX) == pytest.approx(apart)


@given(positions)
def test_labels_as_a_whole_do_not_drift(given_px: list[float]) -> None:
    assert sum(_spread(given_px, GAP_PX)) == pytest.approx(sum(given_px))


@given(st.integers(1, 5000))
def test_a_thinned_curve_keeps_its_ends(count: int) -> None:
    rows = np.arange(count, dtype=float)[:, None]
    thinned = _thinned(rows)
    assert thinned[0] == rows[0]
    assert thinned[-1] == rows[-1]
    assert len(thinned) <= 1500


@given(st.floats(1e-11, 1e3))
def test_an_axis_has_the_prefix_that_makes_its_largest_value_readable(largest: float) -> None:
    factor, _ = _scale_of([np.array([0.0, -largest, np.nan])])
    assert largest / factor >= 1
    assert largest / factor < 1000 or factor == 1.0
