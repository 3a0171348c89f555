"""A mistake of the set-up that is put right leaves the log that there would have been."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from motion_cases import EXACT, ROBOT, WIRE, coarse_table, moved_only

from gap_diagnosis.analysis import analyse
from gap_diagnosis.bus import bus_block
from gap_diagnosis.codes import codes_block
from gap_diagnosis.drive import drive_block
from gap_diagnosis.drive.mistakes import COUNTS
from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.gross import Order, _Pair, looks_gross, order_of, put_right
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.whitening import CONTACT, LEVELS
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording
from gap_diagnosis.setup_mistakes import FACTORS, LEAST_GAIN
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from gap_diagnosis.trials.drives import drive as trial_drive
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

FASTEST_M_S = ROBOT.plant.drive.max_wheel_rate_rad_s * ROBOT.plant.wheels.radius_m
FEW = frozenset(EXPLAINED) - {
    "gyro_bias",
    "gyro_scale",
    "one_sided_slip",
    "setup_sign",
    "setup_unit",
    "setup_wheels_swapped",
    "wheelbase_scale",
}
"""What a library lacks of which these alone are asked: mistakes, and what these passed for."""
LOG = synthetic_recording(ROBOT, WIRE, scenario("figure8"), (), 1, reference=EXACT, duration_s=5.0)


def wrong(signal: str, factor: float) -> Recording:
    """Return the log with a signal that reads so many times what it should."""
    rate = LOG.gyro_rate_rad_s
    assert rate is not None
    sides = {"ticks": ("left_ticks", "right_ticks")}.get(signal, (signal,))
    if signal == "gyro":
        return replace(LOG, gyro_rate_rad_s=rate * factor)
    return replace(LOG, **{side: getattr(LOG, side) * factor for side in sides})


def block_of(log: Recording, *unnamed: str) -> MotionBlock:
    """Return the motion of a log that may be as wrong as it likes, without some names."""
    without = FEW.union(unnamed)
    return MotionBlock(MotionModel(log, ROBOT, default_prior(), gross=True, without=without))


def assert_same(found: Recording) -> None:
    assert found.gyro_rate_rad_s is not None
    assert LOG.gyro_rate_rad_s is not None
    np.testing.assert_allclose(found.left_ticks, LOG.left_ticks, rtol=1e-12)
    np.testing.assert_allclose(found.right_ticks, LOG.right_ticks, rtol=1e-12)
    np.testing.assert_allclose(found.gyro_rate_rad_s, LOG.gyro_rate_rad_s, rtol=1e-12)


@pytest.mark.parametrize("signal", ["left_ticks", "right_ticks", "ticks", "gyro"])
@pytest.mark.parametrize("factor", [one for known in FACTORS for one in (known, 1 / known)])
def test_a_factor_is_divided_out_of_the_signal_that_has_it(signal, factor):
    found, log_scale = put_right(
        wrong(signal, factor), "setup_unit", {"signal": signal, "factor": factor}
    )
    assert_same(found)
    # Only the gyro is compared in its own unit: a density per rad becomes one per so many rad.
    assert log_scale == (pytest.approx(-np.log(factor)) if signal == "gyro" else 0.0)


@pytest.mark.parametrize(
    ("factor", "before", "step"),
    [
        (10.0, 10.0, 1.0),
        (10.0, 1.0, 0.1),
        (2.0, 1.0, 0.5),
        (0.1, 1.0, 10.0),
        (180 / np.pi, 0.0, 1.0),
    ],
)
def test_counts_step_by_what_they_show(factor: float, before: float, step: float) -> None:
    """Counts that were multiplied step by one again once it is undone, those of an encoder that is
    finer than described by less, and what was rounded once it was divided by more."""
    ticks = np.rint(LOG.left_ticks * (before or factor))
    told = {"signal": "left_ticks", "factor": factor}
    found, _ = put_right(replace(LOG, left_ticks=ticks), "setup_unit", told)
    assert found.counts_per_step == pytest.approx((step, 1.0))


def test_what_a_speed_is_unsure_by_is_in_its_unit_as_well() -> None:
    unsure = np.full((2, len(LOG.t_s)), 3.6**2)
    log = replace(LOG, unsure_ticks2=unsure)
    found, _ = put_right(log, "setup_unit", {"signal": "left_ticks", "factor": 3.6})
    assert found.unsure_ticks2 is not None
    np.testing.assert_allclose(found.unsure_ticks2[:, 0], [1.0, 3.6**2])


def test_what_a_wheel_is_unsure_by_goes_with_it_where_wheels_are_swapped() -> None:
    unsure = np.array([[1.0], [4.0]]) * np.ones(len(LOG.t_s))
    log = replace(LOG, unsure_ticks2=unsure, counts_per_step=(1.0, 0.25))
    found, _ = put_right(log, "setup_wheels_swapped", {})
    assert found.unsure_ticks2 is not None
    np.testing.assert_allclose(found.unsure_ticks2[:, 0], [4.0, 1.0])
    assert found.counts_per_step == (0.25, 1.0)


@pytest.mark.parametrize("signal", ["left_ticks", "right_ticks", "gyro"])
def test_a_sign_is_turned_back(signal):
    found, log_scale = put_right(wrong(signal, -1.0), "setup_sign", {"signal": signal})
    assert_same(found)
    assert log_scale == 0.0


def test_sides_are_swapped_back():
    swapped = replace(LOG, left_ticks=LOG.right_ticks, right_ticks=LOG.left_ticks)
    found, _ = put_right(swapped, "setup_wheels_swapped", {})
    assert_same(found)


def test_a_mistake_that_leaves_the_log_as_gross_as_it_was_is_not_named():
    """A gyro of the wrong sign, without that name: read in a unit in which next to nothing is left
    of it, it is likelier than as described (by 100 nats in these five seconds)."""
    log = wrong("gyro", -1.0)
    unnamed = block_of(log, "setup_sign")
    mistakes = unnamed.scan.effects & {"setup_unit", "setup_wheels_swapped"}
    assert mistakes
    assert max(unnamed.fit(frozenset({one})).log_evidence for one in mistakes) < 0
    assert block_of(log).fit(frozenset({"setup_sign"})).log_evidence > LEAST_GAIN


def test_an_effect_that_leaves_a_contact_of_no_floor_accounts_for_nothing():
    """Counts in a wrong unit, without that name: a wheel that slips its whole way was told (8,177
    nats, 0.89). What it explains, something does that is not listed."""
    log = moved_only(wrong("left_ticks", 256.0))
    few = {"gyro_scale", "one_sided_slip", "setup_sign", "setup_wheels_swapped"}
    others = frozenset(EXPLAINED) - few
    found = analyse(log, ROBOT, WIRE, default_prior(), without=others)
    block = found.motion
    assert block is not None
    best = max(block.scan.found.values(), key=lambda one: one.log_evidence)
    assert best.effects
    assert block.fit(best.effects).log_evidence < 0
    assert found.unknown["setup"] == block.nameless == block.explained > 0


def test_both_wheels_in_millimetres_are_told_against_the_gyro_alone():
    """What a straight line about so gross an error likes best is another signal or factor; which
    one leaves wheels and gyro that agree shows only when it is put right. It was no mistake at all
    (an unlisted one), 986 rad of turn between wheels and gyro in 90 s."""
    log = replace(wrong("ticks", 1000.0), reference=None)
    block = block_of(log)
    mistake = frozenset({"setup_unit"})
    assert block.fit(mistake).log_evidence > LEAST_GAIN
    told = block.detail(mistake).parameters
    for name, value in (("signal", "ticks"), ("factor", 1000)):
        one = told[f"setup_unit.{name}"]
        assert one.value == value
        assert one.probabilities is not None
        assert one.probabilities[str(value)] > 0.999


@pytest.mark.parametrize("noise_m", [0.005, 0.06])
def test_a_reference_that_is_noisy_is_no_mistake_of_the_set_up(noise_m: float) -> None:
    """Each step was as long as its noise, and 1 m of wheels half a metre: a gyro's sign and wheels
    that were swapped had no name, 1.0."""
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), (), 3,
        reference=ReferenceNoise(noise_m, 0.01),
    )  # fmt: skip
    assert not looks_gross(log, ROBOT)
    assert log.gyro_rate_rad_s is not None
    assert looks_gross(replace(log, gyro_rate_rad_s=-log.gyro_rate_rad_s), ROBOT)


@cache
def of_a_gyro_that_reads_four_times_as_much() -> MotionBlock:
    return block_of(wrong("gyro", 4.0))


@pytest.mark.parametrize("level", ["contact_m_per_sqrt_m", "gyro_bias_walk_rad_s_per_sqrt_s"])
def test_beside_a_factor_what_leaves_noise_that_nothing_has_is_no_account(level: str) -> None:
    """A camera whose headings were four times too large: a bias that wandered by 3.4 degrees a
    second in a second stood in for it, beside a bent gyro and a track (> .99 of a sealed case)."""
    block = of_a_gyro_that_reads_four_times_as_much()
    named = block.scan.account(frozenset({"gyro_bias"}))
    quiet = block.model.level_prior.median
    loud = quiet.copy()
    loud[LEVELS.index(level)] *= 200.0
    assert not block._accounts_for_nothing(replace(named, levels=quiet))
    assert block._accounts_for_nothing(replace(named, levels=loud))


@pytest.mark.parametrize(("side", "seed"), [("right_ticks", 2), ("left_ticks", 3)])
def test_no_factor_puts_a_log_in_order_in_which_a_wheel_counts_backwards(
    side: str, seed: int
) -> None:
    """Divided by 57 or by 256, both wheels make turns as large as the gyro's by chance, and ways
    that have no slope: a sign without its name was a unit, 0.998."""
    driven = trial_drive("calibration", np.random.default_rng(seed), FASTEST_M_S)
    log = synthetic_recording(ROBOT, WIRE, driven, (), 2, reference=ReferenceNoise())
    wrong_way = replace(log, **{side: -getattr(log, side)})
    assert looks_gross(wrong_way, ROBOT)
    for signal in ("left_ticks", "right_ticks", "ticks", "gyro"):
        for factor in (one for known in FACTORS for one in (known, 1 / known)):
            values = {"signal": signal, "factor": factor}
            still_wrong, _ = put_right(wrong_way, "setup_unit", values)
            assert order_of(still_wrong, ROBOT) is Order.NONE
    right, _ = put_right(wrong_way, "setup_sign", {"signal": side})
    assert order_of(right, ROBOT) is Order.WHOLE


@pytest.mark.parametrize("noise_m", [0.001, 0.02, 0.1])
@pytest.mark.parametrize("name", ["calibration", "straight", "stop_and_go", "square", "random"])
def test_a_healthy_log_is_in_order_however_its_reference_trembles(
    name: str, noise_m: float
) -> None:
    """On a straight nothing turns, and headings tremble by more than the wheels say."""
    noise = ReferenceNoise(position_m=noise_m, heading_rad=min(noise_m, 0.02))
    log = synthetic_recording(ROBOT, WIRE, scenario(name), (), 2, reference=noise)
    assert order_of(log, ROBOT) is Order.WHOLE


def test_a_gyro_that_trembles_on_a_straight_is_in_no_other_unit() -> None:
    """Its noise was all it said, of which no heading knew: it was in degrees (setup_unit, 0.98)."""
    straight = coarse_table("stop_and_go", 10, of_the_moment=True)
    assert order_of(straight, ROBOT) is Order.WHOLE
    in_degrees = coarse_table("random", 10, of_the_moment=True)
    assert in_degrees.gyro_rate_rad_s is not None
    in_degrees = replace(in_degrees, gyro_rate_rad_s=np.degrees(in_degrees.gyro_rate_rad_s))
    assert order_of(in_degrees, ROBOT) is Order.NONE


def test_a_loud_gyro_on_a_straight_is_in_no_other_unit_by_chance() -> None:
    """Noise of 0.1 rad/s added up to more than its mean in 5 of 30 drives: none was in order."""
    straight = coarse_table("stop_and_go", 10, of_the_moment=True)
    rate_rad_s = straight.gyro_rate_rad_s
    assert rate_rad_s is not None
    for seed in range(30):
        noise = np.random.default_rng(seed).normal(0, 0.1, len(rate_rad_s))
        loud = replace(straight, gyro_rate_rad_s=rate_rad_s + noise)
        assert order_of(loud, ROBOT) is Order.WHOLE, seed


def test_a_unit_is_told_of_a_straight_though_its_headings_tremble() -> None:
    noise = ReferenceNoise(heading_rad=0.02)
    log = synthetic_recording(
        ROBOT, WIRE, scenario("straight"), (), 2, reference=noise, duration_s=30.0
    )
    large = replace(log, left_ticks=10.0 * log.left_ticks, right_ticks=10.0 * log.right_ticks)
    block = MotionBlock(
        MotionModel(
            large,
            ROBOT,
            default_prior(),
            gross=True,
            without=frozenset(EXPLAINED) - {"radius_scale", "setup_unit"},
        )
    )
    assert block.fit(frozenset({"setup_unit"})).log_evidence > LEAST_GAIN


def test_wheel_speeds_whose_noise_is_as_large_as_their_turns_say_nothing_of_a_factor() -> None:
    """A car on a straight road: of what its wheels turned half was noise, and its gyro, of half of
    that, was told to read in a unit of two."""
    log = synthetic_recording(ROBOT, WIRE, scenario("straight"), (), 2, reference=None)
    rate = log.gyro_rate_rad_s
    assert rate is not None
    random = np.random.default_rng(1)
    weave = 0.02 * np.sin(0.5 * log.t_s)
    sd = 40.0  # of a tick's counts, of each wheel
    steps = sd * random.standard_normal((2, len(log.t_s)))
    turned = weave * log.tick_s * ROBOT.plant.wheels.wheelbase_m / ROBOT.plant.wheels.radius_m
    counts = turned / (2 * np.pi / ROBOT.plant.encoder.ticks_per_rev)
    noisy = replace(
        log,
        left_ticks=log.left_ticks + np.cumsum(steps[0] - 0.5 * counts),
        right_ticks=log.right_ticks + np.cumsum(steps[1] + 0.5 * counts),
        gyro_rate_rad_s=rate + weave,
    )
    assert looks_gross(noisy, ROBOT)
    known = replace(noisy, unsure_ticks2=np.full(steps.shape, sd**2))
    assert not looks_gross(known, ROBOT)


def test_half_the_counts_of_one_wheel_are_gross() -> None:
    """Where a robot turns half of its way, either turn is three quarters of what it should be, as
    far as any effect makes it: the counts were lost by chance, one in two, it was said (.97)."""
    random = np.random.default_rng(1)
    ahead, turn = random.standard_normal((2, 400))
    left, right = ahead - 1.3 * turn, ahead + 1.3 * turn
    assert not _Pair(right - left, right - left, wheels=np.array([-left, right])).is_of_one_wheel
    halved = _Pair(0.5 * right - left, right - left, wheels=np.array([-left, 0.5 * right]))
    assert not halved.is_gross
    assert halved.is_of_one_wheel


@pytest.mark.parametrize("signal", ["left_ticks", "ticks"])
def test_counts_in_a_unit_of_57_are_known_to_57_counts_when_it_is_undone(signal: str) -> None:
    """They were taken for as fine as any: what rounding had left of them no set-up explained, and
    a drive of a gain and a lag of no drive was 5,000 nats likelier (unlisted, 1.0)."""
    driven = trial_drive("squares", np.random.default_rng(3), FASTEST_M_S)
    settings = [EffectSetting("setup_unit", (("signal", signal), ("factor", np.pi / 180)))]
    log = synthetic_recording(
        ROBOT, WIRE, replace(driven, effects=()), settings, 1, reference=EXACT
    )
    drive = drive_block(log, ROBOT, COUNTS)
    assert drive is not None
    wrong_unit, of_no_drive = (
        drive.fit(frozenset(one)).log_evidence
        for one in ({"setup_unit"}, {"drive_gain", "drive_lag"})
    )
    assert wrong_unit > max(of_no_drive, drive.unexplained().log_evidence) + LEAST_GAIN
    undone, _ = put_right(log, "setup_unit", {"signal": signal, "factor": np.pi / 180})
    motion = MotionModel(undone, ROBOT, default_prior(), gross=True, without=FEW)
    # No floor is rough for it, and no gyro noisy.
    louder = motion.no_effect_levels / motion.level_prior.median
    assert louder[CONTACT] < 1.0
    assert louder[LEVELS.index("gyro_noise_rad_per_sqrt_s")] < 1.0


@pytest.mark.parametrize(("name", "seed"), [("tour", 5), ("weave", 5), ("weave", 6)])
def test_a_gyro_of_so_small_a_unit_that_its_noise_is_rounded_off_repeats_itself(
    name: str, seed: int
) -> None:
    """It was frozen for a second, and its producer stale now and then (.999)."""
    settings = [EffectSetting("setup_unit", (("signal", "gyro"), ("factor", np.pi / 180)))]
    driven = replace(trial_drive(name, np.random.default_rng(seed), FASTEST_M_S), effects=())
    log = synthetic_recording(ROBOT, WIRE, driven, settings, 1, reference=None)
    codes, bus = codes_block(log, ROBOT), bus_block(log, ROBOT, WIRE)
    assert codes is not None
    assert bus is not None
    assert codes.fit(frozenset({"gyro_frozen"})).log_evidence < 0
    assert bus.fit(frozenset({"stale_producer"})).log_evidence < 0
