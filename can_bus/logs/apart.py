"""Reading in a process of its own: what a broken file does to a library's C code ends that one.

The process is forked, so that it costs no imports, and hands back plain numbers: nothing that it
says is executed. Where there is no fork, reading stays in this process.
"""

from __future__ import annotations

import faulthandler
import json
import os
import signal
import warnings
from collections.abc import Callable
from contextlib import suppress
from importlib import import_module
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from can_bus.errors import CanBusError
from can_bus.logs.frame_block import FrameBlock

_PIPE_BYTES: Final = 1 << 20
_BROKE_DOWN: Final = "it breaks the library that reads it"

Reading = list[FrameBlock] | str
"""Blocks of frames, or what is wrong with the file."""


def read_apart(read: Callable[[], Reading]) -> Reading:
    """Return what *read* returns in a process of its own, which may break down.

    Raises CanBusError where *read* does.
    """
    if not hasattr(os, "fork"):
        return read()
    receiving, sending = _wide_pipe()
    with warnings.catch_warnings():
        # A fork beside threads may find locks taken; this child only reads a file and ends.
        warnings.simplefilter("ignore", DeprecationWarning)
        child = os.fork()
    if child == 0:
        _be_the_child(read, receiving, sending)
    os.close(sending)
    try:
        with os.fdopen(receiving, "rb") as source:
            said = source.readline()
            answer: dict[str, Any] = json.loads(said) if said else {"wrong": _BROKE_DOWN}
            blocks = [_received(source, *shape) for shape in answer.get("shapes", ())]
    except (EOFError, ValueError):
        answer, blocks = {"wrong": _BROKE_DOWN}, []
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    finally:
        os.waitpid(child, 0)
    if "refused" in answer:
        raise CanBusError(answer["refused"])
    wrong: str | None = answer.get("wrong")
    return blocks if wrong is None else wrong


def _wide_pipe() -> tuple[int, int]:
    fcntl = import_module("fcntl")  # only where there is a fork
    receiving, sending = os.pipe()
    if hasattr(fcntl, "F_SETPIPE_SZ"):
        with suppress(OSError):  # a user may have used up the pages for it
            fcntl.fcntl(sending, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)
    return receiving, sending


def _be_the_child(read: Callable[[], Reading], receiving: int, sending: int) -> None:
    try:
        faulthandler.disable()  # what it dies of is told by who started it
        mute = os.open(os.devnull, os.O_WRONLY)
        os.dup2(mute, 1)
        os.dup2(mute, 2)
        os.close(receiving)
        with os.fdopen(sending, "wb") as sink:
            try:
                reading = read()
            except CanBusError as error:
                _say(sink, refused=str(error))
            else:
                if isinstance(reading, str):
                    _say(sink, wrong=reading)
                else:
                    _say(sink, shapes=[block.data.shape for block in reading])
                    for block in reading:
                        for column in vars(block).values():
                            sink.write(_bytes_of(column))
    finally:
        os._exit(0)  # nothing of the parent's is to be ended twice


def _say(sink: BinaryIO, **answer: object) -> None:
    sink.write(json.dumps(answer).encode() + b"\n")


def _bytes_of(column: NDArray[Any]) -> memoryview:
    return column.reshape(-1).view(np.uint8).data


def _received(source: BinaryIO, frames: int, width: int) -> FrameBlock:
    """Return a block as it comes. Raises EOFError where it ends too early."""
    block = FrameBlock.empty(frames, width)
    for column in vars(block).values():
        room = _bytes_of(column)
        while room:
            count = source.readinto(room)  # type: ignore[attr-defined]  # a buffered file has it
            if not count:
                raise EOFError
            room = room[count:]
    return block
