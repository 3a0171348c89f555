"""BLF logs, container by container.

A BLF file is a header and objects; those of one type are containers of compressed objects, and an
object may begin in one container and end in the next. Frames are among them; whatever else is
there is passed over.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, Final

from can_bus.errors import CanBusError, one_line
from can_bus.logs.frame_block import FrameBlock, faults, refusal

# Signature, header size, eight version numbers, file size, uncompressed size, two object counts,
# start and stop as year, month, weekday, day, hour, minute, second, millisecond.
_FILE_HEADER: Final = struct.Struct("<4sL8BQQLL8H8H")
_OBJECT_HEADER: Final = struct.Struct("<4sHHLL")
_CONTAINER: Final = 10
_CONTAINER_HEADER_BYTES: Final = 16
_SIGNATURE: Final = b"LOBJ"
_STORED: Final = b"\x00\x00"
_DEFLATED: Final = b"\x02\x00"
_MAX_CONTAINER_BYTES: Final = 64 * 1024 * 1024


def read_blf_blocks(path: Path) -> Iterator[FrameBlock]:
    """Yield the frames of a BLF file, a block for each container.

    Raises CanBusError in one line for a file that is truncated or corrupt, holds a frame that no
    bus carries, or would fill the memory; the frames before that place were yielded.
    """
    count = 0

    def broken(why: str) -> CanBusError:
        return CanBusError(f"{path}: truncated or corrupt BLF file after {count} frames: {why}")

    with path.open("rb") as file:
        size = path.stat().st_size
        head = file.read(_FILE_HEADER.size)
        if len(head) < _FILE_HEADER.size:
            raise broken(f"a header of {_FILE_HEADER.size} bytes is missing")
        header = _FILE_HEADER.unpack(head)
        start_s = _seconds(header[14:22])
        file.seek(header[1])
        unread: list[bytes] = []
        missing = 0
        containers = _containers(path, file)
        while True:
            try:
                content = next(containers, None)
            except (struct.error, zlib.error) as error:
                raise broken(one_line(error)) from error
            except _NoObjectError:
                raise broken("no object where one should begin") from None
            if content is None:
                break
            unread.append(content)
            missing -= len(content)
            if missing > 0:
                continue
            block, rest, missing, fault = _frames(path, b"".join(unread), start_s)
            unread = [rest]
            bad = faults(block)
            if bad.any():
                good = int(bad.argmax())
                yield block.rows(0, good)
                raise refusal(path, block, good, count + good)
            count += len(block)
            yield block
            if fault is not None:
                raise fault if isinstance(fault, CanBusError) else broken(fault)
        if size < header[10]:
            raise CanBusError(
                f"{path}: truncated BLF file after {count} frames: {size} of {header[10]} bytes"
            )


class _NoObjectError(Exception):
    """There is no object where one should begin."""


def _containers(path: Path, file: BinaryIO) -> Iterator[bytes]:
    """Yield what the containers hold. Raises struct.error and zlib.error where the file is broken.

    The last container of a file whose writer was killed may lack its end: what is there counts.
    """
    while head := file.read(_OBJECT_HEADER.size):
        signature, _, _, size, kind = _OBJECT_HEADER.unpack(head)
        if signature != _SIGNATURE:
            raise _NoObjectError
        content = file.read(max(0, size - _OBJECT_HEADER.size))
        file.read(size % 4)
        if kind != _CONTAINER:
            continue
        if len(content) < _CONTAINER_HEADER_BYTES:
            raise struct.error("a container breaks off within its header")
        objects = content[_CONTAINER_HEADER_BYTES:]
        if content[:2] == _DEFLATED:
            inflate = zlib.decompressobj()
            objects = inflate.decompress(objects, _MAX_CONTAINER_BYTES)
            if inflate.unconsumed_tail:
                raise CanBusError(
                    f"{path}: a container of over {_MAX_CONTAINER_BYTES >> 20} MiB: "
                    "not a BLF file that can be read here"
                )
        elif content[:2] != _STORED:
            continue
        yield objects


def _frames(
    path: Path, content: bytes, start_s: float
) -> tuple[FrameBlock, bytes, int, CanBusError | str | None]:
    """Return the frames in objects.

    Behind them stand the beginning of an object that is not complete, how many bytes it lacks at
    least, and what is wrong there.
    """
    # numba takes a quarter of a second to import: only who reads a BLF file pays for it.
    from can_bus.logs import blf_objects as walk  # noqa: PLC0415

    text = walk.as_bytes(content)
    frames, stop, is_wide, state, size = walk.count_objects(text)
    block = FrameBlock.empty(frames, 64 if is_wide else 8)
    walk.read_objects(text, start_s, *vars(block).values())
    fault: CanBusError | str | None = None
    if state == walk.NO_OBJECT:
        fault = "no object where one should begin"
    elif state == walk.TOO_SMALL:
        fault = f"an object of {size} bytes is too small for a frame"
    elif state == walk.BAD_SIZE:
        fault = CanBusError(
            f"{path}: an object of {size} bytes: "
            f"expected {walk.HEADER_BYTES} to {walk.MAX_OBJECT_BYTES}"
        )
    return block, content[stop:], size - (len(content) - stop), fault


def _seconds(stamp: tuple[int, ...]) -> float:
    """Return a SYSTEMTIME as seconds since 1970, 0 where the file gives none."""
    year, month, _, day, hour, minute, second, millisecond = stamp
    try:
        return datetime(
            year, month, day, hour, minute, second, 1000 * millisecond, tzinfo=UTC
        ).timestamp()
    except (ValueError, OverflowError):
        return 0.0
