"""What a device under test looks like to the harness, whatever it is made of."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from hil_harness.errors import HarnessError

if TYPE_CHECKING:
    import can

    from can_bus import Database
    from hil_harness.robot import Robot
    from hil_harness.signal_map import SignalMap


class DevicePose(NamedTuple):
    """Where a device believes the robot is, as it says itself, without the bus in between."""

    x_m: float
    y_m: float
    heading_rad: float


@dataclass(frozen=True, kw_only=True)
class DeviceSetup:
    """What a device may know when it is created.

    `tick_period_us` is the time between two steps. `interface` and `channel` say which python-can
    bus the run is on; `in_lockstep` says whether the harness calls the device once per tick of
    simulated time, or a device of its own has to speak on that bus. Relative paths of a device
    start at `folder` (None: the current one).
    """

    tick_period_us: int
    database: Database | None = None
    signal_map: SignalMap | None = None
    robot: Robot | None = None
    in_lockstep: bool = True
    interface: str = "virtual"
    channel: str = ""
    bitrate: int | None = None
    folder: Path | None = None

    def locate(self, path: str) -> Path:
        """Return where a device's file is."""
        return Path(path) if self.folder is None else self.folder / path


class Device(ABC):
    """A device under test.

    `in_loop` is true for a device that the harness steps, and false for one that speaks on the bus
    by itself (an ECU, a process): that one is only watched, by `check`.
    """

    name: str
    in_loop: bool = True

    @abstractmethod
    def step(self, now_us: int, frames: Sequence[can.Message]) -> Sequence[can.Message]:
        """Run one tick on the frames received since the last; return the frames to send.

        Raises HarnessError, naming the device and the time, if the device breaks its contract.
        """

    def odometry(self) -> DevicePose | None:
        """Return the device's own pose, or None if it has none or cannot tell."""
        return None

    def check(self) -> None:  # noqa: B027  most devices cannot die by themselves
        """Raise HarnessError if the device has died."""

    def close(self) -> None:  # noqa: B027  nor hold anything
        """Give back what the device holds; may be called twice."""


class OutsideDevice(Device):
    """An ECU that is already on the bus: the harness neither starts nor steps it."""

    in_loop = False

    def __init__(self) -> None:
        """Take no part in its life."""
        self.name = "none (the ECU is outside)"

    def step(self, now_us: int, frames: Sequence[can.Message]) -> Sequence[can.Message]:
        """Refuse: there is nothing here to step."""
        raise HarnessError(not_stepped(self.name, now_us))


def at_time(now_us: int) -> str:
    """Return a moment of bus time as error messages spell it."""
    return f"at {now_us // 1_000_000}.{now_us % 1_000_000:06d} s"


def not_stepped(name: str, now_us: int) -> str:
    """Say that a device which speaks on the bus by itself was asked for a step."""
    return (
        f"device {name}: asked for a step {at_time(now_us)}, but it speaks on the bus by itself; "
        "lockstep needs python:, lib: or process: on an in-process bus"
    )
