"""No message is raised that errors.md does not list, but those that no command can provoke."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

from error_rows import SECTIONS
from error_tables import rig

ROOT = Path(__file__).parents[2]
ROOMS = (
    *("can_bus", "chiplog", "firmware_model", "gap_diagnosis", "hil_harness", "precision_study"),
    "sim_plant",
)
ERRORS = {
    "CanBusError",
    "CommandError",
    "DiagnosisError",
    "FirmwareError",
    "HarnessError",
    "PlantError",
    "StudyError",
}
LISTED = [
    line
    for rows in (*SECTIONS.values(), rig.SETTINGS, rig.STATEMENTS)
    for row in rows
    for line in (row.line, row.or_line)
]

UNLISTED = {
    "only a run of bad luck, or a trial written by a program, comes here": {
        "gap_diagnosis/trials/make.py:make_case",
        "gap_diagnosis/trials/plan.py:_pair",
    },
    "only the benchmark of blind trials reads what it kept": {
        "gap_diagnosis/trials/kept.py:kept",
    },
    "only Python code hands these in": {
        "can_bus/checker.py:e2e",
        "can_bus/columns.py:__init__",
        "can_bus/e2e_state.py:__post_init__",
        "can_bus/signals.py:to_bits",
        "can_bus/simulated/bus.py:_open_wire",
        "can_bus/simulated/bus.py:send",
        "can_bus/specs.py:_cannot_protect",
        "can_bus/specs.py:_wrong_length",
        "can_bus/specs.py:encode_raw",
        "can_bus/specs.py:pack",
        "can_bus/specs.py:unpack",
        "can_bus/response_time.py:response_times",
        "can_bus/timing.py:_require_classic",
        "can_bus/timing.py:frame_length_bits",
        "chiplog/regression.py:assert_gap_below",
        "firmware_model/batch_inputs.py:of",
        "firmware_model/batch_inputs.py:_counts",
        "firmware_model/batch_inputs.py:_spread",
        "firmware_model/batch_inputs.py:_validity",
        "firmware_model/batch.py:pose_m_rad",
        "firmware_model/c99_layout.py:put",
        "firmware_model/kernel.py:__init__",
        "firmware_model/kernel.py:load_state",
        "firmware_model/kernel.py:set_gyro_offset",
        "gap_diagnosis/diagnose.py:diagnose",
        "gap_diagnosis/motion/estimate.py:estimate_motion",
        "gap_diagnosis/synthetic.py:synthetic_recordings",
        "hil_harness/devices/shared_library.py:odometry",
        "hil_harness/lockstep.py:__init__",
        "hil_harness/rig.py:_last_value",
        "hil_harness/running.py:_run_lockstep",
        "hil_harness/scenarios/profile.py:__post_init__",
        "hil_harness/scenarios/model.py:commands",
        "hil_harness/sensor_frames.py:code_scale",
        "sim_plant/batch.py:__init__",
        "sim_plant/batch.py:_check_commands",
        "sim_plant/batch.py:advance",
        "sim_plant/mechanisms.py:__post_init__",
        "sim_plant/plant.py:step",
        "precision_study/ranges/envelope.py:of",
    },
    "a diagnosis was made, and its answer printed, before this can be said": {
        "gap_diagnosis/criterion.py:_held_against",
        "gap_diagnosis/take_home.py:_changed",
        "gap_diagnosis/take_home.py:_effect_table",
        "gap_diagnosis/take_home.py:effects_text",
    },
    "an emulated core: no command starts one": {
        "firmware_model/cortex_m.py:_run",
        "firmware_model/cortex_m.py:_tool",
    },
    "takes an installation, a load or a moment that no row can name; tested where it is raised": {
        "can_bus/database.py:shipped_path",
        "can_bus/logs/columns.py:read_log_columns",
        "can_bus/logs/columns.py:refuse_beyond",
        "chiplog/commands/export.py:_truth",
        "chiplog/commands/export.py:command",
        "chiplog/pytest_rig.py:_channel",
        "firmware_model/c99_library.py:compile_library",
        "firmware_model/c99_library.py:find_compiler",
        "gap_diagnosis/reading/log_columns.py:load_columns",
        "gap_diagnosis/reading/reference_file.py:_read",
        "gap_diagnosis/reading/reference_file.py:_refuse_without_fixes",
        "gap_diagnosis/reading/ros_reference.py:_chosen",
        "gap_diagnosis/reading/ros_reference.py:_fix",
        "gap_diagnosis/reading/ros_reference.py:_package",
        "gap_diagnosis/reading/ros_reference.py:read_ros_poses",
        "gap_diagnosis/reading/rows.py:rows_of_ticks",
        "gap_diagnosis/reading/table_file.py:_read_parquet",
        "gap_diagnosis/reading/table_file.py:_read_parts",
        "gap_diagnosis/trials/make.py:_other_engine",
        "gap_diagnosis/trials/run.py:_one",
        "hil_harness/devices/process.py:_exchange",
        "hil_harness/devices/shared_library.py:_put",
        "hil_harness/devices/shared_library.py:step",
        "hil_harness/export/mcap_file.py:_packages",
        "precision_study/study/results.py:pyarrow_modules",
        "hil_harness/rig_loops.py:_raise_failure",
    },
}


def raised() -> Iterator[tuple[str, str, str]]:
    """Yield file, function and pattern of each message that the rooms raise."""
    for room in ROOMS:
        for path in sorted((ROOT / room).rglob("*.py")):
            tree = ast.parse(path.read_text(encoding="utf-8"))
            for function in ast.walk(tree):
                if isinstance(function, ast.FunctionDef):
                    for call in calls(function):
                        name = f"{path.relative_to(ROOT)}:{function.name}"
                        yield name, pattern(call.args[0]), ast.unparse(call.args[0])


def calls(function: ast.FunctionDef) -> Iterator[ast.Call]:
    """Yield where a function makes one of our errors."""
    for node in ast.walk(function):
        is_call = isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        if is_call and node.func.id in ERRORS and node.args:
            yield node


def pattern(message: ast.expr) -> str:
    """Return the text of a message as a pattern: what is put into it may be anything."""
    match message:
        case ast.Constant(value=str(text)):
            return re.escape(text)
        case ast.JoinedStr(values=parts):
            return "".join(map(pattern, parts))
        case ast.BinOp(left=left, right=right):
            return pattern(left) + pattern(right)
    return ".*"


def test_every_message_is_listed_but_those_named_here() -> None:
    allowed = set().union(*UNLISTED.values())
    unlisted = {
        (place, text)
        for place, wanted, text in raised()
        if not any(re.fullmatch(rf"(?:.*: )?{wanted}", line) for line in LISTED)
    }
    assert [found for found in sorted(unlisted) if found[0] not in allowed] == []
    assert allowed == {place for place, _ in unlisted} & allowed, "no longer raised, or listed"
