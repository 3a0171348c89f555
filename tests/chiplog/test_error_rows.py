"""Every message that the docs list is what a user sees: one line, status 2, no traceback."""

from __future__ import annotations

import json
import re
from itertools import count
from pathlib import Path

import can
import pytest
from can.interfaces.virtual import VirtualBus
from command_line import Chiplog
from error_rows import SECTIONS, page
from error_tables.row import Row

from can_bus import read_log
from chiplog.cli import Status

ROWS = [row for rows in SECTIONS.values() for row in rows]
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "errors.md"


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.slug)
def test_the_message_is_one_line_and_the_status_two(
    row: Row, chiplog: Chiplog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, content in row.files.items():
        data = content.encode() if isinstance(content, str) else content
        (tmp_path / name).write_bytes(data)
    if row.breaks_after_frames is not None:
        break_the_bus(monkeypatch, row.breaks_after_frames)
    said = chiplog(*row.words)
    assert said.err in {f"chiplog: {line}\n" for line in (row.line, row.or_line or row.line)}
    assert said.out == ""
    assert said.status == 2


def break_the_bus(monkeypatch: pytest.MonkeyPatch, after_frames: int) -> None:
    """Let python-can's virtual bus fail as an adapter that is pulled out."""
    check = VirtualBus._check_if_open
    sent = count()

    def failing(bus: VirtualBus) -> None:
        if next(sent) >= after_frames:
            raise can.CanOperationError("adapter unplugged")
        check(bus)

    monkeypatch.setattr(VirtualBus, "_check_if_open", failing)


def test_a_bus_that_goes_away_leaves_a_log_that_can_be_read(
    chiplog: Chiplog, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    break_the_bus(monkeypatch, 500)
    assert chiplog("run", "--out", "out").status == 2
    assert len(list(read_log(tmp_path / "out" / "bus.log"))) > 400
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["interrupted"] is True


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
    assert len({row.slug for row in ROWS}) == len(ROWS)
