"""A device under test written in Python: any object with ``step(now_us, frames) -> frames``."""

from __future__ import annotations

import contextlib
import copy
import importlib
import importlib.util
import inspect
import itertools
import sys
import traceback
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import can

from hil_harness.devices.device import Device, DevicePose, DeviceSetup, at_time
from hil_harness.errors import HarnessError

_module_numbers = itertools.count()


class PythonDevice(Device):
    """Wraps an object with ``step(now_us, frames)``; what it raises becomes one clear line.

    The object may also have ``close()``, and ``odometry()`` returning (x_m, y_m, heading_rad) or
    None.
    """

    def __init__(self, node: Any, name: str | None = None) -> None:
        """Wrap *node*. Raises HarnessError if it has no ``step``."""
        self.name = name if name is not None else type(node).__name__
        if not callable(getattr(node, "step", None)):
            raise HarnessError(
                f"device {self.name}: has no step(now_us, frames); "
                "a device returns from it the frames that it sends"
            )
        self.node = node

    def step(self, now_us: int, frames: Sequence[can.Message]) -> Sequence[can.Message]:
        """Call the object's step; check each frame that it answers, and stamp it with the tick."""
        try:
            answer = self.node.step(now_us, frames)
            sent = list(answer) if isinstance(answer, Iterable) else None
        except (Exception, SystemExit) as error:
            raise HarnessError(
                f"device {self.name}: raised {_what_and_where(error)} {at_time(now_us)}"
            ) from error
        if sent is None:
            raise HarnessError(
                f"device {self.name}: step returned {type(answer).__name__} {at_time(now_us)}; "
                "expected a list of can.Message, which may be empty"
            )
        return [self._take(message, now_us) for message in sent]

    def odometry(self) -> DevicePose | None:
        """Return what the object's ``odometry()`` says, if it has one."""
        pose = self.node.odometry() if hasattr(self.node, "odometry") else None
        return None if pose is None else DevicePose(*map(float, pose))

    def close(self) -> None:
        """Call the object's ``close()``, if it has one."""
        if hasattr(self.node, "close"):
            self.node.close()

    def _take(self, message: object, now_us: int) -> can.Message:
        """Return one frame of the answer, stamped; the device's own object stays as it is."""
        if not isinstance(message, can.Message):
            raise HarnessError(
                f"device {self.name}: step returned a {type(message).__name__} "
                f"{at_time(now_us)} where a can.Message was expected"
            )
        wrong = _what_is_wrong(message)
        if wrong is not None:
            raise HarnessError(
                f"device {self.name}: a frame sent {at_time(now_us)} {wrong}; allowed are classic "
                "data frames of up to 8 bytes with an identifier of 11 bits, or of 29 if extended"
            )
        stamp_s = now_us * 1e-6
        if message.timestamp != stamp_s:
            message = copy.deepcopy(message)
            message.timestamp = stamp_s
        return message


def load_python_device(target: str, setup: DeviceSetup) -> PythonDevice:
    """Return the device for ``module.py:ClassName`` or ``package.module:ClassName``.

    The class (or function) is called with *setup* if it takes an argument, else with nothing.
    Raises HarnessError if the module or the name is not there, or creating the device fails.
    """
    module_name, separator, attribute = target.rpartition(":")
    if not separator or not module_name or not attribute:
        raise HarnessError(
            f"device python:{target}: expected python:FILE.py:CLASS or python:PACKAGE.MODULE:CLASS"
        )
    module = _load_module(module_name, setup)
    factory = getattr(module, attribute, None)
    if not callable(factory):
        raise HarnessError(f"device python:{target}: {module_name} has no class {attribute!r}")
    try:
        node = factory(setup) if _takes_an_argument(factory) else factory()
    except HarnessError:
        raise
    except (Exception, SystemExit) as error:
        raise HarnessError(
            f"device python:{target}: creating it raised {_what_and_where(error)}"
        ) from error
    return PythonDevice(node, name=attribute)


def _load_module(name: str, setup: DeviceSetup) -> ModuleType:
    try:
        if not name.endswith(".py"):
            return importlib.import_module(name)
        path = setup.locate(name).resolve()
        if not path.is_file():
            raise HarnessError(f"device python:{name}: no such file")
        # A fresh name each time: two tests' node.py are two modules.
        module_name = f"_chiplog_device_{next(_module_numbers)}_{path.stem}"
        spec = importlib.util.spec_from_file_location(module_name, path)
        assert spec is not None  # as for every name that ends in .py
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[module_name] = module
        with _neighbours_importable(path.parent):
            spec.loader.exec_module(module)
    except HarnessError:
        raise
    except (Exception, SystemExit) as error:
        raise HarnessError(
            f"device python:{name}: importing it raised {_what_and_where(error)}"
        ) from error
    return module


@contextlib.contextmanager
def _neighbours_importable(folder: Path) -> Iterator[None]:
    """Let a file import the files next to it, as `python FILE` would."""
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):
            sys.path.remove(str(folder))


def _takes_an_argument(factory: Any) -> bool:
    try:
        parameters = inspect.signature(factory).parameters.values()
    except (TypeError, ValueError):
        return False
    positional = (
        inspect.Parameter.POSITIONAL_ONLY,
        inspect.Parameter.POSITIONAL_OR_KEYWORD,
        inspect.Parameter.VAR_POSITIONAL,
    )
    return any(parameter.kind in positional for parameter in parameters)


def _what_is_wrong(message: can.Message) -> str | None:
    """Return why a frame is no classic data frame, None if it is one."""
    if message.is_fd:
        return "is a CAN FD frame"
    if message.is_error_frame:
        return "is an error frame"
    if message.is_remote_frame:
        return "is a remote frame"
    frame_id = message.arbitration_id
    if not isinstance(frame_id, int):
        return f"has the identifier {frame_id!r}"
    bits = 29 if message.is_extended_id else 11
    if not 0 <= frame_id < 1 << bits:
        return f"has the identifier {frame_id:#x}, outside {bits} bits"
    if len(message.data) > 8:
        return f"has {len(message.data)} bytes"
    if message.dlc != len(message.data):
        return f"says that it has {message.dlc} bytes, but has {len(message.data)}"
    return None


def _what_and_where(error: BaseException) -> str:
    """Return an exception's type, text and innermost line, in one line.

    An import that fails ends inside Python's own machinery: that line would help nobody.
    """
    text = " ".join(str(error).split())
    frames = traceback.extract_tb(error.__traceback__)
    where = ""
    if frames and not frames[-1].filename.startswith("<frozen "):
        where = f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})"
    return f"{type(error).__name__}: {text}{where}" if text else f"{type(error).__name__}{where}"
