"""Where the `chiplog` command starts: Ctrl-C during the imports is an interruption, not a crash."""

from __future__ import annotations

import sys


def main() -> int:
    """Run the command line on the process's own arguments; return the exit status."""
    try:
        from chiplog.cli import main as command_line

        return command_line()
    except KeyboardInterrupt:
        print("chiplog: interrupted", file=sys.stderr)
        return 130
