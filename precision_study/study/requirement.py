"""What a configuration must hold, as a person says it: "arithmetic position 5 mm after 100 m"."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Final, Literal

from precision_study.errors import StudyError

Kind = Literal["arithmetic", "total"]
Quantity = Literal["position", "heading"]

_UNITS: Final[dict[str, dict[str, float]]] = {
    "position": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6, "nm": 1e-9},
    "heading": {
        "rad": 1.0,
        "mrad": 1e-3,
        "urad": 1e-6,
        "µrad": 1e-6,
        "deg": math.pi / 180,
        "°": math.pi / 180,
    },
}
_LENGTHS: Final = {"m": 1.0, "km": 1e3}
_TIMES: Final = {"s": 1.0, "min": 60.0, "h": 3600.0}
_EXAMPLE: Final = '"arithmetic position 5 mm after 100 m"'
_FORM: Final = re.compile(
    r"(?:(?P<kind>arithmetic|total)\s+)?(?P<quantity>position|heading)\s+"
    r"(?P<limit>[0-9.eE+-]+)\s*(?P<unit>\S+)\s+after\s+(?P<far>[0-9.eE+-]+)\s*(?P<far_unit>\S+)"
)
_FARTHEST_M: Final = 1e6
_LONGEST_S: Final = 7 * 86_400.0


@dataclass(frozen=True)
class Course:
    """How far the robots drive: a distance, or a time.

    Attributes:
        distance_m: driven distance at which a run ends [m], or None.
        duration_s: time at which it ends [s], or None.
    """

    distance_m: float | None = None
    duration_s: float | None = None

    @property
    def words(self) -> str:
        """Return it as a person says it."""
        if self.distance_m is not None:
            return f"{self.distance_m:g} m"
        return f"{self.duration_s:g} s"


@dataclass(frozen=True)
class Requirement:
    """The largest error that is allowed anywhere on a course.

    Attributes:
        kind: arithmetic (firmware − float) or total (firmware − truth).
        quantity: position or heading.
        limit: the largest error allowed [m or rad].
        course: how far.
        text: as it was said.
    """

    kind: Kind
    quantity: Quantity
    limit: float
    course: Course
    text: str


def parse_requirement(text: str) -> Requirement:
    """Return what *text* asks for: [arithmetic|total] position|heading LIMIT after DISTANCE|TIME.

    Raises:
        StudyError: another form, an unknown unit, or a number that makes no sense.
    """
    match = _FORM.fullmatch(text.strip())
    if match is None:
        raise StudyError(f"--meet {text!r}: expected the form {_EXAMPLE}")
    quantity: Quantity = "position" if match["quantity"] == "position" else "heading"
    units = _UNITS[quantity]
    if match["unit"] not in units:
        raise StudyError(
            f"--meet {text!r}: {quantity} in {match['unit']!r}: expected one of {', '.join(units)}"
        )
    limit = _number(text, match["limit"]) * units[match["unit"]]
    return Requirement(
        kind="total" if match["kind"] == "total" else "arithmetic",
        quantity=quantity,
        limit=limit,
        course=_course(text, _number(text, match["far"]), match["far_unit"]),
        text=" ".join(text.split()),
    )


def parse_course(text: str) -> Course:
    """Return the course that *text* names, such as "100 m" or "10 min". Raises StudyError."""
    match = re.fullmatch(r"([0-9.eE+-]+)\s*(\S+)", text.strip())
    if match is None:
        raise StudyError(f"--after {text!r}: expected a distance or a time, such as '100 m'")
    return _course(text, _number(text, match[1]), match[2])


def _course(text: str, value: float, unit: str) -> Course:
    if unit in _LENGTHS:
        course = Course(distance_m=value * _LENGTHS[unit])
    elif unit in _TIMES:
        course = Course(duration_s=value * _TIMES[unit])
    else:
        known = ", ".join((*_LENGTHS, *_TIMES))
        raise StudyError(f"{text!r}: after so many {unit!r}: expected one of {known}")
    if (course.distance_m or 0.0) > _FARTHEST_M or (course.duration_s or 0.0) > _LONGEST_S:
        raise StudyError(f"{text!r}: expected at most {_FARTHEST_M:g} m, or a week")
    return course


def _number(text: str, word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise StudyError(f"{text!r}: {word!r}: expected a number above 0")
    return value
