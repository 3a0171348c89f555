#!/bin/sh
# Make .venv and install this checkout into it: `setup.sh` for use, `setup.sh test` with the test tools.
# On Debian and Ubuntu whatever the system lacks is fetched with apt.
set -eu
cd "$(dirname "$0")/.."

install() {
    as_root=""
    [ "$(id -u)" = 0 ] || as_root="sudo"
    $as_root apt-get update -qq
    $as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@"
}

# The first Python that is new enough, whatever `python3` itself is.
find_python() {
    for python in python3 python3.14 python3.13 python3.12 python3.11; do
        if command -v "$python" >/dev/null &&
            "$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
            return 0
        fi
    done
    return 1
}

find_python || install python3 python3-venv
find_python || {
    echo "chiplog needs Python 3.11 or newer, and this system's python3 is older: install one, for" \
        "example with  apt-get install python3.11 python3.11-venv" >&2
    exit 2
}
"$python" -c 'import ensurepip, venv' 2>/dev/null || install "$python-venv"
if [ "${1:-}" = test ]; then
    # examples/ holds a node in C; the kernel in C is checked, and run on an emulated Cortex-M3
    command -v gcc >/dev/null || install gcc libc6-dev
    command -v cppcheck >/dev/null || install cppcheck
    command -v arm-none-eabi-gcc >/dev/null || install gcc-arm-none-eabi
    command -v qemu-system-arm >/dev/null || install qemu-system-arm
    # a real browser opens the page of a diagnosis; Ubuntu has none in its archive, but its users often one
    command -v chromium-headless-shell >/dev/null || command -v chromium >/dev/null ||
        command -v google-chrome >/dev/null || install chromium-headless-shell ||
        echo "no Chromium to be had with apt: the tests of pages in a browser will be skipped" >&2
    # a real SocketCAN bus and its tools; where this kernel has no vcan, in a small virtual machine
    command -v candump >/dev/null || install can-utils iproute2
    if ! scripts/vcan.sh --where >/dev/null && [ "$(uname -m)" = x86_64 ]; then
        install qemu-system-x86 busybox-static cpio kmod xz-utils zstd
        scripts/vcan.sh --fetch
    fi
fi

[ -x .venv/bin/python ] || "$python" -m venv .venv
extras=""
[ "${1:-}" = test ] && extras="[test]"
# uv installs in a sixth of the time that pip takes; where it cannot, behind an index that only pip is told of, pip does.
pip=".venv/bin/python -m pip --quiet --disable-pip-version-check"
{ $pip install uv && .venv/bin/uv pip install --quiet --python .venv/bin/python -e ".$extras"; } ||
    $pip install --no-compile -e ".$extras"
# Byte code for what was installed and for what is here, on all cores; some packages carry files in no valid Python.
.venv/bin/python -m compileall -qq -j 0 -x '/(tests|OpenGL|pip)/' .venv/lib can_bus chiplog firmware_model \
    gap_diagnosis hil_harness precision_study sim_plant || true
