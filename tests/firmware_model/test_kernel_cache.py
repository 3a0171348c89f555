"""Compiled once per machine: the second process starts at once, a read-only package as well."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import firmware_model

PROGRAM = """
import sys
from numba.core import event
from firmware_model import FirmwareConstants, FirmwareDescription, Kernel, build_config
import firmware_model
assert firmware_model.__file__.startswith(sys.argv[1]), firmware_model.__file__
constants = FirmwareConstants(
    wheel_radius_m=0.05, wheelbase_m=0.3, ticks_per_rev=2048, counter_bits=16, tick_period_s=0.01,
    gyro_sensitivity_rad_s_per_lsb=1.33e-4, gyro_zero_rate_code=32768, gyro_min_code=18,
    gyro_max_code=65518, max_wheel_rate_rad_s=30.0)
with event.install_recorder("numba:compile") as recorder:
    kernel = Kernel(build_config(FirmwareDescription(), constants))
for count in range(5):
    kernel.step(count, count, 0, 32768, 0)
print(len(recorder.buffer) > 0, kernel.x_m_q)
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    """Return a folder with a copy of the package and no cache."""
    source = Path(firmware_model.__file__).parent
    shutil.copytree(
        source, tmp_path / "firmware_model", ignore=shutil.ignore_patterns("__pycache__")
    )
    return tmp_path


def run(folder: Path, home: Path) -> tuple[bool, int]:
    """Return whether a fresh process compiled, and the x that it reached."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME")
    }
    environment |= {"PYTHONPATH": str(folder), "HOME": str(home), "PYTHONDONTWRITEBYTECODE": "1"}
    environment["NUMBA_OPT"] = "0"  # what is cached when has nothing to do with how fast it is
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(folder)],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    compiled, x = result.stdout.split()
    return compiled == "True", int(x)


def test_the_second_process_does_not_compile_and_an_edited_kernel_is_compiled_anew(
    package: Path, tmp_path: Path
) -> None:
    home = tmp_path / "home"
    home.mkdir()
    first = run(package, home)
    assert first[0]
    assert run(package, home) == (False, first[1])
    # an edit in another module than the one numba watches
    pose = package / "firmware_model" / "pose.py"
    text = pose.read_text()
    assert "return position_q + step_q" in text
    pose.write_text(text.replace("return position_q + step_q", "return position_q"))
    assert run(package, home) == (True, 0)


def test_a_package_that_cannot_be_written_to_uses_the_users_cache(
    package: Path, tmp_path: Path
) -> None:
    """A file stands where the cache folder would be made: read-only even for root."""
    (package / "firmware_model" / "__pycache__").write_text("not a folder")
    home = tmp_path / "home"
    home.mkdir()
    first = run(package, home)
    assert first[0]
    assert run(package, home) == (False, first[1])


def test_without_any_place_for_a_cache_the_kernel_still_runs(package: Path, tmp_path: Path) -> None:
    (package / "firmware_model" / "__pycache__").write_text("not a folder")
    home = tmp_path / "home"
    home.write_text("not a folder")
    compiled, x = run(package, home)
    assert compiled
    assert x > 0
