"""What a method may try in the process that diagnoses, and finds closed."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import pytest

from gap_diagnosis.trials import drives
from gap_diagnosis.trials.layout import CASES, LOG, REFERENCE, ROBOT, TASK
from gap_diagnosis.trials.make import make_trial
from gap_diagnosis.trials.plan import Counts, Planned
from gap_diagnosis.trials.rivals import whitened_bic
from gap_diagnosis.trials.run import run_trial
from gap_diagnosis.trials.seal import BLOCK
from gap_diagnosis.trials.secret import Secret

SECRET: Final = Secret(bytes(range(48, 64)))
BEGINNING: Final = """
import ctypes, json, multiprocessing, os, pathlib, shutil, sqlite3, subprocess, sys

def forked():
    if os.fork() == 0:
        os._exit(0)

def spawned():
    child = multiprocessing.get_context("spawn").Process(target=print)
    child.start()
    child.join()

def loaded_anew():
    del sys.modules["_posixsubprocess"]
    import _posixsubprocess

def seen_from(folder, name):
    number = os.open(folder, os.O_RDONLY)
    try:
        os.close(os.open(name, os.O_RDONLY, dir_fd=number))
    finally:
        os.close(number)

def from_within(folder, name):
    os.chdir(folder)
    open(name).close()

def tried(attempts):
    found = {}
    for name, attempt in attempts.items():
        try:
            attempt()
            found[name] = "open"
        except PermissionError as error:
            found[name] = "closed" if "closed to this process" in str(error) else str(error)
        except BaseException as error:
            found[name] = f"{type(error).__name__}: {error}"
    return found

def diagnose(log, robot, reference, without):
    trial = log.parent.parent.parent
    here = log.parent.name
    other = trial / "cases" / ("0002" if here == "0001" else "0001")
    key = pathlib.Path(KEY)
    return tried({
"""
FILES: Final = {
    "the key": "lambda: open(key)",
    "the key by its number": "lambda: os.open(key, os.O_RDONLY)",
    "the key's bytes": "lambda: key.read_bytes()",
    "the key by a link": "lambda: open(LINK)",
    "the key under another name": "lambda: open(HARD)",
    "another key that nobody may read": "lambda: open(COPY)",
    "another key made readable": "lambda: os.chmod(COPY, 0o600)",
    "the key, copied": "lambda: shutil.copy(key, key.with_name('mine'))",
    "the key, renamed": "lambda: key.rename(key.with_name('mine'))",
    "the key, linked": "lambda: os.link(key, key.with_name('mine'))",
    "the key as a database": "lambda: sqlite3.connect(key)",
    "the key seen from its folder": "lambda: seen_from(key.parent, key.name)",
    "the key from within its folder": "lambda: from_within(key.parent, key.name)",
    "the answers": "lambda: open(trial / 'answers.sealed')",
    "the answers seen from above": "lambda: seen_from(trial.parent, 'trial/answers.sealed')",
    "another case": "lambda: (other / 'bus.log').read_text()",
    "another case seen from its own": "lambda: seen_from(log.parent, f'../{other.name}/bus.log')",
    "another case taken away": "lambda: (other / 'task.json').unlink()",
    "the results": "lambda: os.listdir(trial / 'results')",
    "all cases": "lambda: os.listdir(trial / 'cases')",
    "all cases, scanned": "lambda: os.scandir(trial / 'cases')",
    "all cases, walked": "lambda: list((trial / 'cases').iterdir())",
    "the trial, scanned": "lambda: os.scandir(trial)",
    "the trial, gone to": "lambda: os.chdir(trial)",
}  # fmt: skip
PROCESSES: Final = {
    "a process": "lambda: subprocess.run(['cat', key])",
    "a shell": "lambda: os.system('true')",
    "a pipe": "lambda: os.popen('true').read()",
    "another program": "lambda: os.execv('/bin/true', ['true'])",
    "a spawned program": "lambda: os.posix_spawn('/bin/true', ['true'], {})",
    "an older spawn": "lambda: os.spawnv(os.P_WAIT, '/bin/true', ['true'])",
    "a fork": "forked",
    "a worker": "spawned",
    "what starts a process, loaded anew": "loaded_anew",
    "open of C": "lambda: ctypes.CDLL(None).open",
    "open of C by another name": "lambda: ctypes.CDLL(None)['__open64']",
    "fopen of Python's own C": "lambda: ctypes.pythonapi.fopen",
    "system of C": "lambda: ctypes.CDLL(None)['system']",
    "no more hooks": "lambda: ctypes.pythonapi._PySys_ClearAuditHooks",
}
OPEN: Final = {
    "its own log": "lambda: log.read_text()",
    "its own folder": "lambda: sorted(log.parent.iterdir())",
    "a package": "lambda: __import__('scipy.stats')",
    "a file of its own": "lambda: pathlib.Path(OWN).write_text('mine')",
    "a number of C": "lambda: ctypes.pythonapi.Py_IsInitialized()",
}


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a trial of two nulls whose key lies elsewhere under a name of its own."""
    folder = tmp_path_factory.mktemp("closing") / "trial"
    elsewhere = key_of(folder).parent
    elsewhere.mkdir()
    plan = [Planned("field", "null", drive=drives.SHORT)] * 2
    make_trial(Counts(2, nulls=2, pairs=0), folder, key_of(folder), SECRET, plan=plan)
    (elsewhere / "link").symlink_to(key_of(folder))
    (elsewhere / "hard").hardlink_to(key_of(folder))
    (elsewhere / "copy").write_bytes(bytes(3 * BLOCK))  # another trial's
    (elsewhere / "copy").chmod(0)
    return folder


def key_of(folder: Path) -> Path:
    return folder.parent / "elsewhere" / "x"


@pytest.fixture(scope="module")
def found(trial: Path) -> dict[str, Any]:
    """Return what came of each attempt of a method in the first case: all in one process."""
    before = key_of(trial).stat()
    came = tried(trial, {**FILES, **PROCESSES, **OPEN})
    assert key_of(trial).stat() == before
    return came


def tried(folder: Path, attempts: Mapping[str, str]) -> dict[str, Any]:
    key = key_of(folder)
    names = {"KEY": key, "OWN": folder.parent / "own.txt"}
    names |= {name: key.with_name(name.lower()) for name in ("LINK", "HARD", "COPY")}
    text = "".join(f"{name} = {str(path)!r}\n" for name, path in names.items()) + BEGINNING
    text += "".join(f"        {name!r}: {attempt},\n" for name, attempt in attempts.items())
    method = folder.parent / "trying.py"
    method.write_text(text + "    })\n")
    out = folder.parent / "out.json"
    words = [sys.executable, "-m", "gap_diagnosis.trials.worker", folder / CASES / "0001"]
    subprocess.run([*map(str, [*words, out, key, method])], check=True, timeout=300)
    found: dict[str, Any] = json.loads(out.read_text())
    return found


def test_no_sealed_file_is_opened_by_whatever_name(found: dict[str, Any]) -> None:
    assert {name: found[name] for name in FILES} == dict.fromkeys(FILES, "closed")


def test_no_process_is_started_and_no_c_is_called_that_could_open_them(
    found: dict[str, Any],
) -> None:
    assert {name: found[name] for name in PROCESSES} == dict.fromkeys(PROCESSES, "closed")


def test_what_a_method_needs_stays_open(found: dict[str, Any]) -> None:
    assert {name: found[name] for name in OPEN} == dict.fromkeys(OPEN, "open")


@pytest.mark.full_size
def test_a_diagnosis_of_ours_and_a_rivals_run_closed_in(trial: Path) -> None:
    for method in (None, Path(whitened_bic.__file__)):
        ran = run_trial(trial, jobs=1, method=method, key=key_of(trial))
        assert ran.done == 2
        for path in ran.results.iterdir():
            found = json.loads(path.read_text())
            assert "error" not in found, found["traceback"]
            assert found["which"]
    home = trial / CASES / "0001"
    assert {path.name for path in home.iterdir()} == {LOG, ROBOT, REFERENCE, TASK}
