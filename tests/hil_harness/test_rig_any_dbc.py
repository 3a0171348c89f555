"""The rig on DBCs that know nothing of chiplog: other units, other layouts, other robots, none."""

from collections.abc import Sequence
from pathlib import Path

import can
import pytest

from can_bus import CanBusError
from hil_harness.errors import HarnessError
from hil_harness.rig import Rig

FOREIGN = Path(__file__).parents[2] / "examples" / "foreign_dbc"

GEARBOX = """VERSION ""
BU_: TCU ENGINE
BO_ 2566834686 GEAR: 8 TCU
 SG_ Gear : 0|4@1+ (1,0) [0|8] "" ENGINE
BO_ 1280 TORQUE: 2 ENGINE
 SG_ Torque : 0|16@1- (0.5,0) [-500|1000] "Nm" TCU
BA_DEF_ BO_ "GenMsgCycleTime" INT 0 65535;
BA_DEF_DEF_ "GenMsgCycleTime" 0;
BA_ "GenMsgCycleTime" BO_ 2566834686 50;
BA_ "GenMsgCycleTime" BO_ 1280 20;
"""


@pytest.fixture
def gearbox(tmp_path: Path) -> Path:
    path = tmp_path / "gearbox.dbc"
    path.write_text(GEARBOX)
    return path


class Echo:
    """Answers each torque with a gear."""

    def step(self, now_us: int, frames: Sequence[can.Message]) -> list[can.Message]:
        return [
            can.Message(
                arbitration_id=2566834686 & 0x1FFFFFFF,
                is_extended_id=True,
                data=bytes([3, 0, 0, 0, 0, 0, 0, 0]),
                timestamp=now_us * 1e-6,
            )
            for frame in frames
            if frame.arbitration_id == 1280
        ]


def test_the_shipped_firmware_and_plant_speak_a_foreign_dbc_through_a_map() -> None:
    with Rig(dbc=FOREIGN / "vehicle.dbc", signals=FOREIGN / "map.toml") as rig:
        assert rig.tick_period_us == 20_000
        rig.send("DRIVE", Speed=400, TurnRate=10.0)
        frame = rig.expect("POSITION", within_s=5.0, PosX=lambda x_mm: x_mm > 500)
        assert frame["PosX"] == pytest.approx(500, abs=20)
        assert rig.odometry == pytest.approx(rig.truth, abs=0.01)


def test_a_rest_bus_leaves_to_the_plant_what_the_plant_sends() -> None:
    with Rig(dbc=FOREIGN / "vehicle.dbc", signals=FOREIGN / "map.toml") as rig:
        restbus = rig.restbus("CHASSIS", BODY={"DoorOpen": "open"})
        assert restbus.messages == ("BODY",)
        rig.expect("BODY", within_s=0.6, DoorOpen="open", CabinTemperature=21.0)
        restbus.set("BODY", CabinTemperature=30.0)
        rig.expect("BODY", within_s=0.6, CabinTemperature=30.0)
        restbus.stop()
        rig.expect_none("BODY", within_s=1.0)


def test_a_rest_bus_leaves_to_the_shipped_firmware_what_it_sends() -> None:
    with Rig() as rig:
        assert rig.restbus("HOST", "ECU").messages == ("COMMAND",)
        rig.run_for(0.1)
        lines = [line for line in rig.recent_frames(1000) if "ODOMETRY_X" in line]
        assert len(lines) == 10
        with pytest.raises(HarnessError, match="nothing is left for a rest bus of ECU"):
            rig.restbus("ECU")


def test_a_rest_bus_may_stand_in_for_a_device_of_ones_own() -> None:
    class Listener:
        def step(self, now_us: int, frames: Sequence[can.Message]) -> list[can.Message]:
            return []

    with Rig(device=Listener()) as rig:
        rig.restbus("ECU")
        rig.expect("ODOMETRY_X")


def test_a_rest_bus_can_command_the_robot() -> None:
    with Rig() as rig:
        rig.restbus("HOST", COMMAND={"v_m_s": 0.4})
        rig.run_for(2.0)
        assert rig.truth.x_m == pytest.approx(0.8, abs=0.05)


def test_without_a_robot_any_dbc_will_do(gearbox: Path) -> None:
    with Rig(dbc=gearbox, plant=False, device=Echo()) as rig:
        assert rig.tick_period_us == 20_000
        rig.restbus("ENGINE", TORQUE={"Torque": 120.0})
        assert rig.expect("TORQUE", within_s=0.1)["Torque"] == 120.0
        assert rig.expect("GEAR", within_s=0.1)["Gear"] == 3


def test_the_sensors_may_be_the_tests_own() -> None:
    with Rig(plant=False) as rig:
        sensors = rig.restbus(
            "PLANT",
            ENCODER={"left_count": 0, "right_count": 0},
            IMU={"gyro_z_raw": 32768, "accel_x_raw": 32768, "accel_y_raw": 32768},
        )
        rig.run_for(0.5)
        sensors.set("ENCODER", left_count=10, right_count=10)
        rig.run_for(0.1)
        assert rig.odometry.x_m > 0
        with pytest.raises(HarnessError, match="this rig has no plant"):
            _ = rig.truth


def test_what_a_rig_without_a_map_cannot_know_is_one_clear_line(gearbox: Path) -> None:
    with Rig(dbc=gearbox, plant=False, device=Echo()) as rig:
        with pytest.raises(HarnessError, match="no signal map, so nothing is known to be odometry"):
            _ = rig.odometry
        with pytest.raises(CanBusError, match=r"gearbox\.dbc has no message 'STATUS'"):
            _ = rig.status


def test_a_robot_on_a_foreign_dbc_needs_a_map(gearbox: Path) -> None:
    with pytest.raises(HarnessError, match=r"gearbox\.dbc has no ENCODER\.left_count"):
        Rig(dbc=gearbox)


def test_a_dbc_without_any_cycle_time_gives_nothing_to_step_by(tmp_path: Path) -> None:
    path = tmp_path / "still.dbc"
    path.write_text(GEARBOX.split("BA_DEF_ ", maxsplit=1)[0])
    with pytest.raises(HarnessError, match="no message has a cycle time"):
        Rig(dbc=path, plant=False, device=Echo())
