"""A user's effects stand beside Chiplog's; what is wrong with them is said in one line."""

import re
from pathlib import Path
from typing import get_args

import pytest

from hil_harness.assembly import RunConfig
from hil_harness.effects import (
    Stage,
    catalogue,
    combine_effects,
    load_effect_library,
    parse_effect,
)
from hil_harness.effects.user_effects import EXPLAINABLE
from hil_harness.errors import HarnessError
from hil_harness.robot import load_robot
from hil_harness.scenarios import scenario

GUIDE = Path(__file__).parents[2] / "docs" / "how-to" / "my-effect.md"
HEAD = "from hil_harness.effects import Effect, EffectParameter\n"
KEEP = "lambda settings, values: settings"


def library(folder: Path, text: str) -> Path:
    file = folder / "my_effects.py"
    file.write_text(text, encoding="utf-8")
    return file


def example(folder: Path) -> Path:
    found = re.search(r"```python\n(.*?)```", GUIDE.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    return library(folder, found[1])


def test_the_guides_example_acts(tmp_path: Path) -> None:
    known = load_effect_library(example(tmp_path))
    assert set(known) == {*catalogue(), "deep_carpet"}
    config = RunConfig(
        scenario=scenario("straight"),
        robot=load_robot(),
        effects=combine_effects([parse_effect("deep_carpet.pile=0.01", known)], known=known),
        known=known,
    )
    assert config.settings().plant.payload_left == 0.02
    assert config.settings().plant.turn_scrub == 0.05
    assert known["deep_carpet"].explain is not None
    assert known["deep_carpet"].tolerance == {"pile": 0.0005}


def test_an_effect_stands_at_the_end_of_its_stage(tmp_path: Path) -> None:
    known = load_effect_library(example(tmp_path))
    wheel = [effect.name for effect in known.values() if effect.stage == "wheel"]
    assert wheel[-1] == "deep_carpet"
    assert [name for name in known if name != "deep_carpet"] == list(catalogue())


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "my_effects.py: no list EFFECTS: expected EFFECTS = [Effect(...)]"),
        ("EFFECTS = [", "my_effects.py:1: '[' was never closed: expected a Python file"),
        ("x = 1\ny = x / 0", "my_effects.py:2: ZeroDivisionError: division by zero: expected a"),
        ("EFFECTS = [1]", "my_effects.py: EFFECTS[0] is of type int: expected EFFECTS = [Effect"),
        (
            HEAD + f"EFFECTS = [Effect('gyro_bias', 'gyro', (), 'x.', {KEEP})]",
            "my_effects.py: effect 'gyro_bias': there is an effect of that name: expected another",
        ),
        (
            HEAD + f"EFFECTS = [Effect('Sag', 'gyro', (), 'x.', {KEEP})]",
            "my_effects.py: effect 'Sag': expected a name of small letters, digits and _",
        ),
        (
            HEAD + f"EFFECTS = [Effect('sag', 'motor', (), 'x.', {KEEP})]",
            "my_effects.py: effect 'sag': stage = 'motor': expected one of actuation, wheel, ",
        ),
        (
            HEAD + f"EFFECTS = [Effect('sag', 'gyro', (), ' ', {KEEP})]",
            "my_effects.py: effect 'sag': signature is empty: expected one sentence",
        ),
        (
            HEAD + f"EFFECTS = [Effect('sag', 'gyro', (1,), 'x.', {KEEP})]",
            "my_effects.py: effect 'sag': parameters: expected a tuple of EffectParameter",
        ),
        (
            HEAD + "P = EffectParameter('a', '1', 0.0, 'm')\n"
            "EFFECTS = [Effect('sag', 'gyro', (P,), 'x.', "
            "lambda settings, values: settings.with_plant(gyro_scale=0.1))]",
            "my_effects.py: effect 'sag': apply changes something at neutral values: expected",
        ),
        (
            HEAD + "EFFECTS = [Effect('sag', 'gyro', (), 'x.', lambda settings, values: 1)]",
            "my_effects.py: effect 'sag': apply returns int: expected Settings",
        ),
        (
            HEAD + "EFFECTS = [Effect('sag', 'gyro', (), 'x.', lambda settings: settings)]",
            "my_effects.py: effect 'sag': apply raises TypeError at neutral values: ",
        ),
        (
            HEAD + f"EFFECTS = [Effect('sag', 'gyro', (), 'x.', {KEEP}, explain=3)]",
            "my_effects.py: effect 'sag': explain: expected a function explain(prediction, ",
        ),
        (
            HEAD + f"EFFECTS = [Effect('sag', 'gyro', (), 'x.', {KEEP}, tolerance={{'a': 1}})]",
            "my_effects.py: effect 'sag': tolerance of 'a': expected one of its parameters, ",
        ),
    ],
)
def test_a_mistake_is_said_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(HarnessError) as caught:
        load_effect_library(library(tmp_path, text))
    assert str(caught.value).startswith(f"{tmp_path}/{message}")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("stage", get_args(Stage))
def test_a_stage_whose_data_no_prediction_holds_takes_no_explanation(
    tmp_path: Path, stage: Stage
) -> None:
    """An `explain` there was never asked, or moved what the effect does not touch."""
    written = f"Effect('sag', '{stage}', (), 'x.', {KEEP}"
    simulated = library(tmp_path, HEAD + f"EFFECTS = [{written})]")
    assert load_effect_library(simulated)["sag"].stage == stage
    explained = library(tmp_path, HEAD + f"EFFECTS = [{written}, explain=lambda prediction: None)]")
    if stage in EXPLAINABLE:
        assert load_effect_library(explained)["sag"].explain is not None
        return
    with pytest.raises(HarnessError) as caught:
        load_effect_library(explained)
    assert str(caught.value).endswith(
        f"effect 'sag': explain in stage {stage}: expected one of stage wheel, encoder, gyro, "
        "reference, whose data a prediction holds, or no explain: the effect is then simulated and "
        "not diagnosed"
    )


def test_a_file_that_is_not_there_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(HarnessError, match=r"none\.py: cannot read this effect library: No such"):
        load_effect_library(tmp_path / "none.py")
