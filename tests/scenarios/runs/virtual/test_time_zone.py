import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.files import LOG_NAME, SUMMARY_NAME
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual


@pytest.fixture
def zones(monkeypatch: pytest.MonkeyPatch) -> Iterator[Iterator[str]]:
    """Names of time zones, each in effect once it is taken."""

    def in_effect() -> Iterator[str]:
        for zone in ("UTC", "America/St_Johns", "Pacific/Chatham"):
            monkeypatch.setenv("TZ", zone)
            time.tzset()
            yield zone

    yield in_effect()
    monkeypatch.undo()
    time.tzset()


def test_the_time_zone_changes_no_byte_of_a_virtual_run(
    zones: Iterator[str], tmp_path: Path
) -> None:
    scenario = load_scenario("lossy_lane_change", ["duration_s=0.5", "convoy.vehicles=2"])
    contents = set()
    for number, _ in enumerate(zones):
        folder = tmp_path / str(number)
        run_virtual(scenario, folder, Stop())
        contents.add(tuple((folder / name).read_bytes() for name in (LOG_NAME, SUMMARY_NAME)))
    assert len(contents) == 1
