"""A recorder that stops for seconds while the robot drives on: the log says nothing of that way."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from full_size import at_full_size

from chiplog.run_folder import reference_tum
from gap_diagnosis.diagnose import diagnose, diagnose_recordings
from gap_diagnosis.motion.blanks import (
    blanks,
    lost_ways_m2,
    odometry_of_one_part,
    stretches,
    without_blanks,
)
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness import RunConfig, load_robot, load_wire, run, scenario

ROBOT = load_robot(None)
WIRE = load_wire()
DRIVE = replace(scenario("random"), effects=())


def healthy(duration_s: float = 60.0) -> Recording:
    return synthetic_recording(
        ROBOT, WIRE, DRIVE, (), 1, reference=ReferenceNoise(), duration_s=duration_s
    )


def silent(whole: Recording, start_s: float, stop_s: float) -> Recording:
    """Return a recording whose wheels and gyro nobody heard from then to then."""
    lost = (whole.t_s > start_s) & (whole.t_s < stop_s)
    assert whole.gyro_rate_rad_s is not None
    return replace(
        whole,
        left_ticks=np.where(lost, np.nan, whole.left_ticks),
        right_ticks=np.where(lost, np.nan, whole.right_ticks),
        gyro_rate_rad_s=np.where(lost, np.nan, whole.gyro_rate_rad_s),
        gyro_code=None if whole.gyro_code is None else np.where(lost, np.nan, whole.gyro_code),
    )


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the log and the reference of a drive, of which both are whole."""
    home = tmp_path_factory.mktemp("drive")
    result = run(RunConfig(scenario=DRIVE, robot=ROBOT, duration_s=60.0, log=home / "bus.log"))
    (home / "reference.tum").write_text(reference_tum(result), encoding="ascii")
    return home


@pytest.mark.parametrize(("start_s", "lasts_s"), [(20.0, 8.0), *at_full_size((12.0, 1.5))])
def test_only_the_gap_in_a_log_is_told(
    recorded: Path, tmp_path: Path, start_s: float, lasts_s: float
) -> None:
    """The body stepped aside by 0.35 m "and no wheel turned with it"; the firmware, which had what
    the recorder lost, truncated (0.65) or had another constant (0.94)."""
    lines = (recorded / "bus.log").read_text(encoding="ascii").splitlines(keepends=True)
    stamps_s = np.array([float(line[1 : line.index(")")]) for line in lines])
    since_s = stamps_s - stamps_s[0]
    kept = (since_s < start_s) | (since_s > start_s + lasts_s)
    log = tmp_path / "bus.log"
    log.write_text("".join(np.array(lines)[kept]), encoding="ascii")
    told = diagnose([log], references=[recorded / "reference.tum"]).diagnosis
    assert told.verdict == "bus_gap"
    (window,) = told.which[0].windows
    assert window == pytest.approx((start_s, start_s + lasts_s), abs=0.03)


@pytest.mark.parametrize("window", [(25.0, 40.0), *at_full_size([10.0, 12.0])])
def test_a_healthy_robot_whose_counts_are_missing_for_a_while_has_no_gap(
    window: tuple[float, float],
) -> None:
    assert diagnose_recordings([silent(healthy(), *window)], ROBOT, WIRE).diagnosis.verdict == (
        "no_gap"
    )


def test_counts_that_can_be_interpolated_leave_no_blank() -> None:
    whole = healthy(10.0)
    assert not blanks(whole).any()
    assert not blanks(silent(whole, 5.0, 5.08)).any()


@pytest.mark.parametrize("is_left_out", [True, False])
def test_a_blank_reaches_to_the_row_that_ends_it_whether_rows_are_empty_or_not_there(
    *, is_left_out: bool
) -> None:
    lost = silent(healthy(10.0), 4.0, 6.0)
    if is_left_out:
        known = np.isfinite(lost.left_ticks)
        lost = replace(
            lost,
            **{name: value[known] for name, value in vars(lost).items() if _is_row(value, lost)},
        )
    ((first, last),) = stretches(blanks(lost))
    assert lost.t_s[first - 1] == pytest.approx(4.0, abs=0.02)
    assert lost.t_s[last] == pytest.approx(6.0, abs=0.02)


def _is_row(value: object, of: Recording) -> bool:
    return isinstance(value, np.ndarray) and value.shape == of.t_s.shape


def test_where_a_way_leads_is_the_less_sure_the_longer_nobody_heard_of_it() -> None:
    whole = healthy()
    t_s = whole.t_s
    forward_m, heading_rad = np.full(len(t_s), 0.004), 0.5 * np.sin(t_s)
    sds = []
    for lasts_s in (0.5, 1.0, 2.0, 4.0):
        blank = blanks(silent(whole, 20.0, 20.0 + lasts_s))
        lost_m2 = lost_ways_m2(blank, t_s, forward_m, heading_rad)
        assert np.count_nonzero(lost_m2) == 1
        sds.append(float(np.sqrt(lost_m2.sum())))
    assert sds == sorted(sds)
    assert sds[-1] <= 0.4 * 4.1, "no farther than it drove"


def test_a_robot_that_stood_is_where_it_was() -> None:
    whole = healthy()
    blank = blanks(silent(whole, 20.0, 24.0))
    stood = np.zeros(len(whole.t_s))
    assert not lost_ways_m2(blank, whole.t_s, stood, stood).any()


def test_a_reference_says_nothing_of_a_blank_and_a_replay_compares_one_part() -> None:
    whole = healthy()
    lost = silent(whole, 20.0, 24.0)
    lost = replace(lost, odometry_x_m=whole.t_s, odometry_y_m=whole.t_s)
    seen = without_blanks(lost).reference
    assert seen is not None
    assert not ((seen.t_s > 20.0) & (seen.t_s < 24.0)).any()
    assert without_blanks(whole) is whole
    part = odometry_of_one_part(lost).odometry_x_m
    assert part is not None
    assert np.isfinite(part).sum() == np.count_nonzero(whole.t_s > 24.005)
    assert odometry_of_one_part(whole) is whole
