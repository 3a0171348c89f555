"""A drive that does otherwise from some time on, or for a while, is told with its times."""

from dataclasses import replace

import numpy as np
import pytest
from drive_recordings import ACTUATION, ROBOT, block_of, evidence, simulated
from full_size import at_full_size
from hypothesis import given
from hypothesis import strategies as st

from gap_diagnosis.drive import drive_block
from gap_diagnosis.drive.answer import for_a_while
from gap_diagnosis.gap.drive_path import commanded_path

START_S, STOP_S = 18.0, 30.0


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("drive_lag", {"time_constant": 0.15}),
        ("drive_gain", {"left": -0.04, "right": -0.04}),
        *at_full_size(
            ("drive_saturation", {"limit": 6.0}),
            ("drive_delay", {"delay": 0.06}),
            ("drive_deadband", {"rate": 1.5}),
            ("drive_acceleration_limit", {"limit": 8.0}),
        ),
    ],
)
def test_what_begins_on_the_way_is_told_with_its_size_and_its_beginning(effect, values):
    """A lag of 0.15 s from half of a log on was no gap (0.96): the drive's answer varied, it was
    taken to."""
    block = block_of(simulated({effect: {**values, "start_s": START_S}}))
    fit = block.fit(frozenset({effect}))
    assert fit.log_evidence > 100.0
    for name, size in values.items():
        told = fit.parameters[f"{effect}.{name}"]
        assert float(told.value) == pytest.approx(size, abs=4 * told.sd + 1e-3 * abs(size))
    begins = fit.parameters[f"{effect}.start_s"]
    assert np.quantile(begins.samples, [0.001, 0.999]) == pytest.approx(
        [START_S] * 2, abs=8 * begins.sd
    )
    assert f"{effect}.stop_s" not in fit.parameters
    (other, *_) = {"drive_lag", "drive_delay"} - {effect}
    assert evidence(block, other) < fit.log_evidence - 20.0


def test_a_gain_of_one_percent_hides_no_change_on_the_way():
    """Beside it a lag of 0.15 s from half of the log on was none: the answer was taken to vary."""
    gain = {"left": -0.01, "right": -0.01}
    lag = {"time_constant": 0.15, "start_s": START_S}
    fit = block_of(simulated({"drive_lag": lag, "drive_gain": gain})).fit(frozenset({"drive_lag"}))
    assert fit.log_evidence > 100.0
    assert fit.parameters["drive_lag.time_constant"].value == pytest.approx(0.15, rel=0.02)
    begins = fit.parameters["drive_lag.start_s"]
    assert begins.value == pytest.approx(START_S, abs=0.1)


def test_what_ends_again_is_told_with_both_its_ends():
    window = {"start_s": START_S, "stop_s": STOP_S}
    block = block_of(simulated({"drive_lag": {"time_constant": 0.1, **window}}))
    fit = block.fit(frozenset({"drive_lag"}))
    ((start_s, stop_s),) = fit.windows
    # An end is told where the drive does something that shows it.
    assert start_s == pytest.approx(START_S, abs=1.0)
    assert stop_s == pytest.approx(STOP_S, abs=1.0)
    assert fit.parameters["drive_lag.time_constant"].value == pytest.approx(0.1, rel=0.02)


def test_a_drive_is_not_blamed_for_counts_that_are_too_many_from_some_time_on():
    """They were drive_gain beside the ticks of a turn, or beside larger wheels (0.82)."""
    block = block_of(simulated({"ticks_per_rev": {"scale": 0.02, "start_s": START_S}}))
    alone = block.fit(frozenset({"ticks_per_rev"}))
    assert alone.log_evidence > evidence(block, "drive_gain")
    assert alone.log_evidence > evidence(block, "drive_gain", "ticks_per_rev") - 5.0
    assert alone.windows == ()  # the motion tells them


@pytest.mark.parametrize("seed", [22, *at_full_size(24, 5, 6)])
def test_a_drive_is_not_blamed_for_how_counts_scatter_that_are_lost_by_chance(seed):
    """A gain beside them took that up: 27 nats more than by lost counts alone."""
    missed = {"side": "left", "probability": 0.03, "start_s": START_S}
    block = block_of(simulated({"missed_ticks": missed}, seed=seed))
    alone = evidence(block, "missed_ticks")
    assert evidence(block, "drive_gain", "missed_ticks") < alone + 6.0


def test_a_threshold_that_does_nothing_says_nothing_beside_counts_that_are_lost_by_chance():
    """Wheels that by far do not reach their limit: a diagnosis ended in a traceback."""
    drive = ROBOT.plant.drive
    drive = drive.model_copy(update={"max_wheel_rate_rad_s": 40 * drive.max_wheel_rate_rad_s})
    fast = replace(ROBOT, plant=ROBOT.plant.model_copy(update={"drive": drive}))
    missed = {"side": "left", "probability": 0.03}
    block = drive_block(simulated({"missed_ticks": missed}, seed=22), fast)
    both = {"drive_saturation", "missed_ticks"}
    assert evidence(block, *both) == pytest.approx(evidence(block, "missed_ticks"))


@pytest.mark.parametrize("seed", [1, *at_full_size(2, 3)])
def test_counts_scatter_by_as_many_as_are_lost_or_by_nothing(seed):
    """Of n counts, each lost with probability p, n p (1 - p) is the variance of those lost."""
    healthy = simulated(seed=seed)
    missed = {"side": "left", "probability": 0.02}
    lossy = simulated({"missed_ticks": missed}, seed=seed)
    scattered = block_of(lossy)._scattering(frozenset({"missed_ticks"}))
    assert scattered is not None
    left, right = scattered.data.scatter.sum(axis=1) / scattered.data.tick_rad**2
    lost = np.abs(np.diff(healthy.left_ticks) - np.diff(lossy.left_ticks)).sum()
    assert 0.5 * lost < left < 2.0 * lost
    assert right == 0.0
    assert block_of(healthy)._scattering(frozenset({"missed_ticks"})) is None


def test_what_scatters_by_lost_counts_does_not_scatter_by_extra_ones_once_more():
    """Each of both by itself is as noisy as all of it: together they were twice as noisy."""
    block = block_of(simulated({"missed_ticks": {"side": "left", "probability": 0.03}}, seed=22))
    missed, both = (
        block._scattering(frozenset(some)).data.scatter.sum()
        for some in ({"missed_ticks"}, {"extra_ticks", "missed_ticks"})
    )
    assert missed <= both < 1.3 * missed


@pytest.mark.parametrize(
    "effects",
    [
        {
            "drive_gain": {"left": 0.03, "right": 0.03, "start_s": START_S},
            "ticks_per_rev": {"scale": 0.02},
        },
        *at_full_size(
            {
                "drive_lag": {"time_constant": 0.1, "start_s": START_S},
                "ticks_per_rev": {"scale": 0.02},
            },
        ),
    ],
    ids=lambda effects: next(iter(effects)),
)
def test_counts_that_are_wrong_all_along_are_so_beside_a_drive_that_changes(effects):
    """Both had to begin together: a gain from half of a log on explained 578 nats less with the
    ticks that were there than without the change."""
    block = block_of(simulated(effects))
    both = block.fit(frozenset(effects))
    assert both.log_evidence > max(evidence(block, one) for one in effects) + 5.0
    (drives,) = set(effects) - {"ticks_per_rev"}
    begins = both.parameters[f"{drives}.start_s"]
    assert begins.value == pytest.approx(START_S, abs=0.1)


@pytest.mark.parametrize(
    "effects", [{}, {"drive_lag": {"time_constant": 0.05}}], ids=["healthy", "lags all along"]
)
def test_what_is_as_it_was_has_no_window(effects):
    block = block_of(simulated(effects))
    assert all(block.fit(frozenset({one})).windows == () for one in ACTUATION)


def test_a_drive_that_changes_in_a_way_that_is_not_listed_is_no_drive_as_described():
    block = block_of(simulated({"drive_lag": {"time_constant": 0.1, "start_s": START_S}}))
    assert block.unexplained().log_evidence > 100.0


def test_the_simulated_drive_changes_when_the_effect_begins():
    lag = {"time_constant": 0.15}
    log = simulated({"drive_lag": {**lag, "start_s": START_S}})
    known = {"drive_lag.time_constant": 0.15, "drive_lag.start_s": START_S}
    as_described, as_found = commanded_path(log, ROBOT), commanded_path(log, ROBOT, known)
    before = log.t_s < START_S
    assert np.array_equal(as_described[before], as_found[before])
    counted_m = (2 * np.pi / ROBOT.plant.encoder.ticks_per_rev) * ROBOT.plant.wheels.radius_m
    turned_rad = counted_m * (log.right_ticks - log.left_ticks) / ROBOT.plant.wheels.wheelbase_m
    off_rad = [np.abs(path[:, 2] - turned_rad).max() for path in (as_described, as_found)]
    assert off_rad[1] < 0.1 * off_rad[0]


@given(st.integers(0, 49), st.integers(0, 50), st.floats(0.0, 0.5))
def test_of_two_drives_that_do_the_same_it_makes_no_difference_when_they_change(first, rows, lag_s):
    angles = np.cumsum(np.sin(np.arange(100.0)).reshape(2, 50), axis=1)
    angles -= angles[:, :1]
    ends = first, min(first + rows, 50)
    changed = for_a_while(angles, angles, *ends, (lag_s, lag_s), 0.01)
    assert np.allclose(changed, angles, atol=1e-12)
