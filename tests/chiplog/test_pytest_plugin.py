"""The pytest plugin: a rig as a fixture, told which by options, settings and markers."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from hil_harness.rig import Rig

pytest_plugins = ["pytester"]

FOREIGN = Path(__file__).parents[2] / "examples" / "foreign_dbc"

ECHO = """
class Node:
    word = "echo"

    def step(self, now_us, frames):
        return []
"""

HEAVY = ("can", "cantools", "matplotlib", "numba", "numpy", "pydantic", "scipy", "typer")


@pytest.fixture(scope="module", autouse=True)
def everything_is_imported() -> None:
    """Import what rigs import, and late: pytester forgets modules that an inner run imports."""
    for interface in ("virtual", "udp_multicast"):
        with Rig(interface=interface) as rig:
            rig.expect("STATUS", within_s=60.0)
            rig.recent_frames(1)


@pytest.fixture(autouse=True)
def inner_runs_are_no_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let these tests be the same when they run in a worker of pytest-xdist themselves."""
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))


def run(pytester: pytest.Pytester, test: str, *options: str) -> pytest.RunResult:
    """Run a test file in this process, where what is heavy has been imported once for all."""
    pytester.makepyfile(test)
    return pytester.runpytest_inprocess("-p", "no:cacheprovider", *options)


def run_apart(pytester: pytest.Pytester, test: str, *options: str) -> pytest.RunResult:
    """Run a test file in a process of its own, and workers of its own."""
    pytester.makepyfile(test)
    lean = ("lean", "no:cacheprovider", "no:hypothesispytest")  # a third of the time to start
    plugins = [word for name in lean for word in ("-p", name)]
    return pytester.runpytest_subprocess(*plugins, *options)


def test_a_test_drives_a_robot_over_the_bus(pytester: pytest.Pytester) -> None:
    result = run_apart(
        pytester,
        """
        import pytest

        def test_drive(chiplog_rig):
            chiplog_rig.send("COMMAND", v_m_s=0.5)
            chiplog_rig.run_for(1.0)
            chiplog_rig.expect("ODOMETRY_X", within_s=0.1, x_m=pytest.approx(0.47, abs=0.05))
        """,
    )
    result.assert_outcomes(passed=1)


def test_the_raw_bus_is_on_the_rigs_channel(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
        def test_raw(chiplog_rig, chiplog_bus):
            chiplog_rig.run_for(0.01)
            assert chiplog_bus.recv(0) is not None

        def test_the_bus_alone_brings_its_rig_along(chiplog_bus):
            assert chiplog_bus.recv(0) is None
        """,
    )
    result.assert_outcomes(passed=2)


def test_a_marker_configures_the_rig_of_one_test(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(node=ECHO)
    result = run(
        pytester,
        """
        import pytest

        pytestmark = pytest.mark.chiplog(device="python:node.py:Node", seed=1)

        def test_module(chiplog_rig):
            assert chiplog_rig.device.node.word == "echo"

        @pytest.mark.chiplog(seed=2, effects=["radius_scale.scale=0.01"])
        def test_function_adds_to_the_module(chiplog_rig):
            assert chiplog_rig.device.node.word == "echo"

        @pytest.mark.chiplog(device=None, scenario="spin")
        def test_function_wins_over_the_module(chiplog_rig):
            assert not hasattr(chiplog_rig.device.node, "word")
        """,
    )
    result.assert_outcomes(passed=3)


def test_a_file_of_effects_acts_as_its_texts_and_is_found_beside_the_test(
    pytester: pytest.Pytester,
) -> None:
    folder = pytester.mkdir("robots")
    (folder / "explained.toml").write_text("[gyro_bias]\nbias = 0.05  # 95 %: 0.04 to 0.06\n")
    (folder / "conftest.py").write_text(
        """
import pytest

@pytest.fixture
def chiplog_settings():
    return {"effects": "explained.toml"}
"""
    )
    (folder / "test_it.py").write_text(
        """
from pathlib import Path
import pytest

TEXT = "gyro_bias.bias=0.05"
FILE = "explained.toml"
ENDS = {}


@pytest.mark.parametrize("given", [
    pytest.param(given, marks=pytest.mark.chiplog(effects=given), id=repr(given))
    for given in (TEXT, [TEXT], FILE, [FILE], Path(FILE), ("gyro_bias.bias=0", ), [FILE, TEXT],
                  ["gyro_bias.bias=0", FILE])
])
def test_of_a_marker(chiplog_rig, given):
    ENDS[repr(given)] = drive(chiplog_rig)


def test_of_the_project(chiplog_rig):
    ENDS["project"] = drive(chiplog_rig)


def drive(rig):
    rig.send("COMMAND", v_m_s=0.2)
    rig.run_for(1.0)
    return rig.odometry.heading_rad


def test_all_are_the_same_but_for_a_text_that_wins_over_the_file():
    overridden = {key for key, end in ENDS.items() if end != ENDS[repr(TEXT)]}
    assert overridden == {"('gyro_bias.bias=0',)", f"['gyro_bias.bias=0', '{FILE}']"}
    assert len(ENDS) == 9
"""
    )
    result = pytester.runpytest_inprocess("-p", "no:cacheprovider", "robots")
    result.assert_outcomes(passed=10)


def test_effects_of_ones_own_are_taken_with_their_library(pytester: pytest.Pytester) -> None:
    pytester.makepyfile(
        mine="""
        from hil_harness.effects import Effect, EffectParameter

        def apply(settings, values):
            rate_rad_s = settings.plant.gyro_bias_rad_s + values["rate"]
            return settings.with_plant(gyro_bias_rad_s=rate_rad_s)

        EFFECTS = [
            Effect(
                name="draught",
                stage="gyro",
                parameters=(EffectParameter("rate", "rad/s", 0.0, "how it blows"),),
                signature="The gyro turns.",
                apply=apply,
            )
        ]
        """
    )
    (pytester.path / "explained.toml").write_text("[draught]\nrate = 0.05\n")
    result = run(
        pytester,
        """
        import pytest

        ENDS = []

        @pytest.mark.parametrize("given", [
            pytest.param(None, marks=pytest.mark.chiplog(effects="gyro_bias.bias=0.05")),
            *(
                pytest.param(None, marks=pytest.mark.chiplog(effects=own, effect_library="mine.py"))
                for own in ("draught.rate=0.05", "explained.toml")
            ),
        ])
        def test_drive(chiplog_rig, given):
            chiplog_rig.send("COMMAND", v_m_s=0.2)
            chiplog_rig.run_for(1.0)
            ENDS.append(chiplog_rig.odometry.heading_rad)

        def test_all_are_the_same():
            assert len(ENDS) == 3
            assert len(set(ENDS)) == 1
        """,
    )
    result.assert_outcomes(passed=4)


def test_a_project_configures_its_rigs_by_overriding_the_settings_fixture(
    pytester: pytest.Pytester,
) -> None:
    pytester.makeconftest(
        f"""
        from pathlib import Path
        import pytest

        @pytest.fixture
        def chiplog_settings():
            folder = Path({str(FOREIGN)!r})
            return {{"dbc": folder / "vehicle.dbc", "signals": folder / "map.toml"}}
        """
    )
    result = run(
        pytester,
        """
        def test_foreign(chiplog_rig):
            chiplog_rig.send("DRIVE", Speed=100)
            chiplog_rig.expect("POSITION", within_s=1.0)
        """,
    )
    result.assert_outcomes(passed=1)


def test_the_command_line_wins_over_the_settings_and_a_marker_over_both(
    pytester: pytest.Pytester,
) -> None:
    pytester.makeconftest(
        """
        import pytest

        @pytest.fixture
        def chiplog_settings():
            return {"device": "python:of_settings.py:Node"}
        """
    )
    for name in ("settings", "command_line", "marker"):
        (pytester.path / f"of_{name}.py").write_text(ECHO.replace("echo", name))
    result = run(
        pytester,
        """
        import pytest

        def test_command_line(chiplog_rig):
            assert chiplog_rig.device.node.word == "command_line"

        @pytest.mark.chiplog(device="python:of_marker.py:Node")
        def test_marker(chiplog_rig):
            assert chiplog_rig.device.node.word == "marker"
        """,
        "--chiplog-device",
        "python:of_command_line.py:Node",
    )
    result.assert_outcomes(passed=2)


def test_options_choose_dbc_signals_and_robot(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
        def test_foreign(chiplog_rig):
            assert chiplog_rig.database.path.name == "vehicle.dbc"
            assert chiplog_rig.signal_map.name == "map.toml"
        """,
        f"--chiplog-dbc={FOREIGN / 'vehicle.dbc'}",
        f"--chiplog-signals={FOREIGN / 'map.toml'}",
    )
    result.assert_outcomes(passed=1)


def test_options_choose_interface_and_channel(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
        def test_real_time(chiplog_rig):
            assert (chiplog_rig.interface, chiplog_rig.channel) == ("udp_multicast", "239.99.1.2")
            assert not chiplog_rig.in_lockstep
            chiplog_rig.expect("ENCODER", within_s=60.0)
        """,
        "--chiplog-interface=udp_multicast",
        "--chiplog-channel=239.99.1.2",
        "--chiplog-bus-arg=port=43999",
    )
    result.assert_outcomes(passed=1)


def test_a_missing_interface_fails_the_test_with_the_lines_that_make_one(
    pytester: pytest.Pytester,
) -> None:
    result = run(
        pytester,
        "def test_vcan(chiplog_rig): pass",
        "--chiplog-interface=socketcan",
        "--chiplog-channel=vcan77",
    )
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(
        ["chiplog: socketcan: *ip link add dev vcan77 type vcan; ip link set up vcan77*"]
    )
    result.stdout.no_fnmatch_line("*exception occurred*")


@pytest.mark.parametrize(
    ("marker", "complaint"),
    [
        ('robot="no.toml"', "chiplog: *no.toml*"),
        ('devise="lib:x.so"', "chiplog: @pytest.mark.chiplog: no setting 'devise'; *device*"),
        ('"lib:x.so"', "chiplog: @pytest.mark.chiplog takes keywords only: robot, device*"),
        ('effects=["gravity.on=1"]', "chiplog: effect *gravity*"),
        ('effects="no.toml"', "chiplog: *no.toml: *"),
        ('effect_library="no.py"', "chiplog: *no.py: cannot read this effect library: *"),
        ('seed="x"', "chiplog: seed = 'x': expected a whole number, 0 or more"),
        ('device="none"', "chiplog: device none: *; use --chiplog-interface with socketcan, *"),
    ],
)
def test_a_marker_that_asks_for_the_impossible_fails_the_test_with_one_line(
    pytester: pytest.Pytester, marker: str, complaint: str
) -> None:
    result = run(
        pytester,
        f"""
        import pytest

        @pytest.mark.chiplog({marker})
        def test_it(chiplog_rig):
            pass
        """,
    )
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines([complaint])
    result.stdout.no_fnmatch_line("*exception occurred*")


def test_a_bus_left_open_fails_the_test(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
        import can
        import pytest

        def test_leaks(chiplog_rig):
            can.Bus(interface="virtual", channel=chiplog_rig.channel)

        def test_tidy(chiplog_rig):
            with can.Bus(interface="virtual", channel=chiplog_rig.channel):
                pass

        def test_leaks_on_another_channel(chiplog_rig):
            can.Bus(interface="virtual", channel="elsewhere")

        @pytest.fixture(scope="module")
        def shared_bus():
            with can.Bus(interface="virtual", channel="shared") as bus:
                yield bus

        def test_a_bus_of_a_wider_fixture_is_not_the_tests(shared_bus, chiplog_rig):
            pass
        """,
    )
    result.assert_outcomes(passed=4, errors=2)
    said = "chiplog: 1 python-can bus left open on channel {} (VirtualBus): call shutdown()*"
    result.stdout.fnmatch_lines([said.format("chiplog-*"), said.format("elsewhere")])


def test_a_failure_shows_the_frames_before_it_and_keeps_the_log(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
        def test_fails(chiplog_rig):
            chiplog_rig.send("COMMAND", v_m_s=0.5)
            chiplog_rig.expect("ODOMETRY_X", within_s=0.2, x_m=99.0)

        def test_passes(chiplog_rig):
            chiplog_rig.run_for(0.1)
        """,
        "--chiplog-log-dir=logs",
    )
    result.assert_outcomes(passed=1, failed=1)
    result.stdout.fnmatch_lines(
        [
            "*AssertionError: no ODOMETRY_X with x_m = 99.0 within 0.2 s*20 came, none of them so",
            "*chiplog: the last 30 frames on the bus*",
            "0.190000 s  PLANT  ENCODER  left_count = * tick, right_count = * tick",
            "0.190000 s  ECU  ODOMETRY_X  x_m = * m",
            "*chiplog: the log is kept*",
        ]
    )
    (log,) = (pytester.path / "logs").iterdir()
    assert re.search(re.escape(str(log)), result.stdout.str())
    assert "test_fails" in log.name
    assert log.read_text().count("\n") > 100


def test_a_failure_in_real_time_shows_the_frames_before_it(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
        def test_fails(chiplog_rig):
            try:
                chiplog_rig.expect_none("STATUS", within_s=60.0)
            finally:
                chiplog_rig.run_for(1.0)
        """,
        "--chiplog-interface=udp_multicast",
    )
    result.assert_outcomes(failed=1)
    output = result.stdout.str()
    met = re.search(r"^E +(\d+\.\d{6}) s  initialised = ", output, re.MULTILINE)
    assert met is not None
    assert re.search(rf"^{re.escape(met[1])} s  ECU  STATUS ", output, re.MULTILINE)


def test_a_log_is_kept_when_the_test_leaks_a_bus_too(pytester: pytest.Pytester) -> None:
    result = run(
        pytester,
        """
        import can

        def test_leaks(chiplog_rig):
            can.Bus(interface="virtual", channel=chiplog_rig.channel)
            chiplog_rig.run_for(0.1)
        """,
        "--chiplog-log-dir=logs",
    )
    result.assert_outcomes(passed=1, errors=1)
    assert len(list((pytester.path / "logs").iterdir())) == 1


def test_workers_of_xdist_do_not_meet(pytester: pytest.Pytester) -> None:
    result = run_apart(
        pytester,
        """
        import pytest

        @pytest.mark.parametrize("number", range(8))
        def test_drive(chiplog_rig, number):
            speed_m_s = 0.1 * (number + 1)
            chiplog_rig.send("COMMAND", v_m_s=speed_m_s)
            chiplog_rig.run_for(1.0)
            before_m = chiplog_rig.odometry.x_m
            chiplog_rig.run_for(1.0)
            assert chiplog_rig.odometry.x_m - before_m == pytest.approx(speed_m_s, rel=0.02)
        """,
        "-n",
        "2",
    )
    result.assert_outcomes(passed=8)


@pytest.mark.full_size
def test_workers_of_xdist_do_not_meet_in_real_time_either(pytester: pytest.Pytester) -> None:
    result = run_apart(
        pytester,
        """
        import pytest

        @pytest.mark.parametrize("number", range(4))
        def test_alone(chiplog_rig, number):
            chiplog_rig.expect_none("COMMAND", within_s=0.2)
            chiplog_rig.send("COMMAND", v_m_s=0.1)
            chiplog_rig.expect("COMMAND", within_s=60.0)
        """,
        "-n",
        "2",
        "--chiplog-interface=udp_multicast",
    )
    result.assert_outcomes(passed=4)


def test_failures_in_a_worker_show_their_frames_too(pytester: pytest.Pytester) -> None:
    result = run_apart(
        pytester,
        """
        def test_fails(chiplog_rig):
            chiplog_rig.run_for(0.1)
            assert False
        """,
        "-n",
        "1",
    )
    result.assert_outcomes(failed=1)
    result.stdout.fnmatch_lines(["*chiplog: the last 30 frames on the bus*", "*the log is kept*"])


def test_workers_that_would_share_one_bus_are_refused(
    pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTEST_XDIST_WORKER", "gw3")
    test = "def test_it(chiplog_rig): assert chiplog_rig.channel == '239.98.0.3'"
    udp = "--chiplog-interface=udp_multicast"
    result = run(pytester, test, udp, "--chiplog-channel=239.98.0.3")
    result.assert_outcomes(errors=1)
    result.stdout.fnmatch_lines(["chiplog: --chiplog-channel 239.98.0.3: the workers of *"])
    result = run(pytester, test, udp, "--chiplog-channel=239.98.0.{worker}")
    result.assert_outcomes(passed=1)


def test_nothing_heavy_is_imported_before_a_fixture_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "test_light.py").write_text("def test_light(): pass\n")
    probe = (
        "import sys, pytest, chiplog.pytest_plugin\n"
        "status = pytest.main(['-q', '-p', 'no:cacheprovider'])\n"
        f"print('loaded:', sorted(set({HEAVY!r}) & set(sys.modules)))\n"
        "sys.exit(status)\n"
    )
    result = subprocess.run(
        [sys.executable, "-c", probe], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert "loaded: []" in result.stdout


def test_the_options_and_the_marker_explain_themselves(pytester: pytest.Pytester) -> None:
    result = pytester.runpytest_inprocess("--help")
    for option in ("interface", "channel", "bitrate", "dbc", "signals", "robot", "device"):
        result.stdout.fnmatch_lines([f"*--chiplog-{option}=*"])
    result = pytester.runpytest_inprocess("--markers")
    result.stdout.fnmatch_lines(["@pytest.mark.chiplog(robot=None, device=None, *"])
