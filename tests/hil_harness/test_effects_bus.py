"""Effects of stage bus do to frames what their names, units and signs say."""

import numpy as np
import pytest
from array_runs import TICK_S, drive_once
from numpy.typing import NDArray

from can_bus import Arrivals
from hil_harness.effect_runs import EffectRun

TICKS = 6000


def encoder(seen: EffectRun) -> Arrivals:
    return seen.arrivals["ENCODER"]


def delays_s(seen: EffectRun) -> NDArray[np.float64]:
    arrivals = encoder(seen)
    return np.asarray(arrivals.time_us * 1e-6 - arrivals.frame * TICK_S, dtype=np.float64)


def test_latency_is_a_constant_delay_of_the_named_frame_alone() -> None:
    seen = drive_once("frame_latency.frame=ENCODER", "frame_latency.delay=0.0123")
    np.testing.assert_allclose(delays_s(seen), 0.0123, atol=1e-9)
    assert "IMU" not in seen.arrivals


def test_jitter_spreads_the_delay_by_sigma_and_never_overtakes() -> None:
    seen = drive_once("frame_jitter.sigma=0.001", ticks=TICKS)
    delays = delays_s(seen)
    assert np.all(np.diff(encoder(seen).time_us) >= 0)
    assert delays.min() >= 0.0
    # an exponential's standard deviation is estimated to √2/√n of itself
    assert np.std(delays) == pytest.approx(0.001, rel=5 * np.sqrt(2 / TICKS))


def test_losses_have_their_share() -> None:
    seen = drive_once("frame_loss.probability=0.1", ticks=TICKS)
    lost = TICKS - len(encoder(seen).frame)
    assert lost == pytest.approx(0.1 * TICKS, abs=5 * np.sqrt(0.09 * TICKS))


def test_bursts_have_their_mean_length_and_leave_the_share() -> None:
    seen = drive_once("frame_loss.probability=0.1", "frame_loss.burst=5", ticks=20 * TICKS)
    gaps = np.diff(encoder(seen).frame) - 1
    bursts = gaps[gaps > 0]
    assert bursts.mean() == pytest.approx(5.0, abs=5 * np.sqrt(20 / len(bursts)))
    # the number of bursts varies as √n, their lengths as √20 each
    share = bursts.sum() / (20 * TICKS)
    assert share == pytest.approx(0.1, rel=5 * np.sqrt(2 / len(bursts)))


def test_a_duplicate_comes_twice_with_the_same_counter() -> None:
    seen = drive_once("frame_duplication.probability=0.05", ticks=TICKS)
    twice = np.sum(np.diff(encoder(seen).frame) == 0)
    assert twice == pytest.approx(0.05 * TICKS, abs=5 * np.sqrt(0.05 * TICKS))


def test_a_reordered_frame_comes_right_after_its_successor() -> None:
    seen = drive_once("frame_reordering.probability=0.05", ticks=TICKS)
    back = np.flatnonzero(np.diff(encoder(seen).frame) == -1)
    assert 0.03 * TICKS < len(back) < 0.06 * TICKS
    assert set(np.unique(np.diff(encoder(seen).frame))) == {-1, 1, 2, 3}


def test_a_stale_producer_repeats_its_payload_for_so_many_cycles() -> None:
    seen = drive_once("stale_producer.cycles=4", "stale_producer.probability=0.01", ticks=TICKS)
    age = encoder(seen).frame - encoder(seen).payload
    assert set(np.unique(age)) >= {0, 1, 2, 3, 4}
    begins = np.sum(age == 1)
    assert begins == pytest.approx(0.01 * TICKS, abs=5 * np.sqrt(0.01 * TICKS))
    longest = np.flatnonzero(age == 4)
    assert np.all(age[longest - 3] == 1)


def test_frames_that_are_polled_are_stamped_on_the_pollers_grid() -> None:
    seen = drive_once("reception_stamp.delay=0.002", "reception_stamp.period=0.007")
    assert np.all(encoder(seen).time_us % 7000 == 0)
    delays = delays_s(seen)
    assert delays.min() >= 0.002 - 1e-9
    assert delays.max() < 0.009


def test_in_a_gap_there_is_no_frame_of_any_message() -> None:
    seen = drive_once("bus_gap.start_s=1", "bus_gap.stop_s=1.5")
    for name in ("ENCODER", "IMU", "ENVIRONMENT", "COMMAND"):
        sent_s = seen.arrivals[name].time_us * 1e-6
        assert not np.any((sent_s >= 1.0) & (sent_s < 1.5))
    assert len(encoder(seen).frame) == len(seen.time_s) - 50


def test_a_fast_ecu_clock_ticks_faster_and_reads_more_turn_than_there_is() -> None:
    skew = 0.01
    plain, fast = (
        drive_once(*effects, scenario="spin", ticks=1000)
        for effects in ((), (f"clock_skew.skew={skew}",))
    )
    assert fast.time_s[-1] * (1 + skew) == pytest.approx(plain.time_s[-1])
    turns = [seen.pose[-1, 2] / seen.truth[-1, 2] for seen in (plain, fast)]
    assert turns[1] / turns[0] == pytest.approx(1 + skew, abs=2e-4)


def test_the_seed_decides_each_messages_fate_whatever_else_is_disturbed() -> None:
    alone = drive_once("frame_loss.frame=ENCODER", "frame_loss.probability=0.2")
    beside = drive_once(
        "frame_loss.frame=ENCODER",
        "frame_loss.probability=0.2",
        "frame_jitter.frame=IMU",
        "frame_jitter.sigma=0.001",
    )
    np.testing.assert_array_equal(encoder(alone).frame, encoder(beside).frame)
