"""Workers get whole files, long ones first, and a run that splits one is told."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from types import SimpleNamespace

import pytest
from scheduling import APART, LONGEST_FIRST, TOGETHER, _Dealer, place_of, share_of

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("name", sorted({*chain(LONGEST_FIRST, APART, TOGETHER)}))
def test_what_is_named_exists(name: str) -> None:
    assert (ROOT / name).exists()


def test_tests_of_a_file_go_to_one_worker_and_so_do_those_of_the_bus_in_a_kernel() -> None:
    assert share_of("tests/a/test_b.py::test_c[1]") == share_of("tests/a/test_b.py::test_d@group")
    assert share_of("tests/vcan/test_a.py::test_b") == share_of("tests/vcan/test_c.py::test_d")
    assert share_of("tests/test_docs.py::test_a[x]") != share_of("tests/test_docs.py::test_a[y]")


def test_a_file_that_is_not_named_comes_last() -> None:
    assert place_of(f"{LONGEST_FIRST[0]}::test_a") == 0
    assert place_of("tests/sim_plant/test_a.py::test_b") == len(LONGEST_FIRST)


@pytest.mark.parametrize(("workers", "is_split"), [(("gw0", "gw0"), False), (("gw0", "gw1"), True)])
def test_a_file_that_two_workers_ran_fails_the_run(workers: tuple[str], is_split: bool) -> None:
    dealer = _Dealer()
    for number, worker in enumerate(workers):
        report = SimpleNamespace(nodeid=f"tests/a.py::test[{number}]", worker_id=worker)
        dealer.pytest_runtest_logreport(report)
    session = SimpleNamespace(exitstatus=pytest.ExitCode.OK)
    dealer.pytest_sessionfinish(session)
    assert (session.exitstatus == pytest.ExitCode.TESTS_FAILED) is is_split
