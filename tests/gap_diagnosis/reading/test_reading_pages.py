"""Multiplexed messages, and logs whose rows would be nearly all empty."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from drives import ROBOT

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.reading import read_recording
from gap_diagnosis.recording import Recording

PAGES = (
    'VERSION ""\nBU_: A B\nBO_ 256 WHEELS: 5 A\n'
    ' SG_ page M : 0|8@1+ (1,0) [0|255] "" B\n'
    ' SG_ left m0 : 8|32@1- (1,0) [-2147483648|2147483647] "pulses" B\n'
    ' SG_ right m1 : 8|32@1- (1,0) [-2147483648|2147483647] "pulses" B\n'
    ' SG_ hot m2 : 8|32@1- (1,0) [-100|300] "degC" B\n'
)
CYCLE = (
    'BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;\nBA_DEF_DEF_ "GenMsgCycleTime" 0;\n'
    'BA_ "GenMsgCycleTime" BO_ 256 %d;\n'
)
MAP = '[signals]\nleft_count = "WHEELS.left"\nright_count = "WHEELS.right"\n'
TICKS = 300


def page(number: int, value: int) -> str:
    return f"100#{number:02x}{value.to_bytes(4, 'little', signed=True).hex()}"


def read(folder: Path, frames: Sequence[tuple[float, str]], dbc: str = PAGES) -> Recording:
    (folder / "mine.dbc").write_text(dbc)
    (folder / "map.toml").write_text(MAP)
    text = "".join(f"({stamp:.6f}) can0 {rest}\n" for stamp, rest in sorted(frames))
    (folder / "bus.log").write_text(text)
    return read_recording(
        folder / "bus.log", robot=ROBOT, dbc=folder / "mine.dbc", signals=folder / "map.toml"
    )


def drive(apart_s: float) -> list[tuple[float, str]]:
    """Return three pages every 20 ms, one *apart_s* after the other."""
    values = ((k, (40 * k, 30 * k, 25)) for k in range(TICKS))
    return [
        (1 + k * 0.02 + number * apart_s, page(number, value))
        for k, three in values
        for number, value in enumerate(three)
    ]


@pytest.mark.parametrize("cycle_ms", [None, 20, 7])
@pytest.mark.parametrize("apart_s", [0.0003, 0.0066])
def test_wheels_in_two_pages_of_a_message_have_the_cycle_of_their_pages(
    cycle_ms: int | None, apart_s: float, tmp_path: Path
) -> None:
    dbc = PAGES if cycle_ms is None else PAGES + CYCLE % cycle_ms
    found = read(tmp_path, drive(apart_s), dbc)
    assert found.tick_period_s == pytest.approx(0.02, rel=1e-3)
    assert np.array_equal(found.left_ticks, 40.0 * np.arange(TICKS))
    assert np.array_equal(found.right_ticks, 30.0 * np.arange(TICKS))


def test_a_page_that_is_lost_is_one_that_is_lost(tmp_path: Path) -> None:
    frames = drive(0.0003)
    del frames[3 * 50 + 1]
    found = read(tmp_path, frames)
    assert np.flatnonzero(np.isnan(found.right_ticks)).tolist() == [50]
    assert np.isfinite(found.left_ticks).all()


def test_a_log_that_would_be_nearly_all_empty_rows_is_told_in_one_line(tmp_path: Path) -> None:
    """Each count is sent three times within a millisecond."""
    frames = [
        (1 + k * 0.02 + copy * 0.0003, page(number, 40 * k + copy))
        for k in range(TICKS)
        for copy in range(3)
        for number in (0, 1)
    ]
    with pytest.raises(DiagnosisError, match=r"bus.log: 900 of 20,... ticks of 0.3 ms"):
        read(tmp_path, frames)


def test_frames_that_share_a_stamp_say_their_cycle_too(tmp_path: Path) -> None:
    """Between most frames no time passed at all: the cycle was no number."""
    frames = [(1 + k * 0.02, page(n, 40 * k)) for k in range(TICKS) for n in (0, 0, 1)]
    found = read(tmp_path, frames)
    assert found.tick_period_s == pytest.approx(0.02, rel=1e-3)
    assert found.left_ticks[-1] == found.right_ticks[-1] == 40.0 * (TICKS - 1)
