"""Poses that somebody put on straight lines between measured ones are no measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drives import ROBOT

from gap_diagnosis.diagnose import diagnose_recordings
from gap_diagnosis.reading.interpolated import without_interpolated_poses
from gap_diagnosis.recording import Recording, Reference
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness import load_wire
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

CALM = replace(scenario("calibration"), effects=())
WIDER = EffectSetting("wheelbase_scale", (("scale", 0.03),))


def driven(*effects: EffectSetting, noise: ReferenceNoise | None = None) -> Recording:
    return synthetic_recording(ROBOT, load_wire(), CALM, effects, 1, reference=noise)


def measured(rate_hz: float = 1.0, position_m: float = 0.02) -> Reference:
    """What a camera says of the drive once a second."""
    found = driven(noise=ReferenceNoise(position_m, 0.01, rate_hz=rate_hz)).reference
    assert found is not None
    return found


def put_on_lines(
    known: Reference, rate_hz: float = 10.0, late_s: float = 0.0, decimals: int = 6
) -> Reference:
    """Return poses of a higher rate on lines between those that are known."""
    t_s = np.round(np.arange(known.t_s[0] + late_s, known.t_s[-1], 1.0 / rate_hz), 6)
    heading = known.heading_rad
    return Reference(
        t_s,
        np.round(np.interp(t_s, known.t_s, known.x_m), decimals),
        np.round(np.interp(t_s, known.t_s, known.y_m), decimals),
        None if heading is None else np.round(np.interp(t_s, known.t_s, heading), decimals),
    )


@pytest.mark.parametrize("late_s", [0.0, 0.033])
@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 100.0])
@pytest.mark.parametrize("has_heading", [True, False])
def test_only_the_poses_that_were_measured_are_left_and_that_is_told(
    rate_hz: float, late_s: float, has_heading: bool
) -> None:
    """Whether or not one of the poses stands where two lines meet."""
    known = measured()
    known = known if has_heading else replace(known, heading_rad=None)
    found, (note,) = without_interpolated_poses(put_on_lines(known, rate_hz, late_s))
    nearest = np.abs(known.t_s[:, None] - found.t_s).argmin(axis=0)
    assert len(found.t_s) > 0.9 * len(known.t_s)
    # What is rounded at the sixth decimal says where lines meet that hardly bend to milliseconds.
    assert np.median(np.abs(found.t_s - known.t_s[nearest])) < 1e-4
    np.testing.assert_allclose(found.x_m, known.x_m[nearest], atol=1e-3)
    np.testing.assert_allclose(found.y_m, known.y_m[nearest], atol=1e-3)
    if known.heading_rad is None:
        assert found.heading_rad is None
    else:
        assert found.heading_rad is not None
        np.testing.assert_allclose(found.heading_rad, known.heading_rad[nearest], atol=1e-3)
    assert f"only the {len(found.t_s):,} where these meet were measured" in note


@pytest.mark.parametrize("decimals", [3, 4, 6, 12])
def test_what_was_measured_stays_however_many_decimals_it_has(decimals: int) -> None:
    """In millimetres a robot goes straight between any three samples of a hundred a second."""
    known = measured(100.0, 0.001)
    rounded = replace(known, x_m=np.round(known.x_m, decimals), y_m=np.round(known.y_m, decimals))
    assert without_interpolated_poses(rounded) == (rounded, ())


@pytest.mark.parametrize("name", ["calibration", "square", "figure8", "random"])
def test_the_truth_of_a_simulator_stays_although_it_drives_straight_at_times(name: str) -> None:
    calm = replace(scenario(name), effects=())
    exact = ReferenceNoise(0.0, 0.0, 0.0, 0.0, rate_hz=100.0)
    true = synthetic_recording(ROBOT, load_wire(), calm, (), 1, reference=exact).reference
    assert true is not None
    assert without_interpolated_poses(true) == (true, ())


def test_fixes_on_a_grid_of_degrees_stay() -> None:
    """On a straight road most lie between their neighbours, and the others a step beside."""
    t_s = np.arange(0.0, 600.0)
    east_m, north_m = (
        np.rint(part * (3.0 * (t_s + 1.0)) / step_m) * step_m * 1.0000003
        for part, step_m in ((np.cos(0.8), 0.7), (np.sin(0.8), 1.11))
    )
    fixes = Reference(t_s, east_m, north_m, None)
    assert without_interpolated_poses(fixes) == (fixes, ())


def test_a_reference_of_a_few_samples_stays() -> None:
    few = Reference(np.arange(2.0), np.zeros(2), np.zeros(2), None)
    assert without_interpolated_poses(few) == (few, ())


@pytest.mark.full_size
def test_a_wider_track_is_told_by_poses_of_once_a_second_put_on_lines() -> None:
    """By all hundred a second, each believed, it was wheels of more counts a turn (0.97)."""
    noise = ReferenceNoise(0.02, 0.01, rate_hz=1.0)
    log = driven(WIDER, noise=noise)
    assert log.reference is not None
    lines = put_on_lines(replace(log.reference, heading_rad=None), 100.0, 0.013)
    given = replace(log, reference=without_interpolated_poses(lines)[0])
    found = diagnose_recordings([given], ROBOT, load_wire()).diagnosis
    assert found.verdict == "wheelbase_scale"
