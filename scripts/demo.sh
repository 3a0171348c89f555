#!/bin/sh
# The main job: set up, then drive a robot over a CAN bus with no hardware in it, and a second one
# with a sealed effect, diagnose that, and open the seal.
set -eu
cd "$(dirname "$0")/.."
scripts/setup.sh
echo "installed into .venv; for commands of your own:  . .venv/bin/activate"
exec .venv/bin/chiplog demo --out out/demo "$@"
