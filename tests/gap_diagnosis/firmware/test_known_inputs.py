"""Where a log has all that the ECU had, a program that ran gives the odometry to the bit."""

import dataclasses
from types import SimpleNamespace
from typing import Any, cast

import pytest
from simulated import kernel_pose, plant_runs, recording_of, robot, wire

from gap_diagnosis.firmware import firmware_block
from gap_diagnosis.firmware.candidates import Candidate, smooth
from gap_diagnosis.firmware.comparison import LOG_NO_EXCUSE
from gap_diagnosis.firmware.pairs import Pairs
from gap_diagnosis.firmware.scored import Scored
from gap_diagnosis.firmware.singles import Singles
from gap_diagnosis.firmware.workbench import Workbench
from gap_diagnosis.recording import Floats
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios.named import square

CLEAR_NATS = 8.0
PROOF_NATS = 500.0
TICKS = 2000


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("auto_zero", {"threshold": 0.008}),
        ("coarse_trig_table", {"entries": 16, "interpolated": 0}),
        ("firmware_truncation", {"rounding": "toward_zero"}),
    ],
)
def test_a_program_without_a_name_is_not_told_by_one_that_comes_near(
    effect: str, values: dict[str, Any]
) -> None:
    setting = EffectSetting(effect, tuple(values.items()))
    recording = synthetic_recording(robot(), wire(), square(), [setting], 4, duration_s=20.0)
    whole = firmware_block(recording, robot(), wire())
    lacking = firmware_block(recording, robot(), wire(), frozenset({effect}))
    assert whole is not None
    assert lacking is not None
    own = whole.fit(frozenset({effect})).log_evidence
    named = max(lacking.fit(frozenset({one})).log_evidence for one in lacking.effects)
    left = lacking.leftover().log_evidence
    assert own > left + PROOF_NATS
    assert left > max(named, 0.0) + CLEAR_NATS


def scored(log_likelihood: float, log_changed: float) -> Scored:
    return Scored(Candidate({}, {}, 0.0, {}), -8.0, log_likelihood, log_changed)


def test_two_names_that_come_near_together_explain_no_more_than_an_unlisted_change() -> None:
    """A withheld auto_zero (4,376 nats) was told as a blend weight and a tick period, certainly:
    together they came 62 nats nearer, and no change was weighed beside both."""
    changed, highest = -255.8, 4097.6
    near = scored(-204.3 + LOG_NO_EXCUSE, -204.3)
    equal = scored(highest, -150.0)
    singles = cast(Singles, SimpleNamespace(changed=lambda effects: changed))
    pairs = Pairs(singles, frozenset({"blend_weight", "firmware_constant"}))
    assert pairs._no_nearer(near).total < changed + near.log_prior
    assert pairs._no_nearer(equal) == equal


@pytest.mark.parametrize(("seed", "rate_rad_s"), [(1, 0.03), (2, 0.004)])
def test_a_threshold_is_found_whose_neighbours_all_fail_at_the_same_turn(
    seed: int, rate_rad_s: float
) -> None:
    blending = robot().firmware.model_copy(update={"mode": "blend"})
    one = dataclasses.replace(robot(), firmware=blending)
    runs = plant_runs(TICKS, seed)
    pose = kernel_pose(runs, one, auto_zero_rad_s=rate_rad_s)
    block = firmware_block(recording_of(runs, pose), one, wire())
    assert block is not None
    fit = block.fit(frozenset({"auto_zero"}))
    assert fit.log_evidence > PROOF_NATS
    threshold = fit.parameters["auto_zero.threshold"].samples
    assert threshold is not None
    assert threshold.min() < rate_rad_s < threshold.max()


def test_a_constant_is_polished_until_every_digit_is_the_records() -> None:
    runs, true = plant_runs(TICKS), 0.00023982455649637006
    pose = kernel_pose(runs, constant="wheel_radius", constant_scale=true)
    block = firmware_block(recording_of(runs, pose), robot(), wire())
    assert block is not None
    bench = block._bench

    def pose_at(scale: float) -> Floats:
        program = bench.program({"constant": "wheel_radius", "constant_scale": scale})
        assert program is not None
        return bench.poses(program)

    for off in (-2e-11, 7e-12, 5e-11):
        assert not bench.is_equal(pose_at(true + off))
        assert bench.is_equal(pose_at(bench.polish(pose_at, true + off, 6.5e-11)))


def test_a_weight_is_found_to_the_bit_though_what_it_bends_looks_like_an_offset() -> None:
    """A gyro that lags drifts off the wheels, and a blend of another weight by another part of it:
    with the offset that seems to have been learnt no weight gives the record."""
    blending = robot().firmware.model_copy(update={"mode": "blend"})
    one = dataclasses.replace(robot(), firmware=blending)
    runs = plant_runs(TICKS)
    recording = recording_of(runs, kernel_pose(runs, one, blend_weight=-0.016))
    block = firmware_block(recording, one, wire())
    assert block is not None
    singles = block._singles
    vars(singles)["_offset"] = robot().plant.gyro.zero_rate_code + 2.0
    (parameter,) = smooth("blend_weight", block._bench.config)
    (found,) = singles.around(parameter)
    assert found.values["blend_weight.weight"] == pytest.approx(-0.016, abs=1e-5)
    assert block.fit(frozenset({"blend_weight"})).log_evidence > PROOF_NATS


def test_a_constant_is_found_in_a_cell_beside_the_nearest_value(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The cell that gave the record was three from the least squares' value, and fewer digits were
    others a dozen cells away than there: polished, it was lost."""
    runs, true = plant_runs(TICKS), 0.03635991655669131
    pose = kernel_pose(runs, constant="wheel_radius", constant_scale=true)
    block = firmware_block(recording_of(runs, pose), robot(), wire())
    assert block is not None
    (parameter,) = (
        one
        for one in smooth("firmware_constant", block._bench.config)
        if one.fixed["constant"] == "wheel_radius"
    )
    (known,) = block._singles.around(parameter)
    cell = 2.0 * known.widths[parameter.name]
    monkeypatch.setattr(Workbench, "solve", lambda *told: true + 3.0 * cell)
    monkeypatch.setattr(Workbench, "polish", lambda bench, pose_at, value, width: value + 9 * cell)
    (found,) = block._singles.around(parameter)
    assert found.values[parameter.name] == pytest.approx(true, abs=cell)


@pytest.mark.parametrize(
    ("changes", "pair"),
    [
        (
            {"constant": "wheel_radius", "constant_scale": 0.00028769, "blend_weight": 0.0305385},
            ("firmware_constant", "blend_weight"),
        ),
        (
            {"blend_weight": 0.074452, "trig_entries": 64},
            ("blend_weight", "coarse_trig_table"),
        ),
    ],
    ids=str,
)
def test_two_effects_are_found_to_the_bit_though_either_alone_gives_other_digits(
    changes: dict[str, Any], pair: tuple[str, str]
) -> None:
    """Of two numbers one stayed where it had been alone, and no two were looked for of which one
    says nothing by itself: both were told as unlisted."""
    blending = robot().firmware.model_copy(update={"mode": "blend"})
    one = dataclasses.replace(robot(), firmware=blending)
    runs = plant_runs(TICKS)
    block = firmware_block(recording_of(runs, kernel_pose(runs, one, **changes)), one, wire())
    assert block is not None
    together = block.fit(frozenset(pair)).log_evidence
    alone = max(block.fit(frozenset({name})).log_evidence for name in block.effects)
    assert together > alone + PROOF_NATS
