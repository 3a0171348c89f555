"""From when on stamps come later is found beside their jitter, and nothing where there is none."""

import numpy as np
import pytest

from gap_diagnosis.lateness import lasting_changes

FRAMES = 6000


def jittered(seed: int, sigma_s: float) -> np.ndarray:
    return np.abs(np.random.default_rng(seed).normal(0.0, sigma_s, FRAMES))


def changes_of(late_s: np.ndarray) -> list[int]:
    return lasting_changes(late_s, np.arange(FRAMES))


@pytest.mark.parametrize("seed", range(20))
def test_a_spell_whose_ends_lie_within_blocks_has_two_ends_beside_jitter(seed: int) -> None:
    """Of a block that is late in part two steps are seen: with four of them there was no spell."""
    late_s = jittered(seed, 0.005)
    first = 1250 + 25 * seed
    late_s[first : first + 1500] += 0.02
    assert changes_of(late_s) == pytest.approx([first, first + 1500], abs=10)


@pytest.mark.parametrize("seed", range(20))
def test_a_spell_of_little_more_than_a_block_has_two_ends(seed: int) -> None:
    late_s = jittered(seed, 1e-4)
    first = 1250 + 25 * seed
    late_s[first : first + 800] += 0.02
    assert changes_of(late_s) == pytest.approx([first, first + 800], abs=10)


def test_jitter_alone_is_no_change() -> None:
    assert not any(changes_of(jittered(seed, 0.003)) for seed in range(50))
