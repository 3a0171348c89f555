"""Kernels that run jobs elsewhere: the sanitized program of this PC, and the emulated core."""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from firmware_model import Kernel, c99
from firmware_model.cortex_m import Answer, Job, decode_answers, encode_jobs

MAIN = str(Path(__file__).parent / "jobs_main.c")
SANITIZED = ("-std=c99", "-O1", "-g", "-fsanitize=undefined,address", "-fno-sanitize-recover=all")


@lru_cache(maxsize=1)
def _sanitized_program() -> tuple[Path, tempfile.TemporaryDirectory[str]]:
    folder = tempfile.TemporaryDirectory(prefix="chiplog-")
    program = Path(folder.name) / "jobs"
    with as_file(files(c99)) as sources:
        units = [MAIN, *(str(sources / name) for name in ("jobs.c", c99.SOURCE))]
        subprocess.run(["cc", *SANITIZED, f"-I{sources}", "-o", str(program), *units], check=True)
    return program, folder


def run_sanitized(jobs: Sequence[Job]) -> list[Answer]:
    """Run jobs under the undefined-behaviour and address sanitizers; a finding fails the test."""
    program, _ = _sanitized_program()
    given = encode_jobs(jobs, pointer_bytes=8)
    done = subprocess.run([str(program)], input=given, capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()
    assert done.stderr == b""
    return decode_answers(jobs, done.stdout)


def assert_as_the_kernel(job: Job, answer: Answer, implementation: str = "compiled") -> None:
    """The odometry of every tick and the final state are those of the kernel in Python's world."""
    kernel = Kernel(job.config, implementation)  # type: ignore[arg-type]
    names = answer.records.dtype.names
    assert names is not None
    for given, record in zip(job.inputs.tolist(), answer.records, strict=True):
        kernel.step(*given)
        expected = (
            kernel.x_m_q,
            kernel.y_m_q,
            kernel.gyro_offset_q,
            kernel.heading_turn_q,
            kernel.v_m_s_q,
            kernel.w_rad_s_q,
            kernel.status_word,
            int(kernel.heading_source),
            int(kernel.v_is_valid),
            int(kernel.w_is_valid),
        )
        assert tuple(int(record[name]) for name in names[:-1]) == expected
    assert answer.state == kernel.state()


def job_of(config: object, ticks: object) -> Job:
    """Return a job from inputs as the cases draw them: clipped to what an int64 holds."""
    return Job(config, np.array(ticks, dtype=np.int64).reshape(-1, 5))  # type: ignore[arg-type]
