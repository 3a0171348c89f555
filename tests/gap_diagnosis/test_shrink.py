"""How far the gap shrinks with what was found, stage by stage."""

from __future__ import annotations

from dataclasses import replace

from structure_cases import ROBOT, WIRE, analysis_of

from gap_diagnosis.firmware import firmware_block
from gap_diagnosis.how_far import shrink
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario


def test_a_program_that_is_found_closes_the_gap_of_the_firmware() -> None:
    wrong = EffectSetting("firmware_constant", (("constant", "wheel_radius"), ("scale", 0.01)))
    drive = replace(scenario("figure8"), effects=())
    log = synthetic_recording(
        ROBOT, WIRE, drive, (wrong,), 3, reference=ReferenceNoise(), duration_s=30.0
    )
    motion, firmware = analysis_of(log), firmware_block(log, ROBOT, WIRE)
    assert firmware is not None
    analysis = replace(motion, blocks=(*motion.blocks, firmware))
    found = shrink(analysis, frozenset({"firmware_constant"}), "firmware", ROBOT, WIRE, None).gap
    assert found is not None
    assert found.metric == "firmware_position_m"
    assert found.before > 0.01
    assert found.after is not None
    assert found.after < 1e-6
    assert found.closed is not None
    assert found.closed > 0.999
