"""One case diagnosed in a process of its own, which cannot read the answers.

`python -m gap_diagnosis.trials.worker CASE OUT KEY [METHOD.py]` reads a case's folder and writes
OUT.json atomically. Before anything of the case is read, KEY and every file of the trial but this
case's own are closed to the process (`closing`). With the argument `serve` it forks such a process
for each line ``[CASE, OUT, KEY, METHOD]`` (JSON) that it reads, and answers with its exit code:
what all cases need is loaded once.
"""

from __future__ import annotations

import json
import os
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NoReturn, cast

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.reading import read_recordings
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.trials.closing import close_all_but
from gap_diagnosis.trials.layout import AGAIN, LOG, REFERENCE, ROBOT, TASK
from hil_harness.assembly import load_wire
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

Method = Callable[..., Any]

_LOADING_S: Final = 10.0
"""Of so short a drive a diagnosis runs the same machine code as of a whole one."""


def work(case: Path, out: Path, key: Path, method: Path | None = None) -> None:
    """Diagnose one case and write what was found, or how it failed."""
    case, out = case.resolve(), out.resolve()
    started = time.monotonic()
    close_all_but(case, out, key)
    try:
        found = _own(case) if method is None else _by_method(method, case)
    except Exception as error:
        found = {
            "error": f"{type(error).__name__}: {error}",
            "traceback": traceback.format_exc(),
            "seconds": time.monotonic() - started,
        }
    fresh = out.with_suffix(".part")
    fresh.write_text(json.dumps(found, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    fresh.replace(out)


def _own(case: Path) -> Any:
    """Diagnose as `chiplog diagnose` does, but for effects that the task withholds."""
    started = time.monotonic()
    robot, wire = load_robot(case / ROBOT), load_wire()
    drives = [one for one in (case, case / AGAIN) if one.is_dir()]
    recordings = read_recordings(
        [one / LOG for one in drives],
        robot=robot,
        wire=wire,
        references=[one / REFERENCE for one in drives],
    )
    without = frozenset(json.loads((case / TASK).read_text(encoding="ascii"))["without"])
    report = diagnose_recordings(recordings, robot, wire, started=started, without=without)
    return json.loads(report.diagnosis.to_json())


def _by_method(path: Path, case: Path) -> Any:
    """Diagnose by a file's ``diagnose(log, robot, reference, without)``, which gives OUT.json."""
    module = ModuleType("blind_method")
    module.__file__ = str(path)
    sys.modules[module.__name__] = module  # where dataclasses look up their annotations
    exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), module.__dict__)
    method = cast(Method, module.__dict__["diagnose"])
    without = json.loads((case / TASK).read_text(encoding="ascii"))["without"]
    return method(case / LOG, case / ROBOT, case / REFERENCE, without)


def load() -> None:
    """Load what a diagnosis needs, its machine code too: by that of a drive made up here."""
    robot, wire = load_robot(None), load_wire()
    square = scenario("square")
    drive = synthetic_recording(
        robot, wire, square, (), 1, reference=ReferenceNoise(), duration_s=_LOADING_S
    )
    diagnose_recordings([drive], robot, wire)


def serve() -> None:
    """Work each case that standard input names in a fork, one after the other.

    This process reads nothing of a trial, so a fork knows no more than a process begun anew.
    """
    for line in sys.stdin:
        words = [Path(word) for word in json.loads(line)]
        child = os.fork()
        if child == 0:
            _work_and_leave(words)
        _, status = os.waitpid(child, 0)
        print(os.waitstatus_to_exitcode(status), flush=True)


def _work_and_leave(words: Sequence[Path]) -> NoReturn:
    """Work one case and end, without the parent's business: its input, its output, its exit."""
    nowhere = os.open(os.devnull, os.O_RDWR)
    os.dup2(nowhere, sys.stdin.fileno())
    os.dup2(nowhere, sys.stdout.fileno())
    code = 1
    try:
        work(*words)
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


def main(arguments: Sequence[str]) -> int:
    """Run one case: CASE OUT KEY [METHOD.py]; or `serve` those that standard input names, or `load`
    and then serve."""
    if arguments[0] in {"load", "serve"}:
        if arguments[0] == "load":
            load()
        serve()
        return 0
    work(*map(Path, arguments))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
