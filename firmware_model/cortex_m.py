"""The C99 kernel on an Arm Cortex-M3 that QEMU emulates: what it answers, and what it costs.

The core is cross-compiled code without an operating system on QEMU's machine mps2-an385; readings
and answers pass through semihosting. With ``-icount shift=0`` one instruction takes one nanosecond
of the emulated clock, so SysTick counts instructions: not cycles, of which a real core takes more.
"""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, Final

import numpy as np

from firmware_model import c99
from firmware_model.c99_layout import (
    Int64Array,
    Records,
    config_record,
    config_tables,
    struct_dtype,
)
from firmware_model.config import KernelConfig
from firmware_model.errors import FirmwareError
from firmware_model.state import FRESH, INVALID, STALE, STATE_FIELDS

COMPILER: Final = "arm-none-eabi-gcc"
EMULATOR: Final = "qemu-system-arm"
CORE: Final = ("-mcpu=cortex-m3", "-mthumb")
FLAGS: Final = ("-std=c99", "-O2", "-ffreestanding", "-fno-tree-loop-distribute-patterns")
_PACKAGES: Final = {COMPILER: "gcc-arm-none-eabi", EMULATOR: "qemu-system-arm"}
_SOURCES: Final = ("jobs.c", c99.SOURCE, "cortex_m/startup.c")
_LINKER_SCRIPT: Final = "cortex_m/mps2_an385.ld"

HEADER_DTYPE: Final = np.dtype(
    [(name, "<u4") for name in ("config_bytes", "sines", "angles", "ticks", "is_measured")]
)
INPUTS_DTYPE: Final = struct_dtype("chiplog_inputs", pointer_bytes=4)
RECORD_DTYPE: Final = np.dtype(
    [
        *((name, "<i8") for name in ("x_m_q", "y_m_q", "gyro_offset_q")),
        *((name, "<i4") for name in ("heading_turn_q", "v_m_s_q", "w_rad_s_q")),
        ("status", "<u4"),
        *((name, "u1") for name in ("heading_source", "v_is_valid", "w_is_valid")),
        ("reserved", "u1", 5),
    ]
)
"""What the firmware would put on a bus after a tick; `job_record` in jobs.c."""
COST_DTYPE: Final = np.dtype([("instructions", "<u8"), ("worst", "<u4"), ("ticks", "<u4")])


@dataclass(frozen=True)
class Job:
    """Readings for one kernel from power-on: int64[ticks, 5] in the order of `Kernel.step`."""

    config: KernelConfig
    inputs: Int64Array


@dataclass(frozen=True)
class Answer:
    """What came of a job: a record of RECORD_DTYPE per tick, and the final state."""

    records: Records
    state: dict[str, int]


@dataclass(frozen=True)
class Cost:
    """What the kernel takes on the emulated core.

    Attributes:
        instructions: per tick, mean over `ticks` [instructions, not cycles].
        worst_instructions: of the tick that took most.
        ticks: over which both were found.
        code_bytes: of the kernel, with its constants.
        table_bytes: of the sine or CORDIC table.
        state_bytes: of RAM for one robot.
        config_bytes: of the configuration, constant.
    """

    instructions: float
    worst_instructions: int
    ticks: int
    code_bytes: int
    table_bytes: int
    state_bytes: int
    config_bytes: int


def encode_jobs(jobs: Sequence[Job], *, pointer_bytes: int = 4, is_measured: bool = False) -> bytes:
    """Return jobs as the job runner reads them."""
    parts: list[bytes] = []
    for job in jobs:
        sines, angles = config_tables(job.config)
        record = config_record(job.config, 0, 0, pointer_bytes=pointer_bytes)
        header = np.array(
            (record.nbytes, sines.size, angles.size, len(job.inputs), is_measured), HEADER_DTYPE
        )
        ticks = np.zeros(len(job.inputs), INPUTS_DTYPE)
        left, right, encoder, code, gyro = job.inputs.T
        ticks["left_count"] = left & 0xFFFFFFFF
        ticks["right_count"] = right & 0xFFFFFFFF
        ticks["gyro_code"] = np.clip(code, -(1 << 31), (1 << 31) - 1)
        for name, given in (("encoder_validity", encoder), ("gyro_validity", gyro)):
            ticks[name] = np.where((given == FRESH) | (given == STALE), given, INVALID)
        parts += [one.tobytes() for one in (header, record, sines, angles, ticks)]
    return b"".join(parts)


def decode_answers(jobs: Sequence[Job], answers: bytes) -> list[Answer]:
    """Return what the job runner wrote about these jobs.

    Raises:
        FirmwareError: it wrote less or more.
    """
    state_dtype = struct_dtype("chiplog_state")
    decoded, start = [], 0
    for job in jobs:
        records, start = _take(answers, start, RECORD_DTYPE, len(job.inputs))
        states, start = _take(answers, start, state_dtype, 1)
        state = {name: int(states[0][name]) for name in STATE_FIELDS}
        decoded.append(Answer(records, state))
    if start != len(answers):
        raise FirmwareError(_short(len(answers), start))
    return decoded


def _take(answers: bytes, start: int, dtype: np.dtype[Any], count: int) -> tuple[Records, int]:
    stop = start + dtype.itemsize * count
    if stop > len(answers):
        raise FirmwareError(_short(len(answers), stop))
    return np.frombuffer(answers, dtype, count, start), stop


def _short(found: int, expected: int) -> str:
    return f"the emulated core answered {found} bytes: expected {expected}"


def run_jobs(jobs: Sequence[Job], flags: Sequence[str] = FLAGS) -> list[Answer]:
    """Run jobs on the emulated core, one after the other.

    Raises:
        FirmwareError: no cross compiler, no emulator, or one of them fails.
    """
    return decode_answers(jobs, _emulate(encode_jobs(jobs), tuple(flags), counting=False))


def measure(job: Job, flags: Sequence[str] = FLAGS) -> Cost:
    """Return what the kernel takes for a job, each tick's instructions counted exactly.

    Raises:
        FirmwareError: as `run_jobs`.
    """
    answer = _emulate(encode_jobs([job], is_measured=True), tuple(flags), counting=True)
    counted, end = _take(answer, 0, COST_DTYPE, 1)
    if end != len(answer):
        raise FirmwareError(_short(len(answer), end))
    sines, angles = config_tables(job.config)
    return Cost(
        instructions=int(counted[0]["instructions"]) / int(counted[0]["ticks"]),
        worst_instructions=int(counted[0]["worst"]),
        ticks=int(counted[0]["ticks"]),
        code_bytes=code_bytes(flags),
        table_bytes=sines.nbytes + angles.nbytes,
        state_bytes=struct_dtype("chiplog_state").itemsize,
        config_bytes=struct_dtype("chiplog_config", pointer_bytes=4).itemsize,
    )


def code_bytes(flags: Sequence[str] = FLAGS) -> int:
    """Return the size of the kernel's code and constants.

    Raises:
        FirmwareError: no cross compiler, or it fails.
    """
    with tempfile.TemporaryDirectory(prefix="chiplog-") as folder:
        unit = Path(folder) / "kernel.o"
        _compile([*flags, "-c", "-o", str(unit)], (c99.SOURCE,))
        sizes = _run([_tool(COMPILER).removesuffix("gcc") + "size", str(unit)], Path(folder))
    return int(sizes.split(b"\n")[1].split()[0])


def _emulate(jobs: bytes, flags: tuple[str, ...], *, counting: bool) -> bytes:
    emulator = _tool(EMULATOR)
    image = _image(flags)
    with tempfile.TemporaryDirectory(prefix="chiplog-") as name:
        folder = Path(name)
        (folder / "jobs.bin").write_bytes(jobs)
        count = ["-icount", "shift=0"] if counting else []
        quiet = ["-display", "none", "-monitor", "none", "-serial", "none", "-net", "none"]
        files_of_host = ["-semihosting-config", "enable=on,target=native"]
        machine = ["-machine", "mps2-an385", "-kernel", str(image)]
        _run([emulator, *machine, *quiet, *files_of_host, *count], folder)
        return (folder / "answers.bin").read_bytes()


@lru_cache(maxsize=8)
def _image(flags: tuple[str, ...]) -> Path:
    """Return the program for the emulated core; it lasts as long as this process."""
    folder = tempfile.TemporaryDirectory(prefix="chiplog-")
    _KEPT.append(folder)
    image = Path(folder.name) / "kernel.elf"
    link = ["-nostdlib", "-o", str(image)]
    _compile([*flags, *link], _SOURCES, link_script=True)
    return image


_KEPT: Final[list[tempfile.TemporaryDirectory[str]]] = []


def _compile(words: Sequence[str], sources: Sequence[str], *, link_script: bool = False) -> None:
    with ExitStack() as kept:
        folder = kept.enter_context(as_file(files(c99)))
        given = [*words, f"-I{folder}", *(str(folder / source) for source in sources)]
        if link_script:
            given += ["-T", str(folder / _LINKER_SCRIPT), "-lgcc"]
        _run([_tool(COMPILER), *CORE, *given], Path.cwd())


def _tool(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        raise FirmwareError(
            f"{name} is not on PATH: expected it for the emulated core, for example by "
            f"`apt-get install {_PACKAGES[name]}`"
        )
    return found


def _run(words: Sequence[str], folder: Path) -> bytes:
    ran = subprocess.run(
        words, cwd=folder, stdin=subprocess.DEVNULL, capture_output=True, check=False
    )
    if ran.returncode != 0:
        lines = ran.stderr.decode(errors="replace").splitlines() or ["no message"]
        told = next((line for line in lines if "error" in line), lines[0])
        raise FirmwareError(
            f"{Path(words[0]).name} exits with status {ran.returncode}: {told}: expected 0"
        )
    return ran.stdout
