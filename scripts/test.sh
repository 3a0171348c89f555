#!/bin/sh
# Set up and run every test, with lint, types and the layer rule among them.
# Arguments go to pytest: scripts/test.sh --chiplog-size full
set -eu
cd "$(dirname "$0")/.."
scripts/setup.sh test
exec .venv/bin/python -m pytest -n auto --dist loadgroup "$@"
