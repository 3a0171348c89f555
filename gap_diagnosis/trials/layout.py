"""What lies where in a trial's folder: an open benchmark that any method may read.

``cases/0001/`` holds `bus.log` (candump), `robot.toml`, `reference.tum` and `task.json`
(``{"schema": 1, "without": [effects that must not be named]}``); ``results/METHOD/0001.json`` is
what a method says of it, in the format of ``chiplog schema diagnosis``. Where a robot was driven
again, ``cases/0001/again/`` holds the second log and its reference.
"""

from typing import Final

SCHEMA: Final = 1
CASES: Final = "cases"
RESULTS: Final = "results"
ROBOT: Final = "robot.toml"
LOG: Final = "bus.log"
REFERENCE: Final = "reference.tum"
TASK: Final = "task.json"
AGAIN: Final = "again"
OWN_METHOD: Final = "chiplog"
