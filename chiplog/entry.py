"""Where the `chiplog` command starts: Ctrl-C during the imports is an interruption, not a crash."""

from __future__ import annotations

import os
import sys


def main() -> int:
    """Run the command line on the process's own arguments; return the exit status."""
    # python-can would import asammdf, half a second, for whoever wants to read MF4 through it. Our
    # own reader of MF4 imports it when it needs it.
    sys.modules.setdefault("asammdf", None)  # type: ignore[arg-type]  # bars the import
    # Our matrices are small: a second thread of BLAS waits more than it computes (a diagnosis takes
    # half as many processor seconds again), and cases run side by side in processes of their own.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from chiplog.cli import main as command_line

        return command_line()
    except KeyboardInterrupt:
        print("chiplog: interrupted", file=sys.stderr)
        return 130
