"""`chiplog ranges`: whether any word of the firmware can overflow, proved or shown."""

from __future__ import annotations

from itertools import groupby
from typing import TYPE_CHECKING, Annotated

import typer

from chiplog.commands.options import DbcOption, JsonFileOption, RobotOption, SignalsOption
from chiplog.commands.output import STANDARD_OUTPUT, write_json

if TYPE_CHECKING:
    from firmware_model import KernelConfig
    from precision_study.ranges import Finding, Intermediate
    from precision_study.ranges.stretches import Stretch


def command(
    robot: RobotOption = None,
    mission_s: Annotated[
        float | None,
        typer.Option("--mission-s", help="Length of the mission, s; default: that of [design]."),
    ] = None,
    speed_m_s: Annotated[
        float | None,
        typer.Option("--speed-m-s", help="Fastest wheel, m/s; default: that of [design]."),
    ] = None,
    dbc: DbcOption = None,
    signals: SignalsOption = None,
    json_file: JsonFileOption = None,
) -> None:
    """Derive the range of every intermediate of the firmware, and say which words can overflow.

    From the speed and acceleration of a wheel, the turn rate and the length of a mission, as
    [drive] and [design] of robot.toml say, from rest at power-on; its way is what the wheels go, to
    and fro. What encoders count on top of that at an edge, tick after tick, is included, and six
    standard deviations of their noise_ticks, and of the gyro's noise, and frames that are lost;
    frames that come late and edges missed, counted twice or spaced unevenly are not, nor is noise
    that adds up (encoder model lesson_counter). Where overflow is not impossible, a drive that
    overflows the word is run through the kernel; where a position's bound is beyond its word and no
    drive of the mission is known to fill it, that drive lasts or goes farther than the mission, as
    is then said. A counter overflows where noise makes it take a wheel's way forward for one
    backward that is believed; then the other words are held against any way that is. A word may
    hold the mission and not what the firmware believes at most: no kernel is built with it but by
    --force, as is then said. Exit status 1 if a word can overflow, or no kernel is built.
    """
    from chiplog.commands.kernel_config import kernel_config, wheel_rounding_ticks
    from chiplog.terminal import show_line, show_table
    from hil_harness.errors import HarnessError
    from hil_harness.robot import load_robot
    from precision_study.ranges import envelope_of, find_ranges, to_json, trembling, way

    described = load_robot(robot)
    refused = ""
    try:
        config = kernel_config(described, dbc, signals)
    except HarnessError as error:  # a word may be too narrow: which, and when, is asked here
        refused = f"Refused without --force: {error}"
        config = kernel_config(described, dbc, signals, force=True)
        if 0 in (config.half_tick_m_q, config.tick_turn_q, config.sensitivity_turn_q):
            raise  # whose scale is zero overflows nowhere
        if config.beyond_c:
            raise  # there is no such word to ask of
    envelope = envelope_of(
        described,
        config,
        mission_s=mission_s,
        speed_m_s=speed_m_s,
        rounding_ticks=wheel_rounding_ticks(described, dbc, signals),
    )
    findings = find_ranges(config, envelope)
    if json_file is not None:
        write_json(json_file, to_json(config, envelope, findings))
    if json_file != STANDARD_OUTPUT:
        head = ["intermediate", "at most", "bits", "needed", "overflow"]
        show_table(head, [row(one, config) for one in findings])
        show_line()
        asked = f"{way(config, envelope)}, {trembling(described, envelope)}."
        show_line(asked[0].upper() + asked[1:])
        for line in filter(None, (answer(findings, config, refused), refused)):
            show_line(line)
    if refused or any(one.verdict != "impossible" for one in findings):
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


def answer(findings: list[Finding], config: KernelConfig, refused: str) -> str:
    """Return the answer: a sentence, or a line for each word that can overflow."""
    wrong = [one for one in findings if one.verdict != "impossible"]
    if not wrong and not refused:
        return "No word can overflow."
    return "\n".join(f"{to_mend(one.intermediate)}{shown(one, config)}" for one in wrong)


def to_mend(value: Intermediate) -> str:
    """Return a word that can overflow with its field and what would be right."""
    missing = value.least_word_bits - value.word_bits
    if value.word == "velocity":  # its word is 32 bits wide, where its point is can be chosen
        return (
            f"{value.name}: {value.field} = {value.frac_bits}, expected at most "
            f"{value.frac_bits - missing} (it saturates where it is read and is not counted)"
        )
    other = ", less encoder.noise_ticks or a slower wheel" if value.word == "counter" else ""
    return (
        f"{value.name}: {value.field} = {value.word_bits}, expected at least "
        f"{value.least_word_bits}{other}"
    )


def shown(finding: Finding, config: KernelConfig) -> str:
    """Return the drive that overflows a word, in words."""
    if finding.drive is None or finding.tick is None:
        return ""
    parts = "; ".join(map(stretch, finding.drive))
    time_s = finding.tick * config.constants.tick_period_s
    late = ""
    if finding.verdict == "overflows later":
        late = ", farther than the mission (in which neither a proof nor a drive decides),"
    return f"; overflows after {time_s:g} s{late} of: {parts}"


def stretch(one: Stretch) -> str:
    """Return a stretch of a drive in words."""
    frames = "no frame" if one.frame_every == 0 else "a frame in each"
    if one.frame_every > 1:
        frames += f" {one.frame_every}th"
    is_ramp = one.ramp_ticks or (one.is_swing and one.gyro_validity == 0)
    code = f"{one.rest_code} to {one.gyro_code}" if is_ramp else f"{one.gyro_code}"
    gyro = f"gyro code {code}" if one.gyro_validity == 0 else "gyro invalid"
    each = "each" if one.over_ticks == 1 else f"each {one.over_ticks}"
    steps = f"left {one.left_step:+d}, right {one.right_step:+d} counts in {each}"
    if one.is_swing:
        steps += f" to and fro, {one.lead_ticks} each way"
        if one.ramp_ticks:
            steps += f" with {one.ramp_ticks} from rest and back"
    elif one.ramp_ticks:
        steps = f"{one.ramp_ticks} from rest to {steps}"
    if one.lead_counts:
        lead_ticks = one.lead_ticks / one.lead_over
        counts = "a count" if one.lead_counts == 1 else f"{one.lead_counts} counts"
        steps += f", {counts} ahead and back in turn each {lead_ticks:.6g}"
    if one.pattern:
        steps += ", ahead of that left and right by " + " then ".join(runs_of(one.pattern))
    ticks = "a tick" if one.ticks == 1 else f"{one.ticks:,} ticks"
    return f"{ticks} of {steps}, {frames}, {gyro}"


def runs_of(pattern: tuple[tuple[int, int, bool], ...]) -> list[str]:
    """Return the places of a pattern in words, those that are alike together."""
    said = []
    for (left, right, arrives), places in groupby(pattern):
        ticks = len(list(places))
        often = f" for {ticks} ticks" if ticks > 1 else ""
        said.append(f"{left:+d}, {right:+d}{often}{'' if arrives else ' without a frame'}")
    return said
