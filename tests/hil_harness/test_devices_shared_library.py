"""A device in a shared library: the C interface, its bounds, and what breaks it."""

import math
import subprocess
from functools import cache
from pathlib import Path

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from can_bus import timestamp_us
from hil_harness.devices import DeviceSetup, SharedLibraryDevice, include_dir
from hil_harness.devices import shared_library as adapter
from hil_harness.errors import HarnessError

SETUP = DeviceSetup(tick_period_us=10_000)

HEAD = '#include "chiplog_device.h"\n'
INIT = "int32_t chiplog_init(uint32_t tick_period_us) { (void)tick_period_us; %s }\n"
STEP = """
int32_t chiplog_step(uint64_t now_us, const chiplog_frame *received, uint32_t received_count,
                     chiplog_frame *sent, uint32_t sent_capacity)
{ (void)now_us; (void)received; (void)received_count; (void)sent; (void)sent_capacity; %s }
"""
ODOMETRY = "int32_t chiplog_odometry(chiplog_pose *pose) { (void)pose; %s }\n"
ECHO = "uint32_t i; for (i = 0; i < received_count; i++) sent[i] = received[i]; return (int32_t)i;"


def build(
    folder: Path,
    *,
    init: str = "return CHIPLOG_ABI_VERSION;",
    step: str = "return 0;",
    odometry: str = "return CHIPLOG_POSE_NONE;",
    source: str | None = None,
) -> Path:
    """Compile a device from the bodies of its functions."""
    text = source if source is not None else HEAD + INIT % init + STEP % step + ODOMETRY % odometry
    (folder / "node.c").write_text(text)
    library = folder / "node.so"
    flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-shared", "-fPIC"]
    subprocess.run(
        ["gcc", *flags, f"-I{include_dir()}", "-o", library, folder / "node.c"], check=True
    )
    return library


@pytest.fixture(scope="module")
def echo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("echo"), step=ECHO)


def frame(**fields: object) -> can.Message:
    return can.Message(**{"arbitration_id": 0x123, "is_extended_id": False, **fields})  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "sent",
    [
        frame(data=b""),
        frame(data=bytes(range(8))),
        frame(data=b"\xff", arbitration_id=0x7FF),
        frame(data=b"\x01\x02", arbitration_id=0x1FFFFFFF, is_extended_id=True),
        frame(is_remote_frame=True, dlc=5),
    ],
)
def test_a_frame_goes_through_a_library_and_back_unchanged(echo: Path, sent: can.Message) -> None:
    (back,) = SharedLibraryDevice(echo, SETUP).step(20_000, [sent])
    assert back.equals(sent, timestamp_delta=None)
    assert back.timestamp == 0.02


@given(
    identifier=st.integers(0, 0x1FFFFFFF),
    data=st.binary(max_size=8),
    now_us=st.integers(0, 2**52),
)
def test_any_classic_frame_goes_through_unchanged(
    echo: Path, identifier: int, data: bytes, now_us: int
) -> None:
    extended = identifier > 0x7FF
    sent = frame(arbitration_id=identifier, is_extended_id=extended, data=data)
    (back,) = _shared(echo).step(now_us, [sent])
    assert back.equals(sent, timestamp_delta=None)
    assert timestamp_us(back) == now_us


@cache
def _shared(library: Path) -> SharedLibraryDevice:
    return SharedLibraryDevice(library, SETUP)


def test_frames_keep_their_order(echo: Path) -> None:
    sent = [frame(arbitration_id=number) for number in (5, 3, 9)]
    back = SharedLibraryDevice(echo, SETUP).step(0, sent)
    assert [message.arbitration_id for message in back] == [5, 3, 9]


def test_the_library_receives_whole_microseconds(tmp_path: Path) -> None:
    library = build(
        tmp_path,
        step="sent[0] = received[0]; sent[0].length = 8; uint64_t t = received[0].timestamp_us;"
        "for (int i = 0; i < 8; i++) sent[0].data[i] = (uint8_t)(t >> (8 * i)); return 1;",
    )
    (back,) = SharedLibraryDevice(library, SETUP).step(0, [frame(timestamp=1234.567891)])
    assert int.from_bytes(back.data, "little") == 1_234_567_891


def test_two_devices_of_one_file_do_not_share_their_variables(tmp_path: Path) -> None:
    library = build(tmp_path, step="static int32_t calls; return calls++ ? -7 : 0;")
    first, second = SharedLibraryDevice(library, SETUP), SharedLibraryDevice(library, SETUP)
    first.step(0, [])
    second.step(0, [])
    with pytest.raises(HarnessError, match="chiplog_step failed with -7"):
        first.step(0, [])


def test_the_pose_may_be_given_in_si_units(tmp_path: Path) -> None:
    library = build(
        tmp_path,
        odometry="pose->x_m = 1.5; pose->y_m = -2.0; pose->heading_rad = 7.0;"
        "return CHIPLOG_POSE_SI;",
    )
    assert SharedLibraryDevice(library, SETUP).odometry() == (1.5, -2.0, 7.0)


def test_the_pose_may_be_given_in_raw_integers(tmp_path: Path) -> None:
    library = build(
        tmp_path,
        odometry="pose->x_m_q32 = (int64_t)3 << 31; pose->y_m_q32 = -1; "
        "pose->heading_turn_q32 = (int64_t)1 << 30; return CHIPLOG_POSE_RAW;",
    )
    assert SharedLibraryDevice(library, SETUP).odometry() == (1.5, -(2.0**-32), math.pi / 2)


def test_a_device_may_have_no_pose_yet(echo: Path) -> None:
    assert SharedLibraryDevice(echo, SETUP).odometry() is None


@pytest.mark.parametrize(
    ("body", "complaint"),
    [
        ("return -3;", "device node.so: chiplog_step failed with -3 at 0.120000 s"),
        ("return 257;", "chiplog_step wrote more frames than the 256 it was given room for"),
        (
            "sent[CHIPLOG_MAX_FRAMES].id = 1; return 0;",
            "chiplog_step wrote more frames than the 256 it was given room for (returned 0)",
        ),
        ("sent->length = 9; return 1;", "frame 0 sent at 0.120000 s has a length of 9 bytes"),
        ("sent->flags = 0x80; return 1;", "frame 0 sent at 0.120000 s has flags 0x80"),
        ("sent->id = 0x800; return 1;", "has the identifier 0x800, more than 11 bits"),
        (
            "sent->id = 0x20000000; sent->flags = CHIPLOG_FRAME_EXTENDED; return 1;",
            "has the identifier 0x20000000, more than 29 bits",
        ),
    ],
)
def test_a_step_that_breaks_the_contract_is_one_clear_line(
    tmp_path: Path, body: str, complaint: str
) -> None:
    device = SharedLibraryDevice(build(tmp_path, step=body), SETUP)
    with pytest.raises(HarnessError) as caught:
        device.step(120_000, [])
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("body", "complaint"),
    [
        ("return 9;", "chiplog_odometry returned 9; expected 0 (none), 1 (SI) or 2 (raw)"),
        ("pose->x_m = 1e999; return CHIPLOG_POSE_SI;", "gave the pose (inf,"),
    ],
)
def test_a_pose_that_makes_no_sense_is_one_clear_line(
    tmp_path: Path, body: str, complaint: str
) -> None:
    source = HEAD + INIT % "return CHIPLOG_ABI_VERSION;" + STEP % "return 0;" + ODOMETRY % body
    library = build(tmp_path, source=source.replace("1e999", "1e308 * 10"))
    with pytest.raises(HarnessError) as caught:
        SharedLibraryDevice(library, SETUP).odometry()
    assert complaint in str(caught.value)


def test_a_library_of_another_version_of_the_header_is_refused(tmp_path: Path) -> None:
    library = build(tmp_path, init="return CHIPLOG_ABI_VERSION + 1;")
    with pytest.raises(
        HarnessError, match=r"built against version 2 of chiplog_device\.h, this is version 1"
    ):
        SharedLibraryDevice(library, SETUP)


def test_a_library_may_refuse_the_tick_period(tmp_path: Path) -> None:
    library = build(tmp_path, init="return -5;")
    with pytest.raises(HarnessError, match="chiplog_init refused with -5 for a tick of 10000 us"):
        SharedLibraryDevice(library, SETUP)


@pytest.mark.parametrize("missing", ["chiplog_init", "chiplog_step", "chiplog_odometry"])
def test_a_missing_function_is_named(tmp_path: Path, missing: str) -> None:
    whole = HEAD + INIT % "return 1;" + STEP % "return 0;" + ODOMETRY % "return 0;"
    library = build(tmp_path, source=whole.replace(f"{missing}(", f"other_{missing}("))
    with pytest.raises(HarnessError, match=f"exports no function {missing}; a device exports"):
        SharedLibraryDevice(library, SETUP)


def test_a_file_that_is_no_library_is_one_clear_line(tmp_path: Path) -> None:
    path = tmp_path / "node.so"
    path.write_text("not a library")
    with pytest.raises(HarnessError, match=r"node\.so: cannot be loaded: node\.so: ") as caught:
        SharedLibraryDevice(path, SETUP)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(HarnessError, match=r"missing\.so: no such file$"):
        SharedLibraryDevice(tmp_path / "missing.so", SETUP)


def test_a_frame_too_long_for_classic_can_is_refused(echo: Path) -> None:
    with pytest.raises(HarnessError, match="has 12 bytes; chiplog_frame holds classic CAN"):
        SharedLibraryDevice(echo, SETUP).step(0, [frame(is_fd=True, data=bytes(12))])


def test_more_frames_than_a_step_can_take_are_refused(echo: Path) -> None:
    with pytest.raises(HarnessError, match="257 frames came in one tick at 0"):
        SharedLibraryDevice(echo, SETUP).step(0, [frame()] * 257)


def test_the_adapter_and_the_header_agree_on_every_number_and_layout(tmp_path: Path) -> None:
    fields = {
        "chiplog_frame": ["timestamp_us", "id", "flags", "length", "data"],
        "chiplog_pose": [
            "x_m",
            "y_m",
            "heading_rad",
            "x_m_q32",
            "y_m_q32",
            "heading_turn_q32",
        ],
    }
    names = ["ABI_VERSION", "MAX_FRAMES", "FRAME_EXTENDED", "FRAME_REMOTE"]
    names += ["POSE_NONE", "POSE_SI", "POSE_RAW"]
    expressions = [f"CHIPLOG_{name}" for name in names]
    for struct, members in fields.items():
        expressions += [f"sizeof({struct})"]
        expressions += [f"offsetof({struct}, {member})" for member in members]
    lines = "".join(f'printf("%lu\\n", (unsigned long){text});' for text in expressions)
    main = tmp_path / "numbers.c"
    main.write_text(
        f"#include <stddef.h>\n#include <stdio.h>\n{HEAD}int main(void) {{ {lines} return 0; }}\n"
    )
    program = tmp_path / "numbers"
    subprocess.run(["gcc", "-std=c99", f"-I{include_dir()}", "-o", program, main], check=True)
    printed = subprocess.run([program], check=True, capture_output=True, text=True).stdout
    numbers = list(map(int, printed.split()))
    assert numbers[: len(names)] == [getattr(adapter, name) for name in names]
    assert numbers[len(names) :] == [
        adapter.FRAME.size,
        *(0, 8, 12, 13, 16),
        adapter.POSE.size,
        *(0, 8, 16, 24, 32, 40),
    ]
