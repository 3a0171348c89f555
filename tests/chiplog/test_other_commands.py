"""`effects`, `schema`, `doctor`, `node`, and the names that `import chiplog` offers."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import Chiplog

import chiplog as package
from chiplog.commands import doctor
from gap_diagnosis.explanations import EXPLAINED
from gap_diagnosis.limits_elsewhere import limits_elsewhere
from gap_diagnosis.motion.noise import NOISES
from gap_diagnosis.priors import default_prior, stated
from hil_harness.effects import catalogue


def test_effects_lists_the_whole_catalogue(chiplog: Chiplog) -> None:
    listed = chiplog("effects").out
    for effect in catalogue().values():
        assert re.search(rf"(^|  ){effect.name}  ", listed, flags=re.M)


def test_effects_of_one_stage_are_those_alone(chiplog: Chiplog) -> None:
    effects = json.loads(chiplog("effects", "--stage", "gyro", "--json", "-").out)
    assert {effect["stage"] for effect in effects} == {"gyro"}
    assert "gyro_bias" in {effect["name"] for effect in effects}


def test_one_effect_is_shown_with_signature_twins_and_meanings(chiplog: Chiplog) -> None:
    shown = chiplog("effects", "radius_scale").out
    effect = catalogue()["radius_scale"]
    assert effect.signature in shown
    assert "Leaves the same data as ticks_per_rev." in shown
    assert effect.parameters[0].meaning in shown


@pytest.mark.parametrize(
    ("effect", "parameter", "tolerance", "prior"),
    [
        ("radius_scale", "scale", "0.002", "0.002 to 0.05"),
        ("wheelbase_scale", "scale", "0.003", "0.003 to 0.08, seldom to 4"),
        ("gyro_nonlinearity", "cubic", "0.0005", "0.0005 to 0.1"),
        ("wheel_eccentricity", "amplitude", "0.001", "0.001 to 0.04"),
        ("frame_loss", "probability", "0.0001", "0.0001 to 0.4"),
        ("frame_loss", "burst", "", "1 to 20"),
        ("drive_deadband", "rate", "0.1", "0.0002 to 0.3 of the largest"),
    ],
)
def test_effects_show_tolerance_and_prior(
    chiplog: Chiplog, effect: str, parameter: str, tolerance: str, prior: str
) -> None:
    believed = re.compile(rf"  {parameter}  .*  {tolerance}  +{prior}(  |$)", flags=re.M)
    one = chiplog("effects", effect).out
    assert believed.search(f"  {one}".replace("\n", "\n  "))
    assert believed.search(chiplog("effects").out)


def test_the_list_shows_the_beginning_of_each_law_in_one_row_of_its_effect(
    chiplog: Chiplog,
) -> None:
    lines = chiplog("effects").out.splitlines()
    column = lines[0].index("prior") + len("prior")
    stops = len("stage") + 7
    name, blocks = "", dict[str, list[str]]()
    for line in lines[1 : lines.index("")]:
        name = line[stops:].split("  ")[0].strip() or name
        blocks.setdefault(name, []).append(line)
    assert blocks.keys() == catalogue().keys()
    for name, law in default_prior().laws.items():
        cells = [re.split("  +", line[:column])[-1] for line in blocks[name]]
        (told,) = (cell for cell in cells if law.startswith(cell.removesuffix(" …")) and cell)
        assert len(told) > 10
        assert told.endswith(" …") == (told != law)
    assert "not named by a diagnosis" in lines[-3]


def test_an_angle_of_an_effect_has_no_size(chiplog: Chiplog) -> None:
    listed = json.loads(chiplog("effects", "wheel_eccentricity", "--json", "-").out)
    believed = {one["name"]: one["prior"] for one in listed[0]["parameters"]}
    assert believed == {
        "side": None,
        "amplitude": {"tolerance": 0.001, "span": [0.001, 0.04], "of": "", "most": None},
        "phase": None,
    }


def test_the_robot_schema_describes_every_table(chiplog: Chiplog) -> None:
    schema = json.loads(chiplog("schema", "robot").out)
    assert {"wheels", "encoder", "gyro", "firmware", "tolerance"} <= schema["properties"].keys()
    assert schema["$defs"]["Wheels"]["properties"]["radius_m"]["description"]


def test_doctor_says_ok_or_what_to_do(chiplog: Chiplog) -> None:
    said = chiplog("doctor")
    assert said.status == 0
    for line in said.out.splitlines():
        assert re.match(r"(ok|missing) +\S", line)
    assert re.search(r"^ok +virtual bus +a frame went round$", said.out, flags=re.M)


def test_doctor_answers_no_when_something_indispensable_is_missing(
    chiplog: Chiplog, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = doctor.Finding("virtual bus", False, "no frame came back", is_needed=True)
    monkeypatch.setattr(doctor, "examine", lambda: iter([broken]))
    said = chiplog("doctor")
    assert said.status == 1
    assert said.out == "missing   virtual bus   no frame came back\n"


def test_plant_and_firmware_meet_as_two_processes(chiplog: Chiplog, tmp_path: Path) -> None:
    group = ("--interface", "udp_multicast", "--channel", "239.74.163.77")
    ending = ("--duration-s", "0.5", "--log", str(tmp_path / "ecu.log"))
    with subprocess.Popen(
        [sys.executable, "-m", "chiplog", "node", "firmware", *group, *ending],
        stdout=subprocess.PIPE,
        text=True,
    ) as firmware:
        while firmware.poll() is None:  # the plant drives again until the firmware was listening
            plant = chiplog("node", "plant", *group, "--duration-s", "1")
            assert plant.status == 0
            assert plant.out.startswith("plant: 100 ticks, ")
        said, _ = firmware.communicate()
    assert firmware.returncode == 0
    waiting, done = said.splitlines()
    assert waiting.startswith("firmware: waiting for the first sensor frame")
    assert done.startswith("firmware: 50 ticks, ")
    assert chiplog("replay", str(tmp_path / "ecu.log")).status == 0


def test_a_plant_of_its_own_process_takes_effects_of_ones_own(
    chiplog: Chiplog, tmp_path: Path
) -> None:
    library = tmp_path / "my_effects.py"
    library.write_text(
        "from hil_harness.effects import Effect, EffectParameter\n"
        "much = EffectParameter('much', '1', 0.0, 'how much')\n"
        "EFFECTS = [Effect('worn_hub', 'wheel', (much,), 'It wobbles.', lambda s, values: s)]\n"
    )
    words = ("node", "plant", "--interface", "udp_multicast", "--channel", "239.74.163.78")
    mine = ("--effect", "worn_hub.much=0.1", "--duration-s", "0.05")
    said = chiplog(*words, *mine, "--effect-library", str(library))
    assert (said.status, said.err) == (0, "")
    refused = chiplog(*words, *mine)
    assert refused.status == 2
    assert "worn_hub" in refused.err


@pytest.mark.parametrize("name", package.__all__)
def test_every_public_name_is_there(name: str) -> None:
    assert getattr(package, name) is not None
    assert name in dir(package)


def test_importing_chiplog_loads_nothing_heavy() -> None:
    check = "import sys, chiplog; print([m for m in ('numpy', 'can', 'typer') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_a_name_that_is_not_public_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'simulate'"):
        _ = package.simulate


def test_effects_of_ones_own_are_listed_beside_chiplogs(chiplog: Chiplog, tmp_path: Path) -> None:
    library = tmp_path / "my_effects.py"
    library.write_text(
        "from hil_harness.effects import Effect\n"
        "EFFECTS = [Effect('worn_hub', 'wheel', (), 'It wobbles.', lambda s, values: s)]\n"
    )
    listed = chiplog("effects", "--effect-library", str(library)).out
    assert "worn_hub" in listed
    assert "radius_scale" in listed
    assert "It wobbles." in chiplog("effects", "worn_hub", "--effect-library", str(library)).out


def test_every_effect_that_a_diagnosis_names_says_its_prior_in_numbers_or_in_words(
    chiplog: Chiplog,
) -> None:
    """In one place, prior.toml; what is said of an effect is printed with it."""
    prior, known = default_prior(), catalogue()
    named = {
        "drive_gain",
        "drive_lag",
        "drive_delay",
        *limits_elsewhere([], ()),
        *EXPLAINED,
        *NOISES,
    }
    assert {name for name in named if not stated(prior, known[name])} <= set(prior.laws)
    assert set(prior.laws) <= set(known)
    spans = {
        name: {part for part, one in stated(prior, known[name]).items() if one.span is not None}
        for name in prior.laws
    }
    assert not [
        name
        for name, told in spans.items()
        if told and told >= {part.name for part in known[name].parameters if part.kind == "real"}
    ], "words beside a number for every size say a thing twice"
    for name, law in prior.laws.items():
        assert f"Prior for `chiplog diagnose`: {law}." in chiplog("effects", name).out
    (one,) = json.loads(chiplog("effects", "stale_heading", "--json", "-").out)
    assert one["law"] == "even over 1 to 4 cycles"
