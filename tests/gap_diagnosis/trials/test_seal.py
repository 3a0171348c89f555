"""The seal: nothing can be read without the key, nothing can be changed behind it."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from gap_diagnosis.errors import DiagnosisError
from gap_diagnosis.synthetic import FIRST_SEALED_SEED, synthetic_recording
from gap_diagnosis.trials.engine import finer
from gap_diagnosis.trials.seal import COMMITMENT, SEALED, seal, unseal
from gap_diagnosis.trials.secret import Secret, fresh_secret
from hil_harness.assembly import load_wire
from hil_harness.effect_runs import run_with_effects
from hil_harness.effects import parse_effect
from hil_harness.effects.reference_errors import correlated_noise
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

ANSWERS = {
    "cases": [{"name": f"{n:04d}", "effects": {"gyro_bias": {"bias": 0.01}}} for n in range(99)]
}


def test_what_was_sealed_comes_out_as_it_was(tmp_path: Path) -> None:
    seal(ANSWERS, tmp_path, tmp_path / "k")
    assert unseal(tmp_path, tmp_path / "k") == ANSWERS


def test_the_sealed_file_looks_like_noise_and_its_length_says_nothing(tmp_path: Path) -> None:
    seal(ANSWERS, tmp_path, tmp_path / "k")
    sealed = (tmp_path / SEALED).read_bytes()
    assert b"gyro" not in sealed
    counts = Counter(sealed)
    expected = len(sealed) / 256
    # χ² with 255 degrees of freedom: 400 is beyond 1 in 10^7.
    assert sum((counts[byte] - expected) ** 2 / expected for byte in range(256)) < 400
    seal({"cases": []}, tmp_path, tmp_path / "k2")
    assert len((tmp_path / SEALED).read_bytes()) == len(sealed)


def test_an_answer_changed_after_the_fact_is_refused(tmp_path: Path) -> None:
    seal(ANSWERS, tmp_path, tmp_path / "k")
    sealed = bytearray((tmp_path / SEALED).read_bytes())
    sealed[40] ^= 1
    (tmp_path / SEALED).write_bytes(bytes(sealed))
    with pytest.raises(DiagnosisError, match="not those that seal"):
        unseal(tmp_path, tmp_path / "k")


def test_another_commitment_does_not_fit_the_answers(tmp_path: Path) -> None:
    seal(ANSWERS, tmp_path, tmp_path / "k")
    content = json.loads((tmp_path / COMMITMENT).read_text())
    content["sha256"] = "0" * 64
    (tmp_path / COMMITMENT).write_text(json.dumps(content))
    with pytest.raises(DiagnosisError, match="commits to"):
        unseal(tmp_path, tmp_path / "k")


def test_the_key_is_closed_on_disk(tmp_path: Path) -> None:
    seal(ANSWERS, tmp_path, tmp_path / "k")
    assert (tmp_path / "k").stat().st_mode & 0o777 == 0
    unseal(tmp_path, tmp_path / "k")
    assert (tmp_path / "k").stat().st_mode & 0o777 == 0


def test_a_missing_key_and_a_missing_trial_are_told(tmp_path: Path) -> None:
    with pytest.raises(DiagnosisError, match="no sealed trial"):
        unseal(tmp_path, tmp_path / "k")
    seal(ANSWERS, tmp_path, tmp_path / "k")
    with pytest.raises(DiagnosisError, match="cannot read the key"):
        unseal(tmp_path, tmp_path / "other")


def test_seeds_of_cases_are_beyond_all_that_a_diagnosis_can_simulate_with() -> None:
    seeds = {fresh_secret().seed(purpose) for purpose in ("plant", "reference") for _ in range(50)}
    assert len(seeds) == 100
    assert min(seeds) >= FIRST_SEALED_SEED
    with pytest.raises(DiagnosisError, match="the rest is sealed"):
        synthetic_recording(load_robot(), load_wire(), scenario("straight"), (), min(seeds))


def test_every_bit_of_a_seed_is_secret() -> None:
    """The highest one of 64 was set, and 63 were left to guess."""
    seeds = [fresh_secret().seed("plant") for _ in range(200)]
    for bit in range(128):
        # all alike: one in 2^199
        assert {seed >> bit & 1 for seed in seeds} == {0, 1}, bit


@pytest.mark.parametrize("bit", [3, 70, 127])
def test_every_bit_of_a_seed_reaches_all_that_is_random_in_a_case(bit: int) -> None:
    robot, wire, seed = load_robot(), load_wire(), fresh_secret().seed("plant")
    effects = [
        parse_effect("frame_jitter.sigma=0.001"), parse_effect("missed_deadline.probability=0.3"),
        parse_effect("micro_slip.left=0.01"), parse_effect("reference_noise.position=0.01"),
    ]  # fmt: skip
    one, other = run_with_effects(
        scenario("figure8"), robot, wire, [(effects, seed), (effects, seed ^ 1 << bit)],
        ticks=500, simulator=finer(2),
    )  # fmt: skip
    assert not np.array_equal(one.truth, other.truth)
    assert not np.array_equal(one.gyro_code, other.gyro_code)
    assert not np.array_equal(one.executed, other.executed)
    arrived = [run.arrivals["ENCODER"].time_us for run in (one, other)]
    assert not np.array_equal(*arrived)
    time_s = np.arange(50) * 0.01
    noise = [correlated_noise(time_s, 0.0, own, 0) for own in (seed, seed ^ 1 << bit)]
    assert not np.array_equal(*noise)


def test_a_secret_gives_the_same_again_and_its_parts_do_not_tell_it() -> None:
    secret = Secret(bytes(16))
    assert secret.generator("a").random() == secret.generator("a").random()
    assert secret.generator("a").random() != secret.generator("b").random()
    assert secret.child("a") != secret.child("b")
    assert secret.child("a").seed("plant") != secret.seed("plant")
