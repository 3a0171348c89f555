"""What noise of speeds does to a log is as large as the filter says, and stands in no column."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from car_cases import read_car
from motion_cases import ROBOT, some_of, without_others
from scipy.signal import lfilter

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.levels import FLOORS, is_louder, level_prior
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.unknown import alternatives
from gap_diagnosis.motion.whitening import LEVELS, whiten
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats
from gap_diagnosis.speed_means import with_means_added_up

TRACK_M, FINE_S, LASTS_S, FIX_S = 0.1, 0.002, 60.0, 0.03
GYRO_RAD_S = 7e-4
NOISE_M_S = 0.008
MISMATCH = "radius_mismatch"


@dataclass(frozen=True)
class Drive:
    """How a small robot really goes, finely: float64[n] each."""

    t_s: Floats
    speed_m_s: Floats
    turn_rate_rad_s: Floats

    def wheel_m_s(self, side: float) -> Floats:
        """Return the speed of a wheel: -1 is the left one."""
        return self.speed_m_s + side * 0.5 * TRACK_M * self.turn_rate_rad_s


def drive(seed: int) -> Drive:
    """Return a drive of cruises, arcs, turns on the spot and rests of 3 s each."""
    rng = np.random.default_rng(seed)
    count = round(LASTS_S / 3.0)
    kinds = rng.choice(["straight", "turn", "arc", "rest"], count, p=[0.3, 0.2, 0.35, 0.15])
    speeds = np.where(np.isin(kinds, ["straight", "arc"]), rng.uniform(0.08, 0.25, count), 0.0)
    rates = np.where(np.isin(kinds, ["turn", "arc"]), rng.uniform(-2.0, 2.0, count), 0.0)
    t_s = np.arange(0.0, LASTS_S, FINE_S)
    stays = math.exp(-FINE_S / 0.08)
    speed, rate = (
        lfilter([1.0 - stays], [1.0, -stays], one[(t_s / 3.0).astype(np.int64)])
        for one in (speeds, rates)
    )
    return Drive(t_s, speed, rate)


def healthy(home: Path, seed: int, row_s: float, lasts_s: float = 0.0) -> MotionModel:
    """Return what a healthy robot's table and its tracker say of a drive: noise of its wheels' mean
    speeds lasts for *lasts_s*."""
    rng = np.random.default_rng(100 + seed)
    one = drive(seed)
    heading = np.cumsum(one.turn_rate_rad_s) * FINE_S
    rows_s = np.arange(0.5, LASTS_S - 0.5, row_s)
    stays = math.exp(-row_s / lasts_s) if lasts_s else 0.0

    def mean_over_rows(rate: Floats) -> Floats:
        return np.diff(np.interp(rows_s, one.t_s, np.cumsum(rate) * FINE_S)) / row_s

    def noise() -> Floats:
        fresh = NOISE_M_S * rng.standard_normal(len(rows_s) - 1)
        return lfilter([math.sqrt(1.0 - stays**2)], [1.0, -stays], fresh)

    speeds = [mean_over_rows(one.wheel_m_s(side)) + noise() for side in (-1.0, 1.0)]
    rate = mean_over_rows(one.turn_rate_rad_s)
    rate += GYRO_RAD_S * rng.standard_normal(len(rate))
    stamps = np.arange(0.7, LASTS_S - 0.7, FIX_S)
    places = (np.cumsum(one.speed_m_s * part(heading)) * FINE_S for part in (np.cos, np.sin))
    fixes = np.array([np.interp(stamps, one.t_s, place) for place in places])
    fixes += 5e-4 * rng.standard_normal(fixes.shape)
    table = np.column_stack([rows_s[1:], *speeds, rate])
    recording, robot = read_car(home, TRACK_M, table, np.column_stack([stamps, *fixes]))
    recording = with_means_added_up(recording, robot)
    without = without_others("small", {MISMATCH})
    return MotionModel(recording, robot, default_prior(), without=without)


def sizes_by_noise(model: MotionModel, draws: int) -> Floats:
    """Return what noise of speeds alone makes of a mismatch, float64[draws], each over its standard
    deviation: by a prediction that has as much more on each wheel."""
    nodes, motion = model.nodes, model.nodes.motion
    way_sd_m = NOISE_M_S * motion.tick_s * 1e-3
    random = np.random.default_rng(0)
    nominal = residuals(nodes, predict(nodes.smooth))
    columns = []
    for _ in range(draws):
        noisy = predict(nodes.smooth)
        noisy.left_m = noisy.left_m + way_sd_m * random.standard_normal(len(motion.t_s))
        noisy.right_m = noisy.right_m + way_sd_m * random.standard_normal(len(motion.t_s))
        columns.append((nominal - residuals(nodes, noisy)) * 1e3)
    (term,) = (one for one in model.columns.terms if one.variant.effect == MISMATCH)
    ((index, _),) = term.weights[0]
    values = np.stack([model.columns.values[..., 1 + index], *columns], axis=-1)
    block_m2 = (1e3 * way_sd_m) ** 2 * nodes.ticks
    course = replace(model.course, left_told_m2=block_m2, right_told_m2=block_m2)
    known = dict(zip(LEVELS, FLOORS, strict=True))
    known |= {"reference_position_m": 5e-4, "gyro_noise_rad_per_sqrt_s": 1e-4}
    levels = np.array([known[name] for name in LEVELS])
    white, _ = whiten(np.ascontiguousarray(values), course, levels, nodes.ticks)
    return white[:, 1:].T @ white[:, 0] / math.sqrt(float(white[:, 0] @ white[:, 0]))


@pytest.mark.parametrize("row_s", [0.05, 0.02], ids=["one row a block", "three rows a block"])
def test_a_mismatch_is_as_sure_as_noise_of_speeds_leaves_it(
    row_s: float, tmp_path: Path, size: str
) -> None:
    """Of three rows in a block the reference's samples lie now before and now after the middle, and
    positions told four times too surely where the robot was heading: healthy robots had wheels of
    two sizes by 128 nats."""
    for seed in some_of(size, (1, 2, 3)):
        sizes = sizes_by_noise(healthy(tmp_path, seed, row_s), draws=60)
        assert float(np.sqrt(np.mean(sizes**2))) < 1.25


@pytest.mark.parametrize("lasts_s", [0.0, 0.1], ids=["white", "0.1 s"])
def test_noise_of_speeds_is_told_with_how_long_it_lasts_and_is_no_unlisted_cause(
    lasts_s: float, tmp_path: Path, size: str
) -> None:
    """Noise that lasts for 0.1 s was taken for white: of 15 healthy robots with it five had a
    cause, up to 0.96; of these drives the wheels' speed was one by 50 nats."""
    for seed in some_of(size, (4, 5, 6, 7)):
        model = healthy(tmp_path, seed, 0.05, lasts_s)
        found = dict(zip(LEVELS, model.no_effect_levels, strict=True))
        if lasts_s:
            assert found["speed_noise_s"] == pytest.approx(lasts_s, rel=0.4)
        else:
            assert found["speed_noise_s"] < 0.04
        best = alternatives(model, model.no_effect_levels)[0]
        assert best.log_evidence < 4.0


def test_columns_have_little_of_the_noise_and_all_of_the_edges_of_speeds(tmp_path: Path) -> None:
    """What stands in the column and in the data alike is explained by it: where a wheel hardly
    turns, a function of its speed or of its reversals took its noise away, 16 nats."""
    row_s = 0.05
    smooth = healthy(tmp_path, 8, row_s).nodes.smooth
    one = drive(8)
    rows_s = np.arange(0.5, LASTS_S - 0.5, row_s)
    edges = np.abs(np.gradient(one.wheel_m_s(1.0), FINE_S)) > 0.05
    near = np.interp(rows_s, one.t_s, np.convolve(edges, np.ones(200), "same")) > 0.0
    true_m_s = np.diff(np.interp(rows_s, one.t_s, np.cumsum(one.wheel_m_s(1.0)) * FINE_S)) / row_s
    told_m_s = smooth.right_step_rad * smooth.radius_m / smooth.tick_s
    off_m_s, near = (told_m_s - true_m_s)[1:], near[2:]
    assert float(off_m_s[~near].std()) < 0.25 * NOISE_M_S
    assert float(off_m_s[near].std()) < NOISE_M_S


def test_noise_of_speeds_that_lasts_is_no_louder_for_that() -> None:
    """It adds up to as much, and has less that is quick: levels were sought from elsewhere too."""
    described = level_prior(ROBOT).median
    longer, louder = described.copy(), described.copy()
    longer[LEVELS.index("speed_noise_s")] *= 5.0
    louder[LEVELS.index("speed_noise")] *= 1.5
    assert not is_louder(longer, described)
    assert is_louder(louder, described)
