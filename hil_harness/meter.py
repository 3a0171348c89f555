"""How busy the bus was: frames per message and bits, counted while a run goes on."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import can
import numpy as np

from can_bus import Database
from can_bus.timing import INTERFRAME_BITS, frame_length_bits, frame_length_bits_array

_CHUNK_FRAMES = 8192


class BusMeter:
    """Counts frames and the bit times they take, stuff bits and intermission included."""

    def __init__(self, database: Database) -> None:
        """Start at zero."""
        self.frames = 0
        self.bits = 0
        self._database = database
        self._by_message: dict[str, int] = {}
        self._waiting: list[can.Message] = []

    def note(self, messages: Sequence[can.Message]) -> None:
        """Count frames."""
        self.frames += len(messages)
        self._waiting += messages
        if len(self._waiting) >= _CHUNK_FRAMES:
            self._count()

    def load(self, duration_us: int, bitrate: int | None) -> float | None:
        """Return the share of bit times in use; None without a bit rate or any time."""
        self._count()
        if not bitrate or duration_us <= 0:
            return None
        return self.bits / (bitrate * duration_us * 1e-6)

    def frames_by_message(self) -> dict[str, int]:
        """Return how many frames of each message there were; strangers by identifier."""
        self._count()
        return dict(sorted(self._by_message.items()))

    def _count(self) -> None:
        waiting, self._waiting = self._waiting, []
        groups: defaultdict[tuple[int, bool, int], list[can.Message]] = defaultdict(list)
        for message in waiting:
            key = (message.arbitration_id, message.is_extended_id, len(message.data))
            groups[key].append(message)
        for (frame_id, is_extended, size), messages in groups.items():
            spec = self._database.by_id(frame_id, is_extended)
            name = spec.name if spec is not None else f"0x{frame_id:X}"
            self._by_message[name] = self._by_message.get(name, 0) + len(messages)
            classic = [
                m for m in messages if not (m.is_fd or m.is_remote_frame or m.is_error_frame)
            ]
            if classic:
                joined = b"".join([message.data for message in classic])
                data = np.frombuffer(joined, dtype=np.uint8).reshape(len(classic), size)
                lengths = frame_length_bits_array(frame_id, is_extended, data)
                self.bits += int(lengths.sum()) + INTERFRAME_BITS * len(classic)
            for message in messages:
                if message.is_remote_frame:
                    self.bits += INTERFRAME_BITS + frame_length_bits(
                        frame_id, is_extended, b"", remote_dlc=message.dlc
                    )
