"""A recorded log, run again: every raw odometry field of every tick, and the state at the end."""

from pathlib import Path

import pytest

from can_bus import load_database
from hil_harness import (
    HarnessError,
    RunConfig,
    RunResult,
    load_robot,
    load_wire,
    replay,
    run,
    scenario,
)


def record(path: Path, name: str = "stop_and_go", duration_s: float = 8.0) -> RunResult:
    return run(
        RunConfig(scenario=scenario(name), robot=load_robot(None), duration_s=duration_s, log=path)
    )


@pytest.mark.parametrize("suffix", [".log", ".asc", ".blf"])
def test_a_run_replays_bit_for_bit_from_its_own_log(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"bus{suffix}"
    recorded = record(path)
    result = replay(path, load_robot(None), load_wire())
    assert result.is_equal
    assert result.ticks == recorded.ticks
    assert result.fields > 9 * recorded.ticks
    assert result.state == recorded.kernel_state


def test_one_flipped_bit_of_odometry_is_found_with_tick_field_and_both_values(
    tmp_path: Path,
) -> None:
    path = tmp_path / "bus.log"
    record(path)
    frame_id = f" {load_database().message('ODOMETRY_Y').frame_id:03X}#"
    lines = path.read_text().splitlines()
    at = [number for number, line in enumerate(lines) if frame_id in line][300]
    head, data = lines[at].split("#")
    changed = bytearray.fromhex(data.split()[0])
    changed[3] ^= 1
    lines[at] = f"{head}#{changed.hex().upper()} {data.split()[1]}"
    path.write_text("\n".join(lines) + "\n")
    difference = replay(path, load_robot(None), load_wire()).first_difference
    assert difference is not None
    assert (difference.tick, difference.field) == (300, "ODOMETRY_Y.y_m")
    assert difference.logged_raw is not None
    assert difference.computed_raw is not None
    # y_m starts at bit 12: the lowest bit of byte 3 is its bit 12
    assert abs(int(difference.logged_raw) - int(difference.computed_raw)) == 1 << 12


def test_a_robot_described_otherwise_does_not_replay(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    record(path)
    robot = load_robot(None)
    other = tmp_path / "robot.toml"
    other.write_text("schema = 1\n[wheels]\nradius_m = 0.0503\n")
    assert robot.plant.wheels.radius_m != 0.0503
    result = replay(path, load_robot(other), load_wire())
    assert not result.is_equal


def with_cycle(path: Path, names: set[str], cycle_ms: int) -> Path:
    """Write the shipped DBC with another cycle time of some messages."""
    database = load_database()
    text = database.path.read_text()
    for message in database.messages.values():
        if message.name in names:
            line = f'BA_ "GenMsgCycleTime" BO_ {message.frame_id} '
            start = text.index(line) + len(line)
            text = text[:start] + str(cycle_ms) + text[text.index(";", start) :]
    path.write_text(text)
    return path


def test_odometry_slower_than_the_tick_replays_from_a_lockstep_log(tmp_path: Path) -> None:
    pose_frames = {"ODOMETRY_X", "ODOMETRY_Y", "ODOMETRY_HEADING"}
    dbc = with_cycle(tmp_path / "slow.dbc", pose_frames, 20)
    log = tmp_path / "bus.log"
    config = RunConfig(
        scenario=scenario("stop_and_go"), robot=load_robot(None), duration_s=6.0, log=log, dbc=dbc
    )
    recorded = run(config)
    result = replay(log, load_robot(None), load_wire(dbc))
    assert result.is_equal
    assert (result.ticks, result.state) == (recorded.ticks, recorded.kernel_state)
    shifted = log.read_text().replace("(0.010000)", "(0.010300)")
    log.write_text(shifted)
    with pytest.raises(HarnessError, match="the stamps are not those of whole ticks"):
        replay(log, load_robot(None), load_wire(dbc))


def test_a_log_that_ends_inside_a_tick_is_compared_as_far_as_it_goes(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    record(path, duration_s=1.0)
    lines = path.read_text().splitlines(keepends=True)
    frame_id = f" {load_database().message('ODOMETRY_X').frame_id:03X}#"
    last = max(number for number, line in enumerate(lines) if frame_id in line)
    path.write_text("".join(lines[: last + 1]))
    result = replay(path, load_robot(None), load_wire())
    assert result.is_equal
    assert result.ticks == 100


def test_a_status_message_of_another_node_is_neither_sent_nor_compared(tmp_path: Path) -> None:
    database = load_database()
    text = database.path.read_text()
    header = f"BO_ {database.message('STATUS').frame_id} STATUS: 8 "
    assert f"{header}ECU" in text
    dbc = tmp_path / "other.dbc"
    dbc.write_text(text.replace(f"{header}ECU", f"{header}PLANT"))
    log = tmp_path / "bus.log"
    run(
        RunConfig(
            scenario=scenario("spin"), robot=load_robot(None), duration_s=1.0, log=log, dbc=dbc
        )
    )
    assert f" {database.message('STATUS').frame_id:03X}#" not in log.read_text()
    assert replay(log, load_robot(None), load_wire(dbc)).is_equal


def without_frames(path: Path, *names: str) -> Path:
    """Leave all frames of these messages out of a log."""
    frame_ids = tuple(f" {load_database().message(name).frame_id:03X}#" for name in names)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(line for line in lines if not any(one in line for one in frame_ids)))
    return path


POSE = ("ODOMETRY_X", "ODOMETRY_Y", "ODOMETRY_HEADING")
REPORTS = ("ODOMETRY_VELOCITY", "STATUS")


@pytest.mark.parametrize("names", [POSE, ("ODOMETRY_Y",), REPORTS, (*POSE, "STATUS")])
def test_what_a_log_has_not_at_all_is_named_and_the_rest_is_compared_as_ever(
    tmp_path: Path, names: tuple[str, ...]
) -> None:
    path = tmp_path / "bus.log"
    recorded = record(path)
    whole = replay(path, load_robot(None), load_wire())
    assert whole.missing == ()
    found = replay(without_frames(path, *names), load_robot(None), load_wire())
    assert found.is_equal
    assert found.missing == names
    assert 0 < found.fields < whole.fields
    assert (found.ticks, found.state) == (recorded.ticks, recorded.kernel_state)


def test_without_poses_the_velocity_still_tells_another_robot(tmp_path: Path) -> None:
    path, other = tmp_path / "bus.log", tmp_path / "robot.toml"
    record(path)
    other.write_text("schema = 1\n[wheels]\nradius_m = 0.0503\n")
    found = replay(without_frames(path, *POSE), load_robot(other), load_wire())
    assert found.missing == POSE
    assert found.first_difference is not None
    assert found.first_difference.field == "ODOMETRY_VELOCITY.v_m_s"


def test_poses_that_come_later_than_at_first_are_no_missing_ones(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    record(path, duration_s=1.0)
    head, tail = path.read_text().split("(0.500000)", 1)
    path.write_text(head)
    without_frames(path, "ODOMETRY_X")
    path.write_text(f"{path.read_text()}(0.500000){tail}")
    found = replay(path, load_robot(None), load_wire())
    assert found.missing == ()
    assert found.first_difference is not None
    assert found.first_difference.field == "ODOMETRY_X.x_m"
    assert found.first_difference.logged_raw is None


def test_a_log_by_wall_clock_whose_steps_cannot_be_told_apart_is_refused(tmp_path: Path) -> None:
    """Its stamps may be whole ticks by chance: those since 1970 would be run one by one."""
    path = tmp_path / "bus.log"
    record(path, duration_s=1.0)
    without_frames(path, *POSE)
    path.write_text(path.read_text().replace("(0.", "(1700000000."))
    with pytest.raises(HarnessError, match="the stamps are not those of whole ticks from 0 on"):
        replay(path, load_robot(None), load_wire())


def test_a_log_without_odometry_is_refused_and_says_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "bus.log"
    path.write_text("(0.000000) vcan0 0C1#4600000000000000 R\n")
    with pytest.raises(HarnessError, match="no odometry frames: expected ODOMETRY_X"):
        replay(path, load_robot(None), load_wire())
