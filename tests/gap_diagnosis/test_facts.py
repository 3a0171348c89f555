"""What a diagnosis says of its logs beside the verdict."""

from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from fake_blocks import FakeBlock, analysis

from gap_diagnosis.analysis import Analysis
from gap_diagnosis.explanations.encoder import encoder_dead_left
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.facts import beside_unlisted, counts_again, makes_worse, notes_on, untrusted
from gap_diagnosis.lost_tracking import Leap, Lost
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.recording import Recording
from gap_diagnosis.reference_mistakes import Mistake
from gap_diagnosis.result_parts import Candidate, Gap, Metric

_ROWS = np.arange(4)
LOG = Recording("drive.csv", 0.01, _ROWS * 0.01, _ROWS * 0.01, _ROWS, _ROWS * 1.0, _ROWS * 1.0)


def test_what_reading_a_log_noted_is_said_under_its_name() -> None:
    noted = replace(LOG, notes=("3 values are missing.",))
    assert "drive.csv: 3 values are missing." in notes_on([analysis(noted)], ())
    assert not any(one.startswith("drive.csv") for one in notes_on([analysis(LOG)], ()))


def test_what_a_log_has_not_is_said_after_what_is_wrong_with_it() -> None:
    """A terminal shows three notes: that there is no reference hid that fixes were left out."""
    said = notes_on([replace(analysis(LOG), outliers=18)], ("something of the verdict",))
    assert "18 samples of the reference" in said[0]
    assert [one.split()[0] for one in said[2:]] == ["No"] * 4


@pytest.mark.parametrize(
    ("after", "is_worse"), [(1.07, True), (0.4, False), (0.001, False), (None, False)]
)
def test_a_name_with_which_the_simulation_lies_farther_off_is_warned_of(
    after: float | None, is_worse: bool
) -> None:
    """Motors too weak, on one side more, were called a gain (> 0.999): 99 mm became 1.07 m, and the
    gap so near its floor of 0.27 m that no share of it was said to be closed, or opened."""
    windows = Metric(unit="m", before=0.099, after=after, floor=0.269, windows=4)
    gap = Gap(metric="drive_position_m", held_out="stretches", **dict(windows))
    assert [("farther" in one) for one in makes_worse(gap)] == [True] * is_worse


@pytest.mark.parametrize(
    ("quarters", "told"),
    [
        (0, None),
        (1, "stays +90 degrees off the frame of its positions; it was"),
        (2, "stays +180 degrees off the frame of its positions; it was"),
        (3, "stays -90 degrees off the frame of its positions, as of a compass beside east"),
    ],
)
def test_a_heading_that_was_turned_into_the_frame_of_its_positions_is_told(
    quarters: int, told: str | None
) -> None:
    mistake = Mistake("reference_heading", -1.0, 1000.0, quarters)
    said = notes_on([replace(analysis(LOG), mistake=mistake)], ())
    assert [told is not None and told in one for one in said if "clockwise" in one] == (
        [] if told is None else [True]
    )


@pytest.mark.parametrize(("quarters", "exchanged"), [(0, False), (1, True), (2, False), (3, True)])
def test_positions_whose_axes_are_exchanged_are_told(quarters: int, exchanged: bool) -> None:
    mistake = Mistake("reference_position", -1.0, 1000.0, quarters)
    said = notes_on([replace(analysis(LOG), mistake=mistake)], ())
    assert any("x and y are exchanged" in one for one in said) == exchanged
    assert not any("clockwise" in one for one in said)


def test_moments_in_notes_count_from_the_start_of_a_log_by_wall_clock() -> None:
    """They said: no samples from 1717400012.00 s to 1717400014.50 s."""
    noon = replace(LOG, t_s=LOG.t_s + 1_717_400_000.0)
    lost = Lost(
        holes=((1_717_400_012.0, 1_717_400_014.5),), leaps=(Leap(1_717_400_020.0, 0.3, 0.0, 0.0),)
    )
    notes = "\n".join(notes_on([replace(analysis(noon), lost=lost)], ()))
    assert "no samples from 12.00 s to 14.50 s" in notes
    assert "leaps by 300 mm and 0.0 degrees at 20.00 s" in notes


@pytest.mark.parametrize(
    ("unlisted_in", "acts"), [("wheel", True), ("reference", True), ("actuation", False)]
)
def test_what_shows_where_an_unlisted_cause_does_not_is_told_beside_it(
    unlisted_in: str, *, acts: bool
) -> None:
    """Motors that lag, beside a tyre that slid for 6 s, were not told of (unknown, 0.91)."""
    motion = FakeBlock({"gyro_bias": 90.0, "wheelbase_scale": 60.0})
    drive = FakeBlock(
        {"drive_lag": 3000.0, "drive_gain": 4.0, "wheelbase_scale": 9.0}, name="drive"
    )
    effects = frozenset({"drive_lag", "drive_gain", "gyro_bias", "wheelbase_scale"})
    said = beside_unlisted([[motion, drive]], effects, unlisted_in)
    assert [one.split(",")[1].split()[0] for one in said if "drive_" in one] == ["drive_lag"] * acts
    assert any("gyro_bias" in one for one in said) == (not acts)


def test_logs_add_up_to_what_is_certain_beside_an_unlisted_cause() -> None:
    drive = FakeBlock({"drive_lag": 15.0}, name="drive")
    assert not beside_unlisted([[drive]], frozenset({"drive_lag"}), "wheel")
    assert beside_unlisted([[drive], [drive]], frozenset({"drive_lag"}), "wheel")


@pytest.mark.parametrize(("pareto_k", "said"), [(None, 0), (0.69, 0), (0.7, 1), (1.2, 1)])
def test_weights_that_do_not_converge_are_told(pareto_k: float | None, said: int) -> None:
    leading = Candidate(
        effects=("gyro_bias",), probability=0.9, group_probability=0.9, pareto_k=pareto_k
    )
    notes = untrusted(leading)
    assert len(notes) == said
    assert all("do not converge" in note for note in notes)


def with_dead(name: str, start_s: float, stop_s: float) -> Analysis:
    """Return a log of a minute in whose motion the left encoder is dead for a while."""
    rows = np.arange(6001)
    t_s = 0.3 + 0.01 * rows
    dead = Variant(
        "encoder_dead",
        encoder_dead_left,
        (),
        {"start_s": 0.3 + start_s, "stop_s": 0.3 + stop_s},
        {"side": "left", "start_s": 0.3 + start_s},
    )
    motion = cast(MotionBlock, SimpleNamespace(settings=lambda effects: [(dead, ())]))
    log = replace(LOG, name=name, t_s=t_s, stamp_s=t_s, tick=rows)
    return replace(analysis(log), motion=motion)


def test_an_encoder_that_counts_again_is_not_said_to_be_dead_for_good() -> None:
    """A plug that was loose for five seconds read as a count frozen from then on. Of two logs the
    first was named, whichever it was; and none where the wheel stood before, so that the moment is
    told long after its counts do."""
    leading = Candidate(effects=("encoder_dead",), probability=0.9, group_probability=0.9)
    for_good = with_dead("first.csv", 30.0, 60.0)
    for_a_while = with_dead("second.csv", 30.0, 35.26)
    (note,) = counts_again(leading, [for_good, for_a_while])
    assert note.startswith("second.csv: the left encoder counts again from 35.26 s on")
    assert counts_again(leading, [for_good]) == ()
    nothing_dead = leading.model_copy(update={"effects": ("gyro_bias",)})
    assert counts_again(nothing_dead, [for_a_while]) == ()
