"""The motion of one log, prepared: what was measured, every effect's columns, noise levels."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gap_diagnosis.explanations import predict
from gap_diagnosis.explanations.known import LONG_S, Known, gyro_delay_s, known_effects
from gap_diagnosis.explanations.variant import Variant
from gap_diagnosis.motion.astray import astray, roughly, seen_astray_m, varies
from gap_diagnosis.motion.blocks import Course, course_of
from gap_diagnosis.motion.coefficients import bounded, split
from gap_diagnosis.motion.columns import (
    Columns,
    Term,
    build_columns,
    with_variant,
)
from gap_diagnosis.motion.constants_beside import free_about
from gap_diagnosis.motion.details import Details
from gap_diagnosis.motion.estimate import estimate_motion, unsure_where_silent, without_gyro
from gap_diagnosis.motion.evidence import Gram, Scored, gram_of, make_gram, score
from gap_diagnosis.motion.far_apart import FarApart
from gap_diagnosis.motion.known import as_this_log_has_it, beside_known
from gap_diagnosis.motion.levels import level_prior, silent_levels
from gap_diagnosis.motion.missing import silences
from gap_diagnosis.motion.nodes import Nodes, make_nodes, residuals
from gap_diagnosis.motion.offset import coarse_delay_s, coarse_gyro_delay_s
from gap_diagnosis.motion.starts import is_of_a_room, starts, with_stamps_off
from gap_diagnosis.motion.weighing import Weighing
from gap_diagnosis.motion.whitening import INEXACT, WHEELS_LATE, whiten
from gap_diagnosis.prediction import Motion
from gap_diagnosis.priors import Prior
from gap_diagnosis.recording import Floats, Recording
from gap_diagnosis.scoring import LevelPrior, along, best_levels, better_levels
from hil_harness.effects.model import Effect
from hil_harness.robot import Robot

Unsure = Callable[[Motion], tuple[Floats, Floats]]
"""Of a motion, how much its wheels' counts vary by chance, counts² per tick of left and right."""

_LAG: Final = "gyro_lag.time_constant"
_LATE_S: Final = 3e-3
"""Of rows that were read late by more the way from row to row is not known."""
_NEWTON_STEPS: Final = 3
_SHORTENED: Final = 6
"""Where chance has been taken for contact noise so far, the levels are far from the best."""
_MORE_STEPS: Final = 9
_STILL: Final = 5.0
"""So many steps more are taken as long as the step before or better noise levels gain this much
[nat]: for a large effect what the scan found, about straight lines, may be far off."""
_DOWNHILL: Final = 0.5
"""A step may lose this much [nat]: the prior pulls too."""


@dataclass(frozen=True)
class Refitted:
    """A set of effects fitted again, about its own best coefficients and at its own noise levels.

    Attributes:
        scored: evidence and coefficients (they are the whole deviation: no tolerance beside them).
        levels: noise levels, float64[levels].
        log_evidence: with the density of the levels; comparable between sets.
        log_likelihood: at the best coefficients and levels, other tolerances marginalised.
        coefficients: per term, the best ones.
    """

    scored: Scored
    levels: Floats
    log_evidence: float
    log_likelihood: float
    coefficients: tuple[tuple[float, ...], ...]


class MotionModel:
    """The motion of one log.

    Attributes:
        recording, robot, prior: what it was made from.
        nodes, course, columns: see there.
        level_prior: prior of the noise levels.
    """

    def __init__(
        self,
        recording: Recording,
        robot: Robot,
        prior: Prior,
        *,
        keep: NDArray[np.bool_] | None = None,
        gross: bool = False,
        without: frozenset[str] = frozenset(),
        library: Mapping[str, Effect] = MappingProxyType({}),
        late_up_to_s: float | None = None,
        unsure: Unsure | None = None,
    ) -> None:
        """Prepare; *keep* (bool[n]) are the ticks whose reference and gyro may be used;
        *without* names effects that are not to be tried, *library* are a user's own;
        *late_up_to_s* is how late the reference may be, if not by the robot's tolerance; *unsure*
        says what is not known of the wheels' counts."""
        self.recording, self.robot, self.prior = recording, robot, prior
        self.without = without
        self._asked_keep, self._library, self._late_up_to_s = keep, library, late_up_to_s
        delay_s = coarse_delay_s(recording, robot)
        motion = unsure_where_silent(estimate_motion(recording, robot, reference_delay_s=delay_s))
        self.keep = ~silences(recording.left_ticks, recording.t_s)
        if keep is not None:
            self.keep, motion = self.keep & keep, without_gyro(motion, ~keep)
        self.nodes: Nodes = make_nodes(motion, recording.reference, self.keep, delay_s)
        self.course: Course = course_of(self.nodes, robot.plant.encoder.noise_ticks)
        if unsure is not None:
            self.course = self.course.scattered(self.nodes, *unsure(motion))
        row_s = 0.0 if motion.has_counters else motion.tick_s
        known = known_effects(recording.granted, motion)
        if known:
            described = level_prior(robot, recording.granted, row_s=row_s).median
            self.nodes = as_this_log_has_it(self.nodes, self.course, described, known)
            self.course = beside_known(self.nodes, self.course)
        self.tolerances = _tolerances(robot)
        offset = "reference_time_offset.offset"
        # Whether a speed is of the moment or of the row before it nothing tells.
        unsure_s = max(recording.stamps_late_s, 0.5 * recording.speed_cycle_s)
        self.tolerances[offset] = max(self.tolerances[offset], unsure_s)
        if late_up_to_s is not None:
            self.tolerances[offset] = late_up_to_s
        if not motion.has_counters:
            # How a table's rows were put together, a mean of a tick or its last sample, is no lag.
            tick_s = motion.tick_s
            self.tolerances[_LAG] = max(self.tolerances[_LAG], tick_s)
        if recording.speed_cycle_s > 0:
            usual_s = prior.of("frame_latency", "delay").tolerance
            self.tolerances["frame_latency.delay"] = max(recording.speed_cycle_s, usual_s)
        self.level_prior: LevelPrior = replace(
            level_prior(robot, recording.granted, row_s=row_s), silent=silent_levels(self.nodes)
        )
        later_s = coarse_gyro_delay_s(motion) - gyro_delay_s(self.nodes.motion.granted)
        self._build(gross, known, later_s)
        is_moved = self.nodes.motion.are_rows_late and self.nodes.has_reference
        if is_moved and self.no_effect_levels[WHEELS_LATE] > _LATE_S:
            self.nodes = self.nodes.of_late_rows()
            self._build(gross, known, later_s)

    def _build(self, gross: bool, known: Sequence[Known], gyro_later_s: float) -> None:
        """Make every effect's columns beside *known* ones."""
        vars(self).pop("no_effect_levels", None)
        self._details = Details(self.nodes)
        self.columns: Columns = build_columns(
            self.nodes,
            self.prior,
            self.tolerances,
            gross=gross,
            without=self.without,
            library=self._library,
            speed_cycle_s=self.recording.speed_cycle_s,
            granted=known,
        )
        self._apart = FarApart(self)
        self._begin_at(gyro_later_s if abs(gyro_later_s) >= LONG_S else 0.0)

    def of(
        self, recording: Recording, *, without: frozenset[str], unsure: Unsure | None
    ) -> MotionModel:
        """Return the motion of another account of this log, *without* further effects."""
        return MotionModel(
            recording,
            self.robot,
            self.prior,
            keep=self._asked_keep,
            without=self.without | without,
            library=self._library,
            late_up_to_s=self._late_up_to_s,
            unsure=unsure,
        )

    def _begin_at(self, delay_s: float) -> None:
        """Add what makes a gyro late by *delay_s* (early, if negative), from there on."""
        late = {"frame": "IMU"} if delay_s > 0 else {"frame": "ENCODER"}
        for term in self.columns.terms if delay_s != 0 else ():
            large = term.variant.large
            is_lag = term.variant.effect == "gyro_lag" and delay_s > 0
            if large is not None and (is_lag or term.variant.report == late):
                # Beside counters a lag trails the wheels, however long it is.
                is_sharp = is_lag and self.nodes.motion.has_counters
                exact = term.variant.exact if is_sharp else None
                variant = replace(term.variant, act=large, exact=exact)
                _, self.columns = with_variant(
                    self.columns, self.nodes, variant, term, abs(delay_s)
                )

    def add(self, variant: Variant, like: Term) -> Term:
        """Add the columns of another variant of a term's effect."""
        term, columns = with_variant(self.columns, self.nodes, variant, like)
        self.columns = columns
        return term

    def take(self, term: Term) -> Term:
        """Add the columns of a term of another model, whose columns stand in other places."""
        alike = [
            one
            for one in self.columns.terms
            if one.variant.effect == term.variant.effect
            and len(one.weights) == len(term.weights)
            and one.variant.report.items() <= term.variant.report.items()
        ]
        if alike:
            return self.add(term.variant, alike[0])
        bare = tuple(tuple(part for part in weight if part[1] != 0.0) for weight in term.weights)
        return self.add(term.variant, replace(term, weights=bare))

    def evidence_about(
        self, terms: Sequence[Term], coefficients: Sequence[tuple[float, ...]], levels: Floats
    ) -> Refitted:
        """Return the fit about given coefficients, to be compared: one step, no other levels."""
        return self.refit(
            terms, levels, free_levels=False, steps=1, start=coefficients, is_compared=True
        )

    def gram(self, levels: Floats) -> Gram:
        """Return all inner products at these noise levels."""
        return make_gram(self.columns, self.course, levels, self.nodes.ticks)

    def levels_for(
        self,
        terms: Sequence[Term],
        start: Floats,
        free: Sequence[int] = (),
        course: Course | None = None,
    ) -> Floats:
        """Return the noise levels that suit these effects best; *free* ones may be anything.

        *course*: with what is left to chance, if these effects leave anything to it.
        """
        weigh = self._of_levels(terms, course)
        prior = self._prior_on(weigh.course)
        return best_levels(weigh, prior, start, free=free, elsewhere=self.elsewhere)

    def _prior_on(self, course: Course) -> LevelPrior:
        """Return the levels' prior on a course: by how much effects vary shows beside one alone."""
        prior = self.level_prior
        is_astray = bool(course.left_astray_m.any() or course.right_astray_m.any())
        return replace(prior, silent=prior.silent - {INEXACT}) if is_astray else prior

    @cached_property
    def elsewhere(self) -> list[Floats]:
        """Levels, float64[levels] each, from which a search may begin instead of the described."""
        return starts(self.nodes, self.level_prior)

    def levels_along(
        self, terms: Sequence[Term], levels: Floats, place: int, free: Sequence[int], course: Course
    ) -> Floats:
        """Return how the best levels go with the one at *place*, in logarithms: float64[levels]."""
        weigh = self._of_levels(terms, course)
        return along(weigh, self._prior_on(course), levels, place, free=free)

    def better_start(self, terms: Sequence[Term], found: Floats) -> Floats | None:
        """Return levels that suit these effects better than *found*, which a search ended at.

        None where a coarse look at the reference shows none. From where a GPS wanders the search
        is worth its time: one that began in a room may have ended at wheels that skid.
        """
        weigh = self._of_levels(terms)

        def height(levels: Floats) -> float:
            return weigh(levels).log_evidence + self.level_prior.log_density(np.log(levels))

        best = max(self.elsewhere, key=height, default=found)
        if not is_of_a_room(self.nodes) and height(best) <= height(found):
            best = self.levels_for(terms, best)
        others = with_stamps_off(found) if self.nodes.has_reference else []
        best = max([best, *others], key=height)
        return best if height(best) > height(found) else None

    def _of_levels(self, terms: Sequence[Term], course: Course | None = None) -> Weighing:
        """Return the evidence of terms as a function of the levels, without their density."""
        used = {index for term in terms for weight in term.weights for index, _ in weight}
        used |= {index for index, _ in self.columns.nuisances}
        order = sorted(used)
        place = {index: row for row, index in enumerate(order)}
        values = np.take(self.columns.values, [0, *(i + 1 for i in order)], axis=-1)
        nuisances = [(place[index], sd) for index, sd in self.columns.nuisances]
        moved = [
            replace(
                term,
                weights=tuple(
                    tuple((place[index], value) for index, value in weight)
                    for weight in term.weights
                ),
            )
            for term in terms
        ]
        way = self.course if course is None else course
        return self._weighing(values, nuisances, moved, way)

    def evidence_at(
        self, terms: Sequence[Term], levels: Floats, course: Course | None = None
    ) -> float:
        """Return the log evidence of terms at these levels, without the levels' density."""
        return self._of_levels(terms, course)(levels).log_evidence

    def _weighing(
        self,
        values: Floats,
        nuisances: Sequence[tuple[int, float]],
        terms: Sequence[Term],
        course: Course,
    ) -> Weighing:
        def gain(gram: Gram) -> float:
            return score(gram, terms, self.prior).log_evidence if terms else 0.0

        return Weighing(values, nuisances, course, self.nodes.ticks, gain)

    def refit(
        self,
        terms: Sequence[Term],
        levels: Floats,
        *,
        free_levels: bool = True,
        steps: int = _NEWTON_STEPS,
        start: Sequence[tuple[float, ...]] | None = None,
        is_compared: bool = False,
        known: Sequence[Floats] = (),
    ) -> Refitted:
        """Fit *terms* again about their own best coefficients (Gauss-Newton).

        *is_compared*: by its evidence alone, which is told about where the last step begins: no
        matter where that leads.
        *known*: levels that suit other sets, tried once besides those here.
        """
        if start is None:
            start = along_lines(score(self.gram(levels), terms, self.prior))
        coefficients = tuple(start)
        gained = math.inf if free_levels and steps > 1 else 0.0
        climbed = 0.0
        height: float | None = None
        for step in range(steps + _MORE_STEPS):
            if step >= steps:
                gained = max(gained, climbed if free_levels else 0.0)
                if gained < _STILL:
                    break
            values, nuisances, tangent = self.linearised(terms, coefficients, levels)
            course = self.scattered(terms, coefficients, levels)
            if step > 0 and gained >= _STILL:
                starts = [levels, *known]
                if any(varies(term.variant, self.nodes) for term in terms):
                    starts += roughly(levels, self.level_prior.median)
                levels, gained = self._better_levels(values, nuisances, tangent, starts, course)
                course = self.scattered(terms, coefficients, levels)
                known, height = (), None
            white = whiten(values, course, levels, self.nodes.ticks)
            gram = gram_of(*white, nuisances, levels)
            scored = score(gram, tangent, self.prior)
            best = bounded(terms, split(terms, scored.means[int(np.argmax(scored.weights))]))
            if not (is_compared and step == steps - 1):
                if height is None:
                    height = _height_in(gram, coefficients)
                best, climbed = self._no_worse(terms, coefficients, best, levels, height)
                height += climbed
            coefficients = best
        density = self.level_prior.log_density(np.log(levels))
        return Refitted(
            scored=replace(scored, terms=tuple(terms)),
            levels=levels,
            log_evidence=gram.log_nothing + scored.log_evidence + density,
            log_likelihood=gram.log_nothing + scored.log_likelihood + density,
            coefficients=coefficients,
        )

    def at_fit(
        self, terms: Sequence[Term], fit: Refitted
    ) -> tuple[Floats, Floats, Floats, dict[str, list[int]]]:
        """Return the whitened log about a fit: data float64[r], free columns float64[r, c], their
        inverse variances float64[c] beforehand, and which of them are each effect's."""
        values, nuisances, tangent = self.linearised(terms, fit.coefficients, fit.levels)
        course = self.scattered(terms, fit.coefficients, fit.levels)
        white, _ = whiten(values, course, fit.levels, self.nodes.ticks)
        known = [place for place, _ in nuisances]
        owners: dict[str, list[int]] = {}
        for term in tangent:
            own = [place for weight in term.weights for place, _ in weight]
            owners[term.variant.effect] = list(range(len(known), len(known) + len(own)))
            known += own
        restraint = np.zeros(len(known))
        restraint[: len(nuisances)] = [sd**-2 for _, sd in nuisances]
        return white[:, 0], white[:, [1 + place for place in known]], restraint, owners

    def left_by(self, terms: Sequence[Term], fit: Refitted) -> Floats:
        """Return what a fit leaves of the whitened log, float64[r]."""
        data, columns, restraint, _ = self.at_fit(terms, fit)
        inner = columns.T @ columns + np.diag(restraint)
        return np.asarray(data - columns @ np.linalg.lstsq(inner, columns.T @ data, rcond=None)[0])

    def _no_worse(
        self,
        terms: Sequence[Term],
        before: tuple[tuple[float, ...], ...],
        after: tuple[tuple[float, ...], ...],
        levels: Floats,
        height: float,
    ) -> tuple[tuple[tuple[float, ...], ...], float]:
        """Shorten a step of Gauss and Newton until it does not lead downhill from *height*; return
        where it leads and what it gains [nat]."""
        for _ in range(_SHORTENED):
            climbed = self._height(terms, after, levels) - height
            if climbed >= -_DOWNHILL:
                return after, climbed
            after = tuple(
                tuple(0.5 * (a + b) for a, b in zip(old, new, strict=True))
                for old, new in zip(before, after, strict=True)
            )
        return before, 0.0

    def _height(
        self,
        terms: Sequence[Term],
        coefficients: Sequence[tuple[float, ...]],
        levels: Floats,
    ) -> float:
        """Return the log likelihood at given coefficients, tolerances marginalised."""
        course = self.scattered(terms, coefficients, levels)
        return self.likelihood(terms, coefficients, levels, course)

    def likelihood(
        self,
        terms: Sequence[Term],
        coefficients: Sequence[tuple[float, ...]],
        levels: Floats,
        course: Course,
        *,
        is_sharp: bool = False,
    ) -> float:
        """Return the log likelihood at given coefficients along a course; *is_sharp*: what counts
        are off by turns the robot as described."""
        change = self._details.change(terms, coefficients, levels, is_sharp=is_sharp)
        own = {index for term in terms for weight in term.weights for index, _ in weight}
        free = [(i, sd) for i, sd in self.columns.nuisances if i not in own]
        values = free_about(self.nodes, self.columns, change, free, terms, coefficients)
        nuisances = [(place, sd) for place, (_, sd) in enumerate(free)]
        return self._weighing(values, nuisances, (), course)(levels).log_evidence

    def scattered(
        self,
        terms: Sequence[Term],
        coefficients: Sequence[tuple[float, ...]],
        levels: Floats,
    ) -> Course:
        """Return the course with what rates and probabilities of these sizes leave to chance, to be
        compared with others at these levels of noise."""
        course = self.course
        varying = [
            (term.variant, sizes)
            for term, sizes in zip(terms, coefficients, strict=True)
            if varies(term.variant, self.nodes)
        ]
        if varying:
            course = course.beside(*astray(self.nodes, varying, self._seen_astray_m))
        for term, sizes in zip(terms, coefficients, strict=True):
            if term.variant.scatter is not None:
                variances = term.variant.scatter(self.nodes.motion, sizes[0], **term.variant.fixed)
                course = course.scattered(self.nodes, *variances)
            if term.variant.jumps is not None:
                course = course.jumping(self.nodes, term.variant.jumps(self.nodes.motion))
        return self._apart.course(terms, coefficients, levels, course)

    @cached_property
    def _seen_astray_m(self) -> float:
        return seen_astray_m(self.nodes, self.columns.values[..., 0])

    def _better_levels(
        self,
        values: Floats,
        nuisances: Sequence[tuple[int, float]],
        terms: Sequence[Term],
        starts: Sequence[Floats],
        course: Course,
    ) -> tuple[Floats, float]:
        """Return better levels than the first of *starts*, sought from the best of them, and what
        they gain [nat]."""
        weigh = self._weighing(values, nuisances, terms, course)
        return better_levels(weigh, self._prior_on(course), starts, elsewhere=self.elsewhere)

    def linearised(
        self, terms: Sequence[Term], coefficients: Sequence[tuple[float, ...]], levels: Floats
    ) -> tuple[Floats, list[tuple[int, float]], list[Term]]:
        """Return columns about these coefficients, at these levels of noise: data, free tolerances,
        tangents of the terms.

        Tangents are smooth and the data exact: where a step ends, what is left of the data goes
        along with no tangent, and noise that the data share with an exact tangent has no say (the
        tangents are instruments; Fuller 1987, Measurement Error Models, section 1.4).
        """
        smooth = self.nodes.smooth
        settings = [(t.variant, c) for t, c in zip(terms, coefficients, strict=True)]
        there = residuals(self.nodes, predict(smooth, settings))
        change = self._details.change(terms, coefficients, levels)
        own = {index for term in terms for weight in term.weights for index, _ in weight}
        free = [(i, sd) for i, sd in self.columns.nuisances if i not in own]
        sizes = sum(len(term.variant.coefficients) for term in terms)
        values = free_about(self.nodes, self.columns, change, free, terms, coefficients, more=sizes)
        behind = len(free)
        tangent: list[Term] = []
        for place, term in enumerate(terms):
            weights = []
            for index in range(len(term.variant.coefficients)):
                value = coefficients[place][index]
                step = max(1e-3 * abs(value), 0.05 * term.tolerances[index])
                moved = list(settings)
                near = list(coefficients[place])
                near[index] = value + step
                moved[place] = (term.variant.smooth_about(coefficients[place]), tuple(near))
                column = (there - residuals(self.nodes, predict(smooth, moved))) / step
                values[..., 0] += value * column
                values[..., 1 + behind] = column
                weights.append(((behind, 1.0),))
                behind += 1
            if not term.is_fixed:
                tangent.append(replace(term, weights=tuple(weights)))
        nuisances = [(place, sd) for place, (_, sd) in enumerate(free)]
        return values, nuisances, tangent

    @cached_property
    def no_effect_levels(self) -> Floats:
        """Noise levels that suit the description without any effect."""
        found = self.levels_for((), self.level_prior.median)
        better = self.better_start((), found)
        return found if better is None else self.levels_for((), better)


def _height_in(gram: Gram, coefficients: Sequence[tuple[float, ...]]) -> float:
    """Return the log likelihood at the coefficients about which columns are told, tolerances
    marginalised, from their products: tangents come last."""
    sizes = np.array([one for of_term in coefficients for one in of_term])
    own = slice(len(gram.data) - len(sizes), None)
    data, inner = gram.data[own], gram.inner[own, own]
    return gram.log_nothing + float(data @ sizes - 0.5 * sizes @ inner @ sizes)


def along_lines(scored: Scored) -> tuple[tuple[float, ...], ...]:
    """Return the likeliest coefficients of each term by straight lines, from where a fit begins."""
    lines = split(scored.terms, scored.means[int(np.argmax(scored.weights))])
    return tuple(
        tuple(sizes if t.variant.unbent is None else map(t.variant.unbent, sizes))
        for t, sizes in zip(scored.terms, lines, strict=True)
    )


def _tolerances(robot: Robot) -> dict[str, float]:
    """Return tolerances by ``effect.coefficient``."""
    known = robot.tolerance
    return {
        "radius_scale.scale": known.radius_scale,
        "ticks_per_rev.scale": known.radius_scale,
        "radius_mismatch.mismatch": known.radius_mismatch,
        "wheelbase_scale.scale": known.wheelbase_scale,
        "gyro_scale.scale": known.gyro_scale,
        "gyro_bias.bias": known.gyro_bias_rad_s,
        "reference_time_offset.offset": known.time_offset_s,
        _LAG: known.time_offset_s,
    }


def is_far(first: Floats, second: Floats) -> bool:
    """Tell whether two sets of levels differ enough to be worth another pass."""
    return bool(np.any(np.abs(np.log(first / second)) > math.log(1.3)))
