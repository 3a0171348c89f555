"""From what a user writes after ``--device`` to a device."""

from __future__ import annotations

from typing import Final

from hil_harness.devices.device import Device, DeviceSetup, OutsideDevice
from hil_harness.devices.process import ProcessDevice
from hil_harness.devices.python_object import load_python_device
from hil_harness.devices.shared_library import SharedLibraryDevice
from hil_harness.errors import HarnessError

DEVICE_HELP: Final = (
    "python:FILE.py:CLASS, lib:FILE.so, process:COMMAND, or none (the ECU is on the bus already)"
)


def open_device(text: str, setup: DeviceSetup) -> Device:
    """Return the device that *text* names.

    ``python:node.py:Node`` or ``python:package.module:Node`` creates an object with
    ``step(now_us, frames)``; ``lib:./node.so`` loads a shared library with the C interface of
    ``chiplog_device.h``; ``process:./node --flag`` starts a program (see `process`); ``none`` is an
    ECU that is on the bus already. Raises HarnessError if it cannot be had.
    """
    kind, _, target = text.partition(":")
    if text == "none":
        if setup.in_lockstep:
            raise HarnessError(
                f"device none: no ECU can reach the in-process interface {setup.interface!r}; "
                "use --interface socketcan, udp_multicast or your hardware"
            )
        return OutsideDevice()
    if kind == "python" and target:
        return load_python_device(target, setup)
    if kind == "lib" and target:
        return SharedLibraryDevice(setup.locate(target), setup)
    if kind == "process" and target:
        return ProcessDevice(target, setup)
    raise HarnessError(f"device {text!r}: expected {DEVICE_HELP}")
