"""One answer asked of every kernel: Python, machine code, C on this PC, C on an emulated core."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache, partial
from importlib.resources import as_file, files
from pathlib import Path
from typing import Final

import numpy as np

from firmware_model import STATE_FIELDS, Kernel, c99, run_batch
from firmware_model.cortex_m import RECORD_DTYPE, Answer, Job, decode_answers, encode_jobs, run_jobs

MAIN = str(Path(__file__).parent / "jobs_main.c")
SANITIZED = ("-std=c99", "-O1", "-g", "-fsanitize=undefined,address", "-fno-sanitize-recover=all")
_CHUNK: Final = 10_000  # ticks


@lru_cache(maxsize=8)
def _program(flags: tuple[str, ...]) -> tuple[Path, tempfile.TemporaryDirectory[str]]:
    folder = tempfile.TemporaryDirectory(prefix="chiplog-")
    program = Path(folder.name) / "jobs"
    with as_file(files(c99)) as sources:
        units = [MAIN, *(str(sources / name) for name in ("jobs.c", c99.SOURCE))]
        subprocess.run(["cc", *flags, f"-I{sources}", "-o", str(program), *units], check=True)
    return program, folder


def run_program(jobs: Sequence[Job], flags: tuple[str, ...] = SANITIZED) -> list[Answer]:
    """Run jobs by a program of this PC; what a sanitizer finds fails the test."""
    program, _ = _program(flags)
    given = encode_jobs(jobs, pointer_bytes=8)
    done = subprocess.run([str(program)], input=given, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stderr == b""
    return decode_answers(jobs, done.stdout)


C_WAYS: Final[dict[str, Callable[[Sequence[Job]], list[Answer]]]] = {
    "sanitizers": run_program,
    "-O0": partial(run_program, flags=("-std=c99", "-O0")),
    "-O2": partial(run_program, flags=("-std=c99", "-O2")),
    "-O3 -flto": partial(run_program, flags=("-std=c99", "-O3", "-flto")),
    "cortex_m3": run_jobs,
}


def oracle(job: Job) -> Answer:
    """Return what the readable kernel puts on the bus after each tick, and its final state."""
    kernel = Kernel(job.config, "python")
    records = np.zeros(len(job.inputs), RECORD_DTYPE)
    for start in range(0, len(records), _CHUNK):
        part = slice(start, start + _CHUNK)
        records[part] = list(_records(kernel, job.inputs[part].tolist()))
    return Answer(records, kernel.state())


def _records(kernel: Kernel, ticks: list[list[int]]) -> Iterator[tuple[int | bytes, ...]]:
    for given in ticks:
        kernel.step(*given)
        yield (
            kernel.x_m_q,
            kernel.y_m_q,
            kernel.gyro_offset_q,
            kernel.heading_turn_q,
            kernel.v_m_s_q,
            kernel.w_rad_s_q,
            kernel.status_word,
            kernel.heading_source,
            kernel.v_is_valid,
            kernel.w_is_valid,
            (0, 0, 0, 0, 0),
        )


def assert_same(found: Answer, expected: Answer, way: str) -> None:
    """Two answers are equal to the byte; else the first tick that differs is told."""
    if found.records.tobytes() != expected.records.tobytes():
        tick = int(np.flatnonzero(found.records != expected.records)[0])
        wrong = {
            name: (found.records[name][tick], expected.records[name][tick])
            for name in RECORD_DTYPE.names or ()
            if np.any(found.records[name][tick] != expected.records[name][tick])
        }
        raise AssertionError(f"{way}: tick {tick}: (found, expected) of {wrong}")
    assert found.state == expected.state, way


def assert_machine_code_as(expected: Answer, job: Job) -> None:
    """The batch's pose, status and source of every tick and its final state are as expected."""
    left, right, encoder, code, gyro = job.inputs.T[:, None, :]
    runs = run_batch(job.config, left, right, code, _validity(encoder), _validity(gyro), twin=False)
    assert runs.pose_q is not None
    assert runs.status is not None
    assert runs.heading_source is not None
    for place, name in enumerate(("x_m_q", "y_m_q", "heading_turn_q")):
        assert np.array_equal(runs.pose_q[0, :, place], expected.records[name]), name
    assert np.array_equal(runs.status[0], expected.records["status"])
    assert np.array_equal(runs.heading_source[0], expected.records["heading_source"])
    final = dict(zip(STATE_FIELDS, runs.final_states[0].item(), strict=True))
    assert final == expected.state


def _validity(given: np.ndarray) -> np.ndarray:  # type: ignore[type-arg]  # any integers
    """Return validities that 8 bits hold: any other number is INVALID, as 3 is."""
    return np.where((given >= 0) & (given <= 2), given, 3)


def assert_four_ways(jobs: Sequence[Job]) -> list[Answer]:
    """Run jobs by all kernels; return the readable one's answers, which all others have given."""
    expected = [oracle(job) for job in jobs]
    for job, one in zip(jobs, expected, strict=True):
        assert_machine_code_as(one, job)
    for way, answers in C_WAYS.items():
        for found, one in zip(answers(jobs), expected, strict=True):
            assert_same(found, one, way)
    return expected


def job_of(config: object, ticks: object) -> Job:
    """Return a job from inputs as the cases draw them: integers that an int64 holds."""
    return Job(config, np.array(ticks, dtype=np.int64).reshape(-1, 5))  # type: ignore[arg-type]
