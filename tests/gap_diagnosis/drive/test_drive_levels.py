"""Noise levels of a drive are sought until they gain no more."""

from __future__ import annotations

import pytest
from drive_recordings import ROBOT, block_of, simulated
from foreign_drives import disturbed

from gap_diagnosis.drive import noise
from gap_diagnosis.drive.likelihood import fitted_levels, setting_of
from gap_diagnosis.drive.noise import IDEAL, STARTS
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import LevelPrior
from gap_diagnosis.slopes import Weigh


@pytest.mark.parametrize("start", STARTS[1:], ids=["quiet", "rough"])
def test_a_search_for_noise_levels_is_not_over_after_so_many_steps(start) -> None:
    """Cut short after 25, levels beside a dead encoder were 545 nats worse than beside a gain of
    nothing as well: that hid counts which came too often (a dead encoder alone, 1.00)."""
    effects = {
        "encoder_dead": {"side": "right", "start_s": 20.0},
        "extra_ticks": {"side": "left", "rate": 5.0},
    }
    block = block_of(simulated(effects, seed=5))
    names = frozenset(effects)
    setting = setting_of(block._variants(names)[0], ROBOT, names)
    levels, reached = fitted_levels(setting, {}, start)
    _, again = fitted_levels(setting, {}, levels)
    assert again < reached + 1.0


@pytest.mark.parametrize("seed", [1, 2])
def test_from_wherever_a_search_begins_a_loaded_drive_is_as_noisy(seed: int) -> None:
    """Ends differed by 1.2 nats, and beside effects 8 to 10 were lost: counts too few, which are
    not there, were worth -10.8 for -.2."""
    setting = block_of(disturbed(seed)).undisturbed
    heights = [fitted_levels(setting, {}, start)[1] for start in (*STARTS, IDEAL)]
    assert max(heights) - min(heights) < 0.1


def test_of_several_starts_the_likelier_two_are_sought_from(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    setting = block_of(disturbed(1)).undisturbed
    starts = (*STARTS, IDEAL)
    each = [fitted_levels(setting, {}, start)[1] for start in starts]
    searches: list[Floats] = []
    search = noise.best_levels

    def counted(weigh: Weigh, prior: LevelPrior, start: Floats) -> Floats:
        searches.append(start)
        return search(weigh, prior, start)

    monkeypatch.setattr(noise, "best_levels", counted)
    _, reached = fitted_levels(setting, {}, *starts)
    assert reached == pytest.approx(max(each), abs=0.1)
    assert len(searches) == 2
