"""Evidence and draws of a fitted set follow its effects as they act, not along straight lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from motion_cases import ROBOT, WIRE
from numpy.typing import NDArray
from scipy.stats import kstest, norm, truncnorm

from gap_diagnosis.explanations import predict
from gap_diagnosis.motion.accounts import NEAR, Found
from gap_diagnosis.motion.block import MotionBlock
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.drawing import draw, is_news
from gap_diagnosis.motion.evidence import Scored, gram_of, log_sum, scales_of
from gap_diagnosis.motion.importance import Bends, Corrected, Drawn
from gap_diagnosis.motion.model import MotionModel, Refitted
from gap_diagnosis.motion.nodes import residuals
from gap_diagnosis.motion.posterior import Posterior
from gap_diagnosis.motion.whitening import whiten
from gap_diagnosis.motion.windows import at_window
from gap_diagnosis.pareto import TRUSTED, smoothed, tail_shape
from gap_diagnosis.prediction import Prediction
from gap_diagnosis.priors import default_prior
from gap_diagnosis.synthetic import ReferenceNoise, synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

Floats = NDArray[np.float64]

BENT = ("gyro_scale", "radius_scale", "gyro_bias")
SETTINGS = [
    EffectSetting("gyro_scale", (("scale", 0.1),)),
    EffectSetting("radius_scale", (("scale", 0.1),)),
    EffectSetting("gyro_bias", (("bias", 0.02),)),
]
RECORDING = synthetic_recording(
    ROBOT, WIRE, scenario("square"), SETTINGS, 3, reference=ReferenceNoise(), duration_s=25.0
)
MODEL = MotionModel(RECORDING, ROBOT, default_prior())


@cache
def straight(*names: str, noise: float = 30.0) -> tuple[tuple[Term, ...], Refitted]:
    """Return effects fitted to the log as if its noise were so many times as large."""
    terms = tuple(
        next(one for one in MODEL.columns.terms if one.variant.effect == name) for name in names
    )
    levels = noise * MODEL.levels_for(terms, MODEL.level_prior.median)
    return terms, MODEL.refit(terms, levels, free_levels=False)


@cache
def fitted(*names: str) -> tuple[tuple[Term, ...], Refitted]:
    """Return the same with the first effect bent: a standard deviation from the fit it acts 1.8
    times as far, two 3.6 times."""
    return bent_by(lambda away: 0.5 * np.sinh(2.0 * away), *straight(*names))


def bent_by(
    bend: Callable[[float], float], terms: tuple[Term, ...], fit: Refitted
) -> tuple[tuple[Term, ...], Refitted]:
    """Return a fit whose first effect acts *bend* standard deviations from it."""
    scored = Bends(MODEL, terms, fit).scored
    sd = float(np.sqrt(scored.covariances[int(np.argmax(scored.weights)), 0, 0]))
    first, ((best,), *_) = terms[0].variant, fit.coefficients
    act = first.act

    def bent(prediction: Prediction, scale: float) -> None:
        act(prediction, scale=best + sd * float(bend((scale - best) / sd)))

    variant = replace(first, act=bent, exact=None, little=None, large=None)
    return (replace(terms[0], variant=variant), *terms[1:]), fit


def gained(bends: Bends) -> float:
    """Return what the bends add to the log evidence."""
    found = bends.corrected()
    along = bends.scored.log_evidence - bends.scored.log_likelihood
    return found.log_evidence - found.log_likelihood - along


def log_prior(terms: Sequence[Term], sizes: Floats) -> float:
    """Return the log density of single sizes beyond their tolerances (motion/evidence.py)."""
    total = 0.0
    for term, size in zip(terms, sizes, strict=True):
        (tolerance,) = term.tolerances
        if (size if term.variant.is_positive else abs(size)) <= tolerance:
            return -np.inf
        scales = scales_of(MODEL.prior, term)[:, 0]
        beyond = norm.sf(tolerance / scales) * (1 if term.variant.is_positive else 2)
        total += log_sum(norm.logpdf(size, 0, scales) - np.log(beyond)) - np.log(len(scales))
    return total


def likelihoods(names: Sequence[str], sizes: Floats) -> tuple[Floats, Floats]:
    """Return log likelihoods of sizes float64[n, k] as effects act and along the lines about the
    fit, tolerances marginalised."""
    terms, fit = fitted(*names)
    values, nuisances, _ = MODEL.linearised(terms, fit.coefficients, fit.levels)
    known = values[..., 1 : len(nuisances) + 1]
    lines = values[..., len(nuisances) + 1 :]
    best = np.array([one for (one,) in fit.coefficients])
    nodes = MODEL.nodes
    course = MODEL.scattered(terms, fit.coefficients, fit.levels)

    def changes(some: Floats) -> Floats:
        settings = [(t.variant, (float(one),)) for t, one in zip(terms, some, strict=True)]
        return residuals(nodes, predict(nodes.smooth, settings))

    def likelihoods_of(left: Sequence[Floats]) -> list[float]:
        """Return one for each; what is whitened together shares the filter's gains."""
        columns = np.concatenate([np.stack(left, axis=-1), known], axis=-1)
        white, log_variance = whiten(np.ascontiguousarray(columns), course, fit.levels, nodes.ticks)
        free = white[:, len(left) :]
        return [
            gram_of(np.column_stack([own, free]), log_variance, nuisances, fit.levels).log_nothing
            for own in white[:, : len(left)].T
        ]

    about = values[..., 0] - lines @ best - changes(best)
    bent: list[float] = []
    straight: list[float] = []
    for some in np.array_split(sizes, math.ceil(len(sizes) / 64)):
        bent += likelihoods_of([about + changes(one) for one in some])
        straight += likelihoods_of([values[..., 0] - lines @ one for one in some])
    return np.array(bent), np.array(straight)


def by_brute_force(names: Sequence[str], points: int) -> float:
    """Return what bends add to the log evidence, by a grid over six standard deviations to each
    side of the posterior along the lines."""
    terms, fit = fitted(*names)
    scored = Bends(MODEL, terms, fit).scored
    shares = scored.weights / scored.weights.sum()
    mean = shares @ scored.means
    away = scored.means - mean
    spread = np.einsum("s,sij->ij", shares, scored.covariances)
    spread += np.einsum("s,si,sj->ij", shares, away, away)
    axis = np.linspace(-6.0, 6.0, points)
    grid = mean + np.array(list(product(axis, repeat=len(names)))) @ np.linalg.cholesky(spread).T
    priors = np.array([log_prior(terms, one) for one in grid])
    grid, priors = grid[np.isfinite(priors)], priors[np.isfinite(priors)]
    bent, straight = likelihoods(names, grid)
    return log_sum(bent + priors) - log_sum(straight + priors)


def test_a_weight_is_the_likelihood_as_the_effects_bend_over_that_along_the_lines() -> None:
    terms, fit = fitted(*BENT)
    best = np.array([one for (one,) in fit.coefficients])
    sizes = np.stack([best, best + np.array([0.02, -0.001, 0.001])])
    bent, straight = likelihoods(BENT, sizes)
    weights = Bends(MODEL, terms, fit).log_weights(sizes)
    assert weights == pytest.approx(bent - straight, abs=1e-6)
    assert weights[0] == pytest.approx(0.0, abs=1e-6), "there the lines touch the effects"
    assert abs(weights[1]) > 1.0, "so far off the lines are astray"


@pytest.mark.full_size
def test_the_evidence_of_three_bent_sizes_is_that_of_brute_force() -> None:
    bends = Bends(MODEL, *fitted(*BENT))
    found = bends.corrected()
    assert found.pareto_k is not None
    assert found.pareto_k < TRUSTED
    assert found.error < 0.1
    assert gained(bends) < -0.3, "so much the straight lines say too much"
    assert gained(bends) == pytest.approx(by_brute_force(BENT, 13), abs=0.1)


@pytest.mark.parametrize("names", [BENT[:1], BENT[:2]])
def test_the_evidence_of_one_and_two_bent_sizes_is_that_of_brute_force(
    names: tuple[str, ...],
) -> None:
    bends = Bends(MODEL, *fitted(*names))
    assert bends.corrected().pareto_k is None
    assert gained(bends) == pytest.approx(by_brute_force(names, 41), abs=0.1)


def test_a_posterior_that_goes_on_beyond_the_nodes_is_not_told_for_sure() -> None:
    """Far off the effect hardly grows: neither nodes nor draws reach where it is as likely. Its
    evidence was that of the lines, and nothing said so."""
    terms, fit = bent_by(np.arcsinh, *straight(*BENT[:2], noise=3.0))
    found = Bends(MODEL, terms, fit).corrected()
    assert found.pareto_k is not None
    assert found.pareto_k > TRUSTED


@pytest.mark.parametrize("names", [BENT[:1], BENT[:2], BENT, (*BENT, "wheelbase_scale")])
def test_along_straight_lines_nothing_is_to_be_corrected(names: tuple[str, ...]) -> None:
    bends = Bends(MODEL, *straight(*names))
    assert gained(bends) == pytest.approx(0.0, abs=0.02)
    assert bends.corrected().pareto_k is None


def test_draws_are_weighed_as_the_effects_bend() -> None:
    """Their mean is that of the effects' own posterior, on a grid along the lines."""
    bends = Bends(MODEL, *fitted(*BENT))
    drawn = bends.drawn(2000)
    again = drawn.resampled(4000, np.random.default_rng(1))
    assert drawn.log_weights is not None
    weights = np.exp(drawn.log_weights - drawn.log_weights.max())
    mean = weights @ drawn.sizes / weights.sum()
    assert again.mean(axis=0) == pytest.approx(mean, abs=0.1 * float(drawn.sizes.std()))
    plain = Drawn(drawn.sizes)
    assert np.array_equal(plain.resampled(10, np.random.default_rng(1)), drawn.sizes[:10])


def pressed() -> tuple[Term, Scored]:
    """Return a load over the left wheel, of which the right one's share lies a standard deviation
    below 0."""
    term = next(one for one in MODEL.columns.terms if one.variant.effect == "payload")
    scored = Scored(
        (term,),
        log_evidence=0.0,
        log_likelihood=0.0,
        means=np.array([[0.01, -0.001]]),
        covariances=1e-6 * np.eye(2)[np.newaxis],
        weights=np.array([1.0]),
    )
    return term, scored


def test_sizes_that_cannot_be_negative_are_drawn_from_what_lies_above_0() -> None:
    term, scored = pressed()
    sizes = draw(scored, [term], np.random.default_rng(1))
    above = truncnorm(1.0, np.inf, loc=-0.001, scale=0.001)
    assert (sizes >= 0).all()
    assert kstest(sizes[:, 1], above.cdf).pvalue > 1e-3


def test_a_draw_with_a_size_that_cannot_be_negative_has_no_weight() -> None:
    term, _ = pressed()
    assert is_news(np.array([[0.01, 0.0], [0.01, -0.001], [-0.01, 0.01]]), [term]).tolist() == [
        True,
        False,
        False,
    ]


@pytest.mark.parametrize(("lacks", "weighed"), [(1.0, 2), (10.0, 1)])
def test_a_variant_that_its_fit_shows_to_be_unlikely_is_not_weighed_as_it_bends(
    lacks: float, weighed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    terms, fit = fitted(*BENT)
    twin = replace(terms[-1])
    scan = SimpleNamespace(
        dispersion=1.0,
        by_effect={term.variant.effect: [term] for term in terms},
        evidence=lambda terms, levels: 0.0,
    )
    scan.by_effect[BENT[-1]].append(twin)
    less = replace(fit, log_evidence=fit.log_evidence - lacks)
    monkeypatch.setattr(MotionModel, "refit", lambda *_, **__: less)
    asked = []
    drawn = Bends.drawn
    monkeypatch.setattr(Bends, "drawn", lambda *args: asked.append(args) or drawn(*args))
    found = Found(frozenset(BENT), terms, 0.0, 0.0, fit.levels, fit)
    parameters, _, pareto_k = Posterior(MODEL, scan).estimates(found, fit)
    assert len(asked) == weighed
    assert len(parameters) == len(BENT)
    assert pareto_k is not None


def test_a_side_for_which_straight_lines_alone_speak_is_not_the_likelier_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A lawnmower's slip was told with the right wheel's size and window, "probability < 0.1 %":
    along straight lines the left one's was worth 220 nats more, and as it acts less."""
    terms, fit = fitted("extra_ticks")
    mine = replace(terms[0], variant=replace(terms[0].variant, report={"side": "right"}))
    other = replace(terms[0], variant=replace(terms[0].variant, report={"side": "left"}))
    scan = SimpleNamespace(
        dispersion=1.0,
        spans={},
        by_effect={"extra_ticks": [mine, other]},
        evidence=lambda terms, levels: 220.0 if terms[-1] is other else 0.0,
    )
    less = replace(fit, log_evidence=fit.log_evidence - 40.0)
    monkeypatch.setattr(MotionModel, "refit", lambda *_, **__: less)
    found = Found(frozenset({"extra_ticks"}), (mine,), 0.0, 0.0, fit.levels, fit)
    side = Posterior(MODEL, scan).estimates(found, fit)[0]["extra_ticks.side"]
    assert side.value == "right"
    assert side.probabilities is not None
    assert side.probabilities["right"] > 0.999


def test_the_other_side_is_fitted_in_the_window_that_was_sought_for_this_one_too(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On the grid alone it lost for an edge that was sought off it."""
    terms, fit = fitted("extra_ticks")

    def slip(side: str, start_s: float) -> Term:
        variant = replace(terms[0].variant, report={"side": side}, coefficients=("rate",))
        return at_window(replace(terms[0], variant=variant), start_s, 30.0)

    mine, other = slip("right", 10.3), slip("left", 9.0)
    scan = SimpleNamespace(
        dispersion=1.0,
        by_effect={"extra_ticks": [mine, other]},
        evidence=lambda terms, levels: 220.0 if terms[-1] is other else 0.0,
    )

    def refit(_: MotionModel, terms: Sequence[Term], *__: object, **___: object) -> Refitted:
        lacks = 40.0 if terms[-1].variant.fixed["start_s"] == 9.0 else 1.0
        return replace(fit, log_evidence=fit.log_evidence - lacks)

    monkeypatch.setattr(MotionModel, "refit", refit)
    found = Found(frozenset({"extra_ticks"}), (mine,), 0.0, 0.0, fit.levels, fit)
    side = Posterior(MODEL, scan)._choice(mine, "side", found, fit)
    assert side.probabilities is not None
    assert side.probabilities["left"] == pytest.approx(1.0 / (1.0 + np.e))


def test_a_set_with_a_size_that_is_no_news_is_told_by_its_lines() -> None:
    """All draws lay within the tolerance: shape and evidence were no numbers, and a car's log with
    a gyro 80 ms late ended as an internal error."""
    terms, fit = fitted(*BENT)
    bends = Bends(MODEL, terms, fit)
    largest = float(np.abs(bends.drawn(100).sizes[:, -1]).max())
    bends = Bends(MODEL, (*terms[:-1], replace(terms[-1], tolerances=(2 * largest,))), fit)
    drawn, corrected = bends.drawn(100), bends.corrected()
    assert drawn.log_weights is None
    assert drawn.pareto_k is corrected.pareto_k is None
    assert np.isfinite(corrected.log_evidence)


def test_every_fitted_set_that_may_win_is_corrected(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: dict[frozenset[str], float] = {}

    class Asked(Bends):
        def __init__(self, model: MotionModel, terms: tuple[Term, ...], *rest: Any) -> None:
            super().__init__(model, terms, *rest)
            self.names = frozenset(term.variant.effect for term in terms)

        def corrected(self) -> Corrected:
            found = super().corrected()
            asked[self.names] = found.log_evidence
            return found

    monkeypatch.setattr("gap_diagnosis.motion.accounts.Bends", Asked)
    others = frozenset(one.variant.effect for one in MODEL.columns.terms) - {*BENT}
    block = MotionBlock(MotionModel(RECORDING, ROBOT, default_prior(), without=others))
    fitted_sets = {one for one, found in block.scan.found.items() if found.refitted}
    best = max(asked, key=lambda one: asked[one])
    near = {one for one in fitted_sets if one in asked or one == best}
    assert frozenset(BENT) in near
    for one in fitted_sets - near:
        assert block.fit(one).log_evidence < block.fit(best).log_evidence - NEAR
    gains = {one: block.fit(one).log_evidence - block.fit(best).log_evidence for one in asked}
    assert gains == pytest.approx({one: asked[one] - asked[best] for one in asked}, abs=1e-6)
    checked = block.detail(frozenset(BENT)).pareto_k
    assert checked is None, "lines so straight need no weights"


def test_a_heavy_tail_has_a_large_shape_and_a_light_one_a_small_one() -> None:
    """Weights whose 1/k-th moment is the first that diverges (Vehtari et al. 2024)."""
    draws = np.random.default_rng(2).pareto(1.0, 4000)
    assert tail_shape(np.log(draws)) == pytest.approx(1.0, abs=0.2)
    assert tail_shape(np.log(np.random.default_rng(2).uniform(0.5, 1.0, 4000))) < 0.0
    assert tail_shape(np.zeros(200)) == 0.0


def test_smoothed_weights_have_a_mean_that_scatters_less() -> None:
    """Of weights exp(1.5 z), whose mean is exp(1.125)."""
    rng = np.random.default_rng(0)
    logs = 1.5 * rng.standard_normal((200, 200))
    raw = np.log(np.exp(logs).mean(axis=1)) - 1.125
    smooth = np.array([np.log(np.exp(smoothed(one)[0]).mean()) for one in logs]) - 1.125
    assert smooth.std() < 0.9 * raw.std()
    assert abs(smooth.mean()) < 0.1
