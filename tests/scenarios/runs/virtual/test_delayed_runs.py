"""Runs in virtual time over links with laws of delay, a queue and outages."""

from collections import Counter
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.results.summary import RunSummary
from scenarios.runs.stop import Stop
from scenarios.runs.virtual import run_virtual
from tests.made.transport.links import link as link_of
from transport.codec import encode
from transport.links.inbox import judge_stream
from transport.links.laws.link_law import Position, TransmissionContext
from transport.log.reader import LogReader
from vehicles.messages import GpsPose, LinkVerdict
from vehicles.schedule import SECOND

ALL = (
    "duration_s=5",
    "links.delay={kind='gamma', mean_ms=30, deviation_ms=25, correlation_ratio=0.8,"
    " order='in_order'}",
    "links.queue={bytes_per_s=1800, depth_messages=3, drop='oldest'}",
    "links.outages=[{kind='window', from_s=1, to_s=1.4},"
    " {kind='stretch', from_m=60, to_m=75, vehicle='both'},"
    " {kind='random', mean_on_s=2, mean_off_s=0.2}]",
    "vehicle.v2.transmitter_off=[{from_s=2, to_s=2.3}]",
    "vehicle.v3.receiver_off=[{from_s=3, to_s=3.25}]",
)


@dataclass(frozen=True)
class Ran:
    scenario: Scenario
    log: bytes
    text: str
    verdicts: tuple[LinkVerdict, ...]
    poses: dict[tuple[str, int], GpsPose]
    summary: RunSummary

    def over(self, sender: str, receiver: str) -> list[LinkVerdict]:
        return [v for v in self.verdicts if (v.sender, v.vehicle) == (sender, receiver)]


def run(scenario: Scenario) -> Ran:
    with TemporaryDirectory() as folder:
        summary = run_virtual(scenario, Path(folder), Stop())
        reader = LogReader(Path(folder) / "run.mcap")
        messages = [message for _, _, message in reader.messages()]
        log, text = reader.path.read_bytes(), reader.attachments()["scenario.toml"].decode()
    verdicts = tuple(one for one in messages if isinstance(one, LinkVerdict))
    poses = {(one.vehicle, one.seq): one for one in messages if isinstance(one, GpsPose)}
    return Ran(scenario, log, text, verdicts, poses, summary)


@cache
def ran(*more: str) -> Ran:
    return run(load_scenario("lane_change", [*ALL, *more]))


def test_every_cause_occurs_and_nothing_is_late() -> None:
    causes = Counter(v.reason for v in ran().verdicts)
    assert set(causes) == {"", "outage", "queue", "transmitter_off", "receiver_off"}
    assert not any(v.late for v in ran().verdicts)
    assert ran().summary.links[0].dropped


def test_the_log_s_own_scenario_gives_the_same_bytes_again() -> None:
    assert run(scenario_from_text(ran().text)).log == ran().log


def test_times_and_places_are_those_of_the_run() -> None:
    start = ran().scenario.start_at_ns
    for v in ran().verdicts:
        since = (v.sent_at_ns - start) / SECOND
        if v.sender == "v2" and 2.0 <= since < 2.3:
            assert v.reason == "transmitter_off"
        elif v.vehicle == "v3" and 3.0 <= since < 3.25:
            assert v.reason == "receiver_off"
        elif 1.0 <= since < 1.4:
            assert v.reason == "outage"
        else:
            assert v.reason in {"", "queue", "outage"}
    # The lead at 30 m/s is on the stretch from 2 to 2.5 s; who is 15 m behind leaves it as the
    # lead has left it, so that both are there only for a moment.
    both = "{kind='stretch', from_m=60, to_m=90, vehicle='both'}"
    plain = run(load_scenario("lane_change", ["duration_s=5", f"links.outages=[{both}]"]))
    hit = [(v.sent_at_ns - start) / SECOND for v in plain.over("v1", "v2") if v.reason]
    assert 2.45 <= min(hit) <= 2.55
    assert 2.9 <= max(hit) <= 3.0
    driven = [plain.poses["v1", v.pose_seq].true_distance_m for v in plain.over("v1", "v2")]
    there = [60.0 <= metres < 90.0 and 60.0 <= metres - 15.0 < 90.0 for metres in driven]
    found = [v.reason == "outage" for v in plain.over("v1", "v2")]
    differ = [k for k in range(len(found)) if found[k] != there[k]]
    assert len(differ) <= 2  # at the bounds: the receiver knows itself at its last tick


def test_verdicts_follow_from_the_stream_alone() -> None:
    """Without outages by place: judged again from the logged poses."""
    only = ran("links.outages=[]")
    for sender, receiver in only.scenario.links:
        setting = only.scenario.link_setting(sender, receiver, only.scenario.start_at_ns)
        table = only.scenario.links[sender, receiver]
        link = link_of(table, sender, receiver, seed=only.scenario.seed, setting=setting)
        stream = [
            TransmissionContext(one.seq, one.sent_at_ns, len(encode(one)), Position())
            for (vehicle, _), one in only.poses.items()
            if vehicle == sender
        ]
        judged = judge_stream(link, stream)
        for v in only.over(sender, receiver):
            wanted = judged[v.pose_seq]
            assert (v.reason, v.visible_at_ns) == (wanted.reason, wanted.visible_at)


def test_deliveries_come_in_order() -> None:
    for sender, receiver in ran().scenario.links:
        received = [v for v in ran().over(sender, receiver) if v.outcome == "delivered"]
        assert len(received) > 20
        assert [v.pose_seq for v in received] == sorted(v.pose_seq for v in received)


def test_another_vehicle_or_another_link_s_rule_changes_no_verdict() -> None:
    def fates(one: Ran) -> list[tuple[int, str, int]]:
        return [(v.pose_seq, v.reason, v.visible_at_ns) for v in one.over("v1", "v2")]

    own = "control.degradation.reaction='extrapolate'"  # else the lead's message is longer
    longer = ran(own, "convoy.vehicles=5")
    rule = "link=[{sender='v1', receiver='v3', queue={bytes_per_s=9999}, loss_ratio=0.5}]"
    assert fates(longer) == fates(ran(own)) == fates(ran(own, rule))
    assert longer.over("v4", "v5")
