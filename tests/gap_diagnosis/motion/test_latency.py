"""A gyro stamped late in a table, whose rows have no counters to put them in place."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from motion_cases import coarse_table, model_of, nodes_of
from scipy.signal import lfilter

from gap_diagnosis.explanations.reference import turn_rate_with_details
from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.motion.bases import basis
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.estimate import estimate_motion
from gap_diagnosis.motion.evidence import score
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.offset import coarse_gyro_delay_s
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.motion.unknown import lay_out
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording, Reference
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.assembly import load_wire
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

LATE_TICKS = 3
LATE_S = 0.03


def table_with_a_late_gyro(ticks: int = LATE_TICKS, *, of_the_moment: bool = False) -> Recording:
    """Return a drive as a table has it, each gyro sample standing some rows too late; a mean since
    the row before, or the rate at the row's own moment."""
    return table_with_late(("gyro_code", "gyro_rate_rad_s"), ticks, of_the_moment=of_the_moment)


def table_with_late(
    columns: Sequence[str], ticks: int = LATE_TICKS, *, of_the_moment: bool = False
) -> Recording:
    """Return a drive as a table has it, each value of these columns standing some rows too late,
    and the gyro's rates means since the row before, or those at the rows' own moments."""
    whole = synthetic_recording(
        load_robot(),
        load_wire(),
        scenario("calibration"),
        (),
        seed=11,
        reference=ReferenceNoise(),
        contact_noise_m_per_sqrt_m=3e-4,
        duration_s=60.0,
    )
    said = {}
    for name in {*columns, "gyro_code", "gyro_rate_rad_s"}:
        if (values := getattr(whole, name)) is None:
            continue
        if of_the_moment and name.startswith("gyro"):
            values = 0.5 * (values + np.append(values[1:], values[-1]))
        if name in columns:
            values = np.concatenate([np.repeat(values[:1], ticks), values[:-ticks]])
        said[name] = values
    return replace(whole, frames={}, **said)


def test_a_slow_turn_that_changes_sides_has_no_details_of_a_straight_between() -> None:
    """As slow as counting errors are it was smoothed as a straight is, and the edges of that had
    details of 0.27 rad/s in a turn of 0.03: neither a late gyro fitted any more nor a slow one."""
    table = coarse_table("figure8", 2)
    motion = nodes_of(table).sharp
    assert table.gyro_rate_rad_s is not None
    turns = (motion.t_s > 4.0) & (motion.t_s < 48.0)
    off = turn_rate_with_details(motion) - table.gyro_rate_rad_s
    assert np.abs(off[turns]).max() < 0.06


def test_in_figures_of_eight_the_late_message_is_named() -> None:
    """A gyro 0.1 s late was an unlisted cause (0.96): no gap was likelier by 1,900 nats."""
    told_by = MotionBlock(
        model_of(coarse_table("figure8", 2, late_rows=5), "frame_latency", "gyro_lag")
    )
    likeliest = max(told_by.scan.found.values(), key=lambda one: one.log_evidence)
    assert likeliest.effects == {"frame_latency"}
    (term,) = likeliest.terms
    assert term.variant.report["frame"] == "IMU"
    delay = told_by.detail(likeliest.effects).parameters["frame_latency.delay"]
    low, high = np.quantile(delay.samples, [0.025, 0.975])
    assert low < 0.1 < high


@pytest.mark.parametrize("ticks_a_row", [5, 10])
def test_a_sample_of_the_moment_has_all_noise_that_its_gyro_lets_through(ticks_a_row: int) -> None:
    """Rows of 50 and 100 ms that each hold the last sample of 10 ms had a noisy gyro (0.92, 0.96),
    beside whatever else was wrong as well."""
    table = coarse_table("random", ticks_a_row, of_the_moment=True)
    block = MotionBlock(model_of(table, "gyro_noise"))
    assert block.fit(frozenset({"gyro_noise"})).log_evidence < 0.0


def test_a_gyro_that_is_noisier_than_any_sample_of_the_moment_is_told() -> None:
    density = 20.0 * load_robot().plant.gyro.noise_density_rad_per_sqrt_s
    noisy = coarse_table("random", 5, gyro_noise={"density": density})
    block = MotionBlock(model_of(noisy, "gyro_noise"))
    fit = block.fit(frozenset({"gyro_noise"}))
    assert fit.log_evidence > 6.0
    assert fit.parameters["gyro_noise.density"].value == pytest.approx(density, rel=0.15)


@pytest.fixture(scope="module")
def block() -> MotionBlock:
    listed = ("frame_latency", "gyro_lag", "reference_clock_skew", "reference_time_offset")
    return MotionBlock(model_of(table_with_a_late_gyro(), *listed))


def test_within_its_row_a_gyro_is_not_late(block):
    """A rate of the moment leads the mean since the row before by half a row: in a table of 20 ms a
    healthy robot's gyro was late by 3 ms (0.94)."""
    terms = [one for one in block.model.columns.terms if one.variant.effect == "frame_latency"]
    news_s = {one.variant.report["frame"]: one.tolerances[0] for one in terms}
    row_s = block.model.recording.tick_period_s
    assert news_s["IMU"] == news_s["ENCODER"] == pytest.approx(row_s)
    assert news_s["sensors"] < row_s


def test_late_counts_and_gyro_are_an_early_reference_and_leave_no_bend_beside_it(block):
    columns = block.model.columns
    (early,), (late,) = (
        [columns.values[:3, :, 1 + term.weights[0][0][0]]]
        for term in columns.terms
        if term.variant.effect == "reference_time_offset"
        or term.variant.report == {"frame": "sensors"}
    )
    assert np.nanmax(np.abs(early + late)) < 1e-9


def test_the_late_message_is_named(block):
    singles = [one for one in block.scan.found.values() if len(one.effects) == 1]
    best = max(singles, key=lambda one: one.log_evidence)
    assert best.effects == {"frame_latency"}
    assert best.terms[0].variant.report["frame"] == "IMU"


def test_the_delay_is_estimated_within_four_standard_deviations(block):
    delay = block.detail(frozenset({"frame_latency"})).parameters["frame_latency.delay"]
    assert abs(delay.value - LATE_S) < 4 * delay.sd


@pytest.mark.parametrize("of_the_moment", [False, True])
def test_a_gyros_delay_is_in_its_interval_be_it_a_mean_or_of_the_moment(block, of_the_moment):
    """In tables of another engine with a gyro of the moment a lag of 60 ms was told as 55.01 ms,
    54.68 to 55.34, and frames 40 ms late at 50 rows a second as 30.56 ms, 30.09 to 31.02."""
    told_by = block
    if of_the_moment:
        moments = table_with_a_late_gyro(of_the_moment=True)
        told_by = MotionBlock(model_of(moments, "frame_latency", "gyro_lag"))
    delay = told_by.detail(frozenset({"frame_latency"})).parameters["frame_latency.delay"]
    low, high = np.quantile(delay.samples, [0.025, 0.975])
    assert low < LATE_S < high
    assert high - low < 1.5 * 0.5 * told_by.model.recording.tick_period_s


@pytest.mark.parametrize("has_reference", [True, False])
@pytest.mark.parametrize("of_the_moment", [False, True])
def test_a_delay_of_wheels_beside_a_gyro_is_in_its_interval_too(has_reference, of_the_moment):
    """Beside a gyro of the moment, and no reference, wheels 30 ms late were so by 31 to 39 ms."""
    table = table_with_late(("left_ticks", "right_ticks"), of_the_moment=of_the_moment)
    table = table if has_reference else replace(table, reference=None)
    told_by = MotionBlock(model_of(table, "frame_latency", "gyro_lag"))
    told = told_by.detail(frozenset({"frame_latency"})).parameters
    delay = told["frame_latency.delay"]
    low, high = np.quantile(delay.samples, [0.025, 0.975])
    assert told["frame_latency.frame"].value == "ENCODER"
    assert low < LATE_S < high
    assert delay.is_either is not has_reference


def test_sensors_late_beside_a_reference_as_late_are_one_delay_and_no_choice(block):
    """Of a real Kobuki both were 7 s late, 0.81: so far apart fewer rows are compared."""
    both = frozenset({"frame_latency", "reference_time_offset"})
    found = block.scan.account(both)
    assert {"frame": "sensors"} not in [term.variant.report for term in found.terms]
    told = block.detail(both).parameters
    probabilities = told["frame_latency.frame"].probabilities
    assert probabilities is not None
    assert "sensors" not in probabilities
    assert abs(told["frame_latency.delay"].value) < 2 * LATE_S


def test_where_surprises_hang_together_the_delay_is_less_sure(block, monkeypatch):
    sure = block.detail(frozenset({"frame_latency"})).parameters["frame_latency.delay"]
    monkeypatch.setattr(block.scan, "dispersion", 4.0)
    unsure = block.detail(frozenset({"frame_latency"})).parameters["frame_latency.delay"]
    # The same draws, of twice the deviation, less those within tolerance; every other one is later
    # by half a row, as a rate of the moment is.
    as_means, sure_as_means = unsure.samples[::2].std(), sure.samples[::2].std()
    assert as_means == pytest.approx(2 * sure_as_means, rel=0.02)


def test_frames_without_counters_may_be_late_as_the_rows_of_a_table_may():
    whole = synthetic_recording(
        load_robot(), load_wire(), scenario("straight"), (), seed=3, reference=None, duration_s=5.0
    )
    plain = {name: replace(one, modulo=0) for name, one in whole.frames.items()}
    for recording, has_counters in ((whole, True), (replace(whole, frames=plain), False)):
        motion = estimate_motion(recording, load_robot())
        assert motion.has_counters == has_counters
        late = EXPLAINED["frame_latency"].variants(motion)
        assert {one.report["frame"] for one in late} == (
            set() if has_counters else {"IMU", "ENCODER", "sensors"}
        )


def test_a_gyro_eight_rows_late_is_seen_before_any_fit():
    late = table_with_a_late_gyro(8)
    delay_s = coarse_gyro_delay_s(estimate_motion(late, load_robot()))
    assert abs(delay_s - 0.08) < 0.01


def test_on_a_straight_drive_no_delay_of_the_gyro_is_made_up():
    straight = synthetic_recording(
        load_robot(), load_wire(), scenario("straight"), (), seed=3, reference=None, duration_s=30.0
    )
    assert coarse_gyro_delay_s(estimate_motion(straight, load_robot())) == 0.0


def test_a_long_delay_beside_a_bias_is_told_where_gyro_and_wheels_are_all_there_is():
    late = table_with_a_late_gyro(8)
    rate = late.gyro_rate_rad_s
    assert rate is not None
    biased = replace(late, gyro_rate_rad_s=rate + 0.01, gyro_code=None, reference=None)
    model = MotionModel(biased, load_robot(), default_prior())
    terms = {}
    for term in model.columns.terms:
        if term.variant.act is term.variant.large or term.variant.effect == "gyro_bias":
            terms[term.variant.effect] = term
    found = model.refit((terms["frame_latency"], terms["gyro_bias"]), model.level_prior.median)
    (delay_s,), (bias,) = found.coefficients
    assert abs(delay_s - 0.08) < 0.004
    assert abs(bias - 0.01) < 0.0005


@pytest.fixture(scope="module")
def trembling() -> MotionModel:
    """A drive of whose every third row alone is left, and that a little beside its time."""
    whole = synthetic_recording(
        load_robot(),
        load_wire(),
        scenario("calibration"),
        (),
        seed=5,
        reference=ReferenceNoise(position_m=2e-4, heading_rad=4e-4),
        contact_noise_m_per_sqrt_m=3e-4,
        duration_s=60.0,
    )
    rate, t_s = whole.gyro_rate_rad_s, whole.t_s[::3]
    assert rate is not None  # the shipped robot has a gyro
    beside_s = 1e-3 * np.random.default_rng(5).standard_normal(len(t_s))
    rows = Recording(
        name="rows",
        tick_period_s=3 * whole.tick_period_s,
        t_s=t_s + beside_s,
        stamp_s=t_s,
        tick=np.arange(len(t_s)),
        left_ticks=whole.left_ticks[::3],
        right_ticks=whole.right_ticks[::3],
        gyro_rate_rad_s=np.convolve(rate, np.full(3, 1 / 3))[: len(rate) : 3],
        reference=whole.reference,
    )
    return MotionModel(rows, load_robot(), default_prior())


def test_a_way_without_its_bends_passes_for_no_delay(trembling):
    levels = trembling.levels_for((), trembling.level_prior.median)
    terms = {
        term.variant.effect: term
        for term in trembling.columns.terms
        if term.variant.report.get("frame", "sensors") == "sensors"
    }
    skew = score(trembling.gram(levels), [terms["reference_clock_skew"]], trembling.prior)
    assert skew.log_evidence < 6.0
    late = trembling.evidence_about([terms["frame_latency"]], [(0.015,)], levels)
    nothing = trembling.evidence_at((), levels) + trembling.level_prior.log_density(np.log(levels))
    assert late.log_likelihood < nothing + 3.0


TICK_S = 0.01
SLOW_S = 0.06


def late(rate):
    t_s = TICK_S * np.arange(len(rate))
    return np.interp(t_s - SLOW_S, t_s, rate)


def trailing(rate):
    share = -np.expm1(-TICK_S / SLOW_S)
    return lfilter([share], [1, share - 1], rate)


def slow_turns(shows, ticks: int) -> Recording:
    """Return a drive whose turns begin slowly, as a car's do, with what a gyro *shows* of them."""
    random = np.random.default_rng(7)
    plant = load_robot().plant
    share = -np.expm1(-TICK_S / 0.3)
    wanted = np.repeat(random.uniform(-0.4, 0.4, ticks // 600), 600)
    rate = lfilter([share], [1, share - 1], lfilter([share], [1, share - 1], wanted))
    t_s = TICK_S * np.arange(ticks)
    speed = 0.5 + 0.2 * np.sin(2 * np.pi * t_s / 23)
    heading, way = TICK_S * np.cumsum(rate), TICK_S * np.cumsum(speed)
    to_side = 0.5 * plant.wheels.wheelbase_m * heading
    per_m = plant.encoder.ticks_per_rev / (2 * np.pi * plant.wheels.radius_m)
    left, right = np.floor((way - to_side) * per_m), np.floor((way + to_side) * per_m)
    seen = slice(None, None, 10)
    x_m, y_m = (
        (TICK_S * np.cumsum(speed * one(heading)))[seen] + random.normal(0, 0.02, ticks // 10)
        for one in (np.cos, np.sin)
    )
    headings = heading[seen] + random.normal(0, 0.003, ticks // 10)
    return Recording(
        "slow turns",
        TICK_S,
        t_s,
        t_s,
        np.arange(ticks),
        left - left[0],
        right - right[0],
        gyro_rate_rad_s=shows(rate) + random.normal(0, 0.0005, ticks),
        reference=Reference(t_s[seen], x_m, y_m, headings),
    )


def test_a_late_gyro_is_not_put_back_by_a_lag_below_zero():
    """It was: by 5 of 60 ms, and by 13 ms beside turns that were smoothed."""
    model = MotionModel(slow_turns(late, 6000), load_robot(), default_prior())
    (term,) = (one for one in model.columns.terms if one.variant.report == {"frame": "IMU"})
    ((delay_s,),) = model.refit((term,), model.level_prior.median).coefficients
    assert delay_s == pytest.approx(SLOW_S, abs=0.002)


def test_what_looks_like_an_effect_of_the_best_set_is_fitted_in_its_place():
    """Along chords to their usual sizes a late gyro lacked 38 nats beside a slow one, and fitted it
    was the likelier by 6."""
    scan = Scan(model_of(slow_turns(trailing, 9000), "frame_latency", "gyro_bias", "gyro_lag"))
    best = max(scan.found.values(), key=lambda one: one.log_evidence)
    assert "gyro_lag" in best.effects
    alike = scan.found[best.effects - {"gyro_lag"} | {"frame_latency"}]
    assert alike.refitted is not None
    assert alike.log_evidence < best.log_evidence


def test_within_its_row_a_late_gyro_is_no_cause_without_a_name(block):
    """Of a small robot at 20 rows a second, a gyro late by 0.6 of a row was one (0.96): what
    goes with the turn's change was no gap up to 1 ms, and not up to half a row."""
    (plan,) = lay_out(block.model, only=("gyro", "acceleration")).plans
    within_rad_s = max(float(sizes[-1].max()) for _, sizes in plan.shapes)
    per_s = max(basis(block.model.nodes.smooth, "gyro", "acceleration").within_per_s)
    assert within_rad_s == pytest.approx(0.5 * block.model.recording.tick_period_s * per_s)
