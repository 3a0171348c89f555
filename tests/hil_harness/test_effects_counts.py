"""Effects between motor, wheel and counter, and effects that act in a part of a run."""

import math

import numpy as np
import pytest
from effect_drives import QUIET, RADIUS_M, TICK_M, TICK_S, Drive, FloatArray, run

TICKS_PER_RAD = QUIET.encoder.ticks_per_rev / math.tau


def there_and_back(speed_m_s: float, times: int) -> FloatArray:
    """Speed up ahead, then alternate: *times* reversals."""
    legs = [np.full((200, 2), (speed_m_s * (-1) ** leg, 0.0)) for leg in range(times + 1)]
    return np.vstack(legs)


def counted(seen: Drive, side: str) -> FloatArray:
    return np.cumsum(seen.tick_steps(side)).astype(float)


def test_ticks_are_missed_with_their_probability() -> None:
    p = 0.02
    seen = run(f"missed_ticks.probability={p}", "missed_ticks.side=left", v=0.5, seconds=100)
    whole, left = seen.ticks("right"), seen.ticks("left")
    assert whole - left == pytest.approx(p * whole, abs=5 * math.sqrt(p * whole))


def test_ticks_are_missed_above_the_threshold_only_and_backwards_too() -> None:
    rate_rad_s = 0.5 / RADIUS_M
    texts = ["missed_ticks.probability=0.1", f"missed_ticks.threshold={rate_rad_s}"]
    slow, fast, back = (run(*texts, v=v, seconds=20) for v in (0.45, 0.55, -0.55))
    assert slow.counted_m == pytest.approx(slow.path_m, abs=2 * TICK_M)
    assert fast.counted_m == pytest.approx(0.9 * fast.path_m, rel=0.01)
    assert back.counted_m == pytest.approx(-0.9 * back.path_m, rel=0.01)


def test_a_wheel_is_as_fast_as_it_turns_and_not_by_whole_counts_in_a_tick() -> None:
    """A count in a tick is 0.3 rad/s: a wheel 0.03 rad/s below the threshold lost counts in each
    tick that had one more than the mean."""
    slower, faster = 0.497, 0.503
    texts = ["missed_ticks.probability=0.1", f"missed_ticks.threshold={0.5 / RADIUS_M}"]
    slow, fast = (run(*texts, v=v, seconds=20) for v in (slower, faster))
    assert slow.counted_m == pytest.approx(slow.path_m, abs=2 * TICK_M)
    assert fast.counted_m == pytest.approx(0.9 * fast.path_m, rel=0.01)


@pytest.mark.parametrize("rate", [5.0, -30.0, 2000.0])
def test_extra_ticks_come_at_their_rate_at_rest_too(rate: float) -> None:
    seen = run(f"extra_ticks.rate={rate}", "extra_ticks.side=right", v=0.0, seconds=100)
    assert seen.ticks("right") == pytest.approx(100 * rate, abs=5 * math.sqrt(100 * abs(rate)))
    assert seen.ticks("left") == 0


def test_a_narrower_counter_wraps_at_its_width() -> None:
    seen, plain = run("encoder_wrap.bits=8", v=0.5), run(v=0.5)
    np.testing.assert_array_equal(seen.runs.left_count, plain.runs.left_count & 0xFF)


def test_each_reversal_costs_the_backlash_of_rolling_and_none_of_counting() -> None:
    width, times = 0.05, 3
    commands = there_and_back(0.3, times)
    plain, seen = (
        run(*e, commands=commands, drive="motor") for e in ((), (f"backlash.width={width}",))
    )
    np.testing.assert_array_equal(plain.runs.left_count, seen.runs.left_count)
    lost = plain.pose[:, 0] - seen.pose[:, 0]
    # after reversals to and fro the wheel is behind by the play, then level again
    assert lost[590] == pytest.approx(0.0, abs=1e-9)
    assert lost[390] == pytest.approx(-width * RADIUS_M, abs=1e-9)
    assert lost[790] == pytest.approx(-width * RADIUS_M, abs=1e-9)


def test_a_channel_off_its_quarter_shifts_every_other_edge_and_never_by_a_tick() -> None:
    error = 0.5
    seen = run(f"quadrature_phase.error={error}", v=0.01, seconds=60)
    plain = run(v=0.01, seconds=60)
    apart = counted(plain, "left") - counted(seen, "left")
    assert set(np.unique(apart)) == {0.0, 1.0}
    # an odd edge comes late by error·2/π ticks, so half the ticks are late for that share
    assert apart.mean() == pytest.approx(error / math.pi, rel=0.1)


def test_cogging_waves_the_wheel_and_the_count_alike() -> None:
    amplitude, order = 0.1, 4
    texts = [f"drive_cogging.{p}" for p in (f"amplitude={amplitude}", f"order={order}")]
    seen = run(*texts, v=0.2, seconds=30, drive="motor")
    assert seen.counted_m == pytest.approx(seen.path_m, abs=2 * TICK_M)
    speed = np.hypot(*np.diff(seen.pose[300:, :2], axis=0).T) / TICK_S
    assert speed.max() == pytest.approx(0.2 * (1 + amplitude), rel=0.01)
    assert speed.min() == pytest.approx(0.2 * (1 - amplitude), rel=0.01)
    waves = np.sum((speed[:-1] < 0.2) & (speed[1:] >= 0.2))
    turned = np.sum(speed) * TICK_S / RADIUS_M
    assert waves == pytest.approx(turned * order / math.tau, abs=1.5)


def test_a_caster_kicks_after_a_reversal_in_the_sense_of_the_last_turn() -> None:
    turning, ahead, back = (np.full((100, 2), c) for c in ((0.2, 0.5), (0.2, 0.0), (-0.2, 0.0)))
    commands = np.vstack([turning, ahead, back])
    plain, seen = (
        run(*e, commands=commands)
        for e in ((), ("caster_kick.angle=0.02", "caster_kick.length=0.1"))
    )
    kick = seen.pose[:, 2] - plain.pose[:, 2]
    assert np.all(kick[:201] == 0.0)
    assert kick[-1] == pytest.approx(0.02)
    halfway = 200 + round(0.05 / (0.2 * TICK_S))
    assert kick[halfway] == pytest.approx(0.01, rel=0.05)
    assert seen.gyro_turn_rad - plain.gyro_turn_rad == pytest.approx(0.02, abs=2e-3)
    np.testing.assert_array_equal(seen.runs.left_count, plain.runs.left_count)


def test_a_caster_does_not_turn_over_where_a_robot_only_spins() -> None:
    """Wheels that slip a little creep to and fro as they spin, which was a reversal each time."""
    ahead, spin = (np.full((100, 2), c) for c in ((0.2, 0.0), (0.0, 1.0)))
    commands = np.vstack([ahead, spin, ahead, -spin, ahead])
    rough = ("micro_slip.left=0.001", "micro_slip.right=0.001")
    plain, seen = (
        run(*rough, *e, commands=commands)
        for e in ((), ("caster_kick.angle=0.02", "caster_kick.length=0.1"))
    )
    np.testing.assert_array_equal(seen.pose, plain.pose)


def test_a_fast_clock_samples_shorter_ticks() -> None:
    plain, fast = (run(*e, v=0.5) for e in ((), ("clock_skew.skew=0.01",)))
    assert fast.path_m == pytest.approx(plain.path_m / 1.01, rel=1e-9)


def test_an_effect_acts_inside_its_window_only() -> None:
    window = ["gyro_bias.bias=0.1", "gyro_bias.start_s=3", "gyro_bias.stop_s=5"]
    apart = run(*window).codes - run().codes
    ticks = np.arange(len(apart)) * TICK_S
    inside = (ticks > 3) & (ticks <= 5)
    assert np.all(apart[~inside] == 0)
    np.testing.assert_allclose(apart[inside], 0.1 * QUIET.gyro.sensitivity_lsb_per_rad_s, atol=1)


def test_counts_go_on_where_they_are_when_the_encoder_changes() -> None:
    texts = ["ticks_per_rev.scale=0.05", "ticks_per_rev.start_s=4", "ticks_per_rev.stop_s=6"]
    seen, plain = run(*texts, v=0.5), run(v=0.5)
    apart = counted(seen, "left") - counted(plain, "left")
    per_s = 0.5 / TICK_M
    assert np.all(np.abs(apart[:400]) == 0)
    assert apart[-1] == pytest.approx(0.05 * 2 * per_s, abs=1.5)
    assert np.abs(np.diff(apart)).max() <= 3


def test_windows_of_several_effects_overlap_freely() -> None:
    texts = [
        "radius_scale.scale=0.1", "radius_scale.start_s=2", "radius_scale.stop_s=6",
        "wheelbase_scale.scale=0.2", "wheelbase_scale.start_s=4",
    ]  # fmt: skip
    seen = run(*texts, commands=np.full((801, 2), (0.0, 1.0)), drive="motor")
    rates = np.diff(seen.pose[:, 2]) / TICK_S
    expected = {150: 1.0, 350: 1.1, 550: 1.1 / 1.2, 750: 1 / 1.2}
    for tick, rate in expected.items():
        assert rates[tick] == pytest.approx(rate, rel=1e-6)
