"""Tables as columns of numbers: CSV with the standard library and numpy, Parquet with pyarrow."""

from __future__ import annotations

import csv
import importlib
import re
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any, Final, TextIO

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading.cut_off import is_cut_row, unfinished_line

Floats = NDArray[np.float64]

TABLE_SUFFIXES: Final = (".csv", ".parquet")
MAX_CELLS: Final = 200_000_000
"""Numbers that are read of one table, 1.6 GB: ten hours of twelve columns have a fifth of it."""

_MAX_COLUMNS: Final = 2_000
_MAX_LINE: Final = 1 << 20
_CHUNK_ROWS: Final = 20_000
_DELIMITERS: Final = ",;\t"
_DATE: Final = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d")
_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d*,\d+(?:[eE][+-]?\d+)?")
_LOOKED_AT: Final = 200
_MISSING: Final = frozenset({"", "nan", "na", "n/a", "null", "none", "-nan"})


def is_table(path: Path) -> bool:
    """Tell whether a file is a table by its name."""
    return path.suffix.lower() in TABLE_SUFFIXES


def read_header(path: Path) -> list[str]:
    """Return the names of a table's columns.

    Raises DiagnosisError for a file that cannot be read, has no header or a name twice.
    """
    if path.suffix.lower() == ".parquet":
        names = [str(name) for name in _parquet(path).schema_arrow.names]
    else:
        try:
            with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
                names = _header(path, file)[0]
        except OSError as error:
            raise DiagnosisError(f"{path}: cannot read this table: {error.strerror}") from None
    if len(names) > _MAX_COLUMNS:
        raise DiagnosisError(f"{path}: {len(names)} columns: expected at most {_MAX_COLUMNS}")
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise DiagnosisError(f"{path}:1: column {name!r} stands twice: expected each name once")
        seen.add(name)
    return names


def read_columns(path: Path, columns: Sequence[str]) -> dict[str, Floats]:
    """Return columns of a table as float64[rows]; empty cells and NaN are NaN.

    Decimal commas are understood where cells are apart by something else; dates and times of day
    (ISO 8601, in UTC where they say no zone) are seconds since 1970. A last row that breaks off is
    left out.

    Raises DiagnosisError naming row and column of a cell that is no number, and for a table that
    would fill the memory.
    """
    if path.suffix.lower() == ".parquet":
        return _read_parquet(path, columns)
    try:
        with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
            names, delimiter = _header(path, file)
            places = [names.index(column) for column in columns]
            parts = list(_read_parts(path, file, delimiter, names, places))
    except OSError as error:
        raise DiagnosisError(f"{path}: cannot read this table: {error.strerror}") from None
    whole = np.concatenate(parts) if parts else np.empty((0, len(places)))
    return {name: np.ascontiguousarray(whole[:, k]) for k, name in enumerate(columns)}


def is_cut_off(path: Path) -> bool:
    """Tell a table whose last row was cut off and is left out by `read_columns`."""
    if path.suffix.lower() == ".parquet":
        return False
    last = unfinished_line(path)
    if last is None:
        return False
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        names, delimiter = _header(path, file)
    return is_cut_row(last, delimiter, len(names))


def is_of_numbers(path: Path, column: str) -> bool:
    """Tell a column that holds a word among numbers from one of words, by its first cells.

    A table that is no text has types of its own: what cannot be read as numbers there is none.
    """
    if path.suffix.lower() == ".parquet":
        return False
    with path.open(encoding="utf-8-sig", errors="replace", newline="") as file:
        names, delimiter = _header(path, file)
        place = names.index(column)
        rows = csv.reader(islice(_bounded_lines(path, file), _LOOKED_AT), delimiter=delimiter)
        cells = [row[place].strip() for row in rows if len(row) > place]
    said = [cell for cell in cells if cell.lower() not in _MISSING]
    return 2 * sum(map(_is_number, said)) > len(said)


def _header(path: Path, file: TextIO) -> tuple[list[str], str]:
    line = file.readline(_MAX_LINE)
    if not line.strip():
        raise DiagnosisError(f"{path}: empty: expected a line with the names of the columns")
    if "\0" in line:
        raise DiagnosisError(f"{path}: no text in UTF-8, as UTF-16 is none: expected UTF-8")
    delimiter = max(_DELIMITERS, key=line.count)
    names = [name.strip() for name in next(csv.reader([line], delimiter=delimiter))]
    if all(_is_number(name) for name in names):
        raise DiagnosisError(f"{path}:1: numbers: expected the names of the columns in this line")
    return names, delimiter


def _read_parts(
    path: Path, file: TextIO, delimiter: str, names: Sequence[str], places: Sequence[int]
) -> Iterator[Floats]:
    cells = 0
    first = 2
    while lines := list(islice(_bounded_lines(path, file), _CHUNK_ROWS)):
        cells += len(lines) * len(places)
        if cells > MAX_CELLS:
            raise DiagnosisError(f"{path}: more than {MAX_CELLS} cells: expected a shorter table")
        if is_cut_row(lines[-1], delimiter, len(names)):
            lines.pop()
        yield _parse(path, lines, first, delimiter, names, places)
        first += len(lines)


def _bounded_lines(path: Path, file: TextIO) -> Iterator[str]:
    while line := file.readline(_MAX_LINE):
        if len(line) == _MAX_LINE:
            raise DiagnosisError(f"{path}: a line of over {_MAX_LINE >> 20} MiB: this is no table")
        yield line


def _parse(
    path: Path,
    lines: Sequence[str],
    first: int,
    delimiter: str,
    names: Sequence[str],
    places: Sequence[int],
) -> Floats:
    if not any(line.strip() for line in lines):
        return np.empty((0, len(places)))  # numpy would warn of it
    try:
        table = np.loadtxt(
            lines, delimiter=delimiter, usecols=places, ndmin=2, comments=None, dtype=np.float64
        )
        # Blank lines are left out by both ways of reading, but this one cannot say where.
        return np.asarray(table, dtype=np.float64)
    except ValueError:
        return _parse_cells(path, lines, first, delimiter, names, places)


def _parse_cells(
    path: Path,
    lines: Sequence[str],
    first: int,
    delimiter: str,
    names: Sequence[str],
    places: Sequence[int],
) -> Floats:
    rows = []
    for number, cells in enumerate(csv.reader(lines, delimiter=delimiter), first):
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) != len(names):
            raise DiagnosisError(
                f"{path}:{number}: {len(cells)} cells: expected {len(names)}, as in the header"
            )
        needed = [cells[place] for place in places]
        if delimiter != ",":
            needed = [_with_a_point(cell) for cell in needed]
        rows.append(
            [
                _number(path, number, names[place], cell)
                for place, cell in zip(places, needed, strict=True)
            ]
        )
    return np.array(rows, dtype=np.float64).reshape(-1, len(places))


def _number(path: Path, line: int, column: str, cell: str) -> float:
    text = cell.strip()
    if text.lower() in _MISSING:
        return float("nan")
    try:
        return _moment_s(text) if _DATE.match(text) else float(text)
    except ValueError:
        raise DiagnosisError(
            f"{path}:{line}: {column} = {text[:40]!r}: expected a number, or nothing where it is "
            "missing"
        ) from None


def _with_a_point(cell: str) -> str:
    text = cell.strip()
    return text.replace(",", ".") if _DECIMAL_COMMA.fullmatch(text) else text


def _moment_s(text: str) -> float:
    """Return a date and time of day as seconds since 1970; raises ValueError for another text."""
    moment = datetime.fromisoformat(text)
    return (moment if moment.tzinfo is not None else moment.replace(tzinfo=UTC)).timestamp()


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _parquet(path: Path) -> Any:
    if not path.is_file():
        raise DiagnosisError(f"{path}: no such file: expected a table")
    try:
        # pyarrow is an extra, and takes its time to import.
        module = importlib.import_module("pyarrow.parquet")
    except ImportError:
        raise DiagnosisError(
            f"{path}: reading Parquet needs pyarrow: pip install pyarrow, or save it as .csv"
        ) from None
    try:
        return module.ParquetFile(path)
    except Exception as error:  # pyarrow's errors derive from several bases
        raise DiagnosisError(f"{path}: not a Parquet file: {_short(error)}") from error


def _read_parquet(path: Path, columns: Sequence[str]) -> dict[str, Floats]:
    file = _parquet(path)
    if file.metadata.num_rows * max(len(columns), 1) > MAX_CELLS:
        raise DiagnosisError(f"{path}: more than {MAX_CELLS} cells: expected a shorter table")
    try:
        table = file.read(columns=list(columns))
        return {
            name: np.asarray(table.column(name).to_numpy(), dtype=np.float64) for name in columns
        }
    except Exception as error:  # a column of text, a damaged page, …
        raise DiagnosisError(
            f"{path}: columns {', '.join(columns)}: expected numbers: {_short(error)}"
        ) from error


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:200] or type(error).__name__
