"""Every law measured once for all tests of this folder."""

import pytest

from hil_harness.laws import Bench, Finding, check_laws, default_bench


@pytest.fixture(scope="session")
def bench(size: str) -> Bench:
    return default_bench("full" if size == "full" else "small")


@pytest.fixture(scope="session")
def findings(bench: Bench) -> list[Finding]:
    return check_laws(bench)
