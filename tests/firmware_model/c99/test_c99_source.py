"""The C sources are fit for real firmware: clean, integer only, without help from a library."""

from __future__ import annotations

import re
import subprocess
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from kernel_cases import config_of, configs
from machines import MAIN

from firmware_model import STATE_FIELDS, FirmwareError, StatusBit, c99
from firmware_model.c99_layout import c_types, config_values, put, struct_dtype
from firmware_model.c99_library import FLAGS, compile_library, find_compiler, library
from firmware_model.config import CONFIG_FIELDS
from firmware_model.cortex_m import CORE

WARNINGS = ["-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-pedantic", "-Werror"]
CORTEX_M3 = ("arm-none-eabi-gcc", *CORE, "-ffreestanding")
CORTEX_M0 = ("arm-none-eabi-gcc", "-mcpu=cortex-m0", "-mthumb", "-ffreestanding")


def run(*words: str, folder: Path) -> str:
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout + done.stderr


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    for name in (c99.HEADER, c99.SOURCE, c99.HOST):
        (tmp_path / name).write_text(c99.text(name))
    return tmp_path


@pytest.mark.parametrize("compiler", [("cc",), CORTEX_M3, CORTEX_M0], ids=["pc", "m3", "m0"])
@pytest.mark.parametrize("level", ["-O0", "-Os", "-O3"])
def test_the_kernel_compiles_without_a_warning(
    sources: Path, compiler: tuple[str, ...], level: str
) -> None:
    said = run(*compiler, "-std=c99", level, *WARNINGS, "-c", c99.SOURCE, folder=sources)
    assert said == ""


def test_host_runner_and_start_up_code_compile_without_a_warning(tmp_path: Path) -> None:
    with as_file(files(c99)) as folder:
        for unit in (str(folder / c99.HOST), str(folder / "jobs.c"), MAIN):
            run("cc", "-std=c99", *WARNINGS, f"-I{folder}", "-c", unit, folder=tmp_path)
        start_up = ["-std=c99", *WARNINGS, "-c", f"-I{folder}", str(folder / "cortex_m/startup.c")]
        run(*CORTEX_M3, *start_up, folder=tmp_path)


def test_a_cplusplus_compiler_may_include_the_header(sources: Path) -> None:
    (sources / "main.cpp").write_text(f'#include "{c99.HEADER}"\n')
    run("arm-none-eabi-g++", "-ffreestanding", *WARNINGS, "-c", "main.cpp", folder=sources)


def test_cppcheck_finds_nothing() -> None:
    quiet = ["--quiet", "--suppress=missingIncludeSystem", "--suppress=unusedFunction"]
    checks = ["--enable=all", "--inconclusive", "--std=c99", "--error-exitcode=1"]
    units = (c99.SOURCE, c99.HOST, "jobs.c")
    with as_file(files(c99)) as folder:
        assert run("cppcheck", *checks, *quiet, *units, folder=folder) == ""


@pytest.mark.parametrize("level", ["-O0", "-Os", "-O2", "-O3"])
def test_on_a_cortex_m3_the_object_calls_nothing_but_the_copying_of_a_struct(
    sources: Path, level: str
) -> None:
    """No 64-bit division, no float helper, no heap: all would be undefined symbols."""
    run(*CORTEX_M3, "-std=c99", level, "-c", "-o", "m3.o", c99.SOURCE, folder=sources)
    symbols = run("arm-none-eabi-nm", "--undefined-only", "m3.o", folder=sources)
    assert set(re.findall(r"U (\S+)", symbols)) <= {"memcpy", "memset"}


def test_on_a_core_without_long_multiplication_there_is_still_no_division_and_no_float(
    sources: Path,
) -> None:
    run(*CORTEX_M0, "-std=c99", "-O2", "-c", "-o", "m0.o", c99.SOURCE, folder=sources)
    symbols = run("arm-none-eabi-nm", "--undefined-only", "m0.o", folder=sources)
    helpers = {"__aeabi_lmul", "__aeabi_llsl", "__aeabi_llsr", "__aeabi_lasr"}
    switches = {name for name in re.findall(r"U (\S+)", symbols) if "_case_" in name}
    assert set(re.findall(r"U (\S+)", symbols)) <= helpers | switches | {"memcpy", "memset"}


def test_nothing_in_the_kernel_is_written_between_ticks_but_the_state(sources: Path) -> None:
    """No variable of static storage is writable: several robots may run side by side."""
    run(*CORTEX_M3, "-std=c99", "-O2", "-c", "-o", "m3.o", c99.SOURCE, folder=sources)
    sizes = run("arm-none-eabi-size", "m3.o", folder=sources).splitlines()[1].split()
    assert sizes[1:3] == ["0", "0"]  # .data and .bss


@pytest.mark.parametrize(
    ("claim", "contrary"),
    [
        ("((-INT64_C(3) >> 1) == -INT64_C(2))", "((-INT64_C(3) >> 1) == -INT64_C(1))"),
        ("((int64_t)UINT64_MAX == -INT64_C(1))", "((int64_t)UINT64_MAX == INT64_MAX)"),
    ],
)
def test_a_compiler_that_shifts_or_converts_otherwise_would_stop(
    sources: Path, claim: str, contrary: str
) -> None:
    source = c99.text(c99.SOURCE)
    assert source.count(claim) == 1
    (sources / c99.SOURCE).write_text(source.replace(claim, contrary))
    stopped = subprocess.run(
        ["cc", "-std=c99", "-c", c99.SOURCE], cwd=sources, capture_output=True, check=False
    )
    assert stopped.returncode != 0
    assert b"negative" in stopped.stderr


def test_each_function_says_its_scaling_and_why_nothing_overflows() -> None:
    """A function of the file says it above its body, one that a user calls in the header."""
    source, header = c99.text(c99.SOURCE), c99.text(c99.HEADER)
    defined = re.findall(r"^(static )?[^\n(/#]*\b(\w+)\([^;{}]*\)\n\{", source, re.M)
    assert len(defined) > 40
    for is_static, name in defined:
        text, start = (source, "static ") if is_static else (header, "")
        comments = re.findall(rf"/\*\*((?:(?!\*/).)*)\*/\n{start}[^\n(]*\b{name}\(", text, re.S)
        assert len(comments) == 1, name
        assert "@brief" in comments[0], name
        assert "Scaling and overflow: " in comments[0], name


def test_no_operator_divides_and_no_type_is_of_floating_point() -> None:
    for name in (c99.SOURCE, c99.HEADER):
        code = re.sub(r"/\*.*?\*/", "", c99.text(name), flags=re.S)
        assert "//" not in code
        assert re.findall(r"[/%]|\b(?:float|double|malloc|long)\b", code) == []


def test_the_structs_hold_the_kernels_fields_and_the_header_its_status_bits() -> None:
    assert set(c_types("chiplog_state")) == set(STATE_FIELDS)
    pointers = {"sine_table", "cordic_table"}
    assert set(c_types("chiplog_config")) - pointers == set(CONFIG_FIELDS) - {"table_start"}
    for bit in StatusBit:
        line = f"#define CHIPLOG_STATUS_{bit.name} UINT32_C({bit.value:#06x})"
        assert line in c99.text(c99.HEADER)


@given(configs())
def test_every_configuration_the_kernel_takes_fits_the_c_struct(config: object) -> None:
    limits = struct_dtype("chiplog_config")
    for name, value in config_values(config).items():  # type: ignore[arg-type]
        bits = 8 * limits[name].itemsize
        low = -(1 << (bits - 1)) if limits[name].kind == "i" else 0
        assert low <= value < low + (1 << bits), name


def test_a_state_that_its_c_field_cannot_hold_is_refused_whole() -> None:
    record = np.zeros(1, struct_dtype("chiplog_state"))
    with pytest.raises(FirmwareError, match=r"rest_ticks = 65536: expected 0 to 65535"):
        put(record, "rest_ticks", 65536)


def test_without_a_compiler_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(FirmwareError, match="kernel c99: no C compiler: none of cc, gcc, clang"):
        find_compiler()


def test_a_compiler_that_fails_is_named_with_its_first_error(tmp_path: Path) -> None:
    with pytest.raises(FirmwareError, match=r"kernel c99: cc exits with status 1: .*error"):
        compile_library(["cc"], ["-std=c99", "-Dinline=float"], tmp_path / "kernel.so")


def test_the_library_is_built_once_and_kept_in_the_users_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    library.cache_clear()
    library(FLAGS)
    (built,) = (tmp_path / "chiplog").iterdir()
    first = built.stat().st_mtime_ns
    library.cache_clear()
    library(FLAGS)
    assert [one.stat().st_mtime_ns for one in (tmp_path / "chiplog").iterdir()] == [first]
    library.cache_clear()


def test_a_cache_that_cannot_be_written_is_done_without(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "chiplog").write_text("a file where the folder would be")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    library.cache_clear()
    assert library(FLAGS).chiplog_host_state_bytes() == struct_dtype("chiplog_state").itemsize
    library.cache_clear()
    assert config_of() is not None
