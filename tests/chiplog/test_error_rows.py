"""Every message that the docs list is what a user sees: one line, status 2, no traceback."""

from __future__ import annotations

from pathlib import Path

import pytest
from command_line import Chiplog
from error_rows import SECTIONS, Row, page

ROWS = [row for rows in SECTIONS.values() for row in rows]
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "errors.md"


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.slug)
def test_the_message_is_one_line_and_the_status_two(
    row: Row, chiplog: Chiplog, tmp_path: Path
) -> None:
    for name, content in row.files.items():
        data = content.encode() if isinstance(content, str) else content
        (tmp_path / name).write_bytes(data)
    said = chiplog(*row.words)
    assert said.err == f"chiplog: {row.line}\n"
    assert said.out == ""
    assert said.status == 2


def test_the_docs_list_exactly_these_messages() -> None:
    again = "python tests/chiplog/error_rows.py > docs/reference/errors.md"
    assert PAGE.read_text(encoding="utf-8") == page(), f"write it again: {again}"


def test_no_kind_of_message_is_listed_twice() -> None:
    assert len({row.slug for row in ROWS}) == len(ROWS)
