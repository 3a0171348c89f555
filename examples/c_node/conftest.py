"""Build the node, and put it under test in every rig of this folder."""

from pathlib import Path
from typing import Any

import pytest
from build import build


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(tmp_path_factory.mktemp("c_node"))


@pytest.fixture
def chiplog_settings(library: Path) -> dict[str, Any]:
    return {"device": f"lib:{library}"}
