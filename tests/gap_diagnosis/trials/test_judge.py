"""Scores of answers whose quality is known: a seer, a coin, a braggart."""

from __future__ import annotations

import gzip
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.trials.case import OTHER_ENGINE, Case, Kind
from gap_diagnosis.trials.judge import Judged, judge
from gap_diagnosis.trials.kept import keep, kept
from gap_diagnosis.trials.opening import Opened, together
from gap_diagnosis.trials.reference_noise import ReferenceLevels
from gap_diagnosis.trials.score import scores, summary
from gap_diagnosis.trials.truth import UNKNOWN, canonical, class_of, stages_of

LEVELS = ReferenceLevels("white", 5e-4, 5e-4, 2e-4, 2e-4, 1.0, 100.0)
BIAS = {"gyro_bias": {"bias": 0.01}}
WIDE = {"ci50": (0.009, 0.011), "ci80": (0.008, 0.012), "ci95": (0.007, 0.013)}


def case(effects: dict[str, Any], kind: Kind = "single", **more: Any) -> Case:
    made = Case(
        "0001", "limit", kind, effects, {}, (), {}, {"micro_slip": {"left": 1e-4, "right": 1e-4}},
        "calibration", "familiar", LEVELS, 4, "00" * 16,
    )  # fmt: skip
    return replace(made, **more)


def answer(probabilities: dict[str, float], **more: Any) -> dict[str, Any]:
    entries = dict(probabilities)
    for needed in ("no_gap", "unknown"):
        entries.setdefault(needed, 0.0)
    which = [
        {"effects": name.split("+"), "probability": p, "group_probability": p, "parameters": {}}
        for name, p in sorted(entries.items(), key=lambda one: -one[1])
    ]
    best = max(entries, key=lambda name: entries[name])
    found = {"verdict": best, "which": which, "seconds": 1.0, "gap": None}
    return {"stage": "none", **found, **more}


def seen(made: Case, found: dict[str, Any], over: float | None = 5.0) -> Judged:
    return judge(made, found, frozenset({canonical(made.true_effects)}), over)


SEER = [
    seen(case({}, "null"), answer({"no_gap": 1.0}), None),
    seen(case(BIAS), answer({"gyro_bias": 1.0}, stage="gyro")),
    seen(case(BIAS, "withheld", without=("adc_offset", "gyro_bias")),
         answer({"unknown": 1.0}, stage="gyro")),
    seen(case(BIAS, "decoy", without=("gyro_lag",)), answer({"gyro_bias": 1.0}, stage="gyro")),
]  # fmt: skip


def test_a_seer_is_right_in_everything() -> None:
    found = scores(Opened(tuple(SEER), 0))["parts"]["all"]
    for name in ("stage", "top1", "group_top1", "true_probability"):
        assert found[name]["value"] == 1.0, name
    assert found["false_alarms"]["value"] == 0.0
    assert found["confident_wrong"]["value"] == 0.0
    assert found["unknown_auroc"]["value"] == 1.0
    assert found["brier"]["value"] == 0.0
    assert found["log_score"]["value"] == 0.0
    assert found["ece"] == 0.0


def test_a_coin_is_right_half_of_the_time_and_says_so() -> None:
    even = {"gyro_bias": 0.5, "gyro_scale": 0.5}
    made = [
        case({one: {value: 0.01}})
        for one, value in (("gyro_bias", "bias"), ("gyro_scale", "scale"))
    ]
    found = scores(Opened(tuple(seen(one, answer(even, stage="gyro")) for one in made), 0))
    part = found["parts"]["all"]
    assert part["top1"]["value"] == 0.5
    assert part["brier"]["value"] == pytest.approx(0.5)
    assert part["ece"] == pytest.approx(0.5)  # two cases: one bin each
    assert part["stage"]["value"] == 1.0


def test_a_braggart_is_counted_as_confident_and_wrong() -> None:
    hidden = case(BIAS, "withheld", without=("adc_offset", "gyro_bias"))
    judged = seen(hidden, answer({"gyro_scale": 0.9, "unknown": 0.1}, stage="gyro"))
    assert judged.truth == UNKNOWN
    assert judged.confident_wrong
    assert judged.wrong_name == "gyro_scale"
    assert not seen(hidden, answer({"gyro_scale": 0.6, "unknown": 0.4})).confident_wrong


def test_a_hidden_cause_that_hardly_shows_is_not_held_against_anyone() -> None:
    hidden = case(BIAS, "withheld", without=("adc_offset", "gyro_bias"))
    told = answer({"no_gap": 0.9, "unknown": 0.1})
    found = scores(Opened((seen(hidden, told, 1.9), *SEER), 0))["parts"]["all"]
    assert found["confident_wrong"]["count"] == 1
    assert found["unknown_auroc"]["value"] == 1.0


def test_what_was_withheld_and_what_never_had_a_name_are_counted_apart() -> None:
    poles = case({"drive_cogging": {"side": "left", "amplitude": 0.1, "order": 6, "phase": 0.0}})
    boast = seen(poles, answer({"drive_lag": 1.0}))
    found = scores(Opened((boast, *SEER), 0))["parts"]["all"]
    assert (found["confident_wrong"]["value"], found["confident_wrong"]["count"]) == (0.0, 1)
    nameless = found["confident_wrong_nameless"]
    assert (nameless["value"], nameless["count"]) == (1.0, 1)
    assert found["unknown_auroc"]["value"] == 1.0


def test_what_the_library_can_imitate_is_counted_apart() -> None:
    hidden = case(BIAS, "withheld", without=("adc_offset", "gyro_bias"))
    group = frozenset({canonical(["gyro_bias"]), canonical(["gyro_temperature_bias"])})
    judged = judge(hidden, answer({"gyro_temperature_bias": 1.0}), group, 5.0)
    assert judged.is_imitable
    assert judged.in_group
    assert not judged.confident_wrong
    assert scores(Opened((judged,), 0))["parts"]["all"]["imitable"] == 1


def test_confident_wrong_names_are_a_share_of_what_the_library_cannot_imitate() -> None:
    """How those fare that it can, and how often what imitates them is named, is told apart."""
    hidden = case(BIAS, "withheld", without=("adc_offset", "gyro_bias"))
    group = frozenset({canonical(["gyro_bias"]), canonical(["gyro_temperature_bias"])})
    told = [{"gyro_temperature_bias": 1.0}, {"unknown": 1.0}, {"gyro_scale": 1.0}]
    imitable = [judge(hidden, answer(one), group, 5.0) for one in told]
    boast = seen(hidden, answer({"gyro_scale": 1.0}))
    found = scores(Opened((*imitable, boast, *SEER), 0))["parts"]["all"]
    assert (found["confident_wrong"]["value"], found["confident_wrong"]["count"]) == (0.5, 2)
    assert found["imitable_right"]["value"] == pytest.approx(2 / 3)
    assert found["imitable_named"]["value"] == pytest.approx(1 / 3)
    assert found["imitable_named"]["count"] == 3


def test_of_a_withheld_cause_the_stage_is_right_where_it_acts() -> None:
    """As far as it was told as unknown, and nothing left can imitate it."""
    hidden = case(BIAS, "withheld", without=("adc_offset", "gyro_bias"))
    group = frozenset({canonical(["gyro_bias"]), canonical(["gyro_temperature_bias"])})
    unknown = {"unknown": 1.0}
    made = (
        seen(hidden, answer(unknown, stage="gyro")),
        seen(hidden, answer(unknown, stage="wheel")),
        seen(hidden, answer({"gyro_scale": 1.0}, stage="gyro")),
        judge(hidden, answer(unknown, stage="wheel"), group, 5.0),
    )
    found = scores(Opened(made, 0))["parts"]["all"]["unknown_stage"]
    assert (found["value"], found["count"]) == (0.5, 2)


def test_what_is_said_of_a_leftover_is_right_as_far_as_a_model_of_it_closes_the_gap(
    tmp_path: Path,
) -> None:
    hidden = case(BIAS, "withheld", without=("adc_offset", "gyro_bias"))

    def leftover(closes: float | None, *variables: str) -> Judged:
        goes_with = [{"variable": name, "share": 0.5} for name in variables]
        told = {"depends_on": goes_with, "closes": closes}
        return seen(hidden, answer({"unknown": 1.0}, stage="gyro", unknown=told))

    made = (
        leftover(0.9, "time", "speed"),
        leftover(0.3, "speed"),
        leftover(-2.0, "heading"),
        leftover(None),
        seen(hidden, answer({"gyro_scale": 1.0}, stage="gyro")),
    )
    keep(tmp_path / "kept", {"chiplog": Opened(made, 0)})
    for opened in (Opened(made, 0), kept(tmp_path / "kept")["chiplog"]):
        found = scores(opened)["parts"]["all"]
        shares = {
            name: (found[name]["value"], found[name]["count"])
            for name in ("unknown_goes_with", "unknown_closes", "unknown_half")
        }
        assert shares == {
            "unknown_goes_with": (pytest.approx(3 / 4), 4),
            "unknown_closes": (pytest.approx(2 / 3), 3),
            "unknown_half": (pytest.approx(1 / 3), 3),
        }


def test_a_withheld_payload_is_imitated_by_a_radius_scale_with_a_mismatch() -> None:
    load = {"payload": {"compression_left": 0.01, "compression_right": 0.02}}
    hidden = case(load, "withheld", without=("payload",))
    told = answer({"radius_mismatch+ticks_per_rev": 1.0}, stage="wheel")
    judged = seen(hidden, told)
    assert judged.is_imitable
    assert judged.in_group
    assert not judged.confident_wrong


def test_an_effect_that_the_library_does_not_have_is_rightly_unknown() -> None:
    poles = case({"drive_cogging": {"side": "left", "amplitude": 0.1, "order": 6, "phase": 0.0}})
    assert seen(poles, answer({"unknown": 1.0}, stage="actuation")).top1


def test_inside_its_tolerance_an_effect_is_no_gap() -> None:
    small = case({"gyro_bias": {"bias": 0.0002}})
    judged = seen(small, answer({"no_gap": 1.0}), 0.5)
    assert judged.is_null
    assert judged.top1
    assert judged.in_group


def test_only_what_is_beyond_its_tolerance_can_be_missed() -> None:
    """Of an effect inside it no gap is the right answer, as the best of all tests knows."""
    silent = answer({"no_gap": 1.0})
    within = seen(case({"gyro_bias": {"bias": 0.0002}}), silent, 0.5)
    beyond = seen(case(BIAS), silent, 2.5)
    (found,) = scores(Opened((within, beyond), 0))["miss_curve"]
    assert (found["from"], found["to"], found["missed"]["count"]) == (2.0, 3.0, 1)
    assert found["missed"]["value"] == 1.0


def test_the_curve_is_of_one_effect_that_has_a_size() -> None:
    """Beside a large effect a small one is not what was missed; a noise has no limit."""
    both = case({**BIAS, "gyro_scale": {"scale": 0.1}}, "pair")
    noise = case({"gyro_noise": {"density": 0.01}})
    told = answer({"no_gap": 1.0})
    assert scores(Opened((seen(both, told, 0.5), seen(noise, told, 0.0)), 0))["miss_curve"] == []


def test_an_effects_own_scores_are_of_the_cases_that_the_whole_is_scored_on() -> None:
    """Top-1 and the probability of the truth where one name is right; a cause that was withheld is
    no case of its name, and one inside its tolerance none that could be told."""
    alike = frozenset({canonical(["gyro_bias"]), canonical(["gyro_temperature_bias"])})
    made = (
        seen(case(BIAS), answer({"gyro_bias": 0.9, "no_gap": 0.1}, stage="gyro")),
        judge(case(BIAS), answer({"gyro_temperature_bias": 1.0}, stage="gyro"), alike, 5.0),
        seen(case(BIAS, "withheld", without=("adc_offset", "gyro_bias")), answer({"unknown": 1.0})),
        seen(case({"gyro_bias": {"bias": 0.0002}}), answer({"no_gap": 1.0}), 0.5),
    )
    found = scores(Opened(made, 0))["effects"]["gyro_bias"]
    assert (found["cases"], found["clear"]) == (3, 2)
    assert (found["group_top1"]["value"], found["group_top1"]["count"]) == (0.5, 2)
    assert (found["stage"]["value"], found["stage"]["count"]) == (1.0, 2)
    assert (found["top1"]["value"], found["top1"]["count"]) == (1.0, 1)
    assert found["true_probability"]["value"] == pytest.approx(0.9)
    assert found["like"] == {"gyro_temperature_bias": 1}
    assert found["verdicts"] == {"gyro_bias": 1, "gyro_temperature_bias": 1}


def test_a_cause_without_a_name_has_a_stage_of_its_own_all_the_same() -> None:
    poles = case({"drive_cogging": {"side": "left", "amplitude": 0.1, "order": 6, "phase": 0.0}})
    told = [seen(poles, answer({"unknown": 1.0}, stage=stage)) for stage in ("actuation", "gyro")]
    found = scores(Opened(tuple(told), 0))["effects"]["drive_cogging"]
    assert found["stage"] == found["stage"] | {"value": 0.5, "count": 2}
    assert found["top1"]["value"] == 1.0


def test_stages_that_were_told_stand_beside_those_that_nobody_could_tell_apart() -> None:
    told = answer({"gyro_bias": 1.0}, stage="gyro")
    alike = frozenset({canonical(["gyro_bias"]), canonical(["wheelbase_scale"])})
    wrong = answer({"wheelbase_scale": 1.0}, stage="wheel")
    made = (
        judge(case(BIAS), wrong, alike, 5.0),
        *(seen(case(BIAS), told) for _ in range(3)),
        seen(case(BIAS, "withheld", without=("adc_offset", "gyro_bias")), answer({"unknown": 1.0})),
        seen(case({}, "null"), answer({"no_gap": 1.0}), None),
        seen(case(BIAS), told, 1.0),
    )
    rows = {row["stage"]: row for row in scores(Opened(made, 0))["stages"]}
    assert rows.keys() == {"gyro", "unknown", "none"}
    assert rows["gyro"]["told"] == {"gyro": 3, "wheel": 1}
    assert rows["gyro"]["alike"] == {"wheel": 0.25}
    assert rows["unknown"]["told"] == {"unknown": 1}


def test_a_pair_in_two_stages_is_not_taken_for_stages_that_look_alike() -> None:
    both = case({**BIAS, "radius_scale": {"scale": 0.01}}, "pair")
    made = seen(both, answer({"gyro_bias+radius_scale": 1.0}, stage="gyro"))
    (row,) = scores(Opened((made,), 0))["stages"]
    assert (row["stage"], row["told"], row["alike"]) == ("gyro", {"gyro": 1}, {})


def test_what_the_other_engine_triggers_is_told_by_name() -> None:
    null = case({}, "null", engine=OTHER_ENGINE)
    slip = answer({"one_sided_slip": 0.9, "no_gap": 0.1})
    slip["which"][0]["ambiguous_with"] = [["backlash"]]
    rest = [seen(null, answer({"no_gap": 1.0}), None), seen(case({}), slip, None)]
    found = scores(Opened((seen(null, slip, None), *rest), 0))["other_engine_alarms"]
    assert found == [
        {"verdict": "one_sided_slip", "count": 1, "probabilities": [0.9], "with": ["backlash"]}
    ]


def test_false_alarms_of_a_stratum_stand_apart_by_what_is_new() -> None:
    """Their goals differ, in one stratum as in all."""
    alarm = answer({"gyro_bias": 1.0}, stage="gyro")
    made = (
        seen(case({}, "null"), answer({"no_gap": 1.0}), None),
        seen(case({}, "null", engine=OTHER_ENGINE), alarm, None),
    )
    found = scores(Opened(made, 0))["alarms"]["limit"]
    told = {name: one["false_alarms"]["value"] for name, one in found.items()}
    assert (told["familiar"], told["other engine"], told["new robot"]) == (0.0, 1.0, None)


def test_twins_count_as_one_name_and_either_stage_is_right() -> None:
    judged = seen(
        case({"ticks_per_rev": {"scale": 0.01}}), answer({"radius_scale": 1.0}, stage="wheel")
    )
    assert judged.top1
    assert judged.stage_right
    both = canonical(["radius_mismatch", "radius_scale"])
    assert canonical(["payload"]) == both
    assert stages_of(both) == {"wheel"}
    assert class_of("adc_gain") == {"adc_gain", "gyro_scale", "gyro_tilt"}
    # An angle of the sensor can only make the scale smaller, but no log tells which it was.
    assert canonical(["gyro_tilt"]) == canonical(["adc_gain"])


def test_probabilities_of_twins_are_added_up() -> None:
    judged = seen(case(BIAS), answer({"gyro_bias": 0.5, "adc_offset": 0.4, "no_gap": 0.1}))
    assert judged.true_probability == pytest.approx(0.9)
    assert judged.brier == pytest.approx(0.1**2 + 0.1**2)


def test_parameters_are_scored_where_the_effect_was_named() -> None:
    found = answer({"gyro_bias": 1.0}, stage="gyro")
    estimate = {"estimate": 0.0105, "sd": 0.0005, "unit": "rad/s", **WIDE}
    found["which"][0]["parameters"] = {"gyro_bias.bias": estimate}
    (parameter,) = seen(case(BIAS), found).parameters
    assert parameter.error_sd == pytest.approx(1.0)
    assert parameter.inside == (True, True, True)
    assert parameter.rank == 3
    other = answer({"gyro_scale": 1.0})
    assert seen(case(BIAS), other).parameters == ()


def test_sizes_of_another_constant_than_the_true_one_are_not_compared() -> None:
    """A turn of so many counts more is a wheel as much smaller: told of the wheel, with the same
    probability, a size of the counts had the wrong sign."""
    made = case({"firmware_constant": {"constant": "ticks_per_rev", "scale": 0.01}})
    for constant, compared in (("ticks_per_rev", 1), ("wheel_radius", 0)):
        found = answer({"firmware_constant": 1.0}, stage="firmware")
        found["which"][0]["parameters"] = {
            "firmware_constant.constant": {"estimate": constant},
            "firmware_constant.scale": {"estimate": 0.0105, "sd": 0.0005, **WIDE},
        }
        assert len(seen(made, found).parameters) == compared


def test_a_phase_is_compared_within_its_turn() -> None:
    made = case({"wheel_eccentricity": {"side": "left", "amplitude": 0.01, "phase": -3.1}})
    found = answer({"wheel_eccentricity": 1.0})
    estimate = {
        "estimate": 3.13,
        "sd": 0.1,
        "ci50": (3.1, 3.2),
        "ci80": (3.0, 3.3),
        "ci95": (2.9, 3.4),
    }
    found["which"][0]["parameters"] = {"wheel_eccentricity.phase": estimate}
    (parameter,) = seen(made, found).parameters
    assert abs(parameter.error_sd) < 1.0


def test_a_crash_is_as_bad_as_can_be_and_is_shown() -> None:
    judged = seen(
        case(BIAS), {"error": "ValueError: no", "traceback": "Traceback ...", "seconds": 1.0}
    )
    found = scores(Opened((judged,), 3))
    assert (found["crashes"], found["missing"]) == (1, 3)
    assert found["parts"]["all"]["group_top1"]["value"] == 0.0
    assert found["parts"]["all"]["brier"]["value"] == 2.0
    assert found["wrong"][0]["error"].startswith("Traceback")


def test_several_trials_count_as_one_and_no_case_is_taken_for_another() -> None:
    first = {"chiplog": Opened(tuple(SEER), 6), "umbmark": Opened(tuple(SEER[:1]), 9)}
    one = together([first, {"chiplog": Opened(tuple(SEER[:2]), 3)}])
    assert [len(each.judged) for each in one.values()] == [6, 1]
    assert [each.missing for each in one.values()] == [9, 14]
    names = [judged.case.name for judged in one["chiplog"].judged]
    assert names[0] == "1-0001"
    assert names[4] == "2-0001"
    assert scores(one["chiplog"])["cases"] == 6


def test_one_manoeuvre_more_goes_with_the_case_that_asked_for_it_in_several_trials_too() -> None:
    more = replace(SEER[0], case=replace(SEER[0].case, name="0001-random", of="0001"))
    asked, driven = together(
        [{"chiplog": Opened((SEER[0],), 0), "again": Opened((more,), 0)}]
    ).values()
    assert driven.judged[0].case.of == asked.judged[0].case.name == "1-0001"


def test_the_short_table_has_a_row_for_what_was_scored() -> None:
    rows = dict(summary(scores(Opened(tuple(SEER), 0))))
    assert rows["cases"] == "4"
    assert rows["false alarms"].startswith("0.00")
    assert "pairs, both named" not in rows


def test_a_name_that_the_twin_goes_by_is_not_the_effects_own() -> None:
    made = case({"adc_offset": {"offset": 10.0}})
    found = answer({"gyro_bias": 1.0}, stage="gyro")
    assert seen(made, found).in_group
    assert not seen(made, found).has_own_name
    found["which"][0]["ambiguous_with"] = [["adc_offset"]]
    assert seen(made, found).has_own_name


def test_a_window_is_scored_by_what_it_shares_with_the_true_one() -> None:
    made = case({"gyro_frozen": {"start_s": 10.0, "stop_s": 12.0}})
    found = answer({"gyro_frozen": 1.0}, stage="gyro")
    found["which"][0]["windows"] = [[11.0, 13.0]]
    assert seen(made, found).overlap == pytest.approx(1 / 3)
    assert seen(made, answer({"gyro_bias": 1.0})).overlap is None


def test_a_forecaster_is_held_to_its_probabilities_where_sizes_are_as_it_believes() -> None:
    """Sizes about the limit are drawn so that they are hard to see, which no prior says."""
    sure = answer({"gyro_bias": 1.0}, stage="gyro")
    blind = answer({"no_gap": 1.0}, stage="none")
    made = [
        seen(case(BIAS, stratum="prior"), sure),
        seen(case(BIAS, "decoy", without=("gyro_lag",), stratum="limit"), sure),
        seen(case(BIAS, stratum="limit"), blind),
    ]
    part = scores(Opened(tuple(made), 0))["parts"]["all"]
    assert part["forecast"]["cases"] == 2
    assert part["forecast"]["error"] == 0.0
    assert part["ece"] == pytest.approx(1 / 3)


def closing(before: float, after: float, floor: float) -> Judged:
    gap = {"before": before, "after": after, "floor": floor}
    return seen(case(BIAS), answer({"gyro_bias": 1.0}, stage="gyro", gap=gap))


def test_only_gaps_of_twice_their_floor_count_as_closed_or_not() -> None:
    """Each in floors of its own: metres and radians do not add up."""
    gaps = [closing(3.0, 1.0, 1.0), closing(0.05, 0.03, 0.01), closing(1.9, 1.9, 1.0)]
    found = scores(Opened(tuple(gaps), 0))["parts"]["all"]["gap_closed"]
    assert found["value"] == pytest.approx((2 + 2) / (2 + 4))
    assert found["count"] == 2
    assert found["low"] == pytest.approx(0.5)
    assert found["high"] == pytest.approx(1.0)


def test_a_gap_without_a_floor_does_not_outweigh_all_that_have_one() -> None:
    """Arithmetic replayed bit for bit leaves nothing: in floors, such a gap is as large as the
    least number that stands for nought is small."""
    gaps = (closing(1e-3, 0.0, 0.0), closing(3.0, 2.0, 1.0), closing(0.0, 0.0, 0.0))
    found = scores(Opened(gaps, 0))["parts"]["all"]
    assert (found["gap_closed"]["value"], found["gap_closed"]["count"]) == (0.5, 1)
    assert (found["gap_closed_exact"]["value"], found["gap_closed_exact"]["count"]) == (1.0, 1)


def test_one_huge_gap_closed_does_not_hide_case_by_case_that_others_were_not() -> None:
    gaps = (closing(1e6, 1.0, 1.0), closing(3.0, 3.0, 1.0))
    found = scores(Opened(gaps, 0))["parts"]["all"]
    assert found["gap_closed"]["value"] == pytest.approx(1.0, abs=1e-5)
    assert found["gap_closed_each"]["value"] == pytest.approx(0.5)


def test_the_ratio_of_groups_is_that_of_their_sums() -> None:
    wide = answer({"gyro_bias": 1.0}, stage="gyro")
    wide["which"][0]["ambiguous_with"] = [["gyro_scale"]]
    group = frozenset({canonical(["gyro_bias"]), canonical(["gyro_lag"])})
    made = (seen(case(BIAS), wide), judge(case(BIAS), answer({"gyro_bias": 1.0}), group, 5.0))
    found = scores(Opened(made, 0))["parts"]["all"]["group_ratio"]
    assert (found["value"], found["count"]) == (1.0, 2)
    assert (found["low"], found["high"]) == (0.5, 2.0)


def test_what_is_kept_of_a_trial_scores_as_it_did_and_cannot_be_made_again(tmp_path: Path) -> None:
    told = answer(
        {"gyro_bias": 0.9, "gyro_scale": 0.1}, gap={"before": 2, "after": 1, "floor": 0.5}
    )
    told["which"][0]["parameters"] = {"gyro_bias.bias": {"estimate": 0.01, "sd": 1e-3, **WIDE}}
    opened = {"chiplog": Opened((*SEER, seen(case(BIAS), told)), 3), "coin": Opened(tuple(SEER), 0)}
    path = tmp_path / "trial.jsonl.gz"
    keep(path, opened)
    again = kept(path)
    assert {m: o.missing for m, o in again.items()} == {"chiplog": 3, "coin": 0}
    for method, own in opened.items():
        assert scores(again[method]) == scores(own)
        assert not any(one.case.secret for one in again[method].judged)
    first = path.read_bytes()
    keep(path, again)
    assert path.read_bytes() == first


def test_a_file_that_keeps_no_trial_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "trial.jsonl.gz"
    others = (
        b"[]\n",
        b"\xff",
        b'{"schema": 9}\n',
        b'{"schema": 1, "missing": {"a": 0}}\n{"method": "a"}\n',
    )
    for content in (b"not compressed", *map(gzip.compress, others)):
        path.write_bytes(content)
        with pytest.raises(DiagnosisError, match="expected judged cases") as told:
            kept(path)
        assert "\n" not in str(told.value)
