"""Every message that the docs list is what a user sees: one line, status 2, no traceback."""

from __future__ import annotations

import json
import re
import subprocess
from itertools import count
from pathlib import Path

import can
import pytest
from can.interfaces.virtual import VirtualBus
from command_line import Chiplog
from error_rows import SECTIONS, page
from error_tables import rig
from error_tables.row import Row

from can_bus import CanBusError, open_bus, read_log
from chiplog.cli import Status
from hil_harness.devices import include_dir
from hil_harness.errors import HarnessError
from hil_harness.rig import Rig

pytest_plugins = ["pytester"]

ROWS = [row for rows in SECTIONS.values() for row in rows]
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "errors.md"


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.slug)
def test_the_message_is_one_line_and_the_status_two(
    row: Row, chiplog: Chiplog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, content in row.files.items():
        data = content.encode() if isinstance(content, str) else content
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(data)
        if name.endswith(".c"):
            build(tmp_path / name)
    for name, target in row.links.items():
        (tmp_path / name).symlink_to(target)
    if row.breaks_after_frames is not None:
        break_the_bus(monkeypatch, row.breaks_after_frames)
    said = chiplog(*row.words)
    assert said.err in {f"chiplog: {line}\n" for line in (row.line, row.or_line or row.line)}
    shows_what_to_choose_from = row.words[0] == "map"
    assert said.out == "" or shows_what_to_choose_from
    assert said.status == 2


def build(source: Path) -> None:
    """Compile a device for `lib:`."""
    flags = ["-std=c99", "-shared", "-fPIC", f"-I{include_dir()}"]
    subprocess.run(["gcc", *flags, "-o", source.with_suffix(".so"), source], check=True)


def break_the_bus(monkeypatch: pytest.MonkeyPatch, after_frames: int) -> None:
    """Let the virtual bus fail to send as an adapter that is pulled out."""
    with open_bus("virtual", "unused") as bus:
        kind = type(bus)
    send, sent = kind.send, count()

    def unplugged(bus: VirtualBus) -> None:
        if not bus._open:
            raise can.CanOperationError("adapter unplugged")

    def sending(bus: VirtualBus, message: can.Message, timeout: float | None = None) -> None:
        bus._open = next(sent) < after_frames
        try:
            send(bus, message, timeout)
        finally:
            bus._open = True

    monkeypatch.setattr(VirtualBus, "_check_if_open", unplugged)
    monkeypatch.setattr(kind, "send", sending)


def test_a_bus_that_goes_away_leaves_a_log_that_can_be_read(
    chiplog: Chiplog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    break_the_bus(monkeypatch, 500)
    assert chiplog("run", "--out", "out").status == 2
    assert len(list(read_log(tmp_path / "out" / "bus.log"))) > 400
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["interrupted"] is True


@pytest.mark.parametrize("row", rig.STATEMENTS, ids=lambda row: row.slug)
def test_what_a_test_asks_wrongly_is_one_line_at_its_line(row: Row) -> None:
    with Rig() as chiplog_rig, pytest.raises((HarnessError, CanBusError)) as caught:
        eval(row.command, {"chiplog_rig": chiplog_rig, "Rig": Rig})
    assert str(caught.value) == row.line


@pytest.mark.parametrize("row", rig.SETTINGS, ids=lambda row: row.slug)
def test_a_rig_that_cannot_be_made_is_one_line_in_the_tests_report(
    row: Row, pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Rig() as warm:  # pytester forgets modules that an inner run imports
        warm.run_for(0.01)
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    for name, content in row.files.items():
        assert isinstance(content, str)
        (pytester.path / name).write_text(content, encoding="utf-8")
    options = row.words if row.command.startswith("pytest ") else []
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider", "test_it.py", *options)
    assert f"chiplog: {row.line}" in result.stdout.lines


def test_the_docs_list_exactly_these_messages() -> None:
    again = "python tests/chiplog/error_rows.py > docs/reference/errors.md"
    assert PAGE.read_text(encoding="utf-8") == page(), f"write it again: {again}"


@pytest.mark.parametrize("page", ["errors.md", "command-line.md"])
def test_both_pages_give_the_exit_statuses_that_the_program_has(page: str) -> None:
    text = (PAGE.parent / page).read_text(encoding="utf-8")
    statuses = re.findall(r"^\| (\d+) \| (\w+)", text, re.MULTILINE)
    assert statuses == [
        (str(status.value), word)
        for status, word in zip(Status, ("done", "done", "bad", "interrupted"), strict=True)
    ]


def test_no_kind_of_message_is_listed_twice() -> None:
    rows = [*ROWS, *rig.STATEMENTS, *rig.SETTINGS]
    assert len({row.slug for row in rows}) == len(rows)
