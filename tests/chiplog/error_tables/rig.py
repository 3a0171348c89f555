"""What only a test can do wrong, with `chiplog_rig` or with the plugin's options and markers."""

from __future__ import annotations

from error_tables.row import DBC, Row

_MARKED = "import pytest\n\n@pytest.mark.chiplog({})\ndef test_it(chiplog_rig):\n    pass\n"


def _marked(when: str, marker: str, line: str) -> Row:
    return Row(
        when, f"@pytest.mark.chiplog({marker})", line, {"test_it.py": _MARKED.format(marker)}
    )


def _option(when: str, option: str, line: str) -> Row:
    test = {"test_it.py": "def test_it(chiplog_rig):\n    pass\n"}
    return Row(when, f"pytest {option}", line, test)


STATEMENTS: tuple[Row, ...] = (
    Row(
        "a message to send that the DBC has not",
        'chiplog_rig.send("COMAND", v_m_s=0.5)',
        "chiplog.dbc has no message 'COMAND': it has ENCODER, IMU, ODOMETRY_X, "
        "ODOMETRY_Y, ODOMETRY_HEADING, COMMAND, ODOMETRY_VELOCITY, STATUS, "
        "REFERENCE_POSE, ENVIRONMENT",
    ),
    Row(
        "a signal to send that the message has not",
        'chiplog_rig.send("COMMAND", v=0.5)',
        "COMMAND has no signal 'v': it has crc, tick_counter, v_m_s, w_rad_s",
    ),
    Row(
        "a value beyond its signal's range",
        'chiplog_rig.send("COMMAND", v_m_s=9.0)',
        "COMMAND.v_m_s = 9.0 m/s: expected -7.999999046325684 to 7.999999046325684 m/s",
    ),
    Row(
        "a word that no value table has",
        'chiplog_rig.send("COMMAND", v_m_s="fast")',
        "COMMAND.v_m_s = 'fast': its named values are SNA",
    ),
    Row(
        "an invalid value where there is none",
        'chiplog_rig.send("STATUS", overflow=None)',
        "STATUS.overflow = None: has no invalid value (SNA) in the DBC",
    ),
    Row(
        "a CRC given by hand",
        'chiplog_rig.send("COMMAND", crc=0)',
        "COMMAND.crc is the frame's own protection and is always right; "
        'rig.fault("corrupt", …) sends wrong ones',
    ),
    Row(
        "a duration that is no number",
        'chiplog_rig.run_for("1 s")',
        "duration_s = '1 s': expected a number of seconds",
    ),
    Row(
        "a duration below zero",
        "chiplog_rig.run_for(-1.0)",
        "duration_s = -1.0: expected seconds, 0 or more",
    ),
    Row(
        "a fault that does not exist",
        'chiplog_rig.fault("lose", "IMU")',
        "no fault 'lose': there are drop, delay, corrupt, duplicate, silence",
    ),
    Row(
        "a fault that strikes nothing",
        'chiplog_rig.fault("drop")',
        "fault 'drop': name a message or a node that it strikes, as in rig.fault('drop', "
        '"IMU") or rig.fault(\'drop\', node="PLANT")',
    ),
    Row(
        "a silence of nobody",
        'chiplog_rig.fault("silence", "IMU")',
        "fault 'silence' needs the name of a node",
    ),
    Row(
        "a delay of no time",
        'chiplog_rig.fault("delay", "IMU")',
        "fault 'delay': delay_us = 0: expected more than 0",
    ),
    Row(
        "a probability beyond one",
        'chiplog_rig.fault("drop", "IMU", probability=2.0)',
        "fault: probability = 2.0: expected 0 to 1",
    ),
    Row(
        "a number of faults below zero",
        'chiplog_rig.fault("drop", "IMU", count=-1)',
        "fault: count = -1: expected 0 or more",
    ),
    Row(
        "a bit below zero",
        'chiplog_rig.fault("corrupt", "IMU", bit=-1)',
        "fault 'corrupt': bit = -1: expected 0 or more",
    ),
    Row(
        "a node that the DBC has not",
        'chiplog_rig.fault("drop", node="PLAND")',
        "chiplog.dbc has no node 'PLAND': it has HOST, PLANT, ECU",
    ),
    Row(
        "a message that the rest bus does not send",
        'chiplog_rig.restbus("HOST").set("IMU", gyro_z_raw=0)',
        "the rest bus does not send 'IMU'; known are COMMAND",
    ),
    Row(
        "a rest bus of what the rig sends already",
        'chiplog_rig.restbus("ECU")',
        "nothing is left for a rest bus of ECU: in chiplog.dbc no further message of "
        "theirs has a cycle time (GenMsgCycleTime)",
    ),
    Row(
        "the truth of a rig without a plant",
        "Rig(plant=False).truth",
        "this rig has no plant (plant=False), so there is no truth",
    ),
    Row(
        "an effect of the bus on a real one",
        'Rig(interface="socketcan", channel="vcan0", effects="frame_loss.probability=0.1")',
        "an effect of stage bus needs simulated time: expected 'virtual'",
    ),
)

SETTINGS: tuple[Row, ...] = (
    _marked(
        "a setting that does not exist",
        'devise="none"',
        "@pytest.mark.chiplog: no setting 'devise'; the nearest is device",
    ),
    _marked(
        "a setting without its name",
        '"none"',
        "@pytest.mark.chiplog takes keywords only: robot, device, effects, "
        "effect_library, scenario, seed, force, plant, dbc, signals",
    ),
    _marked(
        "a seed that is no number",
        'seed="seven"',
        "seed = 'seven': expected a whole number, 0 or more",
    ),
    _marked(
        "effects that are neither texts nor files",
        "effects=[0.5]",
        'effects = [0.5]: expected texts such as "gyro_bias.bias=0.005", or files such as '
        '"explained.toml"',
    ),
    _marked(
        "a plant that is neither there nor not",
        'plant="yes"',
        "plant = 'yes': expected True or False",
    ),
    _marked(
        "an ECU that no in-process bus reaches",
        'device="none"',
        "device none: no ECU can reach the in-process interface 'virtual'; use "
        "--chiplog-interface with socketcan, udp_multicast or your hardware",
    ),
    Row(
        "a DBC without any cycle time",
        '@pytest.mark.chiplog(dbc="mine.dbc", device=…, plant=False)',
        "mine.dbc: no message has a cycle time (GenMsgCycleTime), so there is nothing to step by",
        {
            "test_it.py": _MARKED.format(
                'dbc="mine.dbc", device="python:node.py:Node", plant=False'
            ),
            "node.py": "class Node:\n    def step(self, now_us, frames):\n        return []\n",
            "mine.dbc": DBC,
        },
    ),
    _option(
        "a rig's interface without its channel",
        "--chiplog-interface=socketcan",
        "interface 'socketcan' needs a channel, for example vcan0 or can0",
    ),
    _option(
        "a rig's bus argument that is none",
        "--chiplog-bus-arg=port",
        "--chiplog-bus-arg port: expected KEY=VALUE",
    ),
)
