"""Cases that only the full size runs (`--chiplog-size full`): more of what the small one tests."""

from __future__ import annotations

from typing import Any

import pytest


def at_full_size(*values: Any) -> list[Any]:
    """Return values of a parametrised test, or tuples of values, as cases of the full size."""
    return [
        pytest.param(*(one if isinstance(one, tuple) else (one,)), marks=pytest.mark.full_size)
        for one in values
    ]
