"""A disc far off centre: its error is that of the angle counted, and a gyro sees nothing of it."""

from __future__ import annotations

import numpy as np
from motion_cases import EXACT, ROBOT, WIRE, setting_of, without_noise

from gap_diagnosis.explanations.registry import EXPLAINED
from gap_diagnosis.explanations.variant import Value
from gap_diagnosis.motion.model import MotionModel
from gap_diagnosis.motion.scan import Scan
from gap_diagnosis.priors import default_prior
from gap_diagnosis.recording import Floats
from gap_diagnosis.synthetic import synthetic_recording
from hil_harness.effects import EffectSetting
from hil_harness.scenarios import scenario

VALUES: dict[str, Value] = {"side": "left", "amplitude": 0.15, "phase": -1.9}
QUIET = without_noise(ROBOT)
LAG = "gyro_lag"


def driven(*effects: EffectSetting) -> MotionModel:
    """Return a log without noise, with one eccentricity and a gyro's lag to be told of it."""
    log = synthetic_recording(
        QUIET, WIRE, scenario("calibration"), effects, 3, reference=EXACT, duration_s=30.0
    )
    others = frozenset(EXPLAINED) - {"encoder_eccentricity", LAG}
    return MotionModel(log, ROBOT, default_prior(), without=others)


def test_a_large_eccentricity_is_told_to_half_a_count() -> None:
    """Of an angle that is smoothed a wobble is less, and the square of this one's was missing: four
    times as much."""
    model = driven(EffectSetting("encoder_eccentricity", tuple(VALUES.items())))
    ((_, true),) = setting_of(model.nodes.motion, "encoder_eccentricity", VALUES)
    term = next(
        one
        for one in model.columns.terms
        if one.variant.effect == "encoder_eccentricity" and one.variant.report["side"] == "left"
    )
    fit = model.refit([term], model.level_prior.median, free_levels=False, start=[tuple(true)])
    # Where in its count a disc stood as the log began nothing tells.
    half_a_count = 0.5 * float(VALUES["amplitude"]) * model.nodes.motion.rad_per_count
    assert np.abs(np.subtract(fit.coefficients[0], true)).max() < half_a_count


def of_lag(model: MotionModel, eccentricity: float) -> Floats:
    """Return what a unit of a lag changes of the gyro's turn [rad], beside an eccentricity."""
    values = {**VALUES, "amplitude": eccentricity}
    ((variant, sizes),) = setting_of(model.nodes.motion, "encoder_eccentricity", values)
    term = next(one for one in model.columns.terms if one.variant.report == variant.report)
    own = {index for weight in term.weights for index, _ in weight}
    free = [index for index, _ in model.columns.nuisances if index not in own]
    place = next(at for at, one in enumerate(free) if model.columns.little[one][0].effect == LAG)
    columns, _, _ = model.linearised([term], [tuple(sizes)], model.level_prior.median)
    return np.asarray(columns[3, :, 1 + place])


def test_a_late_gyro_is_late_by_the_turns_of_the_body_and_not_by_an_encoder_s() -> None:
    """A lag within tolerance passed for a disc that stood otherwise: 14 mrad off, with 3 told."""
    whole = of_lag(driven(), 0.0)
    model = driven(EffectSetting("encoder_eccentricity", tuple(VALUES.items())))
    about, beside_none = of_lag(model, float(VALUES["amplitude"])), of_lag(model, 0.0)
    assert np.std(about - whole) < 0.3 * np.std(beside_none - whole)


def test_a_late_gyro_is_late_by_the_wobble_of_a_wheel_that_is_not_round() -> None:
    """A lag of 3 ms beside a wheel 2 % out of round was told as an encoder's eccentricity with the
    wheel's, 170 nats likelier than the wheel's alone."""
    values: dict[str, Value] = {"side": "right", "amplitude": 0.02, "phase": 0.6}
    both = (
        EffectSetting("wheel_eccentricity", tuple(values.items())),
        EffectSetting(LAG, (("time_constant", 0.003),)),
    )
    log = synthetic_recording(
        ROBOT, WIRE, scenario("calibration"), both, 3, reference=EXACT, duration_s=60.0
    )
    others = frozenset(EXPLAINED) - {"encoder_eccentricity", "wheel_eccentricity", LAG}
    scan = Scan(MotionModel(log, ROBOT, default_prior(), without=others))
    wheel = scan.account(frozenset({"wheel_eccentricity"}))
    for besides in ("encoder_eccentricity", LAG):
        pair = scan.account(frozenset({"wheel_eccentricity", besides}))
        assert pair.log_evidence < wheel.log_evidence + 5
