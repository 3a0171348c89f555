"""The one error this package raises on purpose."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager


class CanBusError(ValueError):
    """What was wrong on the wire's side, where, and what would be right: one line.

    Raised for wrong local arguments, unreadable databases and logs, and buses that cannot be opened
    or went away. Bytes from the bus never raise it: they are dropped and counted.
    """


class BusFullError(CanBusError):
    """The interface takes no more frames: as a rule because nobody on the bus acknowledges any."""


def one_line(error: BaseException) -> str:
    """Return a foreign exception's text on one line, its class name when it has no text."""
    return " ".join(str(error).split()) or type(error).__name__


@contextmanager
def quiet(library: str) -> Iterator[None]:
    """Keep a library from logging what it also raises: the one line is ours."""
    log = logging.getLogger(library)
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)
