"""How properties are tested: the same examples every time, however busy the machine.

`pytest --hypothesis-profile=explore` looks for new ones.
"""

import pytest
from hypothesis import settings

settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None, max_examples=1000)
settings.load_profile("deterministic")


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--campaign`: long random campaigns in full, instead of a few of each."""
    parser.addoption("--campaign", action="store_true", help="run random campaigns in full")


@pytest.fixture
def campaign(request: pytest.FixtureRequest) -> bool:
    """Whether random campaigns are to run in full."""
    return bool(request.config.getoption("--campaign"))
