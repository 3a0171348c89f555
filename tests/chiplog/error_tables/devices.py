"""Firmware under test."""

from __future__ import annotations

from error_tables.row import Row

_STEP = "class Node:\n    def step(self, now_us, frames):\n        "

FIRMWARE_UNDER_TEST: tuple[Row, ...] = (
    Row(
        "a kind of device that does not exist",
        "chiplog run --device banana",
        "device 'banana': expected python:FILE.py:CLASS, lib:FILE.so, process:COMMAND, or none "
        "(the ECU is on the bus already)",
    ),
    Row(
        "a Python file that is not there",
        "chiplog run --device python:node.py:Node",
        "device python:node.py: no such file",
    ),
    Row(
        "a Python class that is not there",
        "chiplog run --device python:node.py:Nod",
        "device python:node.py:Nod: node.py has no class 'Nod'",
        {"node.py": "class Node:\n    pass\n"},
    ),
    Row(
        "a Python class that is no node",
        "chiplog run --device python:node.py:Node",
        "device Node: has no step(now_us, frames); a device returns from it the frames that it "
        "sends",
        {"node.py": "class Node:\n    pass\n"},
    ),
    Row(
        "a shared library that is not there",
        "chiplog run --device lib:node.so",
        "device lib:node.so: no such file",
    ),
    Row(
        "a program that is not there",
        "chiplog run --device process:./node",
        "device process:./node: cannot be started: No such file or directory",
    ),
    Row(
        "an ECU that cannot reach the bus",
        "chiplog run --device none",
        "device none: no ECU can reach the in-process interface 'virtual'; use --interface "
        "socketcan, udp_multicast or your hardware",
    ),
    Row(
        "a Python step that raises",
        "chiplog run --device python:node.py:Node",
        "device Node: raised ZeroDivisionError: division by zero (node.py:3) at 0.000000 s",
        {"node.py": _STEP + "return 1 / 0\n"},
    ),
    Row(
        "a Python step that returns something else",
        "chiplog run --device python:node.py:Node",
        "device Node: step returned int at 0.000000 s; expected a list of "
        "can.Message, which may be empty",
        {"node.py": _STEP + "return 7\n"},
    ),
    Row(
        "a Python step whose list holds something else",
        "chiplog run --device python:node.py:Node",
        "device Node: step returned a int at 0.000000 s where a can.Message was expected",
        {"node.py": _STEP + "return [7]\n"},
    ),
    Row(
        "a Python file that raises",
        "chiplog run --device python:node.py:Node",
        "device python:node.py: importing it raised ZeroDivisionError: division "
        "by zero (node.py:1)",
        {"node.py": "1 / 0\n"},
    ),
    Row(
        "a Python class that raises",
        "chiplog run --device python:node.py:Node",
        "device python:node.py:Node: creating it raised OSError: no licence (node.py:3)",
        {"node.py": "class Node:\n    def __init__(self):\n        raise OSError('no licence')\n"},
    ),
    Row(
        "a Python file without a class",
        "chiplog run --device python:node.py",
        "device python:node.py: expected python:FILE.py:CLASS or python:PACKAGE.MODULE:CLASS",
    ),
    Row(
        "a library that is something else",
        "chiplog run --device lib:node.so",
        "device lib:node.so: cannot be loaded: node.so: file too short",
        {"node.so": "no library"},
    ),
    Row(
        "a program that ends at once",
        "chiplog run --device \"process:sh -c 'exit 3'\"",
        "device sh: ended with exit status 3 at 0.000000 s",
    ),
    Row(
        "a program that says something else",
        "chiplog run --device \"process:sh -c 'read line; echo hello; echo done; cat'\"",
        "device sh: said 'hello' at 0.000000 s; expected a frame like "
        "200#A3C10000D4000000, or done (other output belongs on standard error)",
    ),
    Row(
        "a program that does not answer",
        'chiplog run --device "process:sleep 60"',
        "device sleep: did not answer within 10 s at 0.000000 s; a tick ends "
        "with the line done, flushed",
    ),
)
