"""Five cars that use three vehicles ahead: one link is cut, and everything that shows sources."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from scenarios.cli.change_requests import VEHICLE_COLUMNS
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.summary import RunSummary
from scenarios.runs.live import LiveRun
from scenarios.runs.observer import Watcher
from scenarios.runs.run_drawing import open_drawing
from scenarios.runs.run_status import RunStatus, StatusBoard
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from scenarios.studies.explain import explain
from tests.made.transport.recording import Table, columns
from transport.log.reader import LogReader
from transport.picture.option import parse_rerun_option
from vehicles.messages import CompositeTrajectory, Tracking

CUT_AT, END = 1.0, 2.5
FLOW = (
    *("convoy.vehicles=5", f"duration_s={END}", "speed.set_mps=15.0", "links.loss_ratio=0.2"),
    "information_flow={lateral={ahead=3}, longitudinal={ahead=3, behind=1}}",
    f"change=[{{kind='cut', at_s={CUT_AT}, sender='v4', receiver='v5'}}]",
    f"limits.sources=[{{vehicle='v5', source='v4', status='lost', after_s={CUT_AT}, within_s=0.8}},"
    f"{{vehicle='v5', source='v3', status='lost', after_s={CUT_AT}, within_s=0.8}}]",
)


@dataclass(frozen=True)
class FlowRun:
    folder: Path
    scenario: Scenario
    summary: RunSummary
    status: RunStatus
    live: Table


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> FlowRun:
    folder = tmp_path_factory.mktemp("flow")
    scenario = load_scenario("lane_change", FLOW)
    board, statuses = StatusBoard(scenario, "run"), list[RunStatus]()
    option = parse_rerun_option(f"save={folder / 'live.rrd'}")

    class KeepsStatus:
        def update(self, live: LiveRun) -> None:
            statuses.append(board.status(live))

    with open_drawing(option, scenario, folder / "run.mcap") as drawing:
        watchers: list[Watcher] = [KeepsStatus(), drawing]
        summary = run_virtual(scenario, folder, Stop(), watchers=watchers, observers=[drawing])
    status = RunStatus.of(statuses[-1].text.encode())
    return FlowRun(folder, scenario, summary, status, columns(folder / "live.rrd"))


def decisions(run: FlowRun, vehicle: str) -> list[Tracking]:
    messages = LogReader(run.folder / "run.mcap").messages(("tracking",))
    return [one for _, _, one in messages if isinstance(one, Tracking) and one.vehicle == vehicle]


def test_the_others_carry_on_after_the_loss_of_the_predecessor(run: FlowRun) -> None:
    last = decisions(run, "v5")[-1]
    assert (last.mode, last.lead_status, last.predecessor_status) == (
        "composite",
        "unused",
        "lost",
    )
    assert last.statuses() == {"v2": "fresh", "v3": "fresh"}
    assert "v4 silent" in last.reason
    assert sum(last.other_weight_ratio) + last.predecessor_weight_ratio == pytest.approx(1.0)
    assert {one.mode for one in decisions(run, "v4")} == {"straight", "composite"}
    # v4 has four sources: the lead, two vehicles between, and one behind, which gives no path.
    assert list(decisions(run, "v4")[-1].statuses()) == ["v2", "v5"]
    assert decisions(run, "v4")[-1].other_weight_ratio[1] == 0.0
    # v5 brakes as if v4 stopped: it does not receive the lead, which repeats what v4 announces.
    kinds = {event.kind for event in run.summary.events}
    assert kinds == {"hard_braking", "overridden"}


def test_links_and_limits_count_every_source(run: FlowRun) -> None:
    rows = {(row.sender, row.receiver): row for row in run.summary.links}
    assert set(rows) == set(run.scenario.links)
    assert ("v2", "v5") in rows
    assert ("v5", "v4") in rows
    for row in [row for row in rows.values() if row.receiver != "v1"]:
        assert row.age_ms_mean is not None
        assert row.age_ms_mean > 20.0
        assert row.false_alarms.counted is not None
    by_source = {figure.limit: figure for figure in run.summary.limits}
    lost, fresh = (
        next(one for name, one in by_source.items() if name.startswith(f"sources[{place}]"))
        for place in (0, 1)
    )
    assert not lost.broken
    assert fresh.broken


def test_the_explanation_and_the_status_name_every_source(run: FlowRun) -> None:
    knowledge = explain(run.folder / "run.mcap", "v5", END - 0.1)
    assert knowledge.steered_along == ("v2", "v3")
    assert {one.sender: one.use for one in knowledge.sources} == dict.fromkeys(
        ("v2", "v3", "v4"), "lateral and longitudinal"
    )
    behind = explain(run.folder / "run.mcap", "v4", END - 0.1)
    assert behind.sources[-1].sender == "v5"
    assert behind.sources[-1].use == "longitudinal"
    vehicle = next(one for one in run.status.vehicles if one.name == "v5")
    assert vehicle.others.keys() == {"v2", "v3"}
    assert vehicle.predecessor is not None
    (sources,) = (column for column in VEHICLE_COLUMNS if column.heading == "sources")
    assert sources.value(vehicle) == "ahead lost"


def test_samples_have_the_places_of_their_sources(run: FlowRun) -> None:
    used: dict[str, set[int]] = {}
    for _, _, one in LogReader(run.folder / "run.mcap").messages(("trajectory",)):
        assert isinstance(one, CompositeTrajectory)
        used.setdefault(one.vehicle, set()).update(one.sample_source)
    assert used == {"v2": {0}, "v3": {0, 1}, "v4": {0, 1, 2}, "v5": {1, 2, 3}}
