"""Profiles of hypothesis, random campaigns, and the order of tests.

By default examples are the same in each session; `--hypothesis-profile=explore` draws new ones.
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

settings.register_profile("deterministic", derandomize=True, deadline=None, max_examples=10)
settings.register_profile(CAMPAIGN, derandomize=True, deadline=None, max_examples=100)
settings.register_profile("explore", derandomize=False, deadline=None, max_examples=1000)
settings.load_profile("deterministic")


SYSTEM = Path(__file__).parent / "system"

CAMPAIGN_S = 4 * 3600.0
"""Time limit of a test with `--campaign`; the default is in pyproject.toml."""

GC_THRESHOLD = 10_000
"""New objects after which the garbage collector runs."""

# Without bytecode files, each of several hundred started processes would compile the project.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--campaign", action="store_true", help="run random campaigns in full")


def pytest_configure(config: pytest.Config) -> None:
    """Register markers, and load the profile of `--campaign`.

    `@pytest.mark.campaign(few, all)` sets the number of random cases. A test takes the number as
    fixture `campaign`, or runs once for each `case`.
    """
    if config.getoption("--campaign"):
        settings.load_profile(CAMPAIGN)
    config.addinivalue_line("markers", "campaign(few, all): random cases, and with --campaign")
    config.addinivalue_line("markers", "spread(n): n of the cases, and all with --campaign")
    config.addinivalue_line("markers", "long: takes more than ten seconds and starts early")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Exclude collected tests and modules from garbage collection.

    Half a million objects stay for the session. Scanning them costs time, and copies their pages in
    each forked process.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(GC_THRESHOLD)
        gc.enable()


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Order tests: long ones first, then those with real processes.

    The first of three workers gets the first third of the list. It mostly waits for convoys, and
    leaves the cores to the others. Idle workers take tests from the end of another list
    (`--dist=worksteal`), so the last tests must be short.
    """
    if config.getoption("--campaign"):
        for item in items:
            item.add_marker(pytest.mark.timeout(CAMPAIGN_S))
    else:
        _deselect_cases(config, items)
    items.sort(
        key=lambda item: (
            item.get_closest_marker("long") is None,
            SYSTEM not in item.path.parents,
        )
    )


def _deselect_cases(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Keep n cases of each test marked `spread(n)`, including the first and the last."""
    families: dict[str, list[pytest.Item]] = {}
    for item in items:
        if item.get_closest_marker("spread") is not None:
            families.setdefault(item.nodeid.partition("[")[0], []).append(item)
    deselected: list[pytest.Item] = []
    for family in families.values():
        marker = family[0].get_closest_marker("spread")
        count = marker.args[0] if marker is not None else 0
        if len(family) > count:
            kept = {round(k * (len(family) - 1) / max(count - 1, 1)) for k in range(count)}
            deselected += [item for k, item in enumerate(family) if k not in kept]
    if deselected:
        config.hook.pytest_deselected(items=deselected)
        items[:] = [item for item in items if item not in set(deselected)]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run a test for each `case` of its campaign."""
    marker = metafunc.definition.get_closest_marker("campaign")
    if marker is not None and "case" in metafunc.fixturenames:
        metafunc.parametrize("case", range(_size(marker, metafunc.config)))


@pytest.fixture
def campaign(request: pytest.FixtureRequest) -> int:
    """Number of random cases of a test."""
    marker = request.node.get_closest_marker("campaign")
    assert marker is not None, "the test lacks @pytest.mark.campaign(few, all)"
    return _size(marker, request.config)


def _size(marker: pytest.Mark, config: pytest.Config) -> int:
    few, everything = marker.args
    return int(everything if config.getoption("--campaign") else few)
