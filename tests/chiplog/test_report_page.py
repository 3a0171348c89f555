"""The report: one file that answers first, needs nothing from outside, and trusts no text."""

from __future__ import annotations

import re
from dataclasses import replace
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest
from run_samples import STATUS_BITS, run_result

from chiplog.pages.report import report_page
from hil_harness.results import Reception, RunResult

HOSTILE = '"><script>alert(1)</script><img src=x onerror=alert(1)>{{ 7 * 7 }}'


def page_of(result: RunResult) -> str:
    return report_page(result, status_bits=STATUS_BITS, quiet=("INITIALISED",))


@pytest.fixture(scope="module")
def lesson() -> str:
    return page_of(run_result())


class Text(HTMLParser):
    """Collects what a reader sees, and every attribute."""

    def __init__(self) -> None:
        super().__init__()
        self.words: list[str] = []
        self.tags: list[str] = []
        self.attributes: list[tuple[str, str | None]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.attributes += attrs

    def handle_data(self, data: str) -> None:
        self.words += data.split()


def read(page: str) -> Text:
    text = Text()
    text.feed(page)
    return text


def drawings(page: str) -> list[ElementTree.Element]:
    return [ElementTree.fromstring(svg) for svg in re.findall(r"<svg.*?</svg>", page, flags=re.S)]


def test_the_page_answers_before_it_shows(lesson: str) -> None:
    seen = " ".join(read(lesson).words)
    answer = "After 60 s and 36.0 m, the fixed-point firmware is 182.3 nm from its float twin. Both"
    assert answer in seen
    assert lesson.index("float twin. ") < lesson.index("<svg")


@pytest.mark.usefixtures("no_pictures")
def test_firmware_far_from_float_gets_its_own_distance() -> None:
    result = run_result()
    coarse = replace(result, firmware=result.float_twin + np.array([0.5, 0.0, 0.0]))
    seen = " ".join(read(page_of(coarse)).words)
    assert "is 500.0 mm from its float twin. The firmware is" in seen
    assert "from the truth, its twin" in seen


def test_the_lesson_shows_both_estimators_and_the_truth_in_one_picture(lesson: str) -> None:
    labels = {element.text for element in drawings(lesson)[0].iter() if element.text}
    assert {"truth", "wheel only", "gyro heading", "x [m]", "y [m]"} <= labels


def test_any_other_run_shows_truth_float_and_firmware_in_one_picture() -> None:
    page = page_of(run_result(estimators=False))
    labels = {element.text for element in drawings(page)[0].iter() if element.text}
    assert {"truth", "float", "firmware"} <= labels


def test_every_axis_has_a_unit(lesson: str) -> None:
    for drawing in drawings(lesson):
        labels = " ".join(e.text for e in drawing.iter() if e.text)
        assert re.search(r"(x|time) \[(m|s)\]", labels)


def test_every_picture_is_there_for_a_desk_and_for_a_phone(lesson: str) -> None:
    widths = [float(d.attrib["viewBox"].split()[2]) for d in drawings(lesson)]
    assert widths[::2] == [760.0] * 4
    assert widths[1::2] == [358.0] * 4


def test_every_picture_says_in_words_what_it_shows(lesson: str) -> None:
    assert all(len(d.attrib["aria-label"]) > 30 for d in drawings(lesson))


def test_pictures_take_their_colours_from_the_page(lesson: str) -> None:
    svgs = "".join(re.findall(r"<svg.*?</svg>", lesson, flags=re.S))
    assert not re.findall(r"#0\w0\w0\w", svgs)
    used = set(re.findall(r"var\((--[a-z]+)\)", lesson))
    defined = set(re.findall(r"(--[a-z]+):", lesson))
    assert used <= defined


def test_no_two_elements_share_an_id(lesson: str) -> None:
    ids = re.findall(r'\bid="([^"]+)"', lesson)
    assert len(ids) == len(set(ids))
    for reference in re.findall(r'(?:url\(#|href="#)([^")]+)', lesson):
        assert reference in ids


def test_the_page_needs_nothing_from_outside(lesson: str) -> None:
    seen = read(lesson)
    assert not {"script", "link", "iframe", "object", "embed", "img", "base"} & set(seen.tags)
    addresses = {
        value
        for name, value in seen.attributes
        if name in ("src", "href", "xlink:href", "action") and not (value or "").startswith("#")
    }
    assert addresses == set()
    assert "@import" not in lesson
    assert "default-src 'none'" in lesson


def test_a_strangers_text_stays_text() -> None:
    result = run_result(ticks=50)
    page = page_of(
        replace(
            result,
            scenario=HOSTILE,
            configuration={HOSTILE: {"nested": HOSTILE}},
            estimators={HOSTILE: result.estimators["wheel only"]},
            kernel_state={HOSTILE: 1},
            bus=replace(result.bus, frames_by_message={HOSTILE: 1}),
        )
    )
    seen = read(page)
    assert "script" not in seen.tags
    assert "img" not in seen.tags
    assert "49" not in seen.words
    assert not [name for name, _ in seen.attributes if name.startswith("on")]


@pytest.mark.usefixtures("no_pictures")
def test_an_interrupted_run_says_so() -> None:
    page = page_of(run_result(ticks=1234, interrupted=True))
    assert "Interrupted after 12.34 s" in page


def test_a_run_without_a_tick_still_has_a_page() -> None:
    page = page_of(run_result(ticks=0, estimators=False, interrupted=True))
    assert "No tick ran" in page
    assert drawings(page) == []


@pytest.mark.usefixtures("no_pictures")
def test_a_firmware_that_kept_silent_is_said_to_have() -> None:
    result = run_result(estimators=False)
    silent = replace(result, firmware=np.full_like(result.firmware, np.nan), kernel_state={})
    assert "the firmware under test had sent no odometry" in page_of(silent)


def without_poses(result: RunResult, odometry: dict[str, Reception]) -> RunResult:
    return replace(result, firmware=np.full_like(result.firmware, np.nan), odometry=odometry)


@pytest.mark.usefixtures("no_pictures")
def test_a_firmware_whose_frames_were_refused_is_told_why() -> None:
    odometry = {
        "ODOMETRY_X": Reception(800, {"crc": 800}),
        "ODOMETRY_Y": Reception(800, {"crc": 700, "counter": 50}),
        "ODOMETRY_HEADING": Reception(),
    }
    page = page_of(without_poses(run_result(ticks=100), odometry))
    assert "sent 800 ODOMETRY_X, all refused: crc; " in page
    assert "800 ODOMETRY_Y, 750 refused: 700 crc, 50 counter; ODOMETRY_HEADING never came." in page


@pytest.mark.usefixtures("no_pictures")
def test_a_firmware_that_sends_half_a_pose_is_told_what_never_came() -> None:
    odometry = {
        "ODOMETRY_X": Reception(800),
        "ODOMETRY_Y": Reception(),
        "ODOMETRY_HEADING": Reception(),
    }
    page = page_of(without_poses(run_result(ticks=100), odometry))
    assert "sent 800 ODOMETRY_X only; ODOMETRY_Y and ODOMETRY_HEADING never came." in page


@pytest.mark.usefixtures("no_pictures")
def test_refused_frames_are_told_even_where_a_pose_came_through() -> None:
    odometry = {"ODOM": Reception(800, {"crc": 3})}
    page = page_of(replace(run_result(ticks=100), odometry=odometry))
    assert "The firmware under test sent 800 ODOM, 3 refused: crc." in page


@pytest.mark.usefixtures("no_pictures")
def test_a_picture_with_nothing_in_it_is_left_out() -> None:
    silent = without_poses(run_result(ticks=100, estimators=False), {})
    page = page_of(silent)
    assert "The way it went" in page
    assert "How far from the truth" not in page
    assert "Firmware against float" not in page
    assert "What fixed point costs" not in page


@pytest.mark.usefixtures("no_pictures")
def test_a_users_firmware_is_not_called_ours() -> None:
    page = page_of(replace(run_result(ticks=100), configuration={"device": "lib:node.so"}))
    assert "the firmware under test is" in page
    assert "fixed-point firmware" not in page


@pytest.mark.usefixtures("no_pictures")
def test_quiet_status_bits_alone_make_no_timeline() -> None:
    result = replace(run_result(ticks=100), status=np.ones(100, dtype=np.int64))
    assert "No fault bit was set" in page_of(result)


@pytest.mark.usefixtures("no_pictures")
def test_real_time_runs_show_their_timing(lesson: str) -> None:
    assert "missed deadlines" in page_of(run_result(ticks=100, time="real"))
    assert "missed deadlines" not in lesson


def test_the_page_is_small_enough_to_mail(lesson: str) -> None:
    assert len(lesson) < 300_000
