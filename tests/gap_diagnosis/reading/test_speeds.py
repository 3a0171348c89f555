"""Wheel speeds add up to a way, and say how sure it is."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gap_diagnosis.reading.speeds import integrated_speed

ROW_S = 0.02
LEAST_M_S = 0.5


def braking() -> tuple[np.ndarray, np.ndarray]:
    """Return times and speeds of four stops of 3 s, each from 5 m/s at 2 m/s² and up again."""
    t_s = np.arange(0.0, 60.0, ROW_S)
    away_s = np.abs((t_s + 7.5) % 15.0 - 7.5)  # from the middle of the nearest stop
    return t_s, np.clip(2.0 * (away_s - 1.5), 0.0, 5.0)


def test_a_wheel_too_slow_for_its_sensor_creeps_to_its_stop_as_it_slowed_down() -> None:
    t_s, speed = braking()
    told = np.where(speed < LEAST_M_S, 0.0, speed)
    exact = float(np.sum(speed) * ROW_S)
    untold = exact - float(np.sum(told) * ROW_S)
    found = integrated_speed(told, t_s, scale=1.0)
    unsure = math.sqrt(found.unsure_ticks2.sum())
    assert untold > 8 * 0.9 * LEAST_M_S**2 / (2 * 2.0)
    assert found.ticks[-1] == pytest.approx(exact, abs=0.2 * untold)
    assert 0.5 * untold / math.sqrt(8) < unsure < untold
    still = (told == 0.0) & (speed == 0.0)
    assert not found.unsure_ticks2[still][5:-5].all()


def test_a_wheel_that_says_nothing_at_full_speed_does_not_creep_to_a_stop() -> None:
    """It is no news of the wheel: a dead sensor's outage was a second shorter at either end."""
    t_s, speed = braking()
    told = np.where(speed < LEAST_M_S, 0.0, speed)
    told[(t_s > 6.0) & (t_s <= 9.0)] = 0.0
    silent = (t_s > 6.1) & (t_s <= 8.9)
    assert speed[silent].min() == 5.0
    found = integrated_speed(told, t_s, scale=1.0)
    assert np.ptp(found.ticks[silent]) == 0.0


def test_a_wheel_that_tells_every_speed_creeps_no_further() -> None:
    t_s, speed = braking()
    found = integrated_speed(speed, t_s, scale=1.0)
    assert found.ticks[-1] == pytest.approx(np.trapezoid(speed, t_s), abs=1e-9)


def test_what_a_step_of_the_signal_rounds_off_adds_up_for_as_long_as_it_says_the_same() -> None:
    rng = np.random.default_rng(1)
    step, rows, holds = 0.1, 40, 100
    speed = np.repeat(3.0 + rng.uniform(-1.0, 1.0, holds), rows)
    t_s = ROW_S * np.arange(len(speed))
    told = np.round(speed / step) * step
    exact = float(np.sum(speed) * ROW_S)
    found = integrated_speed(told, t_s, scale=1.0)
    rounding2 = holds * (rows * ROW_S * step) ** 2 / 12.0
    unsure2 = float(found.unsure_ticks2.sum())
    assert abs(found.ticks[-1] - exact) < 4 * math.sqrt(unsure2)
    assert rounding2 < unsure2 < 3 * rounding2


def test_a_speed_between_two_steps_is_off_however_often_it_is_told_as_either() -> None:
    """Of noise of a fifth of a step one value in six was the other one; rows were taken to be off
    each by itself, and a healthy robot's body turned by 3.2 % more than its wheels (unlisted)."""
    random = np.random.default_rng(1)
    step, rows, holds = 0.1, 200, 60
    held = step * (random.integers(20, 40, holds) + 0.3)
    speed = np.repeat(held, rows)
    told = np.round((speed + random.normal(0.0, 0.02, len(speed))) / step) * step
    found = integrated_speed(told, ROW_S * np.arange(len(speed)), scale=1.0)
    ends = np.arange(rows - 1, len(speed), rows)
    off = np.diff(found.ticks[ends]) - rows * ROW_S * held[1:]
    unsure2 = np.diff(np.cumsum(found.unsure_ticks2)[ends])
    assert np.mean(off**2 / unsure2) < 1.0 + 4.0 * math.sqrt(2.0 / holds)


COUNTS = st.lists(st.integers(-40, 40), min_size=120, max_size=200).filter(
    # What comes in twos or threes alone was counted otherwise.
    lambda steps: all(sum(one % several == 0 for one in steps) < 100 for several in (2, 3, 5, 7))
)
PER_COUNT_M = 1.54e-4


@given(COUNTS, st.sampled_from(["backward", "forward", "central"]))
def test_speeds_that_are_differences_of_counts_add_up_to_those_counts(
    steps: list[int], kind: str
) -> None:
    """A row early or late: nothing tells. Taken for smooth ways, healthy wheels had play (0.98)."""
    counts = np.concatenate([[0, 5], 5 + np.cumsum([one + (one == 0) for one in steps])])
    t_s = ROW_S * np.arange(len(counts))
    steps_m = np.diff(counts) * PER_COUNT_M
    speed = {
        "backward": np.concatenate([[0.0], steps_m]) / ROW_S,
        "forward": np.concatenate([steps_m, [0.0]]) / ROW_S,
        "central": np.gradient(counts * PER_COUNT_M, t_s),
    }[kind]
    found = integrated_speed(np.round(speed, 6), t_s, scale=1 / PER_COUNT_M)
    assert found.is_counted
    assert not found.unsure_ticks2.any()
    shifted = {"backward": counts, "forward": np.append(counts[1:], counts[-1]), "central": counts}
    np.testing.assert_array_equal(found.ticks, shifted[kind] - (kind == "backward") * counts[0])


@given(COUNTS, st.floats(0.03, 0.36))
def test_differences_of_counts_that_are_rounded_once_more_add_up_to_the_counts(
    steps: list[int], step_counts: float
) -> None:
    """Speeds of 20 Hz in mm/s: of a healthy robot's wheels one had play of 3 mrad (0.98)."""
    counts = np.concatenate([[0, 5], 5 + np.cumsum([one + (one == 0) for one in steps])])
    t_s = ROW_S * np.arange(len(counts))
    speed = np.diff(counts, prepend=0) * PER_COUNT_M / ROW_S
    step = step_counts * PER_COUNT_M / ROW_S
    found = integrated_speed(np.round(speed / step) * step, t_s, scale=1 / PER_COUNT_M)
    assert found.is_counted
    np.testing.assert_array_equal(found.ticks, counts)


@pytest.mark.parametrize("rows_ms", [50, 60, 100])
def test_counts_over_a_part_of_a_row_are_no_differences_of_rows(rows_ms: int) -> None:
    """A controller that counts over 20 ms was logged every 50: its speeds came in steps of 2.5
    counts a row, which was taken for whole ones of two rows, two chains that are 100 counts apart.
    A healthy robot was an unlisted cause (0.96) after four minutes."""
    time_s = np.arange(0.0, 60.0, 0.01)
    driven_s = np.clip(time_s - 2.0, 0.0, 50.0)
    counts = np.floor(3000.0 * (driven_s - np.sin(driven_s)))
    speed = np.append(np.zeros(2), counts[2:] - counts[:-2]) / 0.02
    each = rows_ms // 10
    found = integrated_speed(speed[::each], time_s[::each], scale=1.0)
    assert not found.is_counted
    off = found.ticks - found.ticks[0] - counts[::each]
    assert np.std(np.diff(off)) < 1.5 * each
    assert np.std(np.diff(off)) < np.sqrt(found.unsure_ticks2.mean())


@pytest.mark.parametrize("counts_per_row", [5.1, 12.0])
def test_a_steady_wheel_near_a_whole_number_of_counts_is_not_counted(
    counts_per_row: float,
) -> None:
    """Between its starts and stops every row's way is as near to it."""
    t_s, share = braking()
    noise = np.random.default_rng(1).normal(0.0, 0.03, len(t_s))
    speed = np.where(share > 0.0, counts_per_row * share / 5.0 + noise, 0.0)
    assert np.mean(np.abs(speed - counts_per_row) < 0.2) > 0.4
    found = integrated_speed(speed / ROW_S, t_s, scale=1.0)
    assert not found.is_counted


@pytest.mark.parametrize("sd_m_s", [0.002, 0.02])
def test_the_noise_of_speeds_adds_up(sd_m_s: float) -> None:
    """Unless it is said to, a wheel that trembles at rest has play, and counts of its own."""
    t_s = np.arange(0.0, 60.0, ROW_S)
    speed = np.sin(0.5 * t_s)
    noise = np.random.default_rng(1).normal(0.0, sd_m_s, len(speed))
    found = integrated_speed(speed + noise, t_s, scale=1.0)
    assert not found.is_counted
    assert np.median(found.unsure_ticks2) == pytest.approx((sd_m_s * ROW_S) ** 2, rel=0.25)


def test_a_small_robot_that_seldom_goes_as_fast_for_long_adds_no_more_noise() -> None:
    """At 20 rows a second it speeds up or slows down in most stretches of three seconds."""
    rng = np.random.default_rng(3)
    t_s = np.arange(0.0, 120.0, 0.05)
    asked = np.repeat(rng.uniform(0.1, 0.4, 60), 40)
    speed = np.convolve(asked, np.full(12, 1 / 12), mode="same")  # 0.6 s from one to the next
    found = integrated_speed(speed + rng.normal(0.0, 0.002, len(t_s)), t_s, scale=1.0)
    assert np.median(found.unsure_ticks2) == pytest.approx((0.002 * 0.05) ** 2, rel=0.3)


def test_a_wheel_told_as_zero_while_the_other_one_turns_may_creep_by_less_than_a_step() -> None:
    """Of a healthy robot's speeds in steps of 5 cm/s a wheel inside a bend had a dead encoder."""
    random = np.random.default_rng(1)
    step, rows, holds = 0.05, 200, 40
    held = np.where(np.arange(holds) % 2, random.uniform(-0.5, 0.5, holds) * step, 0.7)
    speed = np.convolve(np.repeat(held, rows), np.full(30, 1 / 30), "same")  # no wheel leaps
    told = np.round(speed / step) * step
    t_s = ROW_S * np.arange(len(speed))
    turns = integrated_speed(told, t_s, scale=1.0, other=np.full(len(told), 0.3))
    off = abs(turns.ticks[-1] - np.trapezoid(speed, t_s))
    assert off < 3.0 * math.sqrt(turns.unsure_ticks2.sum())
    crept2 = turns.unsure_ticks2[told == 0.0].sum()
    assert crept2 == pytest.approx(holds / 2 * (rows * ROW_S * step) ** 2 / 12.0, rel=0.5)
    stands = integrated_speed(told, t_s, scale=1.0, other=told)
    assert stands.unsure_ticks2[told == 0.0].sum() < 0.5 * crept2


@given(st.floats(0.1, 0.9), st.sampled_from([0.002, 0.01, 0.05]))
def test_a_wheel_that_settles_is_told_as_standing_while_it_creeps(
    settles_s: float, step: float
) -> None:
    """Of healthy robots whose wheels settle within a second, told in steps of 2 to 28 mm/s, each of
    six had an unlisted cause or spurious counts (0.53 to 0.96)."""
    t_s = ROW_S * np.arange(1000)
    speed = 0.5 * np.where(t_s < 2.0, 1.0, np.exp(-(t_s - 2.0) / settles_s))
    told = np.round(speed / step) * step
    found = integrated_speed(told, t_s, scale=1.0, other=told)
    still = told == 0.0
    off = np.sum(speed[still]) * ROW_S
    assert off < 3.0 * math.sqrt(found.unsure_ticks2[still].sum())
    assert not found.unsure_ticks2[-100:].any()


def test_a_zero_amid_noise_is_as_unsure_as_what_is_around_it() -> None:
    """A standing robot's noise of 5 mm/s in steps of 10 was none where it was told as 0: what the
    other rows added up to was a push (0.96)."""
    random = np.random.default_rng(4)
    rests = 400
    speed = np.concatenate([np.zeros(rests), np.full(rests, 0.2)])
    told = np.round((speed + random.normal(0.0, 0.005, (200, 2 * rests))) / 0.01) * 0.01
    t_s = ROW_S * np.arange(2 * rests)
    shares = []
    for one in told:
        found = integrated_speed(one, t_s, scale=1.0)
        shares.append(found.ticks[rests - 1] ** 2 / found.unsure_ticks2[:rests].sum())
        unsure = found.unsure_ticks2[1:rests]
        assert float(np.mean(unsure == 0.0)) < 0.1
    assert float(np.mean(shares)) < 1.0 + 4.0 * math.sqrt(2.0 / len(told))
