#!/bin/sh
# The main job: set up, then drive a robot over a CAN bus with no hardware in it, and a second one
# with a sealed effect, diagnose that, and open the seal. Only the demo writes to standard output: its
# first line is the verdict.
set -eu
cd "$(dirname "$0")/.."
scripts/setup.sh >&2
echo "installed into .venv; for commands of your own:  . .venv/bin/activate" >&2
exec .venv/bin/chiplog demo --out out/demo "$@"
