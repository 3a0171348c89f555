"""Scenarios: what the robot is told to do, named ones and files."""

from dataclasses import replace
from pathlib import Path

from hil_harness.errors import HarnessError
from hil_harness.nearest import did_you_mean
from hil_harness.scenarios.model import Drive, EncoderModel, Noise, Scenario
from hil_harness.scenarios.named import NAMED, random
from hil_harness.scenarios.profile import Profile, Segment, SegmentProfile
from hil_harness.scenarios.scenario_file import ScenarioTable, load_scenario

__all__ = [
    "Drive",
    "EncoderModel",
    "Noise",
    "Profile",
    "Scenario",
    "ScenarioTable",
    "Segment",
    "SegmentProfile",
    "load_scenario",
    "scenario",
    "scenario_names",
]


def scenario_names() -> tuple[str, ...]:
    """Return the names of the shipped scenarios."""
    return tuple(NAMED)


def scenario(name_or_path: str | Path, *, seed: int | None = None) -> Scenario:
    """Return the shipped scenario of that name, or the one in that file.

    What ends in ``.toml`` or has a folder in it is a file. *seed* replaces the scenario's own;
    ``random`` draws its drive from it too. Raises HarnessError for an unknown name, naming the
    nearest, and for whatever is wrong with a file.
    """
    text = str(name_or_path)
    if text.endswith(".toml") or Path(text).name != text:
        found = load_scenario(name_or_path)
    elif text == "random" and seed is not None:
        found = random(seed)
    elif text in NAMED:
        found = NAMED[text]()
    else:
        raise HarnessError(
            f"no such scenario: {text}: {did_you_mean(text, NAMED)}; a file ends in .toml"
        )
    return found if seed is None else replace(found, seed=seed)
