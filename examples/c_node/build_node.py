"""Build node.so: ``python build_node.py [FOLDER]`` (default: build, next to this file).

What node.c does not say itself is generated: chiplog_bus.c and chiplog_bus.h (pack and unpack
frames) from the DBC by cantools, and facts.h from the DBC's attributes and robot.toml.
"""

import subprocess
import sys
from pathlib import Path

from can_bus import load_database
from hil_harness.devices import include_dir
from hil_harness.robot import load_robot

HERE = Path(__file__).parent
SENT_AND_RECEIVED = ("ENCODER", "ODOMETRY_X", "ODOMETRY_Y", "ODOMETRY_HEADING")


def build(folder: Path) -> Path:
    """Generate and compile into *folder*; return the library."""
    folder.mkdir(parents=True, exist_ok=True)
    database = load_database()
    generate = [sys.executable, "-m", "cantools", "generate_c_source", "--use-round"]
    generate += ["--database-name", "chiplog_bus", "--output-directory", str(folder)]
    subprocess.run([*generate, str(database.path)], check=True, stdout=subprocess.DEVNULL)
    robot = load_robot(None).plant
    facts = {
        "WHEEL_RADIUS_M": repr(robot.wheels.radius_m),
        "WHEELBASE_M": repr(robot.wheels.wheelbase_m),
        "TICKS_PER_REV": repr(float(robot.encoder.ticks_per_rev)),
    }
    for name in SENT_AND_RECEIVED:
        protection = database.message(name).e2e
        assert protection is not None
        facts[f"{name}_DATA_ID"] = f"{protection.data_id}u"
    lines = "".join(f"#define {name} {value}\n" for name, value in facts.items())
    (folder / "facts.h").write_text(lines)
    library = folder / "node.so"
    compiler = ["gcc", "-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2"]
    compiler += ["-shared", "-fPIC", f"-I{include_dir()}", f"-I{folder}", "-o", str(library)]
    sources = [str(HERE / "node.c"), str(folder / "chiplog_bus.c")]
    subprocess.run([*compiler, *sources, "-lm"], check=True)
    return library


if __name__ == "__main__":
    print(build(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE / "build"))
