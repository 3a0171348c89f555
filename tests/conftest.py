"""Options and settings shared by all tests."""

import gc
import os
from collections.abc import Generator

import pytest
from hypothesis import settings

pytest_plugins = ["on_vcan", "scheduling"]

# A worker of pytest-xdist for each core: more threads in each only wait for one another.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# The machines that run these tests are shared: no property may depend on the wall clock.
settings.register_profile("chiplog", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("chiplog")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--chiplog-size",
        choices=["small", "full"],
        default="small",
        help="small: what every change runs; full: 10^7 steps, thousands of trials",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Declare the mark of what only the full size runs."""
    config.addinivalue_line("markers", "full_size: more cases of what the small size tests too")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep what collection makes, half a million objects that stay to the end, from being searched
    for garbage time and again: 2 and 4 % of the time of two samples of tests."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what only the full size runs, where the size is small."""
    if config.getoption("--chiplog-size") == "full":
        return
    left = [item for item in items if item.get_closest_marker("full_size")]
    config.hook.pytest_deselected(items=left)
    items[:] = [item for item in items if item not in left]


@pytest.fixture(scope="session")
def size(request: pytest.FixtureRequest) -> str:
    """Return "small" or "full": how much work a statistical or soak test does."""
    value: str = request.config.getoption("--chiplog-size")
    return value


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say which tests were skipped where that counts as a failure."""
    if _skips_count_as_failures():
        for report in terminalreporter.getreports("skipped"):
            terminalreporter.write_line(f"a skip is a failure here: {report.nodeid}", red=True)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail a run in continuous integration that skipped anything."""
    reporter = session.config.pluginmanager.get_plugin("terminalreporter")
    if _skips_count_as_failures() and reporter is not None and reporter.stats.get("skipped"):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def _skips_count_as_failures() -> bool:
    return os.environ.get("CI") == "true"
