"""Where a window's ends, a threshold or a limit lie that no grid of variants holds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from gap_diagnosis.motion.accounts import Accounts, Found
from gap_diagnosis.motion.columns import Term
from gap_diagnosis.motion.edges import Edged, best_edges, edged_by, edges_of, has_edges
from gap_diagnosis.motion.model import Refitted
from gap_diagnosis.motion.onset import LOG_SHARE, LOG_WEIGHT, best_window, can_begin
from gap_diagnosis.motion.slips import SLIP, windows_beside
from gap_diagnosis.motion.windows import Windows, at_window, windows_of
from gap_diagnosis.recording import Floats

_EDGED: Final = 4
_WORTH_EDGES: Final = 5.0
_LITTLE: Final = 0.35
_WORTH_WINDOW: Final = 20.0
_AS_MUCH: Final = 0.1
"""What explains less of a window of the grid by this share may explain more of one beside it."""
_MOVES: Final = 3


class OffTheGrid(Accounts):
    """What sets of effects say, with variants whose edges lie where they fit best."""

    def _add_off_the_grid(self, greedy: Sequence[Term]) -> None:
        """Give leading effects with edges a variant whose edges lie where they fit best, and a slip
        the window that suits each wheel best beside what leads at the described levels of noise,
        and by itself."""
        singles = [one for one in self._ranked() if len(one.effects) == 1][:_EDGED]
        nothing = self.found[frozenset()].log_evidence
        described = self._grams[0].levels
        sides = self.by_effect.get(SLIP, ())
        slips = windows_beside(self.model, greedy, sides, described)
        alone = self.found.get(frozenset({SLIP}))
        leads = greedy[0].variant.effect if greedy else SLIP
        if leads != SLIP and alone is not None and alone.log_evidence > nothing:
            # What leads may be what stands in for a slip: of a robot that turned on the spot a
            # wheel spun for 2 s, faster than it ever went, and its gyro was at the end of its
            # range.
            slips += windows_beside(self.model, (), sides, described)
        for edged, grid_term in slips:
            self._add_at_its_edges(edged, grid_term)
        added = bool(slips)
        for one in singles:
            (term,) = one.terms
            if not has_edges(term) or one.log_evidence < nothing + _WORTH_EDGES:
                continue
            if self._is_explained(one) or (slips and one.effects == {SLIP}):
                continue
            start = self.model.refit(one.terms, one.levels, free_levels=False, steps=2)
            edged = best_edges(self.model, one.terms, 0, start.coefficients, one.levels)
            self._add_at_its_edges(edged, term)
            added = True
        asked = self._part_of_the_log()
        if added or asked is not None:
            levels = [gram.levels for gram in self._grams]
            levels += [] if asked is None else [asked]
            self._grams.clear()
            self._kept.clear()
            self.found.clear()
            for one_levels in levels:
                self._add_levels(one_levels)

    def _is_explained(self, one: Found) -> bool:
        """Tell whether an effect gains little of what the best set does, and nothing beside that:
        wherever its edges lay, the best set would explain as much."""
        best = self._ranked()[0]
        if one.effects <= best.effects:
            return False
        nothing = self.found[frozenset()].log_evidence
        is_little = one.log_evidence - nothing < _LITTLE * (best.log_evidence - nothing)
        beside = self.account(best.effects | one.effects).log_evidence if is_little else math.inf
        return is_little and beside < best.log_evidence + _WORTH_EDGES

    def _part_of_the_log(self) -> Floats | None:
        """Give an effect a window where that makes it the best account of all; return its levels.

        It is sought at the described noise levels, where the log is quieter at its own: where
        nothing explains a change, levels grow.
        """
        gram, kept = self._grams[0], self._kept[0]
        density = self.model.level_prior.log_density(np.log(gram.levels))
        best_so_far = self._ranked()[0].log_evidence
        if best_so_far < gram.log_nothing + density + _WORTH_EDGES:
            return None
        begins = [terms[0] for terms in kept.values() if can_begin(terms[0])]
        quiet = np.minimum(gram.levels, self._ranked()[0].levels)
        nothing = self.model.evidence_at((), quiet)
        found = [(one, best_window(self.model, one, quiet)) for one in begins]
        sought = [(window[1], window[0], one) for one, window in found if window is not None]
        sought.sort(key=lambda one: -one[0])
        if not sought or sought[0][0] < nothing + _WORTH_WINDOW:
            return None
        best, term, whole = sought[0]
        known = self._ranked()[0].levels, self.found[frozenset()].levels
        at_ends = self.model.refit((term,), gram.levels, known=known)
        if at_ends.log_evidence + LOG_WEIGHT < best_so_far - _WORTH_WINDOW:
            return None
        # Of a large effect on the whole log a straight line may explain no more than a part.
        all_along = self.model.refit((whole,), gram.levels, known=known)
        best_so_far = max(best_so_far, all_along.log_evidence)
        windows = self._windows(term, at_ends)
        edged = edged_by(term, windows)
        between = self.model.refit(
            (edged.term,), at_ends.levels, start=at_ends.coefficients, steps=2
        )
        if between.log_evidence + LOG_SHARE + windows.log_width < best_so_far - _WORTH_EDGES:
            return None
        self._add_at_its_edges(edged, term)
        reach = max(_WORTH_WINDOW, _AS_MUCH * (best - nothing))
        for evidence, rival, _ in sought[1:]:
            if evidence > best - reach:
                # What acts in this window may be another that shows as much of itself in it.
                there = at_window(rival, *windows.best_s)
                fit = self.model.refit((there,), at_ends.levels, steps=2)
                self._add_at_its_edges(edged_by(there, self._windows(there, fit)), rival)
        return between.levels

    def _windows(self, term: Term, fit: Refitted) -> Windows:
        """Return what the log says of the window of a fitted term.

        About a fit in one that is a second off all windows are seen askew: it is sought again about
        a fit in the best, until that is where it was.
        """
        about = fit.coefficients, fit.levels
        windows = windows_of(self.model, (term,), 0, *about, worth=_WORTH_WINDOW)
        for _ in range(_MOVES):
            sought = windows.best_s
            there = at_window(term, *sought)
            fit = self.model.refit((there,), fit.levels, start=fit.coefficients, steps=2)
            about = fit.coefficients, fit.levels
            windows = windows_of(self.model, (there,), 0, *about, worth=_WORTH_WINDOW)
            if windows.best_s == sought:
                break
        return windows

    def _add_at_its_edges(self, edged: Edged, grid_term: Term) -> None:
        """Add a variant whose edges lie where they fit best."""
        effect = grid_term.variant.effect
        added = self.model.add(edged.term.variant, grid_term)
        if edged.log_width is not None:
            added = self._in_sum(added, edged.log_width)
        self.by_effect[effect].append(added)
        self.spans[effect] = edged.spans

    def _in_sum(self, term: Term, log_width: float) -> Term:
        """Return a term at its best edges so that it is worth what it is at all of them, beside the
        even share of each variant that the grid holds."""
        grid = [one.variant for one in self.by_effect[term.variant.effect] if one.is_on_the_grid]
        kinds = {frozenset(one.report.items() - one.fixed.items()) for one in grid}
        log_weight = log_width + math.log(len(grid) / len(kinds))
        if not edges_of(term.variant) <= edges_of(grid[0]):
            log_weight = LOG_SHARE + log_width
        return replace(term, log_weight=log_weight, is_on_the_grid=False)
