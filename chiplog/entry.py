"""Where the `chiplog` command starts: Ctrl-C during the imports is an interruption, not a crash."""

from __future__ import annotations

import sys


def main() -> int:
    """Run the command line on the process's own arguments; return the exit status."""
    # python-can would import asammdf, half a second, for whoever wants to read MF4 through it. Our
    # own reader of MF4 imports it when it needs it.
    sys.modules.setdefault("asammdf", None)  # type: ignore[arg-type]  # bars the import
    try:
        from chiplog.cli import main as command_line

        return command_line()
    except KeyboardInterrupt:
        print("chiplog: interrupted", file=sys.stderr)
        return 130
