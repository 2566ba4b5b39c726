"""How properties are tested: the same examples every time, however busy the machine.

`pytest --hypothesis-profile=explore` looks for new ones.

`pytest --campaign -m campaign` runs all random campaigns in full: kills, damaged logs, scenarios,
hostile messages.
"""

import gc
import os
import sys
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings

from tests.made.examples import CAMPAIGN

settings.register_profile("deterministic", derandomize=True, deadline=None, max_examples=20)
settings.register_profile(CAMPAIGN, derandomize=True, deadline=None, max_examples=100)
settings.register_profile("explore", derandomize=False, deadline=None, max_examples=1000)
settings.load_profile("deterministic")


SYSTEM = Path(__file__).parent / "system"

CAMPAIGN_S = 4 * 3600.0
"""Time limit of a test that runs in full; others have that of pyproject.toml."""

COLLECTED_EVERY = 10_000
"""So many objects more than before a test has when the garbage collector looks through them."""

# Where the environment forbids to keep compiled modules, each of several hundred processes that
# tests start would compile the project anew.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--campaign`: long random campaigns in full, instead of a few of each."""
    parser.addoption("--campaign", action="store_true", help="run random campaigns in full")


def pytest_configure(config: pytest.Config) -> None:
    """`@pytest.mark.campaign(few, all)`: as many random cases by default, and in a campaign.

    A test gets the number as `campaign`, or is run as often, each time with another `case`. Of a
    property under `examples(few, all)` as many examples are tried.
    """
    if config.getoption("--campaign"):
        settings.load_profile(CAMPAIGN)
    config.addinivalue_line("markers", "campaign(few, all): random cases, and with --campaign")
    config.addinivalue_line("markers", "spread(n): n of the cases, and all with --campaign")
    config.addinivalue_line("markers", "long: takes more than ten seconds and is begun early")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep all that is made here from the garbage collector: it stays for the whole session.

    Half a million objects, which would be looked at again and again, found to be in use, and
    copied in every process that is forked.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(COLLECTED_EVERY)
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Begin with long tests, then with the convoys of real processes.

    Of three workers of `-n` one gets the first third of the list: it spends most of its time
    waiting for convoys, and leaves two cores to the others, which calculate. Whoever is through
    first takes over from the end of another one's list (`--dist=worksteal`), so that what is left
    last must be short.
    """
    if config.getoption("--campaign"):
        for item in items:
            item.add_marker(pytest.mark.timeout(CAMPAIGN_S))
    else:
        _leave_out_cases(config, items)
    items.sort(
        key=lambda one: (
            one.get_closest_marker("long") is None,
            SYSTEM not in one.path.parents,
        )
    )


def _leave_out_cases(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep of each test marked `spread(n)` n cases, the first and the last among them."""
    families: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("spread") is not None:
            families.setdefault(item.nodeid.partition("[")[0], []).append(item)
    left_out: list[pytest.Item] = []
    for family in families.values():
        marker = family[0].get_closest_marker("spread")
        count = marker.args[0] if marker is not None else 0
        if len(family) > count:
            kept = {round(k * (len(family) - 1) / max(count - 1, 1)) for k in range(count)}
            left_out += [item for k, item in enumerate(family) if k not in kept]
    if left_out:
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in set(left_out)]


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
