"""What stands in the DBC stands nowhere else: no Python source repeats one of its numbers."""

from __future__ import annotations

import ast
import math
import operator
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast

import pytest

from can_bus import load_database

ROOT = Path(__file__).parent.parent.parent
PACKAGES = (
    *("can_bus", "chiplog", "firmware_model", "gap_diagnosis", "hil_harness", "precision_study"),
    "sim_plant",
)
DATABASE = load_database()

# A number this small is a loop bound, an exponent or a percentage somewhere: it proves nothing.
SMALLEST_TELLING_INTEGER = 150

# A round time (10 ms, 0.05 s) proves nothing by itself, but bound to a name like these it does.
TIME_NAME = re.compile(r"(period|cycle|tick|delay|phase).*_(us|ms|s)$")
MICROSECONDS = {"us": 1, "ms": 1_000, "s": 1_000_000}

# Facts of their own that happen to be equal to one of the DBC's.
OWN_FACTS = {
    ("hil_harness/lesson.py", 0.01): "the textbook lesson's own step",
}

OPERATORS: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.LShift: operator.lshift,
}


def is_power_of_two(value: float) -> bool:
    return abs(math.frexp(value)[0]) == 0.5


def times_us() -> dict[int, str]:
    """Return the cycle times and phases of the shipped DBC and whose they are."""
    found: dict[int, str] = {}
    for message in DATABASE.messages.values():
        assert message.cycle_time_us is not None
        found.setdefault(message.cycle_time_us, f"cycle time of {message.name}")
        if message.start_delay_us:
            found.setdefault(message.start_delay_us, f"start delay of {message.name}")
    return found


TIMES_US = times_us()


def facts() -> dict[float, str]:
    """Return the telling numbers of the shipped DBC and what they are."""
    found: dict[float, str] = {}

    def add(value: float | None, meaning: str) -> None:
        if value is None or (float(value).is_integer() and abs(value) < SMALLEST_TELLING_INTEGER):
            return
        found.setdefault(value, meaning)

    add(DATABASE.bitrate, "bit rate")
    for microseconds, meaning in TIMES_US.items():
        if len(str(microseconds).rstrip("0")) > 1:
            add(microseconds, f"{meaning} in µs")
            add(microseconds / MICROSECONDS["s"], f"{meaning} in s")
    for message in DATABASE.messages.values():
        assert message.e2e is not None
        add(message.frame_id, f"identifier of {message.name}")
        add(message.e2e.data_id, f"E2E data ID of {message.name}")
        for signal in message.signals.values():
            add(signal.factor, f"factor of {signal.path}")
            # Words and their masks are sized by powers of two; a range that is one proves nothing.
            for what, limit in (("minimum", signal.minimum), ("maximum", signal.maximum)):
                assert limit is not None
                if not float(limit).is_integer() and not is_power_of_two(limit):
                    add(limit, f"{what} of {signal.path}")
            if signal.invalid_raw is not None and not is_power_of_two(signal.invalid_raw):
                add(signal.invalid_raw, f"SNA of {signal.path}")
    return found


FACTS = facts()


def value_of(node: ast.AST) -> float | None:
    """Return the number that an expression of literals is."""
    if isinstance(node, ast.Constant):
        is_number = isinstance(node.value, (int, float)) and not isinstance(node.value, bool)
        return cast("float", node.value) if is_number else None
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        inner = value_of(node.operand)
        return None if inner is None else -inner
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        left, right = value_of(node.left), value_of(node.right)
        if left is None or right is None or abs(right) > 1e6:
            return None
        try:
            return OPERATORS[type(node.op)](left, right)
        except (TypeError, ValueError, ZeroDivisionError):
            return None
    return None


def bindings(tree: ast.AST) -> Iterator[tuple[str, ast.expr]]:
    """Yield each name with the expression it is given: assignments, keywords, defaults."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            for target in node.targets:
                yield ast.unparse(target), node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None:
            yield ast.unparse(node.target), node.value
        elif isinstance(node, ast.keyword) and node.arg is not None:
            yield node.arg, node.value
        elif isinstance(node, ast.arguments):
            positional = [*node.posonlyargs, *node.args]
            defaulted = positional[len(positional) - len(node.defaults) :]
            yield from zip((a.arg for a in defaulted), node.defaults, strict=True)
            for argument, default in zip(node.kwonlyargs, node.kw_defaults, strict=True):
                if default is not None:
                    yield argument.arg, default


def repetitions(source: str) -> Iterator[tuple[int, float, str]]:
    """Yield line, number and meaning for each number in the source that the DBC states."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        value = value_of(node)
        if value is None or value not in FACTS:
            continue
        # A power of two that is computed is the width of a word, not a scale.
        if is_power_of_two(value) and not isinstance(node, ast.Constant):
            continue
        assert isinstance(node, ast.expr)
        yield node.lineno, value, FACTS[value]
    for name, expression in bindings(tree):
        value = value_of(expression)
        match = TIME_NAME.search(name.lower())
        if value and match:
            meaning = TIMES_US.get(round(value * MICROSECONDS[match[2]]))
            if meaning is not None:
                yield expression.lineno, value, meaning


def test_the_facts_are_telling() -> None:
    meanings = " ".join(FACTS.values())
    for message in DATABASE.messages:
        assert f"identifier of {message}" in meanings
        assert f"E2E data ID of {message}" in meanings
    assert FACTS[2.0**-32] == "factor of ODOMETRY_X.x_m"
    assert len(FACTS) > 40


@pytest.mark.parametrize(
    "source",
    [
        f"ENCODER_ID = {DATABASE.message('ENCODER').frame_id:#x}",
        f"period_us = {DATABASE.message('ENCODER').cycle_time_us}",
        "TICK_PERIOD_US = 10 * 1000",
        "def run(*, tick_period_s: float = 0.01) -> None: ...",
        "node = Node(cycle_ms=10)",
        "self.phase_us = 50_000",
        f"wait({DATABASE.message('ENVIRONMENT').cycle_time_us})",
        f"bus.send({DATABASE.message('IMU').frame_id}, b'')",
        f"x_m = raw * {DATABASE.message('ODOMETRY_X').signal('x_m').factor!r}",
        f"if count == {DATABASE.message('ENCODER').signal('left_count').invalid_raw}: pass",
        "if count == (1 << 17) - 1: pass",
        f"open_bus(bitrate={DATABASE.bitrate:_})",
    ],
)
def test_a_repeated_number_is_found(source: str) -> None:
    assert list(repetitions(source))


@pytest.mark.parametrize("package", PACKAGES)
def test_no_source_repeats_a_number_of_the_dbc(package: str) -> None:
    repeated = [
        f"{path.relative_to(ROOT)}:{line}: {value} is the {meaning}"
        for path in sorted((ROOT / package).rglob("*.py"))
        for line, value, meaning in repetitions(path.read_text())
        if (path.relative_to(ROOT).as_posix(), value) not in OWN_FACTS
    ]
    assert repeated == []
