#!/bin/sh
# Make .venv and install this checkout into it: `setup.sh` for use, `setup.sh test` with the test tools.
# On Debian and Ubuntu whatever the system lacks is fetched with apt.
set -eu
cd "$(dirname "$0")/.."

missing=""
command -v python3 >/dev/null || missing="$missing python3"
python3 -c 'import ensurepip, venv' 2>/dev/null || missing="$missing python3-venv"
if [ "${1:-}" = test ]; then
    command -v gcc >/dev/null || missing="$missing gcc libc6-dev"  # examples/ holds a node in C
fi
if [ -n "$missing" ]; then
    as_root=""
    [ "$(id -u)" = 0 ] || as_root="sudo"
    $as_root apt-get update -qq
    # shellcheck disable=SC2086
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing
fi

python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || {
    echo "chiplog needs Python 3.11 or newer; this is $(python3 --version)" >&2
    exit 2
}
[ -x .venv/bin/python ] || python3 -m venv .venv
extras=""
[ "${1:-}" = test ] && extras="[test]"
.venv/bin/python -m pip install --quiet --disable-pip-version-check -e ".$extras"
