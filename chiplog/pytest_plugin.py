"""The pytest plugin: a robot on a CAN bus as a fixture.

``chiplog_rig`` is a `hil_harness.rig.Rig`, ``chiplog_bus`` a python-can bus on the rig's channel.
Which bus, robot and device they are comes from the command line (``--chiplog-…``), from a project's
own ``chiplog_settings`` fixture and from ``@pytest.mark.chiplog(…)``; the nearest to the test wins.

Nothing heavy is imported before a test asks for a fixture: pytest loads this module in every
project on the machine.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    import can

    from chiplog.pytest_rig import RigOfTest
    from hil_harness.rig import Rig

_RIG_OF_TEST: pytest.StashKey[RigOfTest] = pytest.StashKey()

_MARKER = (
    "chiplog(robot=None, device=None, effects=(), effect_library=None, scenario=None, seed=1, "
    "force=False, plant=True, dbc=None, signals=None): configure this test's chiplog_rig; "
    "relative paths start at the test's file."
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options that choose the bus, the robot and the firmware under test."""
    group = parser.getgroup("chiplog", "chiplog: a robot on a CAN bus")
    group.addoption(
        "--chiplog-interface",
        default="virtual",
        metavar="NAME",
        help="python-can interface of chiplog_rig (default: virtual, which runs on simulated time)",
    )
    group.addoption(
        "--chiplog-channel",
        metavar="CHANNEL",
        help="channel, for example vcan0; {worker} becomes the number of the xdist worker "
        "(default: one that nobody else uses)",
    )
    group.addoption(
        "--chiplog-bitrate",
        type=int,
        metavar="BIT/S",
        help="bitrate for hardware (default: the DBC's)",
    )
    group.addoption(
        "--chiplog-bus-arg",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="further argument of the python-can interface; may be repeated",
    )
    group.addoption("--chiplog-dbc", metavar="FILE", help="DBC (default: the shipped one)")
    group.addoption(
        "--chiplog-signals",
        metavar="FILE",
        help="map.toml that says what the DBC's signals mean (default: that of the shipped DBC)",
    )
    group.addoption(
        "--chiplog-robot", metavar="FILE", help="robot.toml (default: the shipped robot)"
    )
    group.addoption(
        "--chiplog-device",
        metavar="DEVICE",
        help="firmware under test: python:FILE.py:CLASS, lib:FILE.so, process:COMMAND, or none "
        "(an ECU that is on the bus already) (default: the shipped firmware)",
    )
    group.addoption(
        "--chiplog-log-dir",
        metavar="DIR",
        help="where the logs of failed tests are kept (default: in pytest's temporary folder)",
    )


def pytest_configure(config: pytest.Config) -> None:
    """Declare the marker."""
    config.addinivalue_line("markers", _MARKER)


@pytest.fixture
def chiplog_settings() -> dict[str, Any]:
    """Override this in a conftest.py to configure the rigs of a project.

    Returns arguments of `hil_harness.rig.Rig`, such as
    ``{"robot": Path(__file__).parent / "our.toml"}``. An option on the command line wins over it,
    and a marker over both.
    """
    return {}


@pytest.fixture
def chiplog_rig(
    request: pytest.FixtureRequest,
    chiplog_settings: dict[str, Any],
    tmp_path_factory: pytest.TempPathFactory,
) -> Iterator[Rig]:
    """Return a robot on a bus: run_for, send, expect, expect_none, fault, restbus, truth, …

    Its bus log is kept if the test fails. A python-can bus that the test opened, on any channel,
    and did not shut down fails the test.
    """
    from chiplog.pytest_rig import RigOfTest

    rig_of_test = RigOfTest.open(request, chiplog_settings, tmp_path_factory)
    request.node.stash[_RIG_OF_TEST] = rig_of_test
    yield rig_of_test.rig
    rig_of_test.finish()


@pytest.fixture
def chiplog_bus(chiplog_rig: Rig) -> Iterator[can.BusABC]:
    """Return a python-can bus on the rig's channel, for frames that no DBC knows.

    In lockstep time stands still outside `run_for`, `expect` and `expect_none`: a frame that is
    sent here arrives in the next tick, and what the nodes send is there after it.
    """
    bus = chiplog_rig.open_bus()
    try:
        yield bus
    finally:
        bus.shutdown()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Add to a failed test's report the frames before the failure, and where the log is."""
    report = yield
    rig_of_test = item.stash.get(_RIG_OF_TEST, None)
    if rig_of_test is not None and report.failed:
        error = None if call.excinfo is None else call.excinfo.value
        report.sections.extend(rig_of_test.failure_sections(error))
    return report
