"""A process closed to what is sealed: by an audit hook, which code that runs later cannot take out.

Python tells a hook of every file that it opens and of every process that it starts. Machine code of
a library that opens files by itself tells nobody, and whoever rewrites this process's own modules
gets by: against a method that means to cheat only a key on another machine helps
(docs/how-to/blind-trials.md).
"""

from __future__ import annotations

import os
import stat
import subprocess  # so that what it starts processes with is loaded, and closed
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NoReturn

from gap_diagnosis.trials.seal import BLOCK

_PATHS: Final = frozenset(
    {
        "open",
        "os.chdir",
        "os.chmod",
        "os.chown",
        "os.link",
        "os.listdir",
        "os.mkdir",
        "os.remove",
        "os.rename",
        "os.rmdir",
        "os.scandir",
        "os.symlink",
        "os.truncate",
        "os.utime",
        "sqlite3.connect",
    }
)
_LISTS: Final = frozenset({"os.chdir", "os.listdir", "os.scandir"})
"""What takes the number of an open folder as well."""

_STARTS: Final = frozenset(
    {
        "_winapi.CreateProcess",
        "cpython.PyInterpreterState_New",  # an interpreter that has no hook
        "os.exec",
        "os.fork",
        "os.forkpty",
        "os.posix_spawn",
        "os.spawn",
        "os.startfile",
        "os.system",
        "pty.spawn",
        "subprocess.Popen",
    }
)
_FORKS: Final = {"_posixsubprocess": "fork_exec", subprocess.__name__: "_fork_exec"}
"""Functions that start processes and tell no hook; a module loaded anew would have them again."""
_LOOKS_UP: Final = frozenset({"ctypes.dlsym", "ctypes.dlsym/handle"})
_REACHING: Final = (
    "creat", "clone", "dlmopen", "dlopen", "dlsym", "exec", "fdopendir", "fopen", "fork", "freopen",
    "open", "popen", "posix_spawn", "process_vm_readv", "ptrace", "syscall", "system", "vfork",
)  # fmt: skip
"""How functions of C begin that open files or start processes; hooks are another matter."""

_OPEN_FILES: Final = Path("/proc/self/fd")


def close_all_but(case: Path, out: Path, key: Path) -> None:
    """From now on refuse to open what lies beside the case: other cases, answers, their key.

    *case*, *out*: absolute, the case's folder and where its result goes. *key*: where the key of
    the answers lies, if it is on this machine; a file that nobody may read, of a key's length, is
    one of some trial, wherever it lies. To start another process, which has no hook, is refused
    too.
    """
    sealed = _Sealed(case, out, key)

    def audit(event: str, arguments: tuple[Any, ...]) -> None:
        if event in _PATHS:
            for argument in arguments[:2]:
                for path in _meant(event, argument):
                    sealed.refuse(path)
        elif event in _STARTS:
            _no_process(event)
        elif event in _LOOKS_UP:
            name = str(arguments[1])
            if name.lstrip("_").startswith(_REACHING) or "AuditHook" in name:
                raise PermissionError(f"{name}: closed to this process: it gets around the seal")
        elif event == "import" and arguments[0] in _FORKS:
            _no_process(f"{arguments[0]}, loaded anew")

    for module, name in _FORKS.items():
        if hasattr(sys.modules.get(module), name):
            setattr(sys.modules[module], name, _no_process)
    sys.addaudithook(audit)


def _no_process(event: object = "fork_exec", *_: object) -> NoReturn:
    what = event if isinstance(event, str) else "fork_exec"
    raise PermissionError(f"{what}: closed to this process: another one could open what is sealed")


class _Sealed:
    """What a case's process may not open."""

    def __init__(self, case: Path, out: Path, key: Path) -> None:
        trial = case.parent.parent
        self._trial, self._around = str(trial), str(trial.parent)
        self._case = str(case)
        self._own = {self._case, str(out), str(out.with_suffix(".part"))}
        self._key_path = os.path.realpath(key)
        self._key = _identity(key)

    def refuse(self, path: str) -> None:
        """Raise PermissionError where a path, all its links followed, is sealed."""
        if _is_in(path, self._trial) and not (path in self._own or _is_in(path, self._case)):
            raise PermissionError(f"{path}: closed to this process: it is part of the trial")
        if (path.endswith(".key") and _is_in(path, self._around)) or self._is_key(path):
            raise PermissionError(f"{path}: closed to this process: a key")

    def _is_key(self, path: str) -> bool:
        if path == self._key_path:
            return True
        try:
            found = Path(path).stat()
        except (OSError, ValueError):
            return False
        if self._key is not None and (found.st_dev, found.st_ino) == self._key:
            return True
        is_shut = stat.S_ISREG(found.st_mode) and not stat.S_IMODE(found.st_mode)
        return is_shut and found.st_size > 0 and found.st_size % BLOCK == 0


def _identity(path: Path) -> tuple[int, int] | None:
    """Return what a file keeps under every name; None where there is none."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def _is_in(path: str, folder: str) -> bool:
    return path == folder or path.startswith(folder.rstrip(os.sep) + os.sep)


def _meant(event: str, argument: Any) -> Iterator[str]:
    """Yield the files that an argument of an event may mean."""
    if isinstance(argument, int):
        if event in _LISTS:
            yield os.path.realpath(_OPEN_FILES / str(argument))
        return
    if argument is None and event in _LISTS:
        argument = "."
    if not isinstance(argument, str | bytes | os.PathLike):
        return
    name = os.fsdecode(argument)
    yield os.path.realpath(name)
    if not Path(name).is_absolute() and _OPEN_FILES.is_dir():
        # seen from any folder that is open: an event does not say from which
        for place in _OPEN_FILES.iterdir():
            yield os.path.realpath(place / name)
