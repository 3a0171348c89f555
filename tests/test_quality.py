"""The rules that a machine can hold: lint, format, types, layers, and what the gate runs."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGES = [
    *("can_bus", "chiplog", "firmware_model", "gap_diagnosis", "hil_harness", "precision_study"),
    "sim_plant",
]


def run(*command: str) -> str:
    result = subprocess.run(
        [sys.executable, "-m", *command], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    return result.stdout


def test_types_are_strict_in_every_package_and_every_benchmark() -> None:
    run("mypy", *PACKAGES, "benchmarks")


def test_what_a_room_exports_has_no_module_of_its_name(tmp_path: Path) -> None:
    """`from hil_harness import scenario` was a module to type checkers, which cannot be called."""
    script = tmp_path / "mine.py"
    script.write_text(
        "from hil_harness import scenario\n"
        "from hil_harness.assembly import RunConfig\n"
        'print(scenario("lesson"), RunConfig)\n'
    )
    run("mypy", str(script))


def test_the_linter_finds_nothing() -> None:
    run("ruff", "check", "--no-cache", ".")


def test_every_file_is_formatted() -> None:
    run("ruff", "format", "--check", "--no-cache", ".")


def test_imports_point_one_way() -> None:
    script = "from importlinter.cli import lint_imports_command; lint_imports_command()"
    result = subprocess.run(
        [sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "1 kept, 0 broken" in result.stdout


def test_the_gate_calls_exactly_the_test_command_of_the_readme() -> None:
    gate = (ROOT / ".ci" / "run").read_text()
    command = gate.strip().splitlines()[-1]
    assert f"\n{command}\n" in (ROOT / "README.md").read_text()


@pytest.mark.parametrize("package", PACKAGES)
def test_every_package_ships_its_types(package: str) -> None:
    assert (ROOT / package / "py.typed").exists()
