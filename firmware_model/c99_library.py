"""The C99 kernel as a shared library of this machine, built once and kept."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Final

from firmware_model import c99
from firmware_model.c99_layout import struct_dtype
from firmware_model.errors import FirmwareError

COMPILERS: Final = ("cc", "gcc", "clang")
"""Tried in this order; the environment's CC goes first."""

FLAGS: Final = ("-std=c99", "-O2")
_SHARED: Final = ("-shared", "-fPIC")
_INTEGER = ctypes.c_int64
_POINTER = ctypes.c_void_p


def cache_folder() -> Path:
    """Return the user's folder for what can be made again."""
    if sys.platform == "win32":
        base = os.environ.get("LOCALAPPDATA", "")
    else:
        base = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(base) if base else Path.home() / ".cache") / "chiplog"


def find_compiler() -> list[str]:
    """Return the words that call the C compiler.

    Raises:
        FirmwareError: there is none.
    """
    asked = shlex.split(os.environ.get("CC", ""))
    for words in (asked, *([name] for name in COMPILERS)):
        if words and shutil.which(words[0]):
            return words
    tried = ", ".join([*asked[:1], *COMPILERS])
    raise FirmwareError(
        f"kernel c99: no C compiler: none of {tried} is on PATH: expected one, for example by "
        "`apt-get install gcc libc6-dev`, or --kernel compiled"
    )


@lru_cache(maxsize=8)
def library(flags: Sequence[str] = FLAGS) -> ctypes.CDLL:
    """Return the kernel built with these flags, from the cache if it is there.

    The cache's key covers sources, flags and the compiler's own words about itself. A folder that
    cannot be written is replaced by one that lasts as long as this process.

    Raises:
        FirmwareError: no compiler, or one that does not compile the sources.
    """
    compiler = find_compiler()
    name = f"c99-{_digest(compiler, flags)}.so"
    built = cache_folder() / name
    if not built.is_file():
        built = _build(compiler, flags, built)
    return _checked(ctypes.CDLL(str(built)))


def _digest(compiler: list[str], flags: Sequence[str]) -> str:
    known = subprocess.run([*compiler, "--version"], capture_output=True, check=False)
    digest = hashlib.sha256(known.stdout + known.stderr)
    for words in (compiler, flags):
        digest.update("\0".join(words).encode() + b"\0\0")
    for name in (c99.HEADER, c99.SOURCE, c99.HOST):
        digest.update(c99.text(name).encode())
    return digest.hexdigest()[:32]


def _build(compiler: list[str], flags: Sequence[str], wanted: Path) -> Path:
    try:
        wanted.parent.mkdir(parents=True, exist_ok=True)
        work = tempfile.mkdtemp(dir=wanted.parent)
    except OSError:
        wanted = Path(_process_folder()) / wanted.name
        work = tempfile.mkdtemp(dir=wanted.parent)
    try:
        made = Path(work) / wanted.name
        compile_library(compiler, flags, made)
        made.replace(wanted)  # at once: another process never sees half a file
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return wanted


@lru_cache(maxsize=1)
def _process_folder() -> str:
    folder = tempfile.TemporaryDirectory(prefix="chiplog-")
    _KEPT.append(folder)
    return folder.name


_KEPT: Final[list[tempfile.TemporaryDirectory[str]]] = []  # deleted when the process ends


def compile_library(compiler: Sequence[str], flags: Sequence[str], out: Path) -> None:
    """Compile kernel and host interface into a shared library.

    Raises:
        FirmwareError: the compiler refuses; the line holds its first error.
    """
    for name in (c99.HEADER, c99.SOURCE, c99.HOST):
        (out.parent / name).write_text(c99.text(name), encoding="utf-8")
    sources = [str(out.parent / name) for name in (c99.SOURCE, c99.HOST)]
    ran = subprocess.run(
        [*compiler, *flags, *_SHARED, "-o", str(out), *sources],
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    if ran.returncode != 0:
        lines = [line for line in ran.stderr.splitlines() if "error" in line] or ["no message"]
        raise FirmwareError(
            f"kernel c99: {shlex.join(compiler)} exits with status {ran.returncode}: {lines[0]}: "
            "expected a C99 compiler, named by the environment's CC"
        )


def _checked(loaded: ctypes.CDLL) -> ctypes.CDLL:
    """Declare the library's functions; the structs are as large as the layout says."""
    state, config = _POINTER, _POINTER
    loaded.chiplog_host_state_bytes.restype = _INTEGER
    loaded.chiplog_host_config_bytes.restype = _INTEGER
    loaded.chiplog_host_start.argtypes = [state, config]
    loaded.chiplog_host_step.argtypes = [state, config, *[_INTEGER] * 5]
    loaded.chiplog_host_run.argtypes = [state, config, _INTEGER, *[_POINTER] * 8]
    for name in ("chiplog_host_start", "chiplog_host_step", "chiplog_host_run"):
        getattr(loaded, name).restype = None
    for name in ("chiplog_host_speed", "chiplog_host_turn_rate"):
        getattr(loaded, name).argtypes = [state, config]
        getattr(loaded, name).restype = ctypes.c_int32
    sizes = (loaded.chiplog_host_state_bytes(), loaded.chiplog_host_config_bytes())
    assert sizes == tuple(struct_dtype(f"chiplog_{one}").itemsize for one in ("state", "config"))
    return loaded
