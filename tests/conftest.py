"""How properties are tested: the same examples every time, however busy the machine.

`pytest --hypothesis-profile=explore` looks for new ones.

`pytest --campaign` damages logs in many more places.
"""

import pytest
from hypothesis import settings

settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None, max_examples=1000)
settings.load_profile("deterministic")

SOME, MANY = 60, 5000
"""Logs that are damaged at random places, by default and in a campaign."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--campaign`: long random campaigns in full, instead of a few of each."""
    parser.addoption("--campaign", action="store_true", help="run random campaigns in full")


@pytest.fixture
def campaign(request: pytest.FixtureRequest) -> int:
    """How many logs to damage."""
    return MANY if request.config.getoption("--campaign") else SOME
