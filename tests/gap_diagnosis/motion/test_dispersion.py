"""A log whose misfit hangs together says less than its likelihood does."""

from dataclasses import replace

import numpy as np
import pytest
from full_size import at_full_size
from motion_cases import ROBOT, SLIP_AND_BASE, calibration_drive

from gap_diagnosis.motion.accounts import Accounts, Found
from gap_diagnosis.motion.dispersion import dispersion
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Recording

PIECE_S = 2.0
UNEVEN = 0.05
"""A turn's share that one floor slips and the next does not: what carpets and ramps do."""


def on_many_floors(log: Recording, seed: int) -> Recording:
    """Return the log with a gyro that reads each piece of the drive by a scale of its own."""
    assert log.gyro_rate_rad_s is not None
    piece = ((log.t_s - log.t_s[0]) / PIECE_S).astype(np.int64)
    scale = 1 + UNEVEN * np.random.default_rng(seed).standard_normal(piece[-1] + 1)[piece]
    return replace(log, gyro_rate_rad_s=log.gyro_rate_rad_s * scale, gyro_code=None)


def dispersion_of(log: Recording, *effects: str) -> float:
    """Return the dispersion about these effects, fitted at the noise levels that suit them."""
    model = MotionModel(log, ROBOT, default_prior())
    of = {one.variant.effect: one for one in reversed(model.columns.terms)}
    terms = tuple(of[effect] for effect in effects)
    levels = model.levels_for(terms, model.level_prior.median)
    if not terms:
        return dispersion(model, (), (), levels)
    fit = model.refit(terms, levels)
    return dispersion(model, terms, fit.coefficients, fit.levels)


@pytest.mark.parametrize("seed", [1, *at_full_size(2)])
def test_a_drive_that_is_explained_scatters_as_its_noise_does(seed: int) -> None:
    assert (
        dispersion_of(calibration_drive(seed, *SLIP_AND_BASE), "lateral_slip", "wheelbase_scale")
        == 1.0
    )


def test_an_effect_that_is_not_in_the_fit_is_no_scatter() -> None:
    """All patterns of the library are fitted first: what is missing must not count against it."""
    assert dispersion_of(calibration_drive(3, *SLIP_AND_BASE)) == 1.0


def test_turns_that_each_go_their_own_way_say_less_than_their_likelihood() -> None:
    """Pieces with a scale each vary by what they turn, not by their samples: the likelihood takes
    each sample for news of its own. Levels grow until samples fit, and pieces do not."""
    assert dispersion_of(on_many_floors(calibration_drive(1), 1)) > 1.5


def test_a_set_gains_its_likelihood_divided_and_pays_its_prior_whole() -> None:
    accounts = Accounts(MotionModel(calibration_drive(1), ROBOT, default_prior()))
    levels = accounts.model.level_prior.median
    nothing, pair = frozenset[str](), frozenset({"lateral_slip", "wheelbase_scale"})
    likelihood, cost = 40.0, 10.0
    accounts.found = {
        nothing: Found(nothing, (), 5.0, 5.0, levels),
        pair: Found(pair, (), 5.0 + likelihood - cost, 5.0 + likelihood, levels),
    }
    accounts.dispersion = 4.0
    found = accounts.gained(accounts.found[pair])
    assert found == (likelihood / 4 - cost, likelihood / 4)
