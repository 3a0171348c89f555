"""`chiplog busload`: how busy the bus is, and how long each frame can take at worst."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from chiplog.commands.options import BitrateOption, DbcOption, JsonFileOption
from chiplog.commands.output import STANDARD_OUTPUT, write_json
from chiplog.errors import CommandError

if TYPE_CHECKING:
    from can_bus.bus_load import BusLoad, FrameLoad

_LONGEST_JITTER_US = 10_000_000


def command(
    dbc: DbcOption = None,
    bitrate: BitrateOption = None,
    jitter_us: Annotated[
        int,
        typer.Option(
            "--jitter-us", help="How much later than its cycle each frame may be queued, µs."
        ),
    ] = 0,
    json_file: JsonFileOption = None,
) -> None:
    """Print the load of the bus and the worst-case response time of each cyclic frame of a DBC.

    With as many stuff bits as there can be, transmit queues ordered by priority and no errors on
    the bus (Davis, Burns, Bril, Lukkien 2007). A response ends when the bus is free again.
    """
    from can_bus import load_database
    from can_bus.bus_load import bus_load
    from chiplog.terminal import show_line, show_table

    if not 0 <= jitter_us <= _LONGEST_JITTER_US:
        raise CommandError(
            f"--jitter-us {jitter_us}: expected a whole number from 0 to {_LONGEST_JITTER_US} [µs]"
        )
    found = bus_load(load_database(dbc), bitrate, jitter_us=jitter_us)
    if json_file is not None:
        write_json(json_file, to_json(found))
    if json_file != STANDARD_OUTPUT:
        head = ["message", "identifier", "cycle", "bits", "load", "worst response", "of its cycle"]
        show_table(head, [_row(one) for one in found.frames], words=2)
        show_line()
        for line in _answer(found):
            show_line(line)


def to_json(found: BusLoad) -> dict[str, Any]:
    """Return the result as JSON: times in seconds, null where there is no bound."""
    return {
        "schema": 1,
        "bitrate": found.bitrate,
        "jitter_us": found.jitter_us,
        "load": found.load,
        "frames": [
            {
                "message": one.spec.name,
                "arbitration_id": one.spec.frame_id,
                "is_extended": one.spec.is_extended,
                "period_s": one.response.frame.period_ns / 1e9,
                "length_bits": one.response.frame.length_bits,
                "load": one.load,
                "response_s": one.response.response_s,
                "end_of_frame_s": one.response.end_of_frame_s,
                "instance": one.response.instance,
                "meets_cycle": _meets_cycle(one),
            }
            for one in found.frames
        ],
        "not_cyclic": list(found.not_cyclic),
        "not_classic": list(found.not_classic),
    }


def _meets_cycle(one: FrameLoad) -> bool:
    response_s = one.response.response_s
    return response_s is not None and response_s * 1e9 <= one.response.frame.period_ns + 1e-3


def _row(one: FrameLoad) -> list[str]:
    frame, response_s = one.response.frame, one.response.response_s
    period_s = frame.period_ns / 1e9
    identifier = f"0x{one.spec.frame_id:X}" + ("x" if one.spec.is_extended else "")
    worst = "no bound" if response_s is None else f"{response_s * 1e3:.3f} ms"
    share = "" if response_s is None else f"{response_s / period_s:.1%}"
    cycle = f"{period_s * 1e3:g} ms"
    return [
        one.spec.name, identifier, cycle, str(frame.length_bits), f"{one.load:.2%}", worst, share,
    ]  # fmt: skip


def _answer(found: BusLoad) -> list[str]:
    lines = [f"Load at {found.bitrate} bit/s: {found.load:.1%} at most."]
    late = [one.spec.name for one in found.frames if not _meets_cycle(one)]
    if late:
        lines.append(f"May take longer than their cycle: {', '.join(late)}.")
    else:
        lines.append("Every frame is through before its next one is due.")
    if found.not_cyclic:
        lines.append(f"Not counted, without a cycle time: {', '.join(found.not_cyclic)}.")
    if found.not_classic:
        lines.append(f"Not counted, CAN FD: {', '.join(found.not_classic)}.")
    return lines
