"""Tests marked `vcan` run where there is a bus named vcan0, wherever they are asked for.

`scripts/vcan.sh` brings that bus: from this kernel, or in a small virtual machine. All marked tests
of a session go there together, as an inner session, and each one's report comes back as its own. A
test that is there already (CHIPLOG_VCAN names the bus) runs like any other. In the machine a
program takes some fifteen times as long as outside: those marked `vcan(size="full")` run there only
if they are asked for, by `-m vcan` (scripts/vcan.sh) or `--chiplog-size full`.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, Final

import pytest

VCAN_ENV: Final = "CHIPLOG_VCAN"
_REPORTS_ENV: Final = "CHIPLOG_VCAN_REPORTS"
_ROOT: Final = Path(__file__).parent.parent
_SCRIPT: Final = _ROOT / "scripts" / "vcan.sh"
_INNER_SESSION: Final = (
    *("-m", "pytest", "-p", "lean", "-p", "on_vcan", "--noconftest"),
    *("-p", "no:cacheprovider"),
)
# Each import costs the machine about fifteen times what it costs here: no plugin but this module.
# This checkout and no other is what is compiled outside: what is not is compiled in the machine.
_LEAN: Final = {
    "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1",
    "PYTHONPATH": f"{Path(__file__).parent}{os.pathsep}{_ROOT}",
}
_HANG_S: Final = 1800
"""Ends a machine that hangs; no test waits for it otherwise."""
_CONSOLE_LINES: Final = 40

# The machine's processor has no instruction that the host's may have: code for the plainest one is
# compiled on the host, where that takes seconds, and found there in numba's cache.
_PLAIN_CODE: Final = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}


def pytest_configure(config: pytest.Config) -> None:
    """Declare the mark, and run marked tests where they can run."""
    config.addinivalue_line("markers", "vcan(size): needs a CAN bus named vcan0 (scripts/vcan.sh)")
    if os.environ.get(_REPORTS_ENV):
        config.pluginmanager.register(_Reporting(config, Path(os.environ[_REPORTS_ENV])))
    elif not os.environ.get(VCAN_ENV):
        config.pluginmanager.register(_Delegating(config))


class _Reporting:
    """The inner session: every report is written down as it is made."""

    def __init__(self, config: pytest.Config, path: Path) -> None:
        self._config = config
        self._path = path

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        plain = self._config.hook.pytest_report_to_serializable(config=self._config, report=report)
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(plain) + "\n")


class _Delegating:
    """The outer session: marked tests are run elsewhere, all at the first one's turn."""

    def __init__(self, config: pytest.Config) -> None:
        self._config = config
        self._reports: dict[str, list[pytest.TestReport]] | None = None
        self._console = ""

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        marked = [item for item in items if item.get_closest_marker("vcan")]
        if not marked:
            return
        where = subprocess.run([_SCRIPT, "--where"], capture_output=True, text=True, check=False)
        config = self._config
        is_asked_for = (
            "vcan" in config.option.markexpr or config.getoption("--chiplog-size") == "full"
        )
        if where.stdout.strip() != "namespace" and not is_asked_for:
            left = [item for item in marked if _is_for_full_size(item)]
            config.hook.pytest_deselected(items=left)
            items[:] = [item for item in items if item not in left]
            marked = [item for item in marked if item not in left]
        for item in marked:
            if where.returncode:
                reason = f"{where.stdout.strip()}; scripts/setup.sh test installs them"
                item.add_marker(pytest.mark.skip(reason=reason))

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> bool | None:
        if item.get_closest_marker("vcan") is None or item.get_closest_marker("skip"):
            return None
        if self._reports is None:
            self._reports = self._run(item.session.items)
        item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
        for report in self._reports.get(item.nodeid) or [self._nothing_came(item)]:
            item.ihook.pytest_runtest_logreport(report=report)
        item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
        return True

    def _run(self, items: list[pytest.Item]) -> dict[str, list[pytest.TestReport]]:
        """Run the marked ones among *items* on a vcan0; return what came of each."""
        marked = [item for item in items if item.get_closest_marker("vcan")]
        wanted = [item.nodeid for item in marked]
        # Of these tests only those of the full size run nodes.
        runs_nodes = any(map(_is_for_full_size, marked))
        compiled = ["kernels"] if runs_nodes else []
        with tempfile.TemporaryDirectory() as folder:
            reports = Path(folder, "reports")
            env = {**os.environ, **_PLAIN_CODE, "NUMBA_CACHE_DIR": f"{folder}/numba"}
            env["VCAN_PROCESSORS"] = "2" if runs_nodes else "1"
            subprocess.run(
                [sys.executable, Path(__file__).parent / "vcan" / "compile_plain.py", *compiled],
                env={**env, **_LEAN},
                cwd=_ROOT,
                check=True,
            )
            self._console = _output_of(
                [_SCRIPT, sys.executable, *_INNER_SESSION, *wanted],
                env={**env, **_LEAN, _REPORTS_ENV: str(reports), "VCAN_KEEP": folder},
            )
            lines = reports.read_text(encoding="utf-8").splitlines() if reports.exists() else []
        found: dict[str, list[pytest.TestReport]] = {}
        for line in lines:
            report = self._report(json.loads(line))
            found.setdefault(report.nodeid, []).append(report)
        return found

    def _report(self, plain: dict[str, Any]) -> pytest.TestReport:
        report = self._config.hook.pytest_report_from_serializable(config=self._config, data=plain)
        assert isinstance(report, pytest.TestReport)
        return report

    def _nothing_came(self, item: pytest.Item) -> pytest.TestReport:
        tail = "\n".join(self._console.splitlines()[-_CONSOLE_LINES:])
        return pytest.TestReport(
            nodeid=item.nodeid,
            location=item.location,
            keywords={},
            outcome="failed",
            longrepr=f"no report of this test came from vcan0; the console's last lines:\n{tail}",
            when="call",
        )


def _is_for_full_size(item: pytest.Item) -> bool:
    return any(mark.kwargs.get("size") == "full" for mark in item.iter_markers("vcan"))


def _output_of(command: list[Any], *, env: dict[str, str]) -> str:
    """Return what the command printed; it ends, with all it started, when this returns."""
    with subprocess.Popen(
        command,
        env=env,
        cwd=_ROOT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        start_new_session=True,
    ) as process:
        try:
            said, _ = process.communicate(timeout=_HANG_S)
        except BaseException:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    return said
