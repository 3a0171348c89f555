"""A device under test in a shared library: the C interface of ``include/chiplog_device.h``."""

from __future__ import annotations

import ctypes
import math
import shutil
import struct
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import can

from hil_harness.devices.device import Device, DevicePose, DeviceSetup, at_time
from hil_harness.errors import HarnessError

# The numbers of chiplog_device.h; a test compiles the header and compares each of them.
ABI_VERSION: Final = 1
MAX_FRAMES: Final = 256
FRAME_EXTENDED: Final = 0x01
FRAME_REMOTE: Final = 0x02
POSE_NONE: Final = 0
POSE_SI: Final = 1
POSE_RAW: Final = 2
FRAME: Final = struct.Struct("=QIBB2x8s")  # chiplog_frame
POSE: Final = struct.Struct("=dddqqq")  # chiplog_pose

_FUNCTIONS: Final = ("chiplog_init", "chiplog_step", "chiplog_odometry")
_ROOM_BYTES: Final = MAX_FRAMES * FRAME.size
_GUARD_FRAMES: Final = 16
_GUARD_BYTE: Final = b"\xa5"
_Q32: Final = 2.0**-32


def include_dir() -> Path:
    """Return the folder that holds ``chiplog_device.h``."""
    return Path(__file__).parent / "include"


class SharedLibraryDevice(Device):
    """Calls the three functions of a library.

    The library is loaded from a private copy, so that two devices from one file do not share their
    static variables and a rebuilt file is loaded anew. It stays loaded until the process ends.

    Raises HarnessError if the file cannot be loaded, a function is missing, or the library was
    built against another version of the header.
    """

    def __init__(self, path: str | Path, setup: DeviceSetup) -> None:
        """Load the library at *path* and call its ``chiplog_init``."""
        path = Path(path)
        self.name = path.name
        if not path.is_file():
            raise HarnessError(f"device lib:{path}: no such file")
        library = _load_private_copy(path)
        for function in _FUNCTIONS:
            if not hasattr(library, function):
                raise HarnessError(
                    f"device {self.name}: exports no function {function}; "
                    f"a device exports {', '.join(_FUNCTIONS)} (see chiplog_device.h)"
                )
        self._init = library.chiplog_init
        self._init.argtypes = [ctypes.c_uint32]
        self._init.restype = ctypes.c_int32
        self._step = library.chiplog_step
        self._step.argtypes = [
            ctypes.c_uint64,
            ctypes.c_void_p,
            ctypes.c_uint32,
            ctypes.c_void_p,
            ctypes.c_uint32,
        ]
        self._step.restype = ctypes.c_int32
        self._odometry = library.chiplog_odometry
        self._odometry.argtypes = [ctypes.c_void_p]
        self._odometry.restype = ctypes.c_int32

        self._received = ctypes.create_string_buffer(_ROOM_BYTES)
        self._sent = ctypes.create_string_buffer(_ROOM_BYTES + _GUARD_FRAMES * FRAME.size)
        # Behind the room for answers lies a strip that must stay as it is.
        self._guard = _GUARD_BYTE * (_GUARD_FRAMES * FRAME.size)
        ctypes.memmove(ctypes.byref(self._sent, _ROOM_BYTES), self._guard, len(self._guard))
        self._pose = ctypes.create_string_buffer(POSE.size)
        # In real time the rig's thread steps the device while a test asks for its pose.
        self._lock = threading.Lock()

        version = self._init(setup.tick_period_us)
        if version < 0:
            raise HarnessError(
                f"device {self.name}: chiplog_init refused with {version} "
                f"for a tick of {setup.tick_period_us} us"
            )
        if version != ABI_VERSION:
            raise HarnessError(
                f"device {self.name}: built against version {version} of chiplog_device.h, "
                f"this is version {ABI_VERSION}; rebuild it against {include_dir()}"
            )

    def step(self, now_us: int, frames: Sequence[can.Message]) -> Sequence[can.Message]:
        """Call ``chiplog_step``; check each frame that it answers."""
        if len(frames) > MAX_FRAMES:
            raise HarnessError(
                f"device {self.name}: {len(frames)} frames came in one tick {at_time(now_us)}; "
                f"chiplog_step takes {MAX_FRAMES} at the most"
            )
        with self._lock:
            return self._answer(now_us, frames)

    def odometry(self) -> DevicePose | None:
        """Call ``chiplog_odometry``. Raises HarnessError if it fails or answers nonsense."""
        with self._lock:
            kind = self._odometry(self._pose)
            values = POSE.unpack(self._pose.raw)
        x_m, y_m, heading_rad, x_m_q32, y_m_q32, heading_turn_q32 = values
        if kind == POSE_NONE:
            return None
        if kind == POSE_RAW:
            return DevicePose(
                x_m_q32 * _Q32, y_m_q32 * _Q32, heading_turn_q32 * _Q32 * 2.0 * math.pi
            )
        if kind != POSE_SI:
            raise HarnessError(
                f"device {self.name}: chiplog_odometry returned {kind}; expected "
                f"{POSE_NONE} (none), {POSE_SI} (SI) or {POSE_RAW} (raw)"
            )
        pose = DevicePose(x_m, y_m, heading_rad)
        if not all(map(math.isfinite, pose)):
            raise HarnessError(f"device {self.name}: chiplog_odometry gave the pose {tuple(pose)}")
        return pose

    def _answer(self, now_us: int, frames: Sequence[can.Message]) -> Sequence[can.Message]:
        for index, frame in enumerate(frames):
            self._put(index, frame, now_us)
        count = self._step(now_us, self._received, len(frames), self._sent, MAX_FRAMES)
        if count < 0:
            raise HarnessError(
                f"device {self.name}: chiplog_step failed with {count} {at_time(now_us)}"
            )
        guard = bytes(memoryview(self._sent)[_ROOM_BYTES:])
        if count > MAX_FRAMES or guard != self._guard:
            raise HarnessError(
                f"device {self.name}: chiplog_step wrote more frames than the {MAX_FRAMES} "
                f"it was given room for (returned {count}) {at_time(now_us)}"
            )
        return [self._take(index, now_us) for index in range(count)]

    def _put(self, index: int, frame: can.Message, now_us: int) -> None:
        if frame.is_fd or len(frame.data) > 8:
            raise HarnessError(
                f"device {self.name}: frame {frame.arbitration_id:#x} {at_time(now_us)} has "
                f"{len(frame.data)} bytes; chiplog_frame holds classic CAN frames of up to 8"
            )
        flags = FRAME_EXTENDED if frame.is_extended_id else 0
        if frame.is_remote_frame:
            flags |= FRAME_REMOTE
        FRAME.pack_into(
            self._received,
            index * FRAME.size,
            round(frame.timestamp * 1e6),
            frame.arbitration_id,
            flags,
            frame.dlc,
            bytes(frame.data),
        )

    def _take(self, index: int, now_us: int) -> can.Message:
        _, frame_id, flags, length, data = FRAME.unpack_from(self._sent, index * FRAME.size)
        extended = bool(flags & FRAME_EXTENDED)
        remote = bool(flags & FRAME_REMOTE)
        wrong = None
        if flags & ~(FRAME_EXTENDED | FRAME_REMOTE):
            wrong = f"flags {flags:#04x}, of which only {FRAME_EXTENDED | FRAME_REMOTE:#04x} exist"
        elif length > 8:
            wrong = f"a length of {length} bytes, more than 8"
        elif frame_id >= (1 << 29 if extended else 1 << 11):
            wrong = f"the identifier {frame_id:#x}, more than {29 if extended else 11} bits"
        if wrong is not None:
            raise HarnessError(
                f"device {self.name}: frame {index} sent {at_time(now_us)} has {wrong}"
            )
        return can.Message(
            timestamp=now_us * 1e-6,
            arbitration_id=frame_id,
            is_extended_id=extended,
            is_remote_frame=remote,
            dlc=length,
            data=None if remote else data[:length],
        )


def _load_private_copy(path: Path) -> ctypes.CDLL:
    with tempfile.TemporaryDirectory(prefix="chiplog-device-") as folder:
        # The loader knows a library by its path: another path is another set of variables.
        copy = Path(shutil.copy(path, folder))
        try:
            return ctypes.CDLL(str(copy))
        except OSError as error:
            reason = " ".join(str(error).replace(str(copy), path.name).split())
            raise HarnessError(f"device lib:{path}: cannot be loaded: {reason}") from error
