"""What the pytest plugin needs once a test asks for a rig: settings, log file, leaked buses."""

from __future__ import annotations

import os
import re
import zlib
from pathlib import Path
from typing import Any, Final

import can
import pytest

from can_bus import IN_PROCESS_INTERFACES
from hil_harness.errors import HarnessError
from hil_harness.nearest import did_you_mean
from hil_harness.rig import Rig
from hil_harness.rig_assembly import given_effects

SHOWN_FRAMES: Final = 30
"""How many frames before a failure its report shows."""

_OF_A_TEST: Final = (
    *("robot", "device", "effects", "effect_library", "scenario", "seed", "force", "plant"),
    *("dbc", "signals"),
)
_PATHS: Final = ("robot", "effect_library", "dbc", "signals", "scenario")


class BusWatch:
    """Takes note of every python-can bus that is opened, until told to stop."""

    def __init__(self) -> None:
        """Start watching."""
        self._open: dict[int, tuple[can.BusABC, str]] = {}
        self._patch = pytest.MonkeyPatch()
        init, shutdown, opened = can.BusABC.__init__, can.BusABC.shutdown, self._open

        def noting_init(bus: can.BusABC, channel: Any, *args: Any, **kwargs: Any) -> None:
            init(bus, channel, *args, **kwargs)
            opened[id(bus)] = (bus, str(channel))

        def noting_shutdown(bus: can.BusABC) -> None:
            opened.pop(id(bus), None)
            shutdown(bus)

        self._patch.setattr(can.BusABC, "__init__", noting_init)
        self._patch.setattr(can.BusABC, "shutdown", noting_shutdown)

    def stop(self) -> None:
        """Stop watching."""
        self._patch.undo()

    def still_open(self) -> list[tuple[can.BusABC, str]]:
        """Return the buses that were opened and not shut down, each with its channel."""
        return list(self._open.values())


class RigOfTest:
    """One test's rig, its log and what has to be said if the test fails."""

    def __init__(self, rig: Rig, log: Path, watch: BusWatch) -> None:
        """Keep them together."""
        self.rig = rig
        self.log = log
        self._watch = watch
        self._failed = False

    @classmethod
    def open(
        cls,
        request: pytest.FixtureRequest,
        settings: dict[str, Any],
        tmp_path_factory: pytest.TempPathFactory,
    ) -> RigOfTest:
        """Open the rig that options, settings and markers ask for; fail the test if it cannot."""
        watch = BusWatch()
        try:
            log = _log_path(request, tmp_path_factory)
            return cls(Rig(log=log, **_rig_arguments(request, settings)), log, watch)
        except (ValueError, OSError) as error:
            watch.stop()
            line = str(error)
        # Outside the handler, so that the report has this line and no chain of exceptions.
        pytest.fail(f"chiplog: {line}", pytrace=False)

    def finish(self) -> None:
        """Close the rig, and throw its log away unless something has failed.

        A bus that was opened since the rig and left open fails the test, and is shut down.
        """
        try:
            self.rig.close()
        finally:
            self._watch.stop()
        leaked = self._watch.still_open()
        for bus, _ in leaked:
            bus.shutdown()
        if leaked:
            kinds = ", ".join(sorted({type(bus).__name__ for bus, _ in leaked}))
            channels = ", ".join(sorted({channel for _, channel in leaked}))
            pytest.fail(
                f"chiplog: {len(leaked)} python-can bus left open on channel {channels} "
                f"({kinds}): call shutdown(), or use it in a with block",
                pytrace=False,
            )
        if not self._failed:
            self.log.unlink(missing_ok=True)

    def failure_sections(self, error: BaseException | None) -> list[tuple[str, str]]:
        """Return the report's sections: the frames before *error* decoded, and where the log is."""
        if self._failed:
            return []  # a second phase of the same test: all is said
        self._failed = True
        lines = self.rig.recent_frames(SHOWN_FRAMES, before=error)
        sections = [(f"chiplog: the last {len(lines)} frames on the bus", "\n".join(lines))]
        if self.log.exists():
            sections.append(("chiplog: the log is kept", str(self.log)))
        return sections


def _rig_arguments(request: pytest.FixtureRequest, settings: dict[str, Any]) -> dict[str, Any]:
    """Put together what Rig takes: settings, then command line, then markers."""
    option = request.config.getoption
    here = request.path.parent
    arguments = _of_a_test(settings, "the fixture chiplog_settings", here)
    given = {
        name: option(f"--chiplog-{name}")
        for name in ("robot", "device", "dbc", "signals")
        if option(f"--chiplog-{name}") is not None
    }
    started_in = request.config.invocation_params.dir
    arguments |= _of_a_test(given, "the command line", started_in)
    for marker in reversed(list(request.node.iter_markers("chiplog"))):
        if marker.args:
            raise HarnessError(f"@pytest.mark.chiplog takes keywords only: {', '.join(_OF_A_TEST)}")
        arguments |= _of_a_test(dict(marker.kwargs), "@pytest.mark.chiplog", here)

    interface = option("--chiplog-interface")
    if arguments.get("device") == "none" and interface in IN_PROCESS_INTERFACES:
        raise HarnessError(
            f"device none: no ECU can reach the in-process interface {interface!r}; "
            "use --chiplog-interface with socketcan, udp_multicast or your hardware"
        )
    arguments["interface"] = interface
    arguments["channel"] = _channel(interface, option("--chiplog-channel"))
    arguments["bitrate"] = option("--chiplog-bitrate")
    arguments["bus_args"] = _bus_args(option("--chiplog-bus-arg"))
    return arguments


def _of_a_test(values: dict[str, Any], source: str, folder: Path) -> dict[str, Any]:
    """Check the names of settings, and let their relative paths start at *folder*."""
    for name in values:
        if name not in _OF_A_TEST:
            raise HarnessError(f"{source}: no setting {name!r}; {did_you_mean(name, _OF_A_TEST)}")
    arguments = dict(values)
    for name in _PATHS:
        value = arguments.get(name)
        if isinstance(value, str | Path) and (name != "scenario" or str(value).endswith(".toml")):
            arguments[name] = folder / value
    if "effects" in arguments:
        effects = given_effects(arguments["effects"])
        arguments["effects"] = (*effects.texts, *(folder / file for file in effects.files))
    if isinstance(arguments.get("device"), str):
        arguments["folder"] = folder
    return arguments


def _channel(interface: str, channel: str | None) -> str | None:
    """Return the channel with the worker's number in it.

    Raises HarnessError if several workers would talk over each other on one bus.
    """
    worker = os.environ.get("PYTEST_XDIST_WORKER")
    if channel is None:
        return None
    if worker is not None and "{worker}" not in channel and interface not in IN_PROCESS_INTERFACES:
        raise HarnessError(
            f"--chiplog-channel {channel}: the workers of pytest-xdist would all use this one bus; "
            f"give each its own, for example --chiplog-channel {channel.rstrip('0123456789')}"
            "{worker}, or run without -n"
        )
    return channel.replace("{worker}", "0" if worker is None else worker.removeprefix("gw"))


def _bus_args(pairs: list[str]) -> dict[str, str]:
    arguments: dict[str, str] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key:
            raise HarnessError(f"--chiplog-bus-arg {pair}: expected KEY=VALUE")
        arguments[key] = value
    return arguments


def _log_path(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a file name that says which test it is of, and that no other test has."""
    given = request.config.getoption("--chiplog-log-dir")
    if given is None:
        folder = tmp_path_factory.getbasetemp() / "chiplog-logs"
    else:
        folder = request.config.invocation_params.dir / given
    folder.mkdir(parents=True, exist_ok=True)
    test = request.node.nodeid
    readable = re.sub(r"[^A-Za-z0-9_.-]+", "_", test)[-100:].strip("_")
    return folder / f"{readable}-{zlib.crc32(test.encode()):08x}.log"
