"""Every message that was sent over a link is accounted for, by what the log holds."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

import pytest
from scenarios.results.link_summary import LinkSummary, request_deviations
from scenarios.results.link_tally import LinkTally
from scenarios.results.metrics import Metrics

from scenarios.definition.channel.presets import presets
from scenarios.definition.errors import ScenarioError
from scenarios.definition.library import drills, library
from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.definition.schema.link_tables import LinkTable
from scenarios.results.log_summary import late_lines, transport_lines
from scenarios.runs.observer import listeners_by_kind
from scenarios.runs.virtual import ObservedSink, VirtualConvoy
from tests.made.scenarios.messages import MS, STRAIGHT, at, gps, health, start, tracking, verdict
from transport.links.content_stage import Transmission
from transport.links.inbox import Inbox
from transport.links.link import GPS
from transport.topics import key
from vehicles.messages import Health, LinkVerdict, Message, RunStart
from vehicles.schedule import SECOND

NAMES = ("v1", "v2", "v3")
LINKS = [("v1", "v2"), ("v1", "v3"), ("v2", "v3")]
SECONDS = 10
POSES = 20 * SECONDS
TRANSIT = 3 * MS
Recorded = tuple[int, Message]


class MadeRun:
    """The messages of a run on the wall clock as the recorder receives them.

    `lost` messages reached no receiver, `unrecorded` poses and verdicts not the recorder. `transit`
    are the times (ns) that poses took to the recorder.
    """

    def __init__(self) -> None:
        self.lost: set[tuple[str, str, int]] = set()
        self.unrecorded: set[tuple[str, int]] = set()
        self.unrecorded_verdicts: set[tuple[str, str, int]] = set()
        self.decided: dict[str, Sequence[int]] = dict.fromkeys(NAMES, range(50 * SECONDS))
        self.transit: dict[tuple[str, int], int] = {}

    def cut_off(self, name: str, begin: int, end: int) -> None:
        """Cut a vehicle off from all others and the recorder, between two numbers of poses."""
        self.lost |= {(a, b, k) for a, b in LINKS if name in {a, b} for k in range(begin, end)}
        self.unrecorded |= {(name, k) for k in range(begin, end)}

    def recorded(self) -> Iterator[Recorded]:
        yield at(0.0), start()
        for name in NAMES:
            for k in range(POSES):
                if (name, k) not in self.unrecorded:
                    pose = gps(name, k)
                    yield pose.sent_at_ns + self.transit.get((name, k), TRANSIT), pose
            for seq, k in enumerate(self.decided[name]):
                yield at(k / 50), replace(tracking(name, seq), decided_at_ns=at(k / 50))
            verdicts = self._verdicts(name)
            for one in verdicts:
                if (one.sender, name, one.pose_seq) not in self.unrecorded_verdicts:
                    yield one.received_at_ns, one
            yield (
                at(SECONDS),
                health(name, seconds=SECONDS, final=True, received=len(verdicts)),
            )

    def _verdicts(self, receiver: str) -> list[LinkVerdict]:
        """Verdicts of a receiver on the messages that reached it and were due before the end."""
        arrived = [
            verdict(sender, receiver, k)
            for k in range(POSES)
            for sender, to in LINKS
            if to == receiver and (sender, receiver, k) not in self.lost
        ]
        due = [one for one in arrived if one.visible_at_ns < at(SECONDS)]
        return [replace(one, seq=number) for number, one in enumerate(due)]


def metrics_of(messages: Iterable[Recorded]) -> Metrics:
    metrics = Metrics(NAMES, dict.fromkeys(LINKS, LinkTable()), duration_ns=SECONDS * SECOND)
    for recorded_at, message in messages:
        metrics.listen(recorded_at, message)
    return metrics


def accounts_of(made: MadeRun) -> dict[tuple[str, str], LinkSummary]:
    metrics = metrics_of(made.recorded())
    rows = metrics.link_summaries(SECONDS * SECOND)
    assert metrics.contradictions(SECONDS * SECOND) == []
    for row in rows:
        assert_balanced(row)
    return {(row.sender, row.receiver): row for row in rows}


def assert_balanced(row: LinkSummary) -> None:
    parts = row.delivered, *row.dropped.values(), *row.not_arrived.values()
    assert row.sent == sum(parts) + row.in_flight + row.unrecorded


def test_loss_is_the_share_of_sent_messages() -> None:
    """57 of 200 messages never arrive: a loss of 28.5 %, not of 0."""
    made = MadeRun()
    made.lost = {("v1", "v2", k) for k in range(40, 97)}
    row = accounts_of(made)["v1", "v2"]
    assert (row.sent, row.delivered, row.not_arrived) == (POSES, POSES - 57, {"unknown": 57})
    assert row.loss_ratio == pytest.approx(57 / POSES)
    assert row.burst_messages_max == 57


def test_the_vehicle_that_was_cut_off_is_named() -> None:
    made = MadeRun()
    made.cut_off("v2", 60, 120)
    rows = accounts_of(made)
    assert rows["v1", "v2"].not_arrived == {"cut_off": 60} == rows["v2", "v3"].not_arrived
    assert rows["v1", "v3"].not_arrived == {}
    lines = list(metrics_of(made.recorded()).channel_warnings(SECONDS * SECOND))
    assert any("v2 cut off" in line and "3.00 to 5.95 s" in line for line in lines)


def test_a_router_that_was_away_cut_everybody_off() -> None:
    made = MadeRun()
    for name in NAMES:
        made.cut_off(name, 60, 120)
    for row in accounts_of(made).values():
        assert row.not_arrived == {"router_away": 60}


def test_messages_before_the_first_received_one_are_due_to_a_late_start() -> None:
    made = MadeRun()
    made.lost = {("v1", "v2", k) for k in range(7)}
    assert accounts_of(made)["v1", "v2"].not_arrived == {"late_start": 7}


def test_messages_to_software_that_does_not_run_are_no_loss_of_the_link() -> None:
    made = MadeRun()
    made.lost = {(a, "v3", k) for a in ("v1", "v2") for k in range(40, 80)}
    made.decided["v3"] = [k for k in range(50 * SECONDS) if not 100 <= k < 200]
    row = accounts_of(made)["v1", "v3"]
    assert (row.not_arrived, row.loss_ratio) == ({"receiver_down": 40}, 0.0)


def test_missing_verdicts_are_no_losses() -> None:
    """Verdicts that the receiver numbered and the log lacks: nothing is known of these messages."""
    made = MadeRun()
    made.unrecorded_verdicts = {(a, "v3", k) for a in ("v1", "v2") for k in range(40, 60)}
    rows = accounts_of(made)
    for sender in ("v1", "v2"):
        row = rows[sender, "v3"]
        assert (row.unrecorded, row.not_arrived, row.loss_ratio) == (20, {}, 0.0)


def test_verdicts_missing_at_the_end_are_known_by_the_final_counters() -> None:
    made = MadeRun()
    made.unrecorded_verdicts = {("v1", "v2", k) for k in range(170, POSES)}
    row = accounts_of(made)["v1", "v2"]
    assert (row.unrecorded, row.in_flight, row.not_arrived) == (30, 0, {})


def with_last_look(made: MadeRun, waiting: str, delay: int) -> Iterator[Recorded]:
    """The messages of a run with arrivals `delay` (ns) after sending and a last list of `waiting`.

    Verdicts on the last three messages are missing.
    """
    for when, one in made.recorded():
        if isinstance(one, LinkVerdict):
            if one.pose_seq < POSES - 3:
                yield when, replace(one, arrived_at_ns=one.sent_at_ns + delay)
        elif isinstance(one, Health) and one.vehicle == "v2":
            yield when, replace(one, waiting=waiting, received=POSES - 3)
        elif isinstance(one, Health) and one.vehicle == "v3":
            yield when, replace(one, received=2 * (POSES - 3))
        else:
            yield when, one


@pytest.mark.parametrize(
    ("delay_ms", "in_flight", "lost"), [(1, 2, 1), (99, 2, 1), (200, 3, 0)], ids=str
)
def test_messages_in_flight_are_those_that_had_arrived(
    delay_ms: int, in_flight: int, lost: int
) -> None:
    """Of the others, only those may be under way that the slowest message so far allows."""
    listed = f"v1 {POSES - 3} {POSES - 3},v1 {POSES - 1} {POSES - 1},v9 x"
    metrics = metrics_of(with_last_look(MadeRun(), listed, delay_ms * MS))
    rows = {(row.sender, row.receiver): row for row in metrics.link_summaries(SECONDS * SECOND)}
    row = rows["v1", "v2"]
    assert (row.in_flight, sum(row.not_arrived.values())) == (in_flight, lost)
    assert row.transport_ms_mean == delay_ms
    assert rows["v1", "v3"].in_flight == (0 if delay_ms < 150 else 2)
    for row in rows.values():
        assert_balanced(row)


def test_a_vehicle_that_was_cut_off_for_good_is_named() -> None:
    """Nothing of it is recorded after 4 s: it sent on, and was sent to."""
    cut_at, made = at(4.0), MadeRun()
    made.lost = {("v2", "v3", k) for k in range(80, POSES)}
    recorded = [
        (when, one) for when, one in made.recorded() if when < cut_at or one.vehicle != "v2"
    ]
    metrics = metrics_of([*recorded, (cut_at, health("v2", seconds=4.0))])
    rows = {(row.sender, row.receiver): row for row in metrics.link_summaries(SECONDS * SECOND)}
    for link in (("v1", "v2"), ("v2", "v3")):
        assert set(rows[link].not_arrived) == {"cut_off"}
        assert rows[link].not_arrived["cut_off"] + rows[link].in_flight == POSES - 80
        assert rows[link].in_flight <= 4
        assert rows[link].sent == POSES
    assert rows["v1", "v3"].not_arrived == {}
    assert metrics.contradictions(SECONDS * SECOND) == []
    lines = list(metrics.channel_warnings(SECONDS * SECOND))
    assert any("v2 cut off" in line for line in lines)


def test_a_vehicle_whose_poses_came_very_late_is_named() -> None:
    made = MadeRun()
    made.transit = {("v2", k): 1500 * MS for k in range(40, 60)}
    (line,) = metrics_of(made.recorded()).channel_warnings(SECONDS * SECOND)
    assert line.startswith("v2 was out of reach")
    assert "2.00 to 2.95 s" in line
    made.transit = {(name, k): 1500 * MS for k in range(40, 60) for name in NAMES}
    (line,) = metrics_of(made.recorded()).channel_warnings(SECONDS * SECOND)
    assert not line.startswith("v2")


@pytest.mark.parametrize("pose_seq", [7, POSES + 50])
def test_verdicts_that_contradict_the_account_fail_the_run(pose_seq: int) -> None:
    """A second verdict on one message, and one on a message that was never sent."""
    forged = verdict("v1", "v2", pose_seq, number=10_000)
    metrics = metrics_of([*MadeRun().recorded(), (at(5.0), forged)])
    (line,) = metrics.contradictions(SECONDS * SECOND)
    assert line.startswith("v1 → v2: the account does not balance")


def test_the_delay_of_the_real_transport_and_the_share_above_the_floor_are_figures() -> None:
    made = MadeRun()
    made.transit = {("v1", k): 566 * MS for k in range(100)}
    rows = accounts_of(made)
    slow, quick = rows["v1", "v2"], rows["v2", "v3"]
    assert slow.transport_ms_mean == pytest.approx((566 + 3) / 2)
    assert (slow.transport_ms_max, slow.transport_above_floor_ratio) == (566.0, 0.5)
    assert (quick.transport_ms_p95, quick.transport_above_floor_ratio) == (3.0, 0.0)


def test_a_slow_network_is_not_blamed_on_the_machine() -> None:
    made = MadeRun()
    made.transit = {("v1", k): 566 * MS for k in range(POSES)}
    metrics = metrics_of(made.recorded())
    links, vehicles = metrics.link_summaries(), metrics.vehicle_summaries()
    (line,) = transport_lines(links, vehicles)
    assert line.startswith("the network was slow: 100 % of the poses of v1")
    assert list(late_lines(vehicles)) == []
    late = [replace(row, late_ticks=row.ticks) for row in vehicles]
    assert list(transport_lines(links, late)) == []
    (busy,) = late_lines(late)
    assert "the machine is too slow" in busy
    (mixed,) = late_lines([replace(row, late_ticks_by_network=row.ticks) for row in late])
    assert "machine" not in mixed
    assert "blocked by the network" in mixed


def test_late_messages_do_not_hide_a_mean_delay_that_deviates() -> None:
    tally = LinkTally()
    for seq in range(200):
        tally.add(verdict("v1", "v2", seq, received_after_ms=566.0))
    (line,) = request_deviations(("v1", "v2"), LinkTable(), tally)
    assert "566.000 ms" in line
    assert "200 of 200 were late" in line


# ---- Virtual runs

CHANGES = """
[[change]]
kind = "crash"
at_s = 1.33
vehicle = "v2"
for_s = 1.0
[[change]]
kind = "leave"
at_s = 2.0
vehicle = "v3"
[[change]]
kind = "join"
at_s = 3.51
vehicle = "v3"
[[change]]
kind = "stall"
at_s = 2.6
vehicle = "v4"
for_s = 1.1
"""


def virtual_rows(scenario: Scenario) -> tuple[tuple[LinkSummary, ...], dict[str, Inbox]]:
    """Account of a virtual run, and the inboxes at its end."""
    metrics, convoy = Metrics.of(scenario), VirtualConvoy(scenario)
    listeners = listeners_by_kind([metrics])
    now = convoy.clock.now
    metrics.listen(now(), RunStart(vehicle="run", seq=0, start_at_ns=now(), run_id="made"))
    nodes = convoy.build(lambda name: ObservedSink(name, convoy.bus, now, listeners))
    convoy.run()
    for node in nodes.values():
        node.outbox.publish_health(now(), final=True)
    ran_ns = now() - scenario.start_at_ns
    assert metrics.contradictions(ran_ns) == []
    return metrics.link_summaries(ran_ns), {name: node.inbox for name, node in nodes.items()}


def waiting_in(inbox: Inbox, sender: str) -> int:
    """Count the messages of a sender that its receiver has and has not yet decided on."""
    waiting = sum(
        isinstance(item, Transmission) and name == sender for _, name, _, _, item in inbox._waiting
    )
    arrived = sum(sender_key == key(sender, GPS) for sender_key, _, _ in inbox._arrived)
    return waiting + len(inbox.links[sender].pending) + arrived


def assert_all_arrive(scenario: Scenario) -> None:
    rows, inboxes = virtual_rows(scenario)
    for row in rows:
        assert_balanced(row)
        assert set(row.not_arrived) <= {"receiver_down"}
        assert (row.in_flight, row.unrecorded) == (
            waiting_in(inboxes[row.receiver], row.sender),
            0,
        )


@pytest.mark.spread(9)
@pytest.mark.parametrize("name", [*library(), *drills()])
def test_the_account_of_shipped_scenarios_balances(name: str) -> None:
    try:
        scenario = load_scenario(name, ["duration_s=6"])
    except ScenarioError:  # its limits are about later instants
        scenario = load_scenario(name)
    assert_all_arrive(scenario)


def test_the_account_balances_with_software_that_does_not_run() -> None:
    text = f"{STRAIGHT}{CHANGES}".replace("duration_s = 20.0", "duration_s = 5.0")
    slow = scenario_from_text(text, overrides=["links.latency_ms=120", "links.jitter_ms=80"])
    rows, inboxes = virtual_rows(slow)
    down = {row.receiver for row in rows if row.not_arrived}
    assert down == {"v2", "v3"}
    for row in rows:
        assert_balanced(row)
        assert row.in_flight == waiting_in(inboxes[row.receiver], row.sender)


@pytest.mark.parametrize("preset", presets())
def test_the_account_of_presets_balances(preset: str) -> None:
    assert_all_arrive(load_scenario("lane_change", ["duration_s=5", f'links.preset="{preset}"']))
