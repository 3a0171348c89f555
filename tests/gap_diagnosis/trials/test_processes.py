"""Work shared out among processes is the same work."""

import math

import pytest

from gap_diagnosis.trials.processes import as_done


@pytest.mark.parametrize("jobs", [1, 2])
def test_every_row_is_done_once_however_many_work_on_them(jobs: int) -> None:
    rows = [(12 * k, 18) for k in range(20)]
    found = list(as_done(math.gcd, rows, jobs))
    assert sorted(found) == sorted(math.gcd(*row) for row in rows)
    assert jobs > 1 or found == [math.gcd(*row) for row in rows]


def test_what_goes_wrong_in_a_process_is_raised_here() -> None:
    with pytest.raises(ValueError, match="math domain"):
        list(as_done(math.sqrt, [(4.0,), (-1.0,)], 2))
