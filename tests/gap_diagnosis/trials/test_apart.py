"""The trials stand apart: nothing of the diagnosis knows them."""

from __future__ import annotations

from pathlib import Path

import gap_diagnosis

ROOM = Path(gap_diagnosis.__file__).parent


def test_nothing_in_the_diagnosis_imports_the_trials() -> None:
    others = [path for path in ROOM.rglob("*.py") if "trials" not in path.relative_to(ROOM).parts]
    assert len(others) > 50
    assert [path for path in others if "gap_diagnosis.trials" in path.read_text("utf-8")] == []
