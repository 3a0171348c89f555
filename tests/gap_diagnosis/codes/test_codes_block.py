"""The codes' block finds faults of the converter, and none in coarse or noiseless sensors."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from full_size import at_full_size

from gap_diagnosis.codes import CodesBlock, codes_block
from gap_diagnosis.codes.bits import missing_codes
from gap_diagnosis.codes.data import code_data
from gap_diagnosis.codes.saturation import flat_top
from gap_diagnosis.recording import Recording
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.effects import EffectSetting
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario
from hil_harness.scenarios.named import random as random_scenario

WIRE = load_wire()
ROBOT = load_robot()


def recording(seed: int = 1, **effects: Mapping[str, Any]) -> Recording:
    settings = tuple(EffectSetting(name, tuple(one.items())) for name, one in effects.items())
    scenario = random_scenario(seed)
    return synthetic_recording(ROBOT, WIRE, scenario, settings, seed, duration_s=60.0)


def block_of(made: Recording) -> CodesBlock:
    block = codes_block(made, ROBOT)
    assert block is not None
    return block


def evidences(made: Recording) -> dict[str, float]:
    block = block_of(made)
    return {one: block.fit(frozenset({one})).log_evidence for one in block.effects}


@pytest.mark.parametrize("seed", range(1, 11))
def test_sound_codes_speak_for_no_effect(seed: int) -> None:
    assert max(evidences(recording(seed)).values()) <= 0.5


def test_a_code_that_was_never_asked_for_leaves_no_trace() -> None:
    fit = block_of(recording()).fit(frozenset({"adc_missing_code"}))
    assert fit.log_silent == pytest.approx(fit.log_evidence, abs=0.01)
    missing = block_of(recording(adc_missing_code={"code": 32768}))
    fit = missing.fit(frozenset({"adc_missing_code"}))
    assert fit.log_silent < 0 < fit.log_evidence - 5


@pytest.mark.parametrize("step", [2, 4, 16, 64])
def test_a_coarse_sensor_has_no_stuck_bit(step: int) -> None:
    made = recording()
    assert made.gyro_code is not None
    coarse = replace(made, gyro_code=step * np.round(made.gyro_code / step))
    assert max(evidences(coarse).values()) <= 0.0


def test_a_simulator_without_noise_is_not_frozen() -> None:
    made = recording()
    assert made.w_command_rad_s is not None
    rate = np.nan_to_num(made.w_command_rad_s)
    clean = replace(made, gyro_code=np.round(32768 + 7505.75 * rate))
    assert max(evidences(clean).values()) <= 0.0


def test_physical_rates_have_no_bits() -> None:
    made = recording()
    assert made.gyro_code is not None
    found = evidences(replace(made, gyro_code=made.gyro_code + 0.37))
    assert set(found) == {"gyro_frozen", "gyro_saturation"}
    assert max(found.values()) <= 0.0


@pytest.mark.parametrize(("bit", "value"), [(1, 0), (2, 1), (5, 0), (8, 1), (11, 0), (13, 1)])
def test_a_stuck_bit_is_named_with_its_value(bit: int, value: int) -> None:
    made = recording(adc_stuck_bit={"bit": bit, "value": value})
    fit = block_of(made).fit(frozenset({"adc_stuck_bit"}))
    assert fit.log_evidence > 5
    assert fit.parameters["adc_stuck_bit.bit"].value == bit
    assert fit.parameters["adc_stuck_bit.value"].value == value


def test_a_frozen_gyro_is_found_with_its_window() -> None:
    fit = block_of(recording(gyro_frozen={"start_s": 20.0, "stop_s": 20.5})).fit(
        frozenset({"gyro_frozen"})
    )
    assert fit.log_evidence > 20
    assert fit.windows[0] == pytest.approx((20.0, 20.5), abs=0.03)


@pytest.mark.parametrize("limit_rad_s", [0.2, 0.3])
def test_codes_that_are_cut_off_for_most_of_a_log_do_not_hide_that_the_rest_tremble(
    limit_rad_s: float,
) -> None:
    """Two thirds of a log at its top do not tremble, so nothing did, and the top told nothing: a
    function of the code, of no listed effect, was likelier than a gyro that is cut off (1.00)."""
    made = synthetic_recording(
        ROBOT,
        WIRE,
        scenario("figure8"),
        (EffectSetting("gyro_saturation", (("limit", limit_rad_s),)),),
        1,
    )
    data = code_data(made, ROBOT)
    assert data is not None
    assert data.noise < 1.5
    found = flat_top(data)
    assert found is not None
    assert found.limit_rad_s == pytest.approx(limit_rad_s, abs=1e-4)
    assert found.log_ratio > 100


def test_a_flat_top_is_a_limit_and_no_frozen_gyro() -> None:
    made = recording(gyro_saturation={"limit": 0.7})
    found = evidences(made)
    assert found["gyro_saturation"] > 10
    assert found["gyro_frozen"] <= 0
    limit = block_of(made).fit(frozenset({"gyro_saturation"})).parameters["gyro_saturation.limit"]
    assert limit.value == pytest.approx(0.7, abs=0.001)


def test_a_frozen_gyro_says_one_code_over_and_over_and_hides_none() -> None:
    """A code that nobody asked for stands below it by chance."""
    made = recording(gyro_frozen={"start_s": 20.0, "stop_s": 22.0})
    assert made.gyro_code is not None
    (window,) = block_of(made).fit(frozenset({"gyro_frozen"})).windows
    frozen = (made.t_s >= window[0]) & (made.t_s <= window[1])
    said = made.gyro_code[frozen][len(made.gyro_code[frozen]) // 2]
    code = np.where(made.gyro_code == said - 1, said - 2, made.gyro_code)
    code = np.where(~frozen & (code == said - 3) & (np.arange(len(code)) % 2 == 0), said - 2, code)
    fit = block_of(replace(made, gyro_code=code)).fit(frozenset({"adc_missing_code"}))
    assert fit.log_evidence < 3.0


def test_a_missing_code_is_named() -> None:
    fit = block_of(recording(adc_missing_code={"code": 32770})).fit(frozenset({"adc_missing_code"}))
    assert fit.log_evidence > 2
    assert fit.parameters["adc_missing_code.code"].value == 32770


def test_a_code_that_never_came_where_eighty_were_expected_is_no_matter_of_luck() -> None:
    """By a fifth of the usual number more or less it was worth 20 nats, 11 of them the price of any
    code: withheld from the library, it was no gap (.84 of a sealed case)."""
    rng = np.random.default_rng(1)
    code = np.rint(32768 + 25.0 * rng.standard_normal(5000))
    codes, ratio = missing_codes(np.where(code == 32771, 32772, code))
    assert codes[int(np.argmax(ratio))] == 32771
    assert ratio.max() > 30.0


@pytest.mark.parametrize("seed", range(300))
def test_no_code_is_missing_beside_the_one_that_a_quiet_gyro_says_at_rest(seed: int) -> None:
    """However sharp the peak is: what lies beside it is as usual as its less usual neighbour."""
    rng = np.random.default_rng(seed)
    turns = np.repeat(rng.choice([0.0, 0.0, 0.0, 1.0, -1.0], 40), 150) * rng.uniform(5.0, 3000.0)
    rate = np.convolve(turns, np.full(20, 0.05), "same") + rng.uniform(-0.5, 0.5)
    noise = np.exp(rng.uniform(np.log(0.2), np.log(6.0))) * rng.standard_normal(len(rate))
    _, ratio = missing_codes(np.rint(32768 + rate + noise))
    assert np.logaddexp.reduce(ratio) - 16 * np.log(2.0) < 0.0


def test_without_a_gyro_there_is_no_block() -> None:
    assert codes_block(replace(recording(), gyro_code=None), ROBOT) is None


@pytest.mark.parametrize(
    "window", [{"start_s": 25.0}, *at_full_size({"start_s": 40.0}, {"stop_s": 35.0})]
)
def test_a_bit_that_is_stuck_from_some_time_on_is_told_with_its_beginning(
    window: dict[str, float],
) -> None:
    """Codes from before it spoke against it: it was a bias that walks."""
    made = recording(3, adc_stuck_bit={"bit": 4, "value": 1, **window})
    fit = block_of(made).fit(frozenset({"adc_stuck_bit"}))
    assert fit.log_evidence > 30.0
    assert fit.parameters["adc_stuck_bit.bit"].value == 4
    assert fit.parameters["adc_stuck_bit.value"].value == 1
    ((name, at_s),) = window.items()
    told = fit.parameters[f"adc_stuck_bit.{name}"]
    assert told.value == pytest.approx(at_s, abs=0.1)


@pytest.mark.parametrize(
    "window", [{"start_s": 25.0}, *at_full_size({"start_s": 35.0}, {"stop_s": 35.0})]
)
def test_a_gyro_that_clips_from_some_time_on_is_not_frozen(window: dict[str, float]) -> None:
    """It went further before, so that its flat top was no end of all codes: it was a code that
    repeats for seven seconds."""
    block = block_of(recording(3, gyro_saturation={"limit": 0.4, **window}))
    fit = block.fit(frozenset({"gyro_saturation"}))
    assert fit.log_evidence > 8.0
    assert fit.parameters["gyro_saturation.limit"].value == pytest.approx(0.4, rel=0.01)
    assert block.fit(frozenset({"gyro_frozen"})).log_evidence < 0.0


def test_codes_of_a_part_of_a_log_show_no_fault_by_chance() -> None:
    for seed in range(1, 4):
        found = evidences(recording(seed))
        assert max(found.values()) <= 0.0


@pytest.mark.parametrize("noise_ticks", [0.0, ROBOT.plant.encoder.noise_ticks])
@pytest.mark.parametrize("reads_less", [-0.04, *at_full_size(-0.06)])
def test_a_quiet_gyro_that_reads_too_little_does_not_clip(
    reads_less: float, noise_ticks: float
) -> None:
    """At each turn of one rate it says one code, below what the wheels say: 196 nats for a limit,
    or 81 for one in the slower part of the log."""
    plant = ROBOT.plant
    still = {"noise_density_rad_per_sqrt_s": 0.0, "bias_walk_density_rad_s_per_sqrt_s": 0.0}
    even = {
        "gyro": plant.gyro.model_copy(update=still),
        "contact": plant.contact.model_copy(update={"noise_m_per_sqrt_m": 0.0}),
        "encoder": plant.encoder.model_copy(update={"noise_ticks": noise_ticks}),
    }
    quiet = replace(ROBOT, plant=plant.model_copy(update=even))
    setting = EffectSetting("gyro_scale", (("scale", reads_less),))
    made = synthetic_recording(quiet, WIRE, replace(scenario("calibration"), seed=3), (setting,), 5)
    block = codes_block(made, quiet)
    assert block is not None
    assert block.fit(frozenset({"gyro_saturation"})).log_evidence < 0.0
