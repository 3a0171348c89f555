"""Evidence in closed form is the integral it stands for."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import multivariate_normal, norm

from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.components import gains
from gap_diagnosis.motion.evidence import Gram, gram_of, score
from gap_diagnosis.priors import default_prior

PRIOR = default_prior()
TOLERANCE = PRIOR.of("radius_scale", "scale").tolerance
HIGH = PRIOR.of("radius_scale", "scale").high


def term_of(effect: str, index: int = 0) -> Term:
    variant, *_ = EXPLAINED[effect].variants(None)  # type: ignore[arg-type]
    return Term(
        variant,
        tuple((((index + place), 1.0),) for place in range(len(variant.coefficients))),
        tuple(PRIOR.of(effect, name).tolerance for name in variant.coefficients),
    )


def gram_with(inner: float, data: float) -> Gram:
    one, two = np.array([[inner]]), np.array([data])
    return Gram(np.ones(8), 0.0, one, two, one, two)


def integrated(inner: float, data: float, tolerance: float, high: float, positive: bool) -> float:
    """Return the log of the mean likelihood over the prior, outside the tolerance, by quadrature.

    The prior is a mixture of five normals, each cut off within the tolerance.
    """
    peak = data / inner
    top = max(0.5 * data * peak, 0.0)

    def likelihood(value: float) -> float:
        return math.exp(data * value - 0.5 * inner * value**2 - top)

    total = 0.0
    for sd in np.geomspace(max(tolerance, 1e-3 * high), high, 5):
        sides = (
            [(tolerance, 12 * sd)] if positive else [(tolerance, 12 * sd), (-12 * sd, -tolerance)]
        )
        outside = norm.sf(tolerance / sd) * len(sides)
        width = 10 / math.sqrt(inner)
        for low, up in sides:
            # Inside the tolerance the likelihood falls off steeply from the edge on.
            fall = 30 / (inner * tolerance)
            marks = [peak - width, peak, peak + width, tolerance + fall, -tolerance - fall]
            marks = [one for one in marks if low < one < up]
            part, _ = quad(
                lambda value, sd=sd: likelihood(value) * norm.pdf(value, scale=sd),
                low,
                up,
                points=marks or None,
                limit=500,
            )
            total += part / outside / 5
    return math.log(total) + top


@pytest.mark.parametrize("sharpness", [0.5, 3.0, 30.0])
@pytest.mark.parametrize("size", [-8.0, -2.0, 0.0, 0.7, 1.5, 5.0])
def test_one_coefficient_is_integrated_exactly_with_what_is_no_news_cut_off(sharpness, size):
    inner = (sharpness / TOLERANCE) ** 2
    data = inner * size * TOLERANCE
    found = score(gram_with(inner, data), [term_of("radius_scale")], PRIOR)
    expected = integrated(inner, data, TOLERANCE, HIGH, positive=False)
    assert found.log_evidence == pytest.approx(expected, abs=0.02, rel=1e-4)


@pytest.mark.parametrize("size", [0.5, 2.0, 6.0])
def test_a_size_that_cannot_be_negative_is_integrated_over_its_half_line(size):
    known = PRIOR.of("lateral_slip", "compliance")
    inner = (2.0 / known.tolerance) ** 2
    data = inner * size * known.tolerance
    found = score(gram_with(inner, data), [term_of("lateral_slip")], PRIOR)
    expected = integrated(inner, data, known.tolerance, known.high, positive=True)
    assert found.log_evidence == pytest.approx(expected, abs=0.02, rel=1e-4)


@pytest.mark.parametrize(("near", "far"), [(2.0, 4.0), (3.0, 5.0), (2.0, 7.5)])
def test_a_size_beyond_the_end_of_its_prior_is_as_rare_as_its_square_says(near, far):
    """A normal tail has 30 nats against 7.5 times the end: of two parameters that are far off
    together, each would be told as off by half."""
    inner = (100.0 / HIGH) ** 2
    rare = []
    for times in (near, far):
        found = score(gram_with(inner, inner * times * HIGH), [term_of("radius_scale")], PRIOR)
        beyond_tolerance = 2.0 * norm.sf(TOLERANCE / (times * HIGH))
        rare.append(found.log_evidence - found.log_likelihood + math.log(beyond_tolerance))
    # The prior's next order of magnitude, less than half as large, has a thousandth of the sum.
    assert rare[0] - rare[1] == pytest.approx(2.0 * math.log(far / near), abs=0.002)


def test_a_size_that_no_effect_has_is_as_rare_as_a_normal_tail_says():
    inner = (100.0 / HIGH) ** 2
    most = PRIOR.of("radius_scale", "scale").most
    rare = []
    for size in (most, 2.0 * most):
        found = score(gram_with(inner, inner * size), [term_of("radius_scale")], PRIOR)
        rare.append(found.log_evidence - found.log_likelihood)
    assert rare[0] - rare[1] == pytest.approx(0.5 * (2.0**2 - 1.0), abs=0.002)


def test_the_gain_in_likelihood_is_that_of_least_squares():
    inner, size = 4e6, 0.003
    found = score(gram_with(inner, inner * size), [term_of("radius_scale")], PRIOR)
    assert found.log_likelihood == pytest.approx(0.5 * inner * size**2, rel=1e-6)


def test_an_effect_without_a_size_has_the_evidence_of_being_there_as_it_is():
    variant = Variant("setup_wheels_swapped", lambda prediction: None)
    term = Term(variant, (((0, 1.0),),), ())
    found = score(gram_with(9.0, 7.0), [term], PRIOR)
    assert found.log_evidence == pytest.approx(7.0 - 4.5)


def test_tolerances_are_marginalised_as_a_dense_normal_has_it():
    random = np.random.default_rng(3)
    columns = random.standard_normal((30, 4))
    data = random.standard_normal(30) + columns[:, 1]
    whole = np.column_stack([data, columns])
    nuisances = [(1, 0.7), (3, 0.2)]
    found = gram_of(whole, np.zeros(30), nuisances, np.ones(8))
    spread = np.eye(30)
    for index, sd in nuisances:
        spread += sd**2 * np.outer(columns[:, index], columns[:, index])
    dense = multivariate_normal(np.zeros(30), spread)
    assert found.log_nothing == pytest.approx(dense.logpdf(data))
    inverse = np.linalg.inv(spread)
    np.testing.assert_allclose(found.inner, columns.T @ inverse @ columns, atol=1e-9)
    np.testing.assert_allclose(found.data, columns.T @ inverse @ data, atol=1e-9)


def test_an_effect_is_the_whole_deviation_no_tolerance_of_its_own_is_free_beside_it() -> None:
    """Chord and tangent of a clock's skew, both free, left the bends of the way between them: 35
    nats of nothing in a healthy robot's log, and in most of its pairs."""
    random = np.random.default_rng(4)
    tangent, other, noise = random.standard_normal((3, 30))
    bend = random.standard_normal(30)
    chord = tangent + 0.1 * bend
    data = noise + 0.5 * bend
    sizes = term_of("radius_scale").tolerances
    white = np.column_stack([data, *(one / sizes[0] for one in (chord, tangent, other))])
    term = Term(term_of("radius_scale").variant, (((0, 1.0), (1, 0.0)),), sizes)

    gram = gram_of(white, np.zeros(30), [(1, sizes[0]), (2, sizes[0])], np.ones(8))
    found = score(gram, [term], PRIOR)
    alone = gram_of(white, np.zeros(30), [(2, sizes[0])], np.ones(8))
    expected = score(alone, [term_of("radius_scale")], PRIOR)
    cost = alone.log_nothing - gram.log_nothing
    assert found.log_evidence == pytest.approx(cost + expected.log_evidence)
    assert found.log_likelihood == pytest.approx(cost + expected.log_likelihood)
    np.testing.assert_allclose(found.means, expected.means)


def test_a_load_cannot_make_one_wheel_larger() -> None:
    """Both wheels pressed, or one pressed and one blown up, at the same likelihood."""
    size, sd = 0.01, 0.001
    inner = np.eye(2) / sd**2

    def evidence(left: float, right: float) -> float:
        data = inner @ np.array([left, right])
        found = score(Gram(np.ones(8), 0.0, inner, data, inner, data), [term_of("payload")], PRIOR)
        return found.log_evidence

    assert evidence(size, size) - evidence(-size, size) == pytest.approx(-norm.logcdf(-10), abs=1)


def test_levels_at_which_the_filter_runs_out_of_digits_explain_nothing() -> None:
    white, log_variance = np.full((30, 3), np.nan), np.full(30, np.nan)
    found = gram_of(white, log_variance, [(0, 1.0)], np.ones(9))
    assert found.log_nothing < -1e9
    assert np.isfinite(found.inner).all()


def test_a_step_of_a_fit_to_where_columns_outgrow_all_digits_leads_nowhere() -> None:
    """Beside a scrub of nearly -1 columns were 1e12 large; the sealed trial's case 2870 crashed."""
    rng = np.random.default_rng(3)
    white = rng.standard_normal((30, 3))
    white[:, 2] = 1e20 * white[:, 1]
    white[:, 1] *= 1e20 * (1.0 + 1e-16)
    found = gram_of(white, np.zeros(30), [(0, 1.0), (1, 1.0)], np.ones(9))
    assert found.log_nothing < -1e9
    assert np.isfinite(found.inner).all()


def test_coefficients_within_no_tolerance_gain_what_their_prior_spreads_the_data_by() -> None:
    """Marginally, data of unit noise with columns of normal sizes are normal; the gain is over
    data of noise alone."""
    random = np.random.default_rng(3)
    columns, data = random.standard_normal((20, 3)), random.standard_normal(20)
    scales = np.array([[0.1, 0.2, 0.3], [1.0, 2.0, 0.5]])
    evidences, likelihoods = gains(columns.T @ columns, columns.T @ data, scales)
    for scale, evidence, likelihood in zip(scales, evidences, likelihoods, strict=True):
        spread = np.eye(20) + (columns * scale**2) @ columns.T
        gained = multivariate_normal(np.zeros(20), spread).logpdf(data)
        assert evidence == pytest.approx(gained - norm.logpdf(data).sum(), rel=1e-9)
        mean = np.linalg.solve(columns.T @ columns + np.diag(scale**-2.0), columns.T @ data)
        left = norm.logpdf(data - columns @ mean).sum()
        assert likelihood == pytest.approx(left - norm.logpdf(data).sum(), rel=1e-9)
