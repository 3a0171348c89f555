"""Random and mutated frames into the firmware: nothing raises, and no invalid one moves the pose.

Full size: ten million frames.
"""

from __future__ import annotations

import math
import random
import resource

import can

from can_bus import Accepted, MessageSpec, make_message
from hil_harness import load_robot, load_wire
from hil_harness.nodes import FirmwareNode
from hil_harness.nodes.schedule import encode_frame

FRAMES = {"small": 20_000, "full": 10_000_000}
SEED = 77
FRAMES_A_STEP = 20
DRIVE_EVERY = 50
GROWN_KIB = 32 * 1024
WIRE = load_wire()
PERIOD_US = WIRE.tick_period_us
SENSORS = tuple(WIRE.signal_map.messages(("left_count", "right_count", "gyro")))
KNOWN = tuple(WIRE.database.messages.values())


class Drive:
    """Valid sensor frames of a robot that drives a curve."""

    def __init__(self) -> None:
        self.tick = 0

    def frames(self, now_us: int) -> list[can.Message]:
        """Return the frames of the next tick."""
        self.tick += 1
        sent: list[can.Message] = []
        for spec in SENSORS:
            raw = {signal.name: signal.initial_raw for signal in spec.payload}
            for role, value in (
                ("left_count", 7 * self.tick % 65536),
                ("right_count", 9 * self.tick % 65536),
                ("gyro", 33_000),
            ):
                mapped = WIRE.signal_map[role]  # type: ignore[index]
                if mapped.message == spec:
                    raw[mapped.signal.name] = value
            sent.append(make_message(spec, encode_frame(spec, raw, self.tick), now_us))
        return sent


def invalid(stream: random.Random, spec: MessageSpec, now_us: int, tick: int) -> can.Message:
    """Return a frame of a sensor that is wrong by construction.

    One or two inverted bits are always caught by the CRC of profile 1, whose polynomial is
    primitive and whose Hamming distance is three at this length.
    """
    raw = {signal.name: stream.getrandbits(signal.length_bits) for signal in spec.payload}
    message: can.Message = make_message(spec, encode_frame(spec, raw, tick), now_us)
    kind = stream.randrange(7)
    if kind == 0:
        for bit in stream.sample(range(8 * len(message.data)), stream.randint(1, 2)):
            message.data[bit // 8] ^= 1 << bit % 8
    elif kind == 1:
        sizes = [size for size in range(9) if size != spec.length_bytes]
        message.data = bytearray(stream.randbytes(stream.choice(sizes)))
        message.dlc = len(message.data)
    elif kind == 2:
        message.is_remote_frame = True
    elif kind == 3:
        message.is_error_frame = True
    elif kind == 4:
        message.is_fd = True
    elif kind == 5:
        message.is_extended_id = True
    else:
        stamps = (math.nan, math.inf, -math.inf, -1e300, 1e300, now_us * 1e-6 + stream.random() + 1)
        message.timestamp = stream.choice(stamps)
    return message


def anything(stream: random.Random, now_us: int) -> can.Message:
    """Return a frame of random content: any identifier, often one that the database knows."""
    is_known = stream.random() < 0.7
    spec = stream.choice(KNOWN)
    is_extended = not is_known and stream.random() < 0.5
    return can.Message(
        timestamp=now_us * 1e-6,
        arbitration_id=spec.frame_id if is_known else stream.getrandbits(29 if is_extended else 11),
        is_extended_id=is_extended,
        data=stream.randbytes(stream.choice((8, 8, 8, stream.randrange(9)))),
    )


def test_no_frame_raises_and_only_accepted_ones_move_the_pose(size: str) -> None:
    stream = random.Random(SEED)
    node = FirmwareNode(
        load_robot(None),
        database=WIRE.database,
        signal_map=WIRE.signal_map,
        tick_period_us=PERIOD_US,
        keep_inputs=False,
    )
    accepted: list[Accepted] = []
    check = node.checker.check

    def watched(message: can.Message, now_us: int) -> Accepted | None:
        result = check(message, now_us)
        if result is not None:
            accepted.append(result)
        return result

    node.checker.check = watched  # type: ignore[method-assign]
    drive = Drive()
    before_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    wrong = moved = by_chance = step = 0
    while wrong < FRAMES[size]:
        step += 1
        now_us = step * PERIOD_US
        pose_q = node.program.pose_q
        accepted.clear()
        if step % DRIVE_EVERY < DRIVE_EVERY // 5:
            node.step(now_us, drive.frames(now_us))
            moved += node.program.pose_q != pose_q
            continue
        is_by_construction = step % 2 == 0
        frames = [
            invalid(stream, stream.choice(SENSORS), now_us, step)
            if is_by_construction
            else anything(stream, now_us)
            for _ in range(FRAMES_A_STEP)
        ]
        wrong += len(frames)
        node.step(now_us, frames)
        if is_by_construction:
            assert accepted == [], frames
        by_chance += len(accepted)
        if not accepted:
            assert node.program.pose_q == pose_q, frames
    grown_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kib
    rejected = dict(node.checker.rejected)
    print(f"{wrong} frames, {by_chance} right by chance, {moved} steps of the drive moved")
    print(f"rejected {rejected}; {grown_kib} KiB more than before")
    assert moved > 0
    assert grown_kib < GROWN_KIB
    assert all(rejected[why] > 0 for why in ("length", "crc", "age", "unknown_id"))
