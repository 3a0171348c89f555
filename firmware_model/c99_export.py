"""A configuration as a C header, for firmware that is built with the C99 kernel."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Final

from firmware_model import c99
from firmware_model.c99_layout import c_types, config_tables, config_values
from firmware_model.config import KernelConfig, require_c

CONFIG_HEADER: Final = "chiplog_config.h"
MARK: Final = "/* Written by `chiplog export-c`; do not edit. */\n"
"""The first line of the header: a file that begins with it may be written again."""

_SUFFIXES: Final = {"int64_t": "INT64_C({})", "uint32_t": "UINT32_C({})", "int32_t": "INT32_C({})"}


def export_files(config: KernelConfig, robot: str, proved: str | None = None) -> dict[str, str]:
    """Return name and text of each file: the kernel's header and source, and the configuration.

    Args:
        config: from `build_config`.
        robot: the robot's name, for a comment.
        proved: the mission in which x and y stay within their word, likewise; None: unproved.
    """
    return {
        CONFIG_HEADER: config_header(config, robot, proved),
        c99.HEADER: c99.text(c99.HEADER),
        c99.SOURCE: c99.text(c99.SOURCE),
    }


def config_header(config: KernelConfig, robot: str, proved: str | None = None) -> str:
    """Return the header that defines ``chiplog_robot``, to be included by one source file.

    The table is that of the kernel in Python: correctly rounded by integer arithmetic.

    Raises:
        FirmwareError: a configuration beyond C.
    """
    require_c(config)
    types = c_types("chiplog_config")
    values = {name: _literal(types[name], value) for name, value in config_values(config).items()}
    sines, angles = config_tables(config)
    values["sine_table"] = "chiplog_sine_table" if sines.size else "0"
    values["cordic_table"] = "chiplog_cordic_table" if angles.size else "0"
    fields = "\n".join(f"    .{name} = {values[name]}," for name in types)
    if sines.size:
        table = _table("int32_t", "chiplog_sine_table", sines.tolist())
    else:
        table = _table("int64_t", "chiplog_cordic_table", angles.tolist())
    period_us = round(config.constants.tick_period_s * 1e6)
    return (
        f"{MARK}#ifndef CHIPLOG_CONFIG_H\n#define CHIPLOG_CONFIG_H\n\n"
        f'#include "{c99.HEADER}"\n\n{_about(config, robot, proved)}\n'
        f"#define CHIPLOG_TICK_PERIOD_US UINT32_C({period_us})\n\n"
        f"{table}\n\nstatic const chiplog_config chiplog_robot = {{\n{fields}\n}};\n\n#endif\n"
    )


def _about(config: KernelConfig, robot: str, proved: str | None) -> str:
    """Return a comment with the robot and the unit of each output."""
    one, known = config.description, config.constants
    printable = "".join(c if c.isprintable() and c not in "*/\\?" else "_" for c in robot)
    lines = [
        f"Robot {printable}: wheel radius {known.wheel_radius_m:g} m, wheelbase "
        f"{known.wheelbase_m:g} m, {known.ticks_per_rev} ticks per turn, tick period "
        f"{known.tick_period_s:g} s, mode {one.mode}, {one.integration}.",
        f"x_m_q, y_m_q: 2^-{one.position.frac_bits} m in {one.position.word_bits} bits "
        f"({one.position.rounding}, {one.position.overflow}). "
        + (
            "It is not proved that they stay within them."
            if proved is None
            else f"Proved that they stay within them: {proved}."
        ),
        f"heading_turn_q: 2^-{one.heading.frac_bits} turn ({one.heading.rounding}), wraps at "
        "one turn.",
        f"Speed and turn rate: 2^-{one.velocity.frac_bits} m/s and rad/s in 32 bits.",
        f"gyro_offset_q: 2^-{one.gyro.offset_frac_bits} LSB.",
    ]
    wrapped = [textwrap.wrap(line, 96, break_on_hyphens=False) for line in lines]
    body = "\n".join(f" * {part}" for parts in wrapped for part in parts)
    return f"/*\n{body}\n */"


def _literal(c_type: str, value: int) -> str:
    """Return a number as C writes it; the least one has no literal of its own."""
    if c_type not in _SUFFIXES:
        return str(value)
    if value == -(1 << 63) or (value == -(1 << 31) and c_type == "int32_t"):
        return f"({_SUFFIXES[c_type].format(value + 1)} - 1)"
    return _SUFFIXES[c_type].format(value)


def _table(c_type: str, name: str, values: Sequence[int]) -> str:
    numbers = textwrap.fill(
        ", ".join(
            _literal(c_type, value) if c_type == "int64_t" else str(value) for value in values
        ),
        width=98,
        initial_indent="    ",
        subsequent_indent="    ",
    )
    return f"static const {c_type} {name}[{len(values)}] = {{\n{numbers},\n}};"
