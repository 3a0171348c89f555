"""Firmware under test."""

from __future__ import annotations

from error_tables.row import Row
from hil_harness.devices import include_dir

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

_C = """#include "chiplog_device.h"
int32_t chiplog_init(uint32_t tick_period_us) { return tick_period_us > 0 ? 1 : 0; }
int32_t chiplog_step(uint64_t now_us, const chiplog_frame *received, uint32_t received_count,
                     chiplog_frame *sent, uint32_t sent_capacity)
{ return now_us + received_count + sent_capacity > 0 && received != sent ? 0 : 1; }
int32_t chiplog_odometry(chiplog_pose *pose) { return pose ? CHIPLOG_POSE_NONE : -1; }
"""
_STEP_OF_C = "return now_us + received_count + sent_capacity > 0 && received != sent ? 0 : 1;"


def _library(when: str, old: str, new: str, line: str) -> Row:
    return Row(when, "chiplog run --device lib:node.so", line, {"node.c": _C.replace(old, new)})


FIRMWARE_UNDER_TEST += (
    _library(
        "a library that lacks a function",
        "chiplog_odometry(",
        "odometry(",
        "device node.so: exports no function chiplog_odometry; a device exports "
        "chiplog_init, chiplog_step, chiplog_odometry (see chiplog_device.h)",
    ),
    _library(
        "a library that refuses to start",
        "? 1 : 0",
        "? -3 : 0",
        "device node.so: chiplog_init refused with -3 for a tick of 10000 us",
    ),
    _library(
        "a library of another version",
        "? 1 : 0",
        "? 7 : 0",
        "device node.so: built against version 7 of chiplog_device.h, this is version 1; "
        f"rebuild it against {include_dir()}",
    ),
    _library(
        "a C step that fails",
        _STEP_OF_C,
        "return -5;",
        "device node.so: chiplog_step failed with -5 at 0.000000 s",
    ),
    _library(
        "a C step that answers too many frames",
        _STEP_OF_C,
        "return 1000;",
        "device node.so: chiplog_step wrote more frames than the 256 it was given room "
        "for (returned 1000) at 0.000000 s",
    ),
    _library(
        "a C step that answers a frame of nine bytes",
        _STEP_OF_C,
        "sent[0].length = 9; sent[0].flags = 0; return 1;",
        "device node.so: frame 0 sent at 0.000000 s has a length of 9 bytes, more than 8",
    ),
    _library(
        "a C step that answers an identifier too large",
        _STEP_OF_C,
        "sent[0].id = 0x800; sent[0].length = 0; sent[0].flags = 0; return 1;",
        "device node.so: frame 0 sent at 0.000000 s has the identifier 0x800, more than 11 bits",
    ),
    _library(
        "a C step that answers an unknown flag",
        _STEP_OF_C,
        "sent[0].length = 0; sent[0].flags = 0x80; return 1;",
        "device node.so: frame 0 sent at 0.000000 s has flags 0x80, of which only 0x03 exist",
    ),
    Row(
        "a Python step that answers a frame that no bus carries",
        "chiplog run --device python:node.py:Node",
        "device Node: a frame sent at 0.000000 s has the identifier 0x800, outside 11 "
        "bits; allowed are classic data frames of up to 8 bytes with an identifier of 11 "
        "bits, or of 29 if extended",
        {
            "node.py": "import can\n"
            + _STEP
            + "return [can.Message(arbitration_id=0x800, is_extended_id=False)]\n"
        },
    ),
    Row(
        "a Python module that is not there",
        "chiplog run --device python:no_such_module:Node",
        "device python:no_such_module: importing it raised ModuleNotFoundError: No "
        "module named 'no_such_module'",
    ),
    Row(
        "a Python file that is no Python",
        "chiplog run --device python:node.py:Node",
        "device python:node.py: importing it raised SyntaxError: invalid syntax (node.py, line 1)",
        {"node.py": "def\n"},
    ),
    Row(
        "a program without a name",
        "chiplog run --device 'process: '",
        "device process: needs a command line, for example process:./node --fast",
    ),
    Row(
        "a program's open quote",
        'chiplog run --device "process:./node \'fast"',
        "device process:./node 'fast: No closing quotation",
    ),
    Row(
        "a program that never ends a tick",
        'chiplog run --device "process:yes 123#00"',
        "device yes: answered more than 1048576 bytes at 0.000000 s without the line done",
    ),
    Row(
        "a program that ends with last words",
        "chiplog run --device \"process:sh -c 'echo no licence >&2; exit 3'\"",
        "device sh: ended with exit status 3 at 0.000000 s; its last words: no licence",
    ),
)
