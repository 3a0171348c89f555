"""One command of cantools; its own entry point imports matplotlib for all the others."""

import argparse
import os
import sys
from importlib import import_module


def main() -> None:
    """Run the command that the first argument names."""
    os.environ.setdefault("TERM", "xterm")  # a fork server may have none
    parser = argparse.ArgumentParser()
    command = import_module(f"cantools.subparsers.{sys.argv[1]}")
    command.add_subparser(parser.add_subparsers())
    arguments = parser.parse_args()
    arguments.func(arguments)
