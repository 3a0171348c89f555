"""The documentation is true: every command and block runs, every link leads somewhere."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import subprocess
import sys
import tomllib
from functools import cache
from pathlib import Path

import pytest
from docs_pages import (
    ROOT,
    Block,
    PageError,
    anchors_of,
    blocks_of,
    commands_of,
    links_of,
    matches,
    run_page,
)

from can_bus import CanBusError, open_bus

PAGES = [ROOT / "README.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
PARTS = ("tutorial", "how-to", "reference", "explanation")
GENERATOR = ROOT / "docs" / "generate.py"
OTHER_TOOLS = {"sudo", "candump", "cansend", "cat", "ls", "git", "docker", "python3", "pip"}
"""Programs that hardware commands may use besides ours; their options are not ours to check."""
BEGUN_ANEW = {"docs/explanation/determinism.md"}
"""Pages on what two processes have in common, each with an order of sets of its own."""


def name_of(page: Path) -> str:
    return str(page.relative_to(ROOT))


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_block_of_the_page_runs_as_it_says(page: Path, tmp_path: Path) -> None:
    run_page(page, tmp_path, forks=name_of(page) not in BEGUN_ANEW)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_link_of_the_page_leads_somewhere(page: Path) -> None:
    for line, link in links_of(page):
        where = f"{name_of(page)}:{line}: {link}"
        if link.startswith("https://"):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.exists(), where
        assert target.is_relative_to(ROOT), where
        if anchor:
            assert anchor in anchors_of(target), where


def test_every_page_can_be_reached_from_the_readme() -> None:
    reached: set[Path] = set()
    waiting = [ROOT / "README.md"]
    while waiting:
        page = waiting.pop()
        if page in reached or page.suffix != ".md":
            continue
        reached.add(page)
        waiting += [
            (page.parent / link.partition("#")[0]).resolve()
            for _, link in links_of(page)
            if not link.startswith(("https://", "#"))
        ]
    assert set(PAGES) <= reached


@pytest.mark.parametrize("part", PARTS)
def test_the_docs_have_their_four_parts(part: str) -> None:
    assert list((ROOT / "docs" / part).glob("*.md"))


def blocks_in(language: str) -> list[Block]:
    return [block for page in PAGES for block in blocks_of(page) if block.language == language]


def words_of(text: str) -> list[str]:
    return shlex.split(text.replace("\\\n", " "), comments=True)


@cache
def help_of(*command: str) -> str:
    environment = {**os.environ, "COLUMNS": "200"}
    result = subprocess.run(
        [sys.executable, "-m", *command, "--help"],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return result.stdout


def unknown_options(words: list[str]) -> list[str]:
    """Return the options of a chiplog or pytest command that its help does not know."""
    if words[0] == "chiplog":
        subcommand = [word for word in words[1:] if not word.startswith("-")][:1]
        known = help_of("chiplog", *subcommand)
    elif words[0] == "pytest":
        known = help_of("pytest")
    elif words[0] in OTHER_TOOLS:
        return []
    else:
        return [words[0]]
    options = [word.partition("=")[0] for word in words if word.startswith("--")]
    return [option for option in options if not re.search(rf"{option}\b", known)]


def looked_at_only() -> list[tuple[str, str]]:
    """Return place and text of every command that is not run here."""
    commands = [
        (f"{name_of(block.page)}:{command.line}", command.text)
        for block in blocks_in("console hardware")
        for command in commands_of(block)
    ]
    return commands + [
        (f"{name_of(block.page)}:{block.line}", found[1])
        for block in blocks_in("yaml")
        for found in re.finditer(r"^\s*(?:- )?run: ([^|\n].*)$", block.text, re.MULTILINE)
    ]


def test_commands_for_hardware_use_options_that_exist() -> None:
    for where, text in looked_at_only():
        assert not unknown_options(words_of(text)), f"{where}: {text}"


def test_the_lines_that_make_a_vcan0_are_those_that_the_tool_gives() -> None:
    with pytest.raises(CanBusError) as caught:
        open_bus("socketcan", "vcan9")
    lines = {text.removeprefix("sudo ") for _, text in looked_at_only() if "vcan" in text}
    making = {line for line in lines if line.startswith(("modprobe", "ip link"))}
    assert len(making) == 3
    for line in making:
        assert line.replace("vcan0", "vcan9") in str(caught.value)


def test_scripts_that_the_readme_names_are_there_and_parse() -> None:
    for block in blocks_in("sh"):
        for line in block.lines:
            script = ROOT / line.split()[0]
            assert os.access(script, os.X_OK), line
            if script.read_bytes().startswith(b"#!/bin/sh"):
                subprocess.run(["sh", "-n", script], check=True)


def test_the_demo_script_ends_in_the_command_that_the_readme_shows() -> None:
    last = (ROOT / "scripts" / "demo.sh").read_text().strip().splitlines()[-1]
    words = last.removeprefix("exec .venv/bin/").removesuffix(' "$@"')
    shown = [
        c.text
        for b in blocks_of(ROOT / "README.md")
        if b.language == "console"
        for c in commands_of(b)
    ]
    assert words in shown


def test_the_layout_of_the_readme_names_every_package() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    packages = project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    layout = (ROOT / "README.md").read_text(encoding="utf-8").partition("\n## Layout\n")[2]
    named = re.findall(r"^([a-z_]+)/  ", layout.partition("\n## ")[0], re.MULTILINE)
    assert set(packages) <= set(named)


def test_the_first_line_of_the_demo_script_is_the_demos(tmp_path: Path) -> None:
    chatty = "#!/bin/sh\necho fetching packages\n"
    programs = {"scripts/setup.sh": chatty, ".venv/bin/chiplog": "#!/bin/sh\necho verdict\n"}
    programs["scripts/demo.sh"] = (ROOT / "scripts" / "demo.sh").read_text()
    for name, text in programs.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)
    said = subprocess.run(
        [tmp_path / "scripts" / "demo.sh"], capture_output=True, text=True, check=True
    )
    assert said.stdout == "verdict\n"
    assert "fetching packages" in said.stderr


def test_generated_pages_are_current(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(GENERATOR.parent)
    pages = runpy.run_path(str(GENERATOR))["pages"]()
    old = [path.name for path, text in pages.items() if path.read_text(encoding="utf-8") != text]
    assert not old, "run: .venv/bin/python docs/generate.py"


def test_what_a_page_promises_is_held_against_what_was_printed(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```console\n$ echo one two\none three\n```\n")
    with pytest.raises(PageError, match="one three"):
        run_page(page, tmp_path)


def test_a_command_that_fails_fails_its_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```console\n$ exit 3\n```\n")
    with pytest.raises(PageError, match="status 3"):
        run_page(page, tmp_path)


def test_a_command_may_fail_where_the_page_shows_its_status(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```console\n$ exit 3\n$ echo $?\n3\n```\n")
    run_page(page, tmp_path)


def test_a_python_block_that_fails_fails_its_page(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```python\nassert 1 == 2\n```\n")
    with pytest.raises(PageError, match="AssertionError"):
        run_page(page, tmp_path)


def test_a_named_file_must_be_used(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```toml\n# robot.toml\n[wheels]\n```\n")
    with pytest.raises(PageError, match="no later block uses it"):
        run_page(page, tmp_path)


def test_commands_of_a_page_share_their_folder(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```console\n$ mkdir a && cd a\n$ pwd\n…/a\n```\n")
    run_page(page, tmp_path)


def test_a_long_command_is_joined_over_lines(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```console\n$ echo one \\\n    two\none two\n```\n")
    run_page(page, tmp_path)


@pytest.mark.parametrize(
    ("expected", "printed", "is_match"),
    [
        (["a…"], ["abc"], True),
        (["a…"], ["bc"], False),
        (["…"], ["a", "b"], True),
        (["a", "…", "d"], ["a", "b", "c", "d"], True),
        (["a", "…", "d"], ["a", "b", "c"], False),
        (["a  b"], ["a     b"], True),
        (["a"], ["a", "b"], False),
        (["1…m"], ["1.5 m"], True),
    ],
)
def test_dots_stand_for_anything(expected: list[str], printed: list[str], is_match: bool) -> None:
    assert matches(tuple(expected), printed) is is_match
