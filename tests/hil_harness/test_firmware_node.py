"""The ECU as a node: what it believes, what it sends, and that rubbish never moves its pose."""

import can
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from can_bus import COUNTER_MODULO, E2EState, MessageSpec, make_message
from firmware_model import FRESH, INVALID, StatusBit
from hil_harness import FirmwareNode, load_robot, load_wire
from hil_harness.assembly import Wire

WIRE = load_wire()
ROBOT = load_robot(None)
PERIOD_US = WIRE.tick_period_us
TICKS_PER_STEP = 39


def new_node(wire: Wire = WIRE) -> FirmwareNode:
    return FirmwareNode(
        ROBOT,
        database=wire.database,
        signal_map=wire.signal_map,
        tick_period_us=wire.tick_period_us,
    )


def sensor_frames(tick: int, *, left: int | None = None) -> list[can.Message]:
    """The frames of a robot that drives straight on, or with a left counter of our choice."""
    count = (TICKS_PER_STEP * tick) % 65536
    now_us, counter = tick * PERIOD_US, tick % COUNTER_MODULO
    encoder, imu = WIRE.database.message("ENCODER"), WIRE.database.message("IMU")
    gyro = ROBOT.plant.gyro.zero_rate_code + 50 + tick % 3
    return [
        make_message(
            encoder, encoder.pack([count if left is None else left, count], counter), now_us
        ),
        make_message(imu, imu.pack([gyro, 32768, 32768], counter), now_us),
    ]


def pose(node: FirmwareNode) -> tuple[int, int, int]:
    return node.kernel.pose_q


def drive(node: FirmwareNode, ticks: int) -> None:
    for tick in range(ticks):
        node.step(tick * PERIOD_US, sensor_frames(tick))


def messages() -> st.SearchStrategy[can.Message]:
    """Frames of any kind: our identifiers more often than chance would have them."""
    ours = [spec.frame_id for spec in WIRE.database.messages.values()]
    return st.builds(
        lambda frame_id, data, extended, remote, error, fd, stamp: can.Message(
            arbitration_id=frame_id,
            data=b"" if remote else data,
            is_extended_id=extended,
            is_remote_frame=remote and not fd,
            is_error_frame=error,
            is_fd=fd,
            timestamp=stamp,
        ),
        st.sampled_from(ours) | st.integers(0, 2**29 - 1),
        st.binary(min_size=8, max_size=8) | st.binary(max_size=64),
        st.booleans(),
        st.booleans(),
        st.booleans(),
        st.booleans(),
        st.floats(allow_nan=True, allow_infinity=True) | st.just(0.5),
    )


@given(st.lists(messages(), max_size=20))
def test_random_frames_never_raise_and_never_move_the_pose(rubbish: list[can.Message]) -> None:
    node = new_node()
    drive(node, 40)
    refused_before = sum(node.checker.rejected.values())
    before = pose(node)
    node.step(40 * PERIOD_US, rubbish)
    # One random payload in 256 has the right CRC; whatever was refused must not move the pose.
    if node.inputs.encoder_validity[-1] != FRESH and node.inputs.gyro_validity[-1] != FRESH:
        assert pose(node) == before
    judged = sum(node.checker.rejected.values()) - refused_before
    assert judged <= len(rubbish)


@given(st.binary(min_size=8, max_size=8), st.sampled_from(["ENCODER", "IMU"]))
def test_a_frame_with_a_wrong_crc_never_moves_the_pose(data: bytes, name: str) -> None:
    node = new_node()
    drive(node, 20)
    before = pose(node)
    spec = WIRE.database.message(name)
    message = make_message(spec, bytearray(data), 20 * PERIOD_US)
    node.step(20 * PERIOD_US, [message])
    assume(node.checker.rejected["crc"] == 1)
    assert pose(node) == before


@pytest.mark.parametrize(
    ("reason", "spoil"),
    [
        ("length", lambda m: (setattr(m, "data", m.data[:7]), setattr(m, "dlc", 7))),
        ("crc", lambda m: m.data.__setitem__(0, m.data[0] ^ 1)),
        ("age", lambda m: setattr(m, "timestamp", m.timestamp - 3 * PERIOD_US * 1e-6)),
        ("age", lambda m: setattr(m, "timestamp", m.timestamp + 1.0)),
        ("unknown_id", lambda m: setattr(m, "arbitration_id", 0x7FE)),
    ],
)
def test_each_kind_of_bad_frame_is_counted_and_leaves_the_position(
    reason: str, spoil: object
) -> None:
    node = new_node()
    drive(node, 20)
    before = pose(node)
    encoder, _ = sensor_frames(20)
    assert callable(spoil)
    spoil(encoder)
    node.step(20 * PERIOD_US, [encoder])
    assert node.checker.rejected[reason] == 1
    assert pose(node) == before


def test_a_repeated_counter_is_refused() -> None:
    node = new_node()
    drive(node, 20)
    before = pose(node)
    again = sensor_frames(19, left=1000)[0]
    again.timestamp = 20 * PERIOD_US * 1e-6
    node.step(20 * PERIOD_US, [again])
    assert node.checker.rejected["counter"] == 1
    assert pose(node) == before


def test_the_newest_of_several_valid_frames_counts() -> None:
    late, prompt = new_node(), new_node()
    drive(late, 10)
    drive(prompt, 10)
    both = sensor_frames(10) + sensor_frames(11)
    late.step(11 * PERIOD_US, both)
    assert late.inputs.left_count[-1] == sensor_count(11)


def sensor_count(tick: int) -> int:
    return TICKS_PER_STEP * tick


def test_an_invalid_counter_value_is_delivered_as_invalid_not_as_a_number() -> None:
    node = new_node()
    drive(node, 10)
    before = pose(node)
    encoder: MessageSpec = WIRE.database.message("ENCODER")
    invalid = encoder.signals["left_count"].invalid_raw
    assert invalid is not None
    frame = sensor_frames(10, left=invalid)[0]
    node.step(10 * PERIOD_US, [frame])
    assert pose(node) == before
    assert node.inputs.encoder_validity[-1] == 2


@pytest.mark.parametrize("way", ["lost", "damaged"])
def test_a_good_frame_of_a_stream_that_is_not_trusted_is_not_used(way: str) -> None:
    """E2E state INVALID: the first frame after it is not believed, the second leads back."""
    node = new_node()
    drive(node, 20)
    before = pose(node)
    back = 24 if way == "lost" else 23
    for tick in range(20, back):
        frames = sensor_frames(tick)
        for frame in frames:
            frame.data[0] ^= 1
        node.step(tick * PERIOD_US, [] if way == "lost" else frames)
    rejected = dict(node.checker.rejected)
    node.step(back * PERIOD_US, sensor_frames(back))
    assert node.checker.e2e("ENCODER")[1] is E2EState.INVALID
    assert node.inputs.encoder_validity[-1] == INVALID
    assert node.inputs.gyro_validity[-1] == INVALID
    assert node.kernel.status & StatusBit.ENCODER_INVALID
    assert node.checker.rejected == rejected, "no check of the frame itself failed"
    assert pose(node)[:2] == before[:2]
    tick = back
    while node.checker.e2e("ENCODER")[1] is not E2EState.VALID:
        tick += 1
        node.step(tick * PERIOD_US, sensor_frames(tick))
    assert tick == back + (1 if way == "lost" else 2)
    assert node.inputs.encoder_validity[-1] == FRESH
    always_heard = new_node()
    drive(always_heard, tick + 1)
    assert pose(node)[0] == pytest.approx(pose(always_heard)[0], rel=1e-3), "no distance is lost"


def test_its_frames_share_the_counter_of_the_tick() -> None:
    node = new_node()
    for tick in range(40):
        for frame in node.step(tick * PERIOD_US, sensor_frames(tick)):
            assert frame.data[1] & 0x0F == tick % COUNTER_MODULO


def test_its_counter_runs_on_while_no_encoder_frame_comes() -> None:
    node = new_node()
    drive(node, 20)
    for tick in range(20, 60):
        for frame in node.step(tick * PERIOD_US, []):
            assert frame.data[1] & 0x0F == tick % COUNTER_MODULO


def test_the_python_oracle_sends_the_same_bytes_as_the_compiled_kernel() -> None:
    oracle = FirmwareNode(
        ROBOT,
        database=WIRE.database,
        signal_map=WIRE.signal_map,
        tick_period_us=PERIOD_US,
        implementation="python",
    )
    compiled = new_node()
    for tick in range(200):
        frames = [] if tick % 17 == 5 else sensor_frames(tick)
        ours = [bytes(m.data) for m in oracle.step(tick * PERIOD_US, frames)]
        theirs = [bytes(m.data) for m in compiled.step(tick * PERIOD_US, frames)]
        assert ours == theirs
    assert oracle.kernel.state() == compiled.kernel.state()
