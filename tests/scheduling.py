"""Which tests share a worker of pytest-xdist, and in which order they start.

A file's tests run on one worker, so that what a file makes once (a fixture of a module, a cached
diagnosis, a program in C) is made once and not by every worker; long files start first, so that no
worker is alone at the end. `--dist loadgroup` is asked for on the command line; that pytest-xdist
3.8 loses its groups under pytest 9.2 without a word (its issue 1386) is why the rule stands here,
and why a run in which a file was split over workers fails.
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any, Final

import pytest
from xdist.scheduler import LoadScopeScheduling

LONGEST_FIRST: Final = (
    "tests/gap_diagnosis/test_diagnose.py",
    "tests/test_quality.py",
    "tests/vcan/",
    "tests/test_docs.py",
    "tests/chiplog/test_round_trip.py",
    "tests/gap_diagnosis/firmware/test_firmware_block.py",
    "tests/gap_diagnosis/drive/test_drive_block.py",
    "tests/gap_diagnosis/trials/",
    "tests/test_packaging.py",
    "tests/gap_diagnosis/",
    "tests/chiplog/test_pytest_plugin.py",
    "tests/firmware_model/test_kernel_cache.py",
    "tests/examples/",
    "tests/hil_harness/",
    "tests/precision_study/",
    "tests/chiplog/",
)
"""Beginnings of files' names; the rest follows. Of the first two, which two workers begin with, one
compiles every kernel and the other needs none, so that no kernel is compiled twice."""

APART: Final = ("tests/test_docs.py", "tests/chiplog/test_round_trip.py", "tests/test_quality.py")
"""Files whose tests share nothing and take long: each test is handed out alone."""

TOGETHER: Final = ("tests/vcan/", "tests/hil_harness/laws/")
"""Folders whose tests share one thing: a bus in a kernel, every law's measurements."""


def share_of(nodeid: str) -> str:
    """Return the name of what runs on one worker: a test, a file or a folder."""
    file, _, test = nodeid.partition("::")
    if file in APART:
        return nodeid
    if "[socketcan" in test:  # the bus in a kernel
        return TOGETHER[0]
    return next((folder for folder in TOGETHER if file.startswith(folder)), file)


def place_of(nodeid: str) -> int:
    """Return the place in line of a test's file."""
    return next(
        (place for place, name in enumerate(LONGEST_FIRST) if nodeid.startswith(name)),
        len(LONGEST_FIRST),
    )


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Start with what takes long; tests of one place keep their order."""
    items.sort(key=lambda item: place_of(item.nodeid))


def pytest_configure(config: pytest.Config) -> None:
    """Deal out files where tests are dealt out to workers."""
    if config.getoption("dist", None) == "loadgroup":
        config.pluginmanager.register(_Dealer())


class _Shares(LoadScopeScheduling):
    def _split_scope(self, nodeid: str) -> str:
        return share_of(nodeid)


class _Dealer:
    """The process that deals the tests out, and sees where they ran."""

    def __init__(self) -> None:
        self._workers: dict[str, set[str]] = defaultdict(set)

    @pytest.hookimpl(tryfirst=True, optionalhook=True)
    def pytest_xdist_make_scheduler(self, config: pytest.Config, log: Any) -> LoadScopeScheduling:
        config.option.loadscopereorder = False  # our order, not by the number of tests
        return _Shares(config, log)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._workers[share_of(report.nodeid)].add(getattr(report, "worker_id", ""))

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self._split():
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        for name in self._split():
            terminalreporter.write_line(f"split over workers: {name}", red=True)

    def _split(self) -> list[str]:
        return sorted(name for name, workers in self._workers.items() if len(workers) > 1)
