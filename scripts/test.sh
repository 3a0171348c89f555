#!/bin/sh
# Set up and run the tests, with lint, types and the layer rule among them.
# Arguments go to pytest: scripts/test.sh --chiplog-size full  runs the repeats and the long ones too.
set -eu
cd "$(dirname "$0")/.."
scripts/setup.sh test
exec .venv/bin/python -m pytest -n auto --dist loadgroup "$@"
