"""Put every rig of this folder on our vehicle's bus."""

from pathlib import Path
from typing import Any

import pytest

HERE = Path(__file__).parent


@pytest.fixture
def chiplog_settings() -> dict[str, Any]:
    return {"dbc": HERE / "vehicle.dbc", "signals": HERE / "map.toml"}
