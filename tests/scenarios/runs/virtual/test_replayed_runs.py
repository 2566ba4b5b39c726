"""Live vehicles behind recorded ones: the same followers, and an account that balances."""

from collections.abc import Sequence
from pathlib import Path

import pytest

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.files import LOG_NAME
from scenarios.results.log_summary import summary_of
from scenarios.runs.replayed import replayed_session
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.transport.changed_logs import changed_log
from transport.codec import encode
from transport.log.reader import LogReader
from transport.topics import TOPIC_OF
from vehicles.messages import GpsPose, Message, TruePose

OVERRIDES = (
    "duration_s=1.5",
    "convoy.vehicles=3",
    "links.loss={kind='gilbert_elliott',loss_ratio=0.3,burst_messages_mean=3}",
    "links.latency_ms=60",
    "vehicle.v1.clock.offset_ms=-3",
    'change=[{kind="stall",vehicle="v2",at_s=0.4,for_s=0.3}]',
    'limits.modes=[{vehicle="v2",mode="lead",within_s=1.4}]',
)


def run(scenario: Scenario, folder: Path) -> Path:
    run_virtual(scenario, folder, Stop())
    return folder / LOG_NAME


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(load_scenario("lane_change", OVERRIDES, seed=4), tmp_path_factory.mktemp("recorded"))


def sent(
    log: Path, vehicle: str, topics: Sequence[str] | None = None
) -> list[tuple[int, str, bytes]]:
    """Instants, topics and bytes of the messages of a vehicle, in order."""
    rows = LogReader(log).messages(topics, (vehicle,))
    return [(at, TOPIC_OF[type(message)].name, encode(message)) for at, _, message in rows]


@pytest.mark.parametrize("replayed", [("v1",), ("v1", "v2"), ("v3",)])
def test_all_vehicles_repeat_their_run_bit_for_bit(
    log: Path, tmp_path: Path, replayed: tuple[str, ...]
) -> None:
    again = run(replayed_session(log, replayed), tmp_path)
    for name in ("v1", "v2", "v3"):
        if name in replayed:
            assert sent(again, name, ("gps", "truth")) == sent(log, name, ("gps", "truth"))
            assert (name, "command") not in LogReader(again).counts
        else:
            assert sent(again, name) == sent(log, name)
            assert (name, "command") in LogReader(again).counts


def test_the_account_balances_and_lists_no_link_to_a_replayed_vehicle(
    log: Path, tmp_path: Path
) -> None:
    before = {(link.sender, link.receiver): link for link in summary_of(log).links}
    summary = summary_of(run(replayed_session(log, ("v1", "v2")), tmp_path))
    assert summary.outcome == "completed"
    assert [(link.sender, link.receiver) for link in summary.links] == [("v1", "v3"), ("v2", "v3")]
    for link in summary.links:
        assert link == before[link.sender, link.receiver]
        dropped = sum(link.dropped.values())
        assert link.sent == link.delivered + dropped + link.in_flight
    assert [link.sent for link in summary.links] == [30, 24]  # v2 stalled for 0.3 s
    assert [one.cross_track_error_m_max for one in summary.vehicles] == [
        one.cross_track_error_m_max for one in summary_of(log).vehicles
    ]


def test_followers_may_have_other_settings(log: Path, tmp_path: Path) -> None:
    scenario = replayed_session(log, ("v1",), ("convoy.vehicles=4", "links.latency_ms=90"), 8)
    again = run(scenario, tmp_path)
    assert sent(again, "v1", ("gps",)) == sent(log, "v1", ("gps",))
    assert ("v4", "command") in LogReader(again).counts
    assert sent(again, "v3", ("truth",)) != sent(log, "v3", ("truth",))


def test_a_record_longer_than_the_run_counts_up_to_its_end(log: Path, tmp_path: Path) -> None:
    short = run(replayed_session(log, ("v1",), ("duration_s=1.4",)), tmp_path)
    assert len(sent(short, "v1", ("truth",))) == 70
    assert sent(short, "v1", ("gps",)) == sent(log, "v1", ("gps",))[:28]


def test_processes_with_the_log_elsewhere_take_part_in_one_run(log: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(log.read_bytes())
    digests = {replayed_session(one, ("v1",)).digest for one in (log, copy)}
    assert len(digests) == 1
    assert replayed_session(log, ("v1", "v2")).digest not in digests


def test_a_live_change_of_a_replayed_vehicle_is_refused(log: Path) -> None:
    change = 'change=[{kind="stall",vehicle="v1",at_s=0.4,for_s=0.3}]'
    with pytest.raises(ScenarioError, match='given "v1", which sends recorded messages'):
        replayed_session(log, ("v1",), (change,))


def without(log: Path, target: Path, topic: type[Message], numbers: range) -> Path:
    def keep(message: Message) -> Message | None:
        is_lost = isinstance(message, topic) and message.vehicle == "v1" and message.seq in numbers
        return None if is_lost else message

    return changed_log(log, target, keep)


@pytest.mark.parametrize(
    ("topic", "why"),
    [(GpsPose, "3 of 30 gps messages are missing"), (TruePose, "3 of 75 truth messages")],
)
def test_a_log_with_holes_is_refused(
    log: Path, tmp_path: Path, topic: type[Message], why: str
) -> None:
    holed = without(log, tmp_path / "holed.mcap", topic, range(8, 11))
    with pytest.raises(ScenarioError, match=f"{why}.*; set replay.partial = true"):
        replayed_session(holed, ("v1",))


def test_a_partial_log_is_numbered_again_and_its_account_balances(
    log: Path, tmp_path: Path
) -> None:
    holed = without(log, tmp_path / "holed.mcap", GpsPose, range(8, 11))
    summary = summary_of(run(replayed_session(holed, ("v1",), partial=True), tmp_path / "run"))
    first = summary.links[0]
    assert (first.sender, first.sent, first.not_arrived) == ("v1", 27, {})
    assert summary.holes == ()


def test_a_log_that_is_not_the_one_of_the_scenario_is_not_sent(log: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(log.read_bytes())
    scenario = replayed_session(copy, ("v1",))
    copy.write_bytes(log.read_bytes() + b"more")
    summary = run_virtual(scenario, tmp_path / "run", Stop())
    assert "is another log than when the scenario was read" in summary.reason
