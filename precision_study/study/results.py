"""The results of a study as a table, as JSON, and the chosen configuration as a robot.toml."""

from __future__ import annotations

import csv
import importlib
import io
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from hil_harness.robot import Robot
from precision_study.errors import StudyError
from precision_study.study.answer import Outcome, high_words
from precision_study.study.space import Point

_KINDS = ("arithmetic position", "arithmetic heading", "total position", "total heading")
_CYCLE = re.compile(r'^(BA_ "GenMsg(?:CycleTime|StartDelayTime)" BO_ \d+ )(\d+);', re.M)


def rows(found: Sequence[Outcome]) -> list[dict[str, Any]]:
    """Return a row per configuration and scenario; units are in the names."""
    table = []
    for one in found:
        for scenario in one.scenarios:
            row: dict[str, Any] = {"key": one.point.key, **dict(one.point.values)}
            row |= {"scenario": scenario.scenario, "runs": scenario.runs}
            row["high"] = high_words(scenario.runs)
            for kind in _KINDS:
                name, unit = kind.replace(" ", "_"), "m" if "position" in kind else "rad"
                row[f"high_{name}_{unit}"] = scenario.high[kind]
                row[f"rms_final_{name}_{unit}"] = scenario.final_rms[kind]
            for quantity, unit in (("position", "m"), ("heading", "rad")):
                row[f"bound_{quantity}_{unit}"] = scenario.bound[quantity]
                row[f"expected_{quantity}_{unit}"] = scenario.expected[quantity]
            for cause, (bound, expected, *_) in scenario.budget.items():
                row[f"{cause}_bound_m"], row[f"{cause}_expected_m"] = bound, expected
            row |= {
                "overflows": scenario.overflows,
                "instructions_per_tick": one.cost.instructions,
                "instructions_per_s": one.cost.instructions_per_s,
                "table_bytes": one.cost.table_bytes,
                "state_bytes": one.cost.state_bytes,
            }
            table.append(row)
    return table


def write_table(path: Path, table: Sequence[Mapping[str, Any]]) -> None:
    """Write rows as CSV, or as Parquet where *path* says so.

    Raises:
        StudyError: Parquet without pyarrow.
    """
    if path.suffix == ".parquet":
        arrow, parquet = pyarrow_modules(path)
        parquet.write_table(arrow.Table.from_pylist(list(table)), path)
        return
    text = io.StringIO()
    writer = csv.DictWriter(text, list(table[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({name: _plain(value) for name, value in row.items()} for row in table)
    path.write_text(text.getvalue(), encoding="utf-8")


def pyarrow_modules(path: Path) -> tuple[Any, Any]:
    """Return pyarrow and its Parquet part; it is an extra, and takes its time to import.

    Raises:
        StudyError: it is not installed.
    """
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise StudyError(
            f"{path}: writing Parquet needs pyarrow: expected it installed "
            "(pip install 'chiplog[parquet]'), or --format csv"
        ) from None


def robot_toml(robot: Robot, point: Point, comment: Sequence[str]) -> str:
    """Return a whole robot.toml of a configuration, as `chiplog export-c` and `run` take it."""
    lines = [*(f"# {line}" for line in comment), "", "schema = 1", ""]
    lines += _table("robot", {"name": robot.name})
    for name, table in point.plant.model_dump().items():
        lines += _table(name, table)
    lines += _table("firmware", point.firmware.model_dump())
    design = robot.design.model_dump() | {"tick_period_us": point.tick_period_us}
    lines += _table("design", design)
    lines += _table("tolerance", robot.tolerance.model_dump())
    return "\n".join(lines).rstrip("\n") + "\n"


def dbc_at_tick(text: str, old_period_us: int, new_period_us: int) -> str | None:
    """Return a DBC whose cycles are scaled to another tick; None where one is no whole ms."""
    if any(int(cycle) * new_period_us % old_period_us for _, cycle in _CYCLE.findall(text)):
        return None
    return _CYCLE.sub(lambda one: f"{one[1]}{int(one[2]) * new_period_us // old_period_us};", text)


def _table(name: str, values: Mapping[str, Any]) -> list[str]:
    lines = [f"[{name}]"]
    inner = {key: value for key, value in values.items() if isinstance(value, Mapping)}
    for key, value in values.items():
        if key not in inner and value is not None:
            lines.append(f"{key} = {_toml(value)}")
    lines.append("")
    for key, table in inner.items():
        lines += _table(f"{name}.{key}", table)
    return lines


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        if not math.isfinite(value):
            raise AssertionError("a description holds finite numbers only")
        return repr(value)
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        # TOML takes no other control characters than these in a string.
        return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04X}" for c in escaped) + '"'
    return str(value)


def _plain(value: Any) -> Any:
    if isinstance(value, bool):
        return str(value).lower()
    return repr(value) if isinstance(value, float) else value
