"""How properties are tested: the same examples every time, however busy the machine.

`pytest --hypothesis-profile=explore` looks for new ones.

`pytest --campaign -m campaign` runs all random campaigns in full: kills, damaged logs, scenarios,
hostile messages.
"""

import pytest
from hypothesis import settings

settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None, max_examples=1000)
settings.load_profile("deterministic")


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--campaign`: long random campaigns in full, instead of a few of each."""
    parser.addoption("--campaign", action="store_true", help="run random campaigns in full")


def pytest_configure(config: pytest.Config) -> None:
    """`@pytest.mark.campaign(few, all)`: as many random cases by default, and in a campaign.

    A test gets the number as `campaign`, or is run as often, each time with another `case`.
    """
    config.addinivalue_line("markers", "campaign(few, all): random cases, and with --campaign")


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test for each `case` of its campaign."""
    marker = metafunc.definition.get_closest_marker("campaign")
    if marker is not None and "case" in metafunc.fixturenames:
        metafunc.parametrize("case", range(_size(marker, metafunc.config)))


@pytest.fixture
def campaign(request: pytest.FixtureRequest) -> int:
    """How many random cases a test has to try."""
    marker = request.node.get_closest_marker("campaign")
    assert marker is not None, "mark it with @pytest.mark.campaign(few, all)"
    return _size(marker, request.config)


def _size(marker: pytest.Mark, config: pytest.Config) -> int:
    few, everything = marker.args
    return int(everything if config.getoption("--campaign") else few)
