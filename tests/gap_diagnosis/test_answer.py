"""From probabilities to entries: names, intervals, choices, twins, what is not listed."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from fake_blocks import PRIOR, STAGE, FakeBlock, analysis, ranked

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.answer import candidates, stage_probabilities, unknown_part
from gap_diagnosis.drive.leftover import Dependence
from gap_diagnosis.hypothesis import Estimate
from gap_diagnosis.motion.unknown import Alternative
from gap_diagnosis.priors import WHEELS
from gap_diagnosis.ranking import Ranking, rank
from gap_diagnosis.recording import Recording
from gap_diagnosis.result_parts import Candidate, ChoiceEstimate, NumberEstimate
from hil_harness.effects import EffectParameter, catalogue

AT_REST = np.zeros(2)
LOG = Recording(
    name="log",
    tick_period_s=0.01,
    t_s=np.array([0.0, 0.01]),
    stamp_s=np.array([0.0, 0.01]),
    tick=np.arange(2),
    left_ticks=AT_REST,
    right_ticks=AT_REST,
)


def normal(mean: float, sd: float) -> Estimate:
    return Estimate(mean, sd, mean + sd * np.random.default_rng(1).standard_normal(4000))


def entries(ranking: Ranking, *blocks: FakeBlock, logs: int = 1) -> list[Candidate]:
    return candidates(ranking, [analysis(LOG, *blocks)] * logs)[0]


def entry(listed: list[Candidate], *effects: str) -> Candidate:
    return next(one for one in listed if one.effects == effects)


def test_listed_entries_and_other_sum_to_one() -> None:
    block = FakeBlock({effect: 0.1 for effect in STAGE if not effect.startswith("setup_")})
    listed, other = candidates(ranked(block, unknown={"wheel": 1.0}), [analysis(LOG, block)])
    assert other > 0.05  # 36 sets and an unlisted cause are too many to list
    assert math.fsum(one.probability for one in listed) + other == pytest.approx(1)


def test_no_gap_and_unknown_are_always_listed() -> None:
    block = FakeBlock({"gyro_bias": 5000.0})
    listed = entries(ranked(block), block)
    assert entry(listed, "no_gap").probability == 0
    assert entry(listed, "unknown").probability == 0


def test_intervals_are_nested_about_the_estimate() -> None:
    block = FakeBlock({"gyro_bias": 50.0}, parameters={"gyro_bias.bias": normal(0.01, 0.002)})
    known = entry(entries(ranked(block), block), "gyro_bias").parameters["gyro_bias.bias"]
    assert isinstance(known, NumberEstimate)
    assert known.unit == "rad/s"
    assert known.ci95[0] < known.ci80[0] < known.ci50[0] < known.estimate
    assert known.estimate < known.ci50[1] < known.ci80[1] < known.ci95[1]
    assert known.ci95[1] - known.ci95[0] == pytest.approx(2 * 1.96 * 0.002, rel=0.05)


def test_a_moment_lies_within_its_interval_where_few_draws_lie_far_off() -> None:
    """A wheel that slipped until 22.66 s was told to have done so until 22.69 s, which its interval
    of 22.64 to 22.68 s left out: one draw in fifty was of another window, 2 s later."""
    samples = 22.66 + 0.01 * np.random.default_rng(1).standard_normal(4000)
    samples[::50] += 2.0
    stops = Estimate(float(samples.mean()), float(samples.std()), samples)
    block = FakeBlock({"gyro_bias": 50.0}, parameters={"gyro_bias.stop_s": stops})
    known = entry(entries(ranked(block), block), "gyro_bias").parameters["gyro_bias.stop_s"]
    assert isinstance(known, NumberEstimate)
    assert known.ci95[0] < known.estimate < known.ci95[1]
    assert known.estimate == pytest.approx(22.66, abs=0.002)


def test_what_leaves_the_data_of_any_member_of_a_group_is_named_with_it() -> None:
    """A gyro's bias that a square cannot tell from `adc_inl` was "adc_inl or gyro_bias": that its
    converter may be off instead was said only where the bias led."""
    block = FakeBlock({"wheelbase_scale": 50.0, "gyro_scale": 49.0, "gyro_bias": 1.0})
    led = entry(entries(ranked(block), block), "wheelbase_scale")
    assert set(led.ambiguous_with) >= {("gyro_scale",), ("adc_gain",), ("gyro_tilt",)}
    assert ("adc_offset",) not in led.ambiguous_with


def test_two_logs_know_a_value_better_than_one() -> None:
    block = FakeBlock({"gyro_bias": 50.0}, parameters={"gyro_bias.bias": normal(0.01, 0.002)})
    known = entry(entries(ranked(block, logs=2), block, logs=2), "gyro_bias")
    value = known.parameters["gyro_bias.bias"]
    assert isinstance(value, NumberEstimate)
    assert value.sd == pytest.approx(0.002 / math.sqrt(2), rel=0.05)


@pytest.mark.parametrize("logs", [1, 2, 8])
def test_no_number_of_logs_tells_what_none_of_them_does(logs: int) -> None:
    """Whether a gyro's rate in a table is of the moment or a mean: of two tables together the
    interval lay between both, and held neither."""
    as_means = np.random.default_rng(2).normal(0.055, 0.0002, 4000)
    samples = as_means + 0.005 * (np.arange(4000) % 2)
    either = Estimate(float(samples.mean()), float(samples.std()), samples, is_either=True)
    block = FakeBlock({"gyro_lag": 50.0}, parameters={"gyro_lag.time_constant": either})
    ranking = rank([[block]] * logs, PRIOR, {**STAGE, "gyro_lag": "gyro"}, {})
    lag = entry(entries(ranking, block, logs=logs), "gyro_lag").parameters["gyro_lag.time_constant"]
    assert isinstance(lag, NumberEstimate)
    for low, high, sds in ((*lag.ci95, 1.64), (*lag.ci80, 0.84)):
        assert low == pytest.approx(0.055 - sds * 0.0002 / math.sqrt(logs), abs=3e-5)
        assert high == pytest.approx(0.06 + sds * 0.0002 / math.sqrt(logs), abs=3e-5)


def test_the_surer_of_two_blocks_has_more_say() -> None:
    motion = FakeBlock({"radius_scale": 50.0}, parameters={"radius_scale.scale": normal(0.0, 0.03)})
    drive = FakeBlock(
        {"radius_scale": 50.0}, name="drive", parameters={"radius_scale.scale": normal(0.1, 0.01)}
    )
    value = entry(entries(ranked(motion, drive), motion, drive), "radius_scale").parameters
    scale = value["radius_scale.scale"]
    assert isinstance(scale, NumberEstimate)
    assert scale.estimate == pytest.approx(0.09, abs=0.001)  # weights 1 to 9


def test_what_two_blocks_read_of_the_same_codes_is_known_no_better_for_that() -> None:
    """When a gyro froze was told within a row by both, and so within 0.7 of one: of 16 intervals of
    50 % 9 left out the truth."""
    said = {"gyro_bias.bias": Estimate(0.005, 0.0029, np.linspace(0.0, 0.01, 4001))}
    motion = FakeBlock({"gyro_bias": 50.0}, parameters=said)
    codes = FakeBlock({"gyro_bias": 50.0}, name="codes", parameters=said)
    known = entry(entries(ranked(motion), motion, codes), "gyro_bias").parameters["gyro_bias.bias"]
    assert isinstance(known, NumberEstimate)
    assert known.ci50 == pytest.approx((0.0025, 0.0075))


def test_what_one_block_knows_to_the_last_digit_is_told_so() -> None:
    """A flat top's limit that stands in the codes: weights of 1/0² ended in a traceback."""
    motion = FakeBlock({"radius_scale": 50.0}, parameters={"radius_scale.scale": normal(0.0, 0.03)})
    codes = FakeBlock(
        {"radius_scale": 50.0}, name="codes", parameters={"radius_scale.scale": normal(0.1, 0.0)}
    )
    value = entry(entries(ranked(motion, codes), motion, codes), "radius_scale").parameters
    scale = value["radius_scale.scale"]
    assert isinstance(scale, NumberEstimate)
    assert scale.estimate == pytest.approx(0.1)
    assert scale.sd == pytest.approx(0.0, abs=1e-12)


def test_a_choice_is_the_most_probable_one_with_all_probabilities() -> None:
    side = Estimate("left", probabilities={"left": 0.9, "right": 0.1})
    block = FakeBlock({"missed_ticks": 50.0}, parameters={"missed_ticks.side": side})
    chosen = entry(entries(ranked(block), block), "missed_ticks").parameters["missed_ticks.side"]
    assert isinstance(chosen, ChoiceEstimate)
    assert chosen.estimate == "left"
    assert chosen.probabilities == pytest.approx({"left": 0.9, "right": 0.1})


def test_a_parameter_of_a_users_own_effect_has_its_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(STAGE, "deep_carpet", "wheel")
    pile = EffectParameter("pile", "m", 0.0, "how deep the wheels sink in")
    carpet = replace(catalogue()["radius_scale"], name="deep_carpet", parameters=(pile,))
    block = FakeBlock({"deep_carpet": 50.0}, parameters={"deep_carpet.pile": normal(0.004, 1e-4)})
    listed, _ = candidates(ranked(block), [analysis(LOG, block)], {"deep_carpet": carpet})
    known = entry(listed, "deep_carpet").parameters["deep_carpet.pile"]
    assert isinstance(known, NumberEstimate)
    assert known.unit == "m"


def test_logs_that_disagree_on_a_choice_are_weighed() -> None:
    """A log that is sure outweighs one that is not."""
    blocks = [
        FakeBlock({"missed_ticks": 50.0}, parameters={"missed_ticks.side": side})
        for side in (
            Estimate("left", probabilities={"left": 0.6, "right": 0.4}),
            Estimate("right", probabilities={"left": 0.1, "right": 0.9}),
        )
    ]
    listed, _ = candidates(ranked(*blocks), [analysis(LOG, one) for one in blocks])
    chosen = entry(listed, "missed_ticks").parameters["missed_ticks.side"]
    assert isinstance(chosen, ChoiceEstimate)
    assert chosen.estimate == "right"
    assert chosen.probabilities["right"] == pytest.approx(0.36 / 0.42)


def test_a_late_frame_goes_by_the_name_that_the_logs_own_bus_has_for_it() -> None:
    frame = Estimate("IMU", probabilities={"IMU": 0.9, "ENCODER": 0.1})
    block = FakeBlock({"frame_latency": 60.0}, parameters={"frame_latency.frame": frame})
    ranking = rank([[block]], PRIOR, {**STAGE, "frame_latency": "bus"}, {})
    log = replace(LOG, own_names={"IMU": "YAW", "ENCODER": "WHEELS"})
    listed = candidates(ranking, [analysis(log, block)])[0]
    told = entry(listed, "frame_latency").parameters["frame_latency.frame"]
    assert isinstance(told, ChoiceEstimate)
    assert told.estimate == "YAW"
    assert told.probabilities == pytest.approx({"YAW": 0.9, "WHEELS": 0.1})


def test_a_group_has_the_probability_of_its_members() -> None:
    both = frozenset({"wheelbase_scale", "gyro_scale"})
    block = FakeBlock({"wheelbase_scale": 60.0, "gyro_scale": 59.0}, {both: 55.0})
    first = entry(entries(ranked(block), block), "wheelbase_scale")
    assert ("gyro_scale",) in first.ambiguous_with
    assert first.probability < 0.8
    assert first.group_probability > 0.98


def test_what_is_named_as_a_twin_counts_for_the_group() -> None:
    """Of a load on one side 78 % and its named twin's 16 % were together 79.8 %."""
    gains = {"payload": 101.0, "radius_mismatch": 97.0, "radius_scale": 20.0}
    likelihood = {"payload": 104.0, "radius_mismatch": 102.0}
    no_more = {WHEELS: 99.5, **{frozenset({"payload", one}): 95.0 for one in WHEELS}}
    no_more[WHEELS | {"payload"}] = 95.0
    block = FakeBlock(gains, no_more, likelihood=likelihood)
    ranking = rank([[block]], PRIOR, {**STAGE, "payload": "wheel"}, {})
    first = entry(entries(ranking, block), "payload")
    assert ("radius_mismatch", "radius_scale") in first.ambiguous_with
    named = (first.effects, *first.ambiguous_with)
    assert ranking.of(WHEELS).probability > 0.05
    assert first.group_probability == pytest.approx(
        math.fsum(ranking.of(frozenset(one)).probability for one in named)
    )


def test_an_effect_that_leaves_the_same_data_in_every_log_is_named() -> None:
    block = FakeBlock({"gyro_bias": 60.0})
    assert ("adc_offset",) in entry(entries(ranked(block), block), "gyro_bias").ambiguous_with


def test_stages_share_the_probability_of_a_pair() -> None:
    block = FakeBlock({"gyro_bias": 500.0, "wheelbase_scale": 500.0})
    stages = stage_probabilities(ranked(block), STAGE)
    assert stages["gyro"] == pytest.approx(0.5)
    assert stages["wheel"] == pytest.approx(0.5)


def test_an_unlisted_cause_without_windows_of_its_own_acts_all_along() -> None:
    found = unknown_part([analysis(LOG, FakeBlock({"gyro_bias": 0.0}))], "wheel")
    assert found.windows == ((0.0, 0.01),)


def test_stages_count_an_unlisted_cause_and_no_gap() -> None:
    block = FakeBlock({"gyro_bias": -20.0})
    stages = stage_probabilities(ranked(block, unknown={"wheel": 0.0}), STAGE)
    assert stages["none"] == pytest.approx(0.4 / 0.42, rel=1e-3)
    assert stages["wheel"] == pytest.approx(0.02 / 0.42, rel=1e-3)
    assert math.fsum(stages.values()) == pytest.approx(1)


def test_what_comes_after_a_reversal_goes_by_a_listed_name() -> None:
    """The schema promises fifteen variables, and a sixteenth was written."""
    kicks = Alternative("wheel", "reversal", 50.0, 60.0, 0.5)
    made = replace(analysis(LOG, FakeBlock({"gyro_bias": 0.0})), alternatives=(kicks,))
    told = unknown_part([made], "wheel")
    assert told.closes is None  # a share of energy said that modelling it would close as much
    found = told.depends_on
    assert [(one.variable, one.share) for one in found] == [("direction", 0.5)]


def test_what_the_leftover_depends_on_is_what_is_likely_not_what_bends_the_most() -> None:
    """Down a slope 11 % of it went with the way driven (39 nats against), 5 % with the heading."""
    bends = Alternative("wheel", "distance", -39.0, 60.0, 0.11)
    slope = Alternative("wheel", "heading", 84.0, 99.0, 0.05)
    dull = Alternative("wheel", "speed", 3.0, 9.0, 0.2)
    made = replace(analysis(LOG, FakeBlock({"gyro_bias": 0.0})), alternatives=(slope, dull, bends))
    found = unknown_part([made], "wheel").depends_on
    assert [one.variable for one in found] == ["heading", "speed"]


def test_a_drive_without_a_name_is_told_with_what_its_leftover_goes() -> None:
    """Whatever the commands and wheels showed, the answer held no variable for this stage."""
    drive = SimpleNamespace(goes_with=[Dependence("acceleration", 40.0, 0.9, np.zeros((0, 2, 0)))])
    made = SimpleNamespace(recording=LOG, drive=drive)
    found = unknown_part([cast(Analysis, made)], "actuation").depends_on
    assert [(one.variable, one.share) for one in found] == [("acceleration", 0.9)]
