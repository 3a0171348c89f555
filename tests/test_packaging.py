"""What a user installs: a wheel and a source archive that work from an empty folder."""

from __future__ import annotations

import json
import os
import re
import site
import subprocess
import sys
import tarfile
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
TOP_LEVEL = {
    *("can_bus", "chiplog", "firmware_model", "gap_diagnosis", "hil_harness", "precision_study"),
    "sim_plant",
}
DATA = {
    "can_bus/dbc/chiplog.dbc",
    *(f"firmware_model/c99/chiplog_firmware.{kind}" for kind in "ch"),
    *(f"firmware_model/c99/{name}" for name in ("host.c", "jobs.c", "jobs.h")),
    *(f"firmware_model/c99/cortex_m/{name}" for name in ("startup.c", "mps2_an385.ld")),
    "gap_diagnosis/data/prior.toml",
    "gap_diagnosis/data/manoeuvres/start_stop.toml",
    "hil_harness/data/robot.toml",
    "hil_harness/devices/include/chiplog_device.h",
    *(f"{package}/py.typed" for package in TOP_LEVEL),
}


def run(command: list[str], folder: Path, **variables: str) -> str:
    result = subprocess.run(
        command,
        cwd=folder,
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def tracked_files() -> list[str]:
    return run(["git", "ls-files", "-z"], ROOT).rstrip("\0").split("\0")


def build(kind: str, source: Path, out: Path) -> Path:
    # The environment has the build backend: no network.
    command = [sys.executable, "-m", "build", f"--{kind}", "--no-isolation", "--outdir", str(out)]
    run([*command, str(source)], out)
    (built,) = out.iterdir()
    return built


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("sdist", ROOT, tmp_path_factory.mktemp("sdist"))


@pytest.fixture(scope="module")
def wheel(sdist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel from the source archive, as a distributor would."""
    source = tmp_path_factory.mktemp("source")
    with tarfile.open(sdist) as archive:
        archive.extractall(source, filter="data")
    (unpacked,) = source.iterdir()
    return build("wheel", unpacked, tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel alone into a new environment that sees the present libraries."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    python = folder / "bin" / "python"
    place = run(
        [str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], folder
    )
    packages = Path(place.strip())
    installer = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    run([*installer, "--no-deps", "--no-index", "--disable-pip-version-check", str(wheel)], folder)
    # Only the folders, as plain paths: their own .pth files, ours among them, are not read.
    libraries = [path for path in site.getsitepackages() if Path(path).is_dir()]
    (packages / "libraries.pth").write_text("\n".join(libraries) + "\n")
    return folder / "bin"


@pytest.fixture
def empty(tmp_path: Path) -> Path:
    return tmp_path


def names_in(wheel: Path) -> list[str]:
    with zipfile.ZipFile(wheel) as archive:
        return archive.namelist()


def test_the_wheel_installs_these_names_and_no_others(wheel: Path) -> None:
    names = {name.partition("/")[0] for name in names_in(wheel)}
    assert names == {*TOP_LEVEL, "chiplog-0.1.0.dist-info"}


def test_the_wheel_carries_the_data_that_the_code_reads(wheel: Path) -> None:
    assert set(names_in(wheel)) >= DATA


def test_every_tracked_file_of_a_package_is_in_the_wheel(wheel: Path) -> None:
    expected = {name for name in tracked_files() if name.partition("/")[0] in TOP_LEVEL}
    assert expected <= set(names_in(wheel))


def test_the_wheel_has_no_tests_and_no_leftovers(wheel: Path) -> None:
    for name in names_in(wheel):
        assert "__pycache__" not in name
        assert not name.startswith(("tests/", "docs/", "dbc/"))


def test_the_source_archive_has_what_the_tests_need(sdist: Path) -> None:
    with tarfile.open(sdist) as archive:
        inside = {name.partition("/")[2] for name in archive.getnames()}
    wanted = [name for name in tracked_files() if name != ".gitignore"]
    assert set(wanted) <= inside


def test_twine_finds_nothing_to_complain_about(wheel: Path, sdist: Path, empty: Path) -> None:
    run([sys.executable, "-m", "twine", "check", "--strict", str(wheel), str(sdist)], empty)


def test_the_installed_packages_are_those_of_the_wheel(installed: Path, empty: Path) -> None:
    for package in sorted(TOP_LEVEL):
        script = f"import {package}; print({package}.__file__)"
        place = run([str(installed / "python"), "-c", script], empty)
        assert Path(place).is_relative_to(installed.parent), package


def test_the_installed_command_prints_its_help(installed: Path, empty: Path) -> None:
    assert "Usage: chiplog" in run([str(installed / "chiplog"), "--help"], empty)


def test_the_installed_package_finds_its_dbc(installed: Path, empty: Path) -> None:
    script = "from can_bus import load_database; print(load_database().path)"
    place = Path(run([str(installed / "python"), "-c", script], empty).strip())
    assert place.is_relative_to(installed.parent)
    assert place.read_bytes() == (ROOT / "dbc" / "chiplog.dbc").read_bytes()


def test_the_installed_product_works_from_an_empty_folder(installed: Path, empty: Path) -> None:
    # One test, because each new environment compiles the kernels anew.
    command = [str(installed / "chiplog"), "run", "--scenario", "lesson", "--out", "out"]
    run([*command, "--duration-s", "2"], empty)
    assert json.loads((empty / "out" / "summary.json").read_text())["ticks"] == 200
    written = {path.name for path in (empty / "out").iterdir()}
    assert written == {"bus.log", "reference.tum", "state.json", "summary.json", "report.html"}

    run([str(installed / "chiplog"), "init", "mine"], empty)
    pytest_of_the_wheel = [
        str(installed / "python"),
        "-m",
        "pytest",
        "-q",
        "-p",
        "no:cacheprovider",
    ]
    assert re.search(r"^[1-9]\d* passed", run([*pytest_of_the_wheel, "mine"], empty), re.MULTILINE)
