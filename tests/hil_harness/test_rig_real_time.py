"""The same rig in real time, on a bus that connects processes of this host."""

import sys
from contextlib import suppress
from pathlib import Path

import pytest

from can_bus import COUNTER_MODULO, make_message, protect
from hil_harness.errors import HarnessError
from hil_harness.rig import Rig

REAL_TIME = "udp_multicast"

# However busy the machine is: only how long it may take to see something that does happen.
PATIENCE_S = 60.0


def test_a_command_drives_the_robot_in_real_time() -> None:
    with Rig(interface=REAL_TIME) as rig:
        rig.send("COMMAND", v_m_s=0.5)
        rig.expect("ODOMETRY_X", within_s=PATIENCE_S, x_m=lambda x_m: x_m > 0.1)
        assert rig.truth.x_m > 0.0


def test_every_frame_goes_out_once_in_real_time() -> None:
    with Rig(interface=REAL_TIME, device="none") as rig, rig.open_bus() as ecu:
        rig.send("COMMAND", v_m_s=0.5)
        heard: list[int] = []
        command, encoder = (rig.database.message(name).frame_id for name in ("COMMAND", "ENCODER"))
        while command not in heard or heard[heard.index(command) :].count(encoder) < 5:
            frame = ecu.recv(PATIENCE_S)
            assert frame is not None
            heard.append(frame.arbitration_id)
        assert heard.count(command) == 1


def test_an_expectation_in_real_time_gives_up_when_its_time_is_over() -> None:
    with Rig(interface=REAL_TIME) as rig, pytest.raises(AssertionError, match="none of them so"):
        rig.expect("ODOMETRY_X", within_s=0.5, x_m=99.0)


def test_faults_strike_in_real_time_too() -> None:
    with Rig(interface=REAL_TIME) as rig:
        rig.expect("ODOMETRY_X", within_s=PATIENCE_S)
        with rig.fault("silence", node="PLANT"):
            rig.expect("STATUS", within_s=PATIENCE_S, encoder_stale=1)
        rig.expect("STATUS", within_s=PATIENCE_S, encoder_stale=0)


def test_a_raw_bus_meets_the_rig_in_real_time() -> None:
    with Rig(interface=REAL_TIME) as rig, rig.open_bus() as bus:
        frame = bus.recv(PATIENCE_S)
        assert frame is not None
        assert rig.database.by_id(frame.arbitration_id) is not None


def test_a_program_on_the_bus_is_the_device_under_test(tmp_path: Path) -> None:
    (tmp_path / "ecu.py").write_text(
        "import sys\n"
        "from can_bus import load_database, make_message, open_bus, protect\n"
        "database = load_database()\n"
        "spec = database.message('ODOMETRY_X')\n"
        "counter = 0\n"
        "with open_bus(sys.argv[1], sys.argv[2]) as bus:\n"
        "    while True:\n"
        "        if bus.recv().arbitration_id == database.message('ENCODER').frame_id:\n"
        "            data = spec.encode_scaled({'x_m': 42.0})\n"
        "            protect(spec, data, counter)\n"
        "            counter = (counter + 1) % 15\n"
        "            bus.send(make_message(spec, data, 0))\n"
    )
    device = f"process:{sys.executable} ecu.py {{interface}} {{channel}}"
    with Rig(interface=REAL_TIME, device=device, folder=tmp_path) as rig:
        assert rig.expect("ODOMETRY_X", within_s=PATIENCE_S)["x_m"] == 42.0


def test_a_program_that_dies_ends_the_wait_with_one_line(tmp_path: Path) -> None:
    (tmp_path / "ecu.py").write_text("import sys\nsys.exit('no such channel')\n")
    device = f"process:{sys.executable} ecu.py"
    with (
        Rig(interface=REAL_TIME, device=device, folder=tmp_path) as rig,
        pytest.raises(
            HarnessError, match=r"ended with exit status 1; its last words: no such channel$"
        ),
    ):
        rig.run_for(PATIENCE_S)


def test_an_ecu_outside_is_only_listened_to() -> None:
    with Rig(interface=REAL_TIME, device="none") as rig, rig.open_bus() as ecu:
        frame = ecu.recv(PATIENCE_S)
        assert frame is not None
        rig.expect_none("ODOMETRY_X", within_s=0.05)


def test_a_command_from_somebody_else_on_the_bus_drives_the_robot() -> None:
    with Rig(interface=REAL_TIME) as rig, rig.open_bus() as host:
        spec = rig.database.message("COMMAND")
        data = spec.encode_scaled({"v_m_s": 0.5})
        for counter in range(100):  # of UDP's frames a busy machine may drop a whole burst
            protect(spec, data, counter % COUNTER_MODULO)
            host.send(make_message(spec, data, 0))
            with suppress(AssertionError):
                rig.expect("COMMAND", within_s=PATIENCE_S / 100, v_m_s=pytest.approx(0.5))
                break
        rig.expect("ODOMETRY_X", within_s=PATIENCE_S, x_m=lambda x_m: x_m > 0.1)
        assert rig.truth.x_m > 0.0


def test_the_frames_before_a_failure_are_still_known_when_the_bus_has_gone_on() -> None:
    with Rig(interface=REAL_TIME) as rig:
        with pytest.raises(AssertionError) as caught:
            rig.expect_none("STATUS", within_s=PATIENCE_S)
        failed_by_s = rig.now_us * 1e-6
        rig.expect_none("COMMAND", within_s=0.5)

        def stamps_s(lines: list[str]) -> list[float]:
            return [float(line.split()[0]) for line in lines]

        before = rig.recent_frames(30, before=caught.value)
        assert any("STATUS" in line for line in before)
        assert max(stamps_s(before)) <= failed_by_s
        assert max(stamps_s(rig.recent_frames(30))) > failed_by_s
