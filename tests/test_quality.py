"""The rules that a machine can hold: lint, format, types, layers, and what the gate runs."""

import subprocess
import sys
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

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


@pytest.mark.parametrize("package", PACKAGES)
def test_no_module_has_the_name_of_a_function_that_its_package_exports(package: str) -> None:
    """`from hil_harness import scenario` was a module to type checkers, which cannot be called."""
    for init in (ROOT / package).rglob("__init__.py"):
        home = import_module(".".join(init.parent.relative_to(ROOT).parts))
        modules = {one.name for one in iter_modules(home.__path__)}
        exported = {name for name in modules & vars(home).keys() if callable(getattr(home, name))}
        assert not exported, init


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
