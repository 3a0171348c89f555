"""Many cases at once, each in a process that has nothing yet."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import Any, TypeVar

Result = TypeVar("Result")


def as_done(
    work: Callable[..., Result], todo: Sequence[tuple[Any, ...]], jobs: int
) -> Iterator[Result]:
    """Yield what a function of a module returns for each row of arguments, as it comes; on the way
    out no further one is begun. With one job all is done here, in order."""
    if jobs == 1:
        yield from (work(*arguments) for arguments in todo)
        return
    # begun anew, not forked: a fork of a process with threads may wait for ever
    with ProcessPoolExecutor(
        jobs,
        mp_context=get_context("spawn"),
        # an interrupt is for the one that waits: it lets what is begun be made, and ends
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    ) as pool:
        try:
            yield from (
                one.result()
                for one in as_completed([pool.submit(work, *arguments) for arguments in todo])
            )
        finally:
            pool.shutdown(cancel_futures=True)
