"""The page of a diagnosis: what it says, and that it is safe, whole and on its own."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import diagnosis_samples as samples
import numpy as np
import pytest

from chiplog.pages.diagnosis import diagnosis_page
from chiplog.pages.diagnosis_words import (
    candidate_rows,
    gap_sentence,
    group_name,
    headline,
    limit,
    parameter_words,
    unknown_sentence,
)
from gap_diagnosis.pictures import HeldOutPath, Pictures, Report
from gap_diagnosis.result import Diagnosis
from gap_diagnosis.result_parts import (
    About,
    Advice,
    Candidate,
    KnownEffect,
    LogFacts,
    NumberEstimate,
    Waterfall,
    WaterfallStep,
)

HOSTILE = "</script><script>alert(1)</script><img src=x onerror=alert(1)>{{7*7}}"
EVERY = [samples.diagnosis(), samples.single(), samples.nothing(), samples.unlisted()]


class Seen(HTMLParser):
    """The tags, the attributes and the words outside scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []
        self._inside = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        self._inside = tag

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside not in ("script", "style"):
            self.words += data.split()

    @property
    def text(self) -> str:
        return " ".join(self.words)


@pytest.fixture(scope="module")
def page() -> str:
    return diagnosis_page(samples.report())


def data_of(page: str) -> Any:
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, flags=re.S)
    assert found is not None
    return json.loads(found[1])


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ("stale_producer.cycles", "3.000"),
        ("setup_unit.factor", "3.000"),
        ("frame_loss.burst", "3.000"),
        ("radius_scale.scale", "300.000 %"),
    ],
)
def test_a_number_of_cycles_is_not_told_in_percent(key: str, said: str) -> None:
    """Three cycles were 300 %."""
    three = NumberEstimate(estimate=3.0, unit="1", sd=0.0, ci50=(3, 3), ci80=(3, 3), ci95=(3, 3))
    assert parameter_words(key, three)[0] == said


def test_the_verdict_stands_first_and_names_the_group(page: str) -> None:
    text = Seen(page).text
    verdict = "radius_mismatch + radius_scale or radius_mismatch + ticks_per_rev"
    assert f"{verdict} (stage wheel), which this data cannot tell apart: together 93 %" in text
    assert text.index("together 93 %") < text.index("From described to explained")


@pytest.mark.parametrize(
    ("about", "said"),
    [
        ("verdict", "Tells lateral_slip and no gap apart;"),
        ("candidate", "Tells lateral_slip and no gap apart;"),
        ("log", "Shows lateral_slip, which this log could not have shown;"),
    ],
)
def test_a_drive_that_tells_a_cause_from_none_says_so(about: About, said: str) -> None:
    advice = Advice(
        separates=(("lateral_slip",), ("no_gap",)), scenario_file="arcs.toml", sentence="Drive.",
        expected_gain=0.9, about=about,
    )  # fmt: skip
    report = replace(samples.report(), diagnosis=samples.diagnosis(advice=(advice,)))
    assert said in Seen(diagnosis_page(report)).text


@pytest.mark.parametrize(
    ("effect", "size", "said"),
    [
        ("lateral_slip", None, "cannot be seen"),
        ("firmware_truncation", 0.0, "any"),
        ("radius_scale", 0.002, "0.200 %"),
        ("missed_ticks", 0.0005, "0.0500 %"),
        ("drive_saturation", 10.0, "up to 10.0 rad/s"),
        ("reference_noise", 0.002, "2.00 mm"),
        ("longitudinal_slip", 0.001, "0.001 s²/m"),
        ("an_effect_of_mine", 0.25, "0.25"),
    ],
)
def test_a_detection_limit_is_told_with_its_unit(
    effect: str, size: float | None, said: str
) -> None:
    assert limit(effect, size) == said


def test_the_way_is_shown_first_where_described_and_measured_part() -> None:
    along = np.stack([np.linspace(0.0, 5.0, 50), np.zeros(50)], axis=1)
    aside = along + np.stack([np.zeros(50), np.linspace(0.0, 0.3, 50)], axis=1)
    paths = tuple(
        HeldOutPath(name, reference=along[::7], before=before, after=along)
        for name, before in (("at rest", along), ("a bend", aside), ("a line", along))
    )
    report = replace(samples.report(), pictures=Pictures(paths=paths))
    assert data_of(diagnosis_page(report))["path"] == 1


def test_the_parts_of_an_answer_are_all_there(page: str) -> None:
    text = Seen(page).text
    for part in (
        "From described to explained",
        "Where and when",
        "What could cause it",
        "The way it went, on held-out data",
        "What this data cannot tell, and what to drive next",
        "What was assumed",
        "Turn one wheel by hand",
        "Contact noise between 0.1 and 3 mm/√m.",
        "chiplog run --scenario radius_scale-or-ticks_per_rev.toml",
        "95 %: −0.539 to −0.461 %",
        samples.SHA256,
    ):
        assert part in text


@pytest.mark.parametrize("found", EVERY, ids=lambda found: found.verdict)
@pytest.mark.parametrize("pictures", [samples.pictures(), Pictures()], ids=["drawn", "bare"])
def test_every_verdict_has_a_page(found: Diagnosis, pictures: Pictures) -> None:
    shown = diagnosis_page(Report(found, pictures))
    assert ('id="path"' in shown) == bool(pictures.paths)
    assert ('id="map"' in shown) == (pictures.residual_map is not None)


def test_what_was_known_already_stands_on_the_page() -> None:
    known = KnownEffect(effect="lateral_slip", values={"compliance": 0.03}, file="known.toml")
    shown = diagnosis_page(samples.report(granted=(known,)))
    assert "Known already: lateral_slip (known.toml)." in shown


def test_the_page_needs_nothing_from_outside(page: str) -> None:
    seen = Seen(page)
    assert not {"link", "iframe", "object", "embed", "img", "base"} & set(seen.tags)
    assert not [name for name, _ in seen.attributes if name in ("src", "href", "action")]
    assert "@import" not in page
    assert "default-src 'none'" in page
    assert not re.search(r"\bfetch\(|XMLHttpRequest|WebSocket|import\(", page)


def test_the_browser_runs_the_one_script_that_the_policy_names(page: str) -> None:
    scripts = re.findall(r"<script>(.*?)</script>", page, flags=re.S)
    assert len(scripts) == 1
    digest = base64.b64encode(hashlib.sha256(scripts[0].encode()).digest()).decode()
    assert f"script-src 'sha256-{digest}'" in page


def test_a_strangers_text_stays_text() -> None:
    report = samples.report(
        notes=(HOSTILE,),
        doubts=(HOSTILE,),
        assumptions=(HOSTILE,),
        logs=(LogFacts(name=HOSTILE, duration_s=1.0, ticks=1),),
    )
    pictures = report.pictures
    hostile = replace(
        pictures,
        residuals=(replace(pictures.residuals[0], name=HOSTILE, stage=HOSTILE),),
        paths=(replace(pictures.paths[0], name=HOSTILE),),
    )
    shown = diagnosis_page(replace(report, pictures=hostile))
    seen = Seen(shown)
    assert seen.tags.count("script") == 2
    assert "img" not in seen.tags
    assert "49" not in seen.words
    assert data_of(shown)["paths"][0]["name"] == HOSTILE


def test_missing_values_are_gaps_in_the_data_not_nan(page: str) -> None:
    assert None in data_of(page)["residuals"][0]["value"]


def test_an_hour_of_data_is_a_page_one_can_mail() -> None:
    report = samples.report()
    long = replace(report, pictures=samples.pictures(points=360_000))
    shown = diagnosis_page(long)
    assert len(shown) < 400_000
    times = data_of(shown)["residuals"][0]["t"]
    assert (times[0], times[-1]) == (0.0, 60.0)


def test_the_waterfall_lies_within_its_track_even_where_an_effect_adds() -> None:
    fall = Waterfall(
        metric="odometry_position_m",
        unit="m",
        before=0.01,
        steps=(
            WaterfallStep(effect="radius_scale", reduction=-0.02),
            WaterfallStep(effect="radius_mismatch", reduction=0.025),
        ),
        after=0.005,
        floor=0.002,
    )
    shown = diagnosis_page(samples.report(waterfall=fall))
    bars = re.findall(r'class="bar \w+" style="left: ([\d.]+)%; width: ([\d.]+)%"', shown)
    ends = np.array([[float(a), float(a) + float(b)] for a, b in bars])
    assert len(bars) == 4
    assert ends.min() >= 0
    assert ends.max() <= 100.001
    assert 'class="bar more"' in shown


def test_no_two_elements_share_an_id(page: str) -> None:
    ids = [value for name, value in Seen(page).attributes if name == "id"]
    assert len(ids) == len(set(ids))


def test_colours_follow_light_and_dark(page: str) -> None:
    used = set(re.findall(r"var\((--[a-z]+)", page))
    assert used <= set(re.findall(r"(--[a-z]+):", page))
    assert "prefers-color-scheme: dark" in page


def test_names_joined_without_spaces_may_break_on_a_narrow_screen(page: str) -> None:
    """`a+b+c` in an advice made a page of 320 px scroll sideways."""
    rule = re.search(r"\.advice \{([^}]*)\}", page)
    assert rule is not None
    assert "overflow-wrap: anywhere" in rule[1]


def test_a_moment_is_told_as_one_and_not_as_from_25_to_25_seconds() -> None:
    found = samples.unlisted()
    assert found.unknown is not None
    pushed = found.unknown.model_copy(update={"windows": ((24.9, 25.1), (30.0, 41.0))})
    said = unknown_sentence(found.model_copy(update={"unknown": pushed}))
    assert "at 25.0 s and from 30 to 41 s" in said


def test_a_window_that_begins_a_rounding_before_zero_begins_at_0() -> None:
    """A start of -1e-14 s read "from -0 to 120 s"."""
    found = samples.unlisted()
    assert found.unknown is not None
    whole = found.unknown.model_copy(update={"windows": ((-1e-14, 120.0),)})
    said = unknown_sentence(found.model_copy(update={"unknown": whole}))
    assert "from 0 to 120 s" in said


def test_a_gap_that_no_held_out_stretch_tests_says_why_no_share_is_closed() -> None:
    """Where no held-out stretch lay in a slip's window, "0 % closed" was said of it."""
    found = samples.diagnosis()
    untested = samples.gap().model_copy(update={"closed": None, "ci95": None})
    said = gap_sentence(found.model_copy(update={"gap": untested}))
    assert said.endswith("nothing that was held out lies in the window in which it acts.")


def test_of_a_gap_with_less_left_than_noise_leaves_no_share_of_more_than_all_is_told() -> None:
    """Of a real robot in a corridor it read "218 % closed (95 %: 169 to 307 %)"."""
    found = samples.diagnosis()
    lucky = samples.gap().model_copy(update={"closed": 2.18, "ci95": (0.69, 3.07)})
    said = gap_sentence(found.model_copy(update={"gap": lucky}))
    assert said.endswith("closed down to what noise leaves (95 %: 69 % or more).")


def test_where_there_is_nothing_to_close_no_gap_of_0_is_told() -> None:
    """Of frames that are late by the same all along it read "gap 0 s → 0 s (floor 0 s)"."""
    found = samples.diagnosis()
    gap = samples.gap().model_copy(
        update={"metric": "timing_s", "unit": "s", "before": 5e-15, "after": 5e-15, "floor": 5e-15}
    )
    late = found.model_copy(update={"gap": gap})
    assert headline(late).endswith(": no gap in the timing")
    assert gap_sentence(late) == "Timing on stretches the fit never saw: no gap."


def test_an_unlisted_cause_that_does_less_than_noise_is_said_to() -> None:
    """Of a car it read "an unlisted cause (96 %): gap 202 mm (floor 362 mm)"."""
    found = samples.unlisted()
    small = samples.gap().model_copy(
        update={"before": 0.2, "after": None, "floor": 0.36, "closed": None, "ci95": None}
    )
    said = found.model_copy(update={"gap": small})
    assert headline(said).startswith("an unlisted cause, smaller than noise (")
    assert gap_sentence(said).endswith("; whatever causes it does less to this than noise does.")
    large = small.model_copy(update={"before": 1.0})
    assert headline(found.model_copy(update={"gap": large})).startswith("an unlisted cause (")


def test_no_gap_beyond_tolerance_is_said_to_be_so_where_more_is_left_than_noise() -> None:
    """Of a robot in another engine it read "no gap (95.4 %): gap 12.1 mm (floor 587 µm)"."""
    found = samples.nothing()
    small = samples.gap().model_copy(
        update={"before": 0.0121, "after": None, "floor": 0.000587, "closed": None, "ci95": None}
    )
    said = found.model_copy(update={"gap": small})
    assert headline(said).startswith("no gap beyond tolerance (")
    assert gap_sentence(said).endswith("; what stands above the floor lies within tolerance.")
    noise = small.model_copy(update={"before": 0.0006})
    assert headline(found.model_copy(update={"gap": noise})).startswith("no gap (")


def test_a_small_group_is_named_member_by_member() -> None:
    assert group_name((("a",), ("b", "c"))) == "a or b + c"


def test_a_large_group_is_named_by_what_all_have_and_by_what_they_differ_in() -> None:
    """Of a Kobuki the first line was four sets of eight effects, and 21 more."""
    sets = (
        ("a", "b", "x"),
        ("a", "b", "y"),
        ("a", "b", "x", "z"),
        ("a", "b", "w"),
        ("a", "b", "v"),
    )
    assert group_name(sets) == "a + b and one of 5 sets of x, y, z, w, v"
    assert group_name((*sets, ("a", "b"))).endswith(
        "one of 6 sets of x, y, z, w, v or nothing else"
    )


def test_a_large_group_that_has_nothing_in_common_names_the_likeliest() -> None:
    assert group_name([(name,) for name in "abcdef"]) == "a or b or c or d or 2 more"


def estimated(value: float, half_width: float = 0.1) -> dict[str, Any]:
    low, high = value - half_width, value + half_width
    return {
        "unit": "m",
        "estimate": value,
        "sd": half_width / 2,
        "ci50": (low, high),
        "ci80": (low, high),
        "ci95": (low, high),
    }


def test_what_two_candidates_have_in_common_is_told_once() -> None:
    """Of a Kobuki's two likeliest sets, of seven effects each, six were the same: 17 rows."""
    one = Candidate(
        effects=("a", "b", "c"),
        probability=0.5,
        group_probability=0.9,
        parameters={"a.x": estimated(1.0), "b.x": estimated(2.0), "c.x": estimated(3.0)},
        ambiguous_with=(("a", "b", "d"),),
    )
    other = Candidate(
        effects=("a", "b", "d"),
        probability=0.4,
        group_probability=0.9,
        parameters={"a.x": estimated(1.001), "b.x": estimated(2.0), "d.x": estimated(4.0)},
        ambiguous_with=(("a", "b", "c"),),
    )
    found = samples.diagnosis().model_copy(update={"which": (one, other)})
    explained = [row[1] for row in candidate_rows(found, 2)]
    assert explained == [
        "a + b + c",
        "  a.x",
        "  b.x",
        "  c.x",
        "d in the place of c",
        "  d.x",
        "  the rest",
    ]


def test_an_estimate_that_differs_is_told_again() -> None:
    one, *_ = samples.diagnosis().which
    moved = {
        key: value.model_copy(update={"estimate": value.ci95[1]})
        for key, value in one.parameters.items()
    }
    other = one.model_copy(update={"parameters": moved})
    found = samples.diagnosis().model_copy(update={"which": (one, other)})
    told = [row[1] for row in candidate_rows(found, 2)]
    assert [told.count(f"  {key}") for key in one.parameters] == [2] * len(one.parameters)
