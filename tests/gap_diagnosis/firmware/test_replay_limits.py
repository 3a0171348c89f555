"""From which size on a replay shows what another program would have said."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import pytest

from chiplog.pages.diagnosis_words import limit
from firmware_model.changes import CONSTANTS
from gap_diagnosis.firmware import FirmwareBlock, firmware_block
from gap_diagnosis.limits_elsewhere import limits_elsewhere
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness import load_robot, load_wire
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

ROBOT, WIRE = load_robot(), load_wire()


def block_of(*effects: EffectSetting, seconds: float = 30.0) -> FirmwareBlock:
    figure8 = replace(scenario("figure8"), effects=())
    log = synthetic_recording(ROBOT, WIRE, figure8, effects, 3, duration_s=seconds)
    found = firmware_block(log, ROBOT, WIRE)
    assert found is not None
    return found


@cache
def limits() -> dict[str, float | None]:
    return limits_elsewhere([], [block_of()])


@pytest.mark.parametrize(
    ("effect", "parameter", "more"),
    [
        ("firmware_constant", "scale", [(("constant", one),) for one in CONSTANTS]),
        ("fixed_tick_period", "scale", [()]),
        ("auto_zero", "threshold", [()]),
    ],
)
def test_at_its_limit_an_effect_changes_a_digit_and_a_fifth_of_it_changes_none(
    effect: str, parameter: str, more: list[tuple[tuple[str, str], ...]]
) -> None:
    size = limits()[effect]
    assert size is not None
    assert size > 0

    def equal(times: float) -> list[bool]:
        settings = [EffectSetting(effect, (*one, (parameter, times * size))) for one in more]
        return [block_of(one).is_equal for one in settings]

    assert not all(equal(1.0))
    assert all(equal(1 / 5))


def test_a_tick_in_the_log_is_the_least_that_is_missed() -> None:
    assert limits()["missed_deadline"] == pytest.approx(1 / 3000, rel=0.01)


def test_what_this_program_does_not_do_cannot_be_seen() -> None:
    assert ROBOT.firmware.mode != "blend"
    assert limits()["blend_weight"] is None


def test_whole_numbers_are_told_in_words() -> None:
    assert limit("firmware_resolution", limits()["firmware_resolution"]) == "fewer by 1 bit"
    entries = limits()["coarse_trig_table"]
    assert entries is not None
    assert limit("coarse_trig_table", entries) == f"up to {entries:.0f} entries"
    assert limit("firmware_constant", 1e-13) == "1e-13"
    assert limit("firmware_truncation", limits()["firmware_truncation"]) == "any"


def test_without_odometry_frames_nothing_of_the_program_is_seen() -> None:
    assert limits_elsewhere([], [])["firmware_constant"] is None
