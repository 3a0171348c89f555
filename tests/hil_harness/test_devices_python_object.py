"""A device in Python: any object with step(now_us, frames) -> frames."""

from pathlib import Path

import can
import pytest

from can_bus import read_log, timestamp_us
from hil_harness.devices import DeviceSetup, PythonDevice, open_device
from hil_harness.errors import HarnessError
from hil_harness.rig import Rig

SETUP = DeviceSetup(tick_period_us=10_000)
SILENT_NODE = "class Node:\n    def step(self, now_us, frames):\n        return []\n"


def write_node(folder: Path, body: str) -> str:
    path = folder / "node.py"
    path.write_text(body)
    return f"python:{path}:Node"


def test_an_object_with_a_step_is_a_device() -> None:
    class Echo:
        def step(self, now_us: int, frames: list[can.Message]) -> list[can.Message]:
            return frames

    frame = can.Message(arbitration_id=1, data=b"\x01")
    assert PythonDevice(Echo()).step(0, [frame]) == [frame]


class Sends:
    """A device that sends one frame."""

    def __init__(self, frame: can.Message) -> None:
        self.frame = frame

    def step(self, now_us: int, frames: list[can.Message]) -> list[can.Message]:
        return [self.frame]


@pytest.mark.parametrize("stamp_s", [0.0, 1.7e9], ids=["without a stamp", "wall clock"])
def test_an_answer_is_stamped_with_the_tick_whatever_stamp_it_comes_with(stamp_s: float) -> None:
    frame = can.Message(timestamp=stamp_s, arbitration_id=1, data=b"\x01")
    (sent,) = PythonDevice(Sends(frame)).step(20_000, [])
    assert sent.timestamp == 0.02
    assert sent.equals(frame, timestamp_delta=None)
    assert frame.timestamp == stamp_s


def test_the_log_of_a_device_that_stamps_nothing_runs_on_bus_time(tmp_path: Path) -> None:
    frame = can.Message(arbitration_id=0x7A, is_extended_id=False, data=b"\x01")
    with Rig(device=Sends(frame), log=tmp_path / "bus.log") as rig:
        rig.run_for(0.03)
    stamps_us = [
        timestamp_us(frame)
        for frame in read_log(tmp_path / "bus.log")
        if frame.arbitration_id == 0x7A
    ]
    assert stamps_us == [0, 10_000, 20_000]


@pytest.mark.parametrize(
    ("frame", "complaint"),
    [
        (can.Message(arbitration_id=1, is_fd=True), "is a CAN FD frame"),
        (can.Message(arbitration_id=1, is_remote_frame=True, dlc=4), "is a remote frame"),
        (can.Message(arbitration_id=1, is_error_frame=True), "is an error frame"),
        (can.Message(arbitration_id=1, data=bytes(9)), "has 9 bytes"),
        (can.Message(arbitration_id=1, dlc=4, data=b"12"), "says that it has 4 bytes, but has 2"),
        (
            can.Message(arbitration_id=0x800, is_extended_id=False),
            "has the identifier 0x800, outside 11 bits",
        ),
        (can.Message(arbitration_id=1 << 29), "has the identifier 0x20000000, outside 29 bits"),
        (can.Message(arbitration_id=-1), "has the identifier -0x1, outside 29 bits"),
    ],
)
def test_a_frame_that_is_no_classic_data_frame_is_refused(
    frame: can.Message, complaint: str
) -> None:
    with pytest.raises(HarnessError) as caught:
        PythonDevice(Sends(frame)).step(120_000, [])
    assert str(caught.value) == (
        f"device Sends: a frame sent at 0.120000 s {complaint}; allowed are classic data frames "
        "of up to 8 bytes with an identifier of 11 bits, or of 29 if extended"
    )


@pytest.mark.parametrize(
    ("body", "complaint"),
    [
        ("raise SystemExit(3)\n", "importing it raised SystemExit: 3 (node.py:1)"),
        (
            "class Node:\n    def __init__(self):\n        raise SystemExit(3)\n",
            "creating it raised SystemExit: 3 (node.py:3)",
        ),
        (
            "class Node:\n    def step(self, now_us, frames):\n        raise SystemExit(3)\n",
            "raised SystemExit: 3 (node.py:3) at 0.000000 s",
        ),
    ],
)
def test_a_device_that_exits_does_not_end_the_harness(
    tmp_path: Path, body: str, complaint: str
) -> None:
    spec = write_node(tmp_path, body)
    with pytest.raises(HarnessError) as caught:
        open_device(spec, SETUP).step(0, [])
    assert complaint in str(caught.value)


def test_an_object_without_a_step_is_refused_with_what_a_device_needs() -> None:
    with pytest.raises(HarnessError, match=r"^device str: has no step\(now_us, frames\)"):
        PythonDevice("not a node")


def test_a_class_in_a_file_is_created_without_arguments(tmp_path: Path) -> None:
    spec = write_node(
        tmp_path, "class Node:\n    def step(self, now_us, frames):\n        return []\n"
    )
    assert open_device(spec, SETUP).step(0, []) == []


def test_a_class_that_takes_an_argument_is_given_the_setup(tmp_path: Path) -> None:
    spec = write_node(
        tmp_path,
        "class Node:\n"
        "    def __init__(self, setup):\n"
        "        self.period_us = setup.tick_period_us\n"
        "    def step(self, now_us, frames):\n"
        "        return []\n",
    )
    device = open_device(spec, SETUP)
    assert isinstance(device, PythonDevice)
    assert device.node.period_us == 10_000


def test_a_file_may_import_the_file_next_to_it(tmp_path: Path) -> None:
    (tmp_path / "neighbour_of_the_node.py").write_text("ANSWER = 42\n")
    spec = write_node(
        tmp_path,
        "from neighbour_of_the_node import ANSWER\n"
        "class Node:\n    def step(self, now_us, frames):\n        return []\n",
    )
    device = open_device(spec, SETUP)
    assert isinstance(device, PythonDevice)


def test_two_files_of_one_name_are_two_devices(tmp_path: Path) -> None:
    names = []
    for number in (1, 2):
        folder = tmp_path / str(number)
        folder.mkdir()
        spec = write_node(
            folder,
            f"class Node:\n    number = {number}\n    def step(self, t, f):\n        return []\n",
        )
        device = open_device(spec, SETUP)
        assert isinstance(device, PythonDevice)
        names.append(device.node.number)
    assert names == [1, 2]


def test_what_a_step_raises_is_one_line_with_the_time_and_the_place(tmp_path: Path) -> None:
    spec = write_node(
        tmp_path, "class Node:\n    def step(self, now_us, frames):\n        return 1 // 0\n"
    )
    with pytest.raises(HarnessError) as caught:
        open_device(spec, SETUP).step(120_000, [])
    assert str(caught.value) == (
        "device Node: raised ZeroDivisionError: integer division or modulo by zero (node.py:3) "
        "at 0.120000 s"
    )
    assert isinstance(caught.value.__cause__, ZeroDivisionError)


@pytest.mark.parametrize(
    ("answer", "complaint"),
    [
        ("None", r"step returned NoneType at 0\.000000 s; expected a list of can\.Message"),
        ("[b'12']", r"step returned a bytes at 0\.000000 s where a can\.Message was expected"),
    ],
)
def test_an_answer_that_is_no_list_of_frames_is_refused(
    tmp_path: Path, answer: str, complaint: str
) -> None:
    spec = write_node(
        tmp_path, f"class Node:\n    def step(self, now_us, frames):\n        return {answer}\n"
    )
    with pytest.raises(HarnessError, match=complaint):
        open_device(spec, SETUP).step(0, [])


@pytest.mark.parametrize(
    ("spec", "complaint"),
    [
        ("python:missing.py:Node", "device python:missing.py: no such file"),
        ("python:no.such.module:Node", "device python:no.such.module: importing it raised"),
        ("python:Node", "expected python:FILE.py:CLASS"),
        ("python:json:Node", "json has no class 'Node'"),
        ("shape:x", "device 'shape:x': expected python:FILE.py:CLASS, lib:FILE.so"),
        ("lib:", "device 'lib:': expected python:FILE.py:CLASS"),
        ("none", "no ECU can reach the in-process interface 'virtual'"),
    ],
)
def test_a_device_that_cannot_be_had_is_one_clear_line(spec: str, complaint: str) -> None:
    with pytest.raises(HarnessError) as caught:
        open_device(spec, SETUP)
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_class_that_cannot_be_created_is_one_clear_line(tmp_path: Path) -> None:
    spec = write_node(
        tmp_path, "class Node:\n    def __init__(self):\n        raise OSError('no')\n"
    )
    with pytest.raises(HarnessError, match=r"Node: creating it raised OSError: no \(node\.py:3\)$"):
        open_device(spec, SETUP)


def test_an_ecu_outside_is_never_stepped() -> None:
    device = open_device("none", DeviceSetup(tick_period_us=10_000, in_lockstep=False))
    assert not device.in_loop
    device.check()
    with pytest.raises(HarnessError, match="it speaks on the bus by itself"):
        device.step(0, [])
