#!/bin/sh
# The main job: set up, then run the lesson's robot over a CAN bus with no hardware in it.
set -eu
cd "$(dirname "$0")/.."
scripts/setup.sh
echo "installed into .venv; for commands of your own:  . .venv/bin/activate"
exec .venv/bin/chiplog run --scenario lesson --out out/lesson "$@"
