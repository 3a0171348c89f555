"""Stage actuation: from what was counted at a motor to what the wheel behind it really turned."""

from collections.abc import Iterable
from typing import Final

import numpy as np

from gap_diagnosis.explanations.variant import Value, Variant
from gap_diagnosis.play import followed
from gap_diagnosis.prediction import Motion, Prediction
from gap_diagnosis.recording import Floats

_SIDES: Final = {"left": (True, False), "right": (False, True), "both": (True, True)}


def backlash(p: Prediction, *, width: float, left: float, right: float, ahead: float) -> None:
    """Turn each motor so far after a reversal before its wheel follows.

    Args:
        p: turns of the motors, as counted; become those of the wheels.
        width: angle at the wheel from one flank to the other [rad].
        left, right: 1 for a side with play, 0 for one without.
        ahead: 1 if the log begins with the motors at their forward flanks, -1 if at their backward
            ones, 0 if at those of their first way.
    """
    m = p.motion
    p.left_rad = p.left_rad - left * _lost(m.left_motor_rad, width, ahead)
    p.right_rad = p.right_rad - right * _lost(m.right_motor_rad, width, ahead)


def _lost(step_rad: Floats, width_rad: float, ahead: float) -> Floats:
    """Return what of a motor's steps the wheel does not turn."""
    backward = ahead < 0 or (ahead == 0 and _begins_backward(step_rad))
    return step_rad - followed(step_rad, width_rad, width_rad if backward else 0.0)


def _begins_backward(step_rad: Floats) -> bool:
    """Tell whether the first that a motor turns by more than its counts tremble is backward."""
    angle = np.cumsum(step_rad)
    far = np.flatnonzero(np.abs(angle) > _TURNED_BACK_RAD)
    return len(far) > 0 and bool(angle[far[0]] < 0)


_TURNED_BACK_RAD: Final = 0.1
"""A motor that turns round by less may not have crossed its play."""


def variants_of_backlash(motion: Motion) -> Iterable[Variant]:
    """Return either side and both, where a motor reverses; before the log it came either way.

    Not where speeds are noisy at rest too: what their noise adds up to, a play would swallow.
    """
    if np.all(motion.wheel_unsure_rad2[:, 1:] > 0.0):
        return
    steps = {"left": motion.left_motor_rad, "right": motion.right_motor_rad}
    crossed = {side: followed(step, _TURNED_BACK_RAD, 0.0) for side, step in steps.items()}
    for side, (left, right) in _SIDES.items():
        own = [one for one, has in (("left", left), ("right", right)) if has]
        if not any(np.any(crossed[one] > 0) and np.any(crossed[one] < 0) for one in own):
            continue
        report: dict[str, Value] = {"side": side}
        # A log may begin after a way back, whichever way the motors turn first.
        begin_alike = len({_begins_backward(steps[one]) for one in own}) == 1
        for ahead in (1.0, -1.0) if begin_alike else (1.0, -1.0, 0.0):
            fixed = {"left": float(left), "right": float(right), "ahead": ahead}
            yield Variant("backlash", backlash, ("width",), fixed, report, is_positive=True)
