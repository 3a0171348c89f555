"""Devices under test: a Python object, a C library, a program, or an ECU on the bus."""

from hil_harness.devices.device import Device, DevicePose, DeviceSetup, OutsideDevice
from hil_harness.devices.process import ProcessDevice
from hil_harness.devices.python_object import PythonDevice, load_python_device
from hil_harness.devices.resolve import DEVICE_HELP, open_device
from hil_harness.devices.shared_library import SharedLibraryDevice, include_dir

__all__ = [
    "DEVICE_HELP",
    "Device",
    "DevicePose",
    "DeviceSetup",
    "OutsideDevice",
    "ProcessDevice",
    "PythonDevice",
    "SharedLibraryDevice",
    "include_dir",
    "load_python_device",
    "open_device",
]
