"""Judged cases on disk, so that trials add up over sessions and machines.

A full trial takes longer than a machine is there for. What is kept of a case are its effects and
its scores, not its log nor the world around: enough for every table, and for nobody to make the
case again.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.trials.case import Case
from gap_diagnosis.trials.judge import Judged, Parameter
from gap_diagnosis.trials.opening import Opened
from gap_diagnosis.trials.truth import Answer

_SCHEMA: Final = 1


def keep(path: Path, opened: Mapping[str, Opened]) -> None:
    """Write every method's judged cases to *path*, a line of JSON each, compressed.

    The same cases give the same bytes.
    """
    missing = {method: own.missing for method, own in opened.items()}
    lines = [json.dumps({"schema": _SCHEMA, "missing": missing})]
    lines += [
        json.dumps({"method": method, **_plain(one)}, sort_keys=True)
        for method, own in opened.items()
        for one in own.judged
    ]
    text = "\n".join(lines) + "\n"
    path.write_bytes(gzip.compress(text.encode(), mtime=0))


def kept(path: Path) -> dict[str, Opened]:
    """Return what `keep` wrote; raise DiagnosisError for a file of another kind."""
    try:
        first, *lines = gzip.decompress(path.read_bytes()).decode().splitlines()
        head = json.loads(first)
        if head["schema"] != _SCHEMA:
            raise ValueError(f"schema {head['schema']}, not {_SCHEMA}")
        rows = [json.loads(line) for line in lines]
        return {
            method: Opened(tuple(_judged(row) for row in rows if row["method"] == method), count)
            for method, count in head["missing"].items()
        }
    except (gzip.BadGzipFile, ValueError, KeyError, TypeError) as error:
        raise DiagnosisError(
            f"{path}: {error}: expected judged cases as benchmarks/blind_trial.py keeps them"
        ) from error


def _plain(one: Judged) -> dict[str, Any]:
    told = asdict(one)
    told["case"] = replace(one.case, secret="", nominal={}, surroundings={}).as_json()
    told["truth"] = sorted(one.truth)
    told["oracle"] = _sorted(one.oracle)
    told["group"] = _sorted(one.group)
    return told


def _sorted(answers: frozenset[Answer]) -> list[list[str]]:
    return sorted(sorted(one) for one in answers)


def _judged(row: dict[str, Any]) -> Judged:
    told = {name: value for name, value in row.items() if name != "method"}
    told["case"] = Case.from_json(told["case"])
    told["truth"] = frozenset(told["truth"])
    told["oracle"] = frozenset(frozenset(one) for one in told["oracle"])
    told["group"] = frozenset(frozenset(one) for one in told["group"])
    told["parameters"] = tuple(
        Parameter(**{**one, "inside": tuple(one["inside"])}) for one in told["parameters"]
    )
    told["gap"] = None if told["gap"] is None else tuple(told["gap"])
    if told.get("leftover") is not None:
        told["leftover"] = tuple(told["leftover"])
    return Judged(**told)
