"""How far simulated and real lie apart, where along the data, and how far an explanation closes it.

Nothing here fits anything: metrics, shares and intervals of paths that others predict.
"""

from gap_diagnosis.gap.drive_path import commanded_path
from gap_diagnosis.gap.holdout import HoldOut, hold_out
from gap_diagnosis.gap.how_far import Compared, closed_share, gap_of, metric_of
from gap_diagnosis.gap.manoeuvres import KINDS, kinds_of
from gap_diagnosis.gap.on_recording import (
    Replayed,
    compare_all,
    levels_of,
    odometry_rms,
    windows_on,
)
from gap_diagnosis.gap.waterfall import shapley_reductions
from gap_diagnosis.gap.where import manoeuvre_segments

__all__ = [
    "KINDS",
    "Compared",
    "HoldOut",
    "Replayed",
    "closed_share",
    "commanded_path",
    "compare_all",
    "gap_of",
    "hold_out",
    "kinds_of",
    "levels_of",
    "manoeuvre_segments",
    "metric_of",
    "odometry_rms",
    "shapley_reductions",
    "windows_on",
]
