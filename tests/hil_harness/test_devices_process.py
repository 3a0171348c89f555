"""A device that is a program: the lines it speaks in lockstep, and every way it can fail."""

import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from hil_harness.devices import DeviceSetup, ProcessDevice, open_device
from hil_harness.errors import HarnessError

SETUP = DeviceSetup(tick_period_us=10_000)
ON_BUS = DeviceSetup(
    tick_period_us=10_000,
    in_lockstep=False,
    interface="udp_multicast",
    channel="239.1.2.3",
    bitrate=500_000,
)

ECHO = """
import sys
for line in sys.stdin:
    if line.startswith("step"):
        print("done", flush=True)
    else:
        print(line.split()[2])
"""


@pytest.fixture
def program(tmp_path: Path) -> Iterator[list[ProcessDevice]]:
    """Hold the programs that a test starts, and end them."""
    started: list[ProcessDevice] = []
    yield started
    for device in started:
        device.close()


def start(
    started: list[ProcessDevice], folder: Path, source: str, *, answer_within_s: float = 60.0
) -> ProcessDevice:
    path = folder / "node.py"
    path.write_text(source)
    device = ProcessDevice(f"{sys.executable} {path}", SETUP, answer_within_s=answer_within_s)
    started.append(device)
    return device


def frame(number: int, data: bytes = b"", *, extended: bool = False) -> can.Message:
    return can.Message(arbitration_id=number, data=data, is_extended_id=extended, timestamp=0.01)


def test_frames_go_to_a_program_and_back_tick_by_tick(
    program: list[ProcessDevice], tmp_path: Path
) -> None:
    device = start(program, tmp_path, ECHO)
    for tick in range(3):
        sent = [frame(0x12, bytes([tick, 0xFF])), frame(0x12345, b"12345678", extended=True)]
        back = device.step(tick * 10_000, sent)
        assert [(m.arbitration_id, m.is_extended_id, bytes(m.data)) for m in back] == [
            (0x12, False, bytes([tick, 0xFF])),
            (0x12345, True, b"12345678"),
        ]
        assert all(message.timestamp == tick * 0.01 for message in back)


def test_what_a_program_is_told_is_a_candump_log_and_the_time(
    program: list[ProcessDevice], tmp_path: Path
) -> None:
    heard = tmp_path / "heard"
    device = start(
        program,
        tmp_path,
        f"import sys\nheard = open({str(heard)!r}, 'w')\n"
        "for line in sys.stdin:\n    heard.write(line)\n    heard.flush()\n"
        "    if line.startswith('step'):\n        print('done', flush=True)\n",
    )
    device.step(10_000, [frame(0x100, b"\x01\xab"), frame(0x200, extended=True)])
    assert heard.read_text() == (
        "(0.010000) can0 100#01AB\n(0.010000) can0 00000200#\nstep 10000\n"
    )


def test_more_frames_than_a_pipe_holds_are_exchanged_without_standing_still(
    program: list[ProcessDevice], tmp_path: Path
) -> None:
    device = start(program, tmp_path, ECHO)
    assert len(device.step(0, [frame(1, b"12345678")] * 10_000)) == 10_000


def test_a_program_that_dies_names_its_status_the_time_and_its_last_words(
    program: list[ProcessDevice], tmp_path: Path
) -> None:
    device = start(
        program,
        tmp_path,
        "import sys\ninput()\nprint('done', flush=True)\ninput()\nsys.exit('watchdog bit')\n",
    )
    device.step(0, [])
    with pytest.raises(HarnessError) as caught:
        device.step(10_000, [])
    assert str(caught.value) == (
        f"device {sys.executable}: ended with exit status 1 at 0.010000 s; "
        "its last words: watchdog bit"
    )


def test_a_program_that_is_killed_names_the_signal(
    program: list[ProcessDevice], tmp_path: Path
) -> None:
    device = start(program, tmp_path, f"import os\nos.kill(os.getpid(), {int(signal.SIGSEGV)})\n")
    with pytest.raises(HarnessError, match=r"was ended by SIGSEGV at 0\.000000 s"):
        device.step(0, [])


def test_a_program_that_hangs_is_given_up_on(program: list[ProcessDevice], tmp_path: Path) -> None:
    device = start(program, tmp_path, "while True:\n    input()\n", answer_within_s=0.01)
    with pytest.raises(HarnessError, match=r"did not answer within 0\.01 s at 0\.500000 s"):
        device.step(500_000, [])


@pytest.mark.parametrize(
    ("says", "complaint"),
    [
        ("hello", "said 'hello' at 0.000000 s; expected a frame like"),
        ("123#1", "said '123#1'"),
        ("12#11", "said '12#11'"),
        ("123#112233445566778899", "said '123#112233445566778899'"),
    ],
)
def test_a_line_that_is_no_frame_is_one_clear_line(
    program: list[ProcessDevice], tmp_path: Path, says: str, complaint: str
) -> None:
    device = start(program, tmp_path, f"input()\nprint({says!r})\nprint('done', flush=True)\n")
    with pytest.raises(HarnessError) as caught:
        device.step(0, [])
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_program_that_never_says_done_cannot_fill_the_memory(
    program: list[ProcessDevice], tmp_path: Path
) -> None:
    device = start(program, tmp_path, "while True:\n    print('1' * 1000)\n")
    with pytest.raises(HarnessError, match="answered more than 1048576 bytes"):
        device.step(0, [])


def test_a_program_that_answers_without_listening_is_found_out(
    program: list[ProcessDevice], tmp_path: Path
) -> None:
    device = start(program, tmp_path, "while True:\n    print('done', flush=True)\n")
    with pytest.raises(HarnessError, match="before it had read the tick's frames"):
        device.step(0, [frame(1, b"12345678")] * 10_000)


def test_a_program_that_does_not_exist_is_one_clear_line() -> None:
    with pytest.raises(HarnessError, match="cannot be started: No such file or directory"):
        open_device("process:./no/such/node --fast", SETUP)


@pytest.mark.parametrize("command", ["", "   ", "'unclosed"])
def test_a_command_line_that_makes_no_sense_is_refused(command: str) -> None:
    with pytest.raises(HarnessError, match=r"^device '?process:"):
        open_device(f"process:{command}", SETUP)


def test_closing_ends_a_program_that_ignores_the_end_of_its_input(
    program: list[ProcessDevice], tmp_path: Path
) -> None:
    pid_file = tmp_path / "pid"
    device = start(
        program,
        tmp_path,
        "import os, time\n"
        f"open({str(pid_file)!r}, 'w').write(str(os.getpid()))\n"
        "input()\nprint('done', flush=True)\n"
        "while True:\n    time.sleep(60)\n",
    )
    device.step(0, [])
    device.close()
    with pytest.raises(ProcessLookupError):
        os.kill(int(pid_file.read_text()), 0)


def test_on_a_real_time_bus_a_program_is_told_the_bus_and_left_to_speak(
    program: list[ProcessDevice], tmp_path: Path
) -> None:
    told = tmp_path / "told"
    path = tmp_path / "node.py"
    path.write_text(f"import sys\nopen({str(told)!r}, 'w').write(' '.join(sys.argv[1:]))\n")
    device = ProcessDevice(
        f"{sys.executable} {path} --bus={{interface}} {{channel}} {{bitrate}}", ON_BUS
    )
    program.append(device)
    assert not device.in_loop
    with pytest.raises(HarnessError, match="it speaks on the bus by itself"):
        device.step(0, [])
    device._process.wait()
    assert told.read_text() == "--bus=udp_multicast 239.1.2.3 500000"
    with pytest.raises(HarnessError, match=r"ended with exit status 0$"):
        device.check()
