"""Options and settings shared by all tests."""

import pytest
from hypothesis import settings

# The machines that run these tests are shared: no property may depend on the wall clock.
settings.register_profile("chiplog", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("chiplog")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--chiplog-size",
        choices=["small", "full"],
        default="small",
        help="small: what every change runs; full: 10^7 steps, thousands of trials",
    )


@pytest.fixture(scope="session")
def size(request: pytest.FixtureRequest) -> str:
    """Return "small" or "full": how much work a statistical or soak test does."""
    value: str = request.config.getoption("--chiplog-size")
    return value
