"""`chiplog ranges`: whether any word of the firmware can overflow, proved or shown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from chiplog.commands.options import DbcOption, JsonFileOption, RobotOption, SignalsOption
from chiplog.commands.output import STANDARD_OUTPUT, write_json

if TYPE_CHECKING:
    from firmware_model import KernelConfig
    from precision_study.ranges import Finding


def command(
    robot: RobotOption = None,
    mission_s: Annotated[
        float, typer.Option("--mission-s", help="Length of the mission, s.")
    ] = 3600.0,
    speed_m_s: Annotated[
        float | None,
        typer.Option("--speed-m-s", help="Fastest wheel, m/s; default: the described one."),
    ] = None,
    dbc: DbcOption = None,
    signals: SignalsOption = None,
    json_file: JsonFileOption = None,
) -> None:
    """Derive the range of every intermediate of the firmware, and say which words can overflow.

    From speed, gyro range and mission length; any acceleration. Where overflow is not impossible,
    a drive that overflows the word is run through the kernel; where a position's bound is beyond
    its word by less than its slack, that drive may last longer than the mission, as is then said.
    Exit status 1 if a word can overflow.
    """
    from chiplog.terminal import show_line, show_table
    from hil_harness.assembly import load_wire
    from hil_harness.errors import HarnessError
    from hil_harness.nodes.firmware import firmware_config
    from hil_harness.robot import load_robot
    from precision_study.ranges import Envelope, find_ranges, to_json

    described, wire = load_robot(robot), load_wire(dbc, signals)
    given = described, wire.signal_map, wire.tick_period_us
    try:
        config = firmware_config(*given)
    except HarnessError:  # a word may be too narrow: which, and when, is what is asked here
        config = firmware_config(*given, allow_overflow=True)
    envelope = Envelope.of(config, mission_s=mission_s, speed_m_s=speed_m_s)
    findings = find_ranges(config, envelope)
    if json_file is not None:
        write_json(json_file, to_json(config, envelope, findings))
    if json_file != STANDARD_OUTPUT:
        head = ["intermediate", "at most", "bits", "needed", "overflow"]
        show_table(head, [row(one, config) for one in findings])
        show_line()
        show_line(answer(findings, config))
    if any(one.verdict != "impossible" for one in findings):
        raise typer.Exit(1)


def row(finding: Finding, config: KernelConfig) -> list[str]:
    """Return one intermediate as a row: bound in its unit, width, width needed, verdict."""
    value = finding.intermediate
    bound = value.bound / 2.0**value.frac_bits
    said: str = finding.verdict
    if finding.tick is not None:
        said = f"after {finding.tick * config.constants.tick_period_s:.2f} s"
    widths = [str(value.word_bits), str(value.least_word_bits)]
    return [value.name, f"{bound:.4g} {value.unit}", *widths, said]


def answer(findings: list[Finding], config: KernelConfig) -> str:
    """Return the answer: a sentence, or a line for each word that can overflow."""
    wrong = [one for one in findings if one.verdict != "impossible"]
    if not wrong:
        return "No word can overflow."
    return "\n".join(
        f"{one.intermediate.name}: {one.intermediate.field} = {one.intermediate.word_bits}, "
        f"expected at least {one.intermediate.least_word_bits}{shown(one, config)}"
        for one in wrong
    )


def shown(finding: Finding, config: KernelConfig) -> str:
    """Return the drive that overflows a word, in words."""
    if finding.drive is None or finding.tick is None:
        return ""
    parts = []
    for one in finding.drive:
        frames = "no frame" if one.frame_every == 0 else "a frame in each"
        if one.frame_every > 1:
            frames += f" {one.frame_every}th"
        gyro = f"gyro code {one.gyro_code}" if one.gyro_validity == 0 else "gyro invalid"
        each = "each" if one.over_ticks == 1 else f"each {one.over_ticks}"
        steps = f"left {one.left_step:+d}, right {one.right_step:+d} counts in {each}"
        ticks = "a tick" if one.ticks == 1 else f"{one.ticks:,} ticks"
        parts.append(f"{ticks} of {steps}, {frames}, {gyro}")
    time_s = finding.tick * config.constants.tick_period_s
    late = ", beyond the mission," if finding.verdict == "overflows later" else ""
    return f"; overflows after {time_s:g} s{late} of: {'; '.join(parts)}"
