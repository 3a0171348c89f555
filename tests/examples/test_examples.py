"""Every example passes its own tests, in a process of its own, as a reader would run them."""

import os
import subprocess
from pathlib import Path

import pytest
from forked import folder_of_programs

EXAMPLES = Path(__file__).parents[2] / "examples"
OPTIONS = ("-q", "-p", "lean", "-p", "no:hypothesispytest", "-p", "no:cacheprovider")
FOLDERS = sorted(path.name for path in EXAMPLES.iterdir() if path.is_dir())


@pytest.mark.parametrize("folder", FOLDERS)
def test_an_example_passes_its_own_tests(folder: str) -> None:
    result = subprocess.run(
        [folder_of_programs() / "pytest", *OPTIONS, str(EXAMPLES / folder)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("folder", FOLDERS)
def test_an_example_says_what_it_shows(folder: str) -> None:
    readme = (EXAMPLES / folder / "README.md").read_text(encoding="utf-8")
    assert readme.startswith("# ")
    assert f"pytest examples/{folder}" in readme


def test_there_are_two_nodes_a_foreign_dbc_and_real_recordings() -> None:
    assert FOLDERS == ["c_node", "foreign_dbc", "python_node", "recordings"]
