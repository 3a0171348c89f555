"""How large each noise may be, and which levels a log asks for."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gap_diagnosis.granted import NOTHING, Granted
from gap_diagnosis.motion.nodes import Nodes
from gap_diagnosis.motion.whitening import INEXACT, LATE_LASTS, LEVELS, OF_ROWS, SPEED_NOISE_S
from gap_diagnosis.prediction import USUAL_CONTACT_M_PER_SQRT_M
from gap_diagnosis.recording import Floats
from gap_diagnosis.scoring import LevelPrior
from hil_harness.robot import Robot

_MOST: Final = {"inexact": 0.3, "speed_noise_s": 0.3, "late_lasts_s": 1.0}
_HIGHEST: Final = np.array([_MOST.get(name, 100.0) for name in LEVELS])
"""What varies by more than a third is there at times, and no effect that lasts: a slip of 2 % for
8 s had another track, where that might be nothing for the rest of a log. Noise of speeds that lasts
for longer is what a step rounds off, and is told. Rows that are late by much the same for longer
than a second are a delay: with a wander of three, healthy robots had one of 26 ms."""
_LOUDER: Final = 1.3
_BANDWIDTH_HZ: Final = 100.0
"""Of a gyro's own filter, as usual: 40 to 250 Hz."""
FLOORS: Final = (
    *(1e-4, 2e-5, 1e-6, 1e-7, 1e-3, 1e-4, 1.0, 5e-3),
    *(1e-6, 1e-6, 0.02),
    *(1e-4, 1e-4, 1e-6, 1e-5, 1e-5, 0.05),
)
"""No floor is smoother than 0.1 mm per root metre, on none does a wheel slip by less than 0.01 % of
its way, and no room measures better than 0.1 mm: without these, data without noise would make any
small misfit a certainty. Nor have speeds less noise than is told: what a step rounds off is the
same for as long as a wheel turns as fast, which no level and no correlation time describe."""


def level_prior(robot: Robot, granted: Granted = NOTHING, *, row_s: float = 0.0) -> LevelPrior:
    """Return the prior: contact 0.1 to 3 mm per square root of a metre and slip that wanders by
    0.03 % of the way, gyro as described, noise of speeds as told or up to some times louder, rows
    read a millisecond or some more early or late, reference as in a lab or as it is known.

    *row_s*: how long a row lasts of which nothing tells whether its rate is a mean over it or of a
    moment. That has all the noise that the gyro's own filter lets through.
    """
    gyro = robot.plant.gyro
    # What a first-order filter lets through, folded into the rows' band; between it and a mean over
    # the row anything is as likely, in the logarithm.
    louder = 0.5 * math.log1p(math.pi * _BANDWIDTH_HZ * row_s)
    contact = max(robot.plant.contact.noise_m_per_sqrt_m, USUAL_CONTACT_M_PER_SQRT_M)
    noise = max(gyro.noise_density_rad_per_sqrt_s, 1e-5)
    walk = max(gyro.bias_walk_density_rad_s_per_sqrt_s, 3e-6)
    table = {
        "contact_m_per_sqrt_m": (contact, 0.9),
        "lateral_m_per_sqrt_m": (1e-4, 1.5),
        "gyro_noise_rad_per_sqrt_s": (
            noise * math.exp(0.5 * louder),
            math.hypot(0.35, louder / math.sqrt(12.0)),
        ),
        "gyro_bias_walk_rad_s_per_sqrt_s": (walk, 0.5),
        "inexact": (0.01, 1.0),
        "slip_wander": (3e-4, 1.0),
        "speed_noise": (1.0, 0.7),
        "speed_noise_s": (0.03, 1.2),
        "wheels_late_s": (1e-3, 1.5),
        "gyro_late_s": (1e-3, 1.5),
        "late_lasts_s": (0.2, 1.2),
        "reference_position_m": (granted.number("reference_noise.position") or 1e-3, 2.0),
        "reference_heading_rad": (granted.number("reference_noise.heading") or 1e-3, 2.0),
        "reference_stamp_s": (3e-4, 2.0),
        "reference_slow_position_m": (3e-4, 2.0),
        "reference_slow_heading_rad": (3e-4, 2.0),
        "reference_slow_s": (1.0, 1.2),
    }
    rows = np.array([table[name] for name in LEVELS])
    return LevelPrior(rows[:, 0], rows[:, 1], np.array(FLOORS), _HIGHEST)


def silent_levels(nodes: Nodes) -> frozenset[int]:
    """Return the levels on which nothing depends: those of channels that a log has not, and by how
    much effects vary, as long as there are none."""
    kinds = {
        "gyro_": nodes.has_gyro,
        "reference_": nodes.has_reference,
        "reference_heading_": nodes.has_heading,
        "reference_slow_heading_": nodes.has_heading,
    }
    missing = tuple(kind for kind, is_there in kinds.items() if not is_there)
    if not np.any(nodes.motion.wheel_unsure_rad2):
        missing += ("speed_",)
    if not nodes.motion.are_rows_late:
        missing += OF_ROWS
    silent = {place for place, name in enumerate(LEVELS) if name.startswith(missing)}
    return frozenset(silent | {INEXACT})


def is_louder(levels: Floats, than: Floats) -> bool:
    """Tell whether levels, float64[levels], hold more of any noise than others, at any frequency.

    How effects vary is none of it: without effects nothing does. Nor is how long noise of speeds
    lasts: what it adds up to is the same, and the longer it lasts, the less of it is quick.

    Slow noise of standard deviation s and correlation time T has the spectral density
    2 s² T / (1 + (w T)²): s² T decides below its corner, s² / T above.
    """
    ratio = np.delete(levels / than, [INEXACT, SPEED_NOISE_S, LATE_LASTS])
    slow, longer = ratio[-3:-1], math.sqrt(float(ratio[-1]))
    return bool(np.concatenate([ratio[:-3], slow * longer, slow / longer]).max() > _LOUDER)
