"""In real time the plant obeys whoever commands it on the bus."""

from can_bus import load_database, make_message, open_bus, protect
from hil_harness.nodes import PlantNode
from hil_harness.realtime import Pacer, run_plant_node
from hil_harness.robot import load_robot
from hil_harness.signal_map import default_map
from hil_harness.stopping import StopRequest
from sim_plant import Plant


def test_a_command_frame_from_another_node_is_not_taken_for_a_frame_of_the_future() -> None:
    database = load_database()
    signal_map = default_map(database)
    robot = load_robot(None)
    period_us = signal_map.tick_period_us
    plant = PlantNode(
        Plant(robot.plant, tick_period_us=period_us, seed=1),
        robot.plant,
        database=database,
        signal_map=signal_map,
        tick_period_us=period_us,
    )
    spec = database.message("COMMAND")
    data = spec.encode_scaled({"v_m_s": 0.5})
    protect(spec, data, 0)
    with open_bus("virtual", "commands") as plant_bus, open_bus("virtual", "commands") as host:
        host.send(make_message(spec, data, 0))
        run_plant_node(plant, plant_bus, pacer=Pacer(period_us), ticks=3, stop=StopRequest())
    assert plant.command[0] > 0
    assert plant.checker.rejected["age"] == 0
