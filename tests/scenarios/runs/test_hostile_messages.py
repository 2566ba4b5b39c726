"""A foreign sender on the bus of a convoy: its messages are counted and change nothing else.

`pytest --campaign` sends a hundred thousand messages.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random

import pytest

from scenarios.cli.common_options import DisplayOptions
from scenarios.cli.display import displays
from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.results.summary import RunSummary, from_json, to_json
from scenarios.runs.live import LiveRun
from scenarios.runs.node.node import AnyNode
from scenarios.runs.node.sink import BusSink
from scenarios.runs.observer import Observer, OnMessage, Watcher
from scenarios.runs.processes.conductor import Conductor, Phase
from scenarios.runs.processes.membership import VEHICLE, Fingerprint, Membership
from scenarios.runs.processes.vehicle_process import RunAnnouncements
from scenarios.runs.run_log import RunLog
from scenarios.runs.virtual import VirtualConvoy
from tests.made.scenarios.hostile_messages import TEXTS, Put, Stranger
from transport.bus.bus import Bus, BusError, MemoryBus, MemoryNetwork
from transport.codec import encode
from transport.log.reader import LogReader
from transport.topics import REASONS, RUN_SENDER, TOPICS, key
from vehicles.messages import Health, LogText, Message
from vehicles.schedule import SECOND, Timer, nanoseconds

VEHICLES = ("v1", "v2", "v3")
DURATION_S = 1.5
EVERYTHING = "convoy/**"
KEPT = 40
"""Number of received messages that the foreign sender keeps."""


@dataclass(frozen=True)
class Attacked:
    """A run that was recorded off its bus, and what was put there by somebody else."""

    folder: Path
    summary: RunSummary
    nodes: dict[str, AnyNode]
    honest: Counter[str]
    """Messages of the vehicles by key."""
    hostile: Counter[str]
    recorded: int
    announced: RunAnnouncements
    conductor: Conductor

    @property
    def messages(self) -> list[Message]:
        """All messages of its log."""
        return [message for _, _, message in LogReader(self.folder / "run.mcap").messages()]


def trial() -> Scenario:
    """Return the run that is disturbed."""
    short = f"duration_s={DURATION_S}"
    return load_scenario("lane_change", ["convoy.vehicles=3", short, "links.loss_ratio=0.2"])


class AttackedSink:
    """Publishes what a vehicle sends, and then lets the foreign sender act."""

    def __init__(self, vehicle: str, bus: Bus, disturb: Callable[[], None]) -> None:
        self._sink, self._disturb = BusSink(vehicle, bus), disturb
        self.send, self.reads = self._sink.send, self._sink.reads

    def flush(self) -> None:
        self._sink.flush()
        self._disturb()


def drive(
    folder: Path,
    draw: Callable[[Stranger, Sequence[Put]], Put],
    count: int,
    observers: Sequence[Observer] = (),
    watchers: Sequence[Watcher] = (),
) -> Attacked:
    """Run a short convoy whose recorder listens to its bus, with `count` messages of a stranger."""
    scenario = trial()
    convoy = VirtualConvoy(scenario)
    bus, clock = convoy.bus, convoy.clock
    end_at = clock.now() + nanoseconds(DURATION_S)
    conductor = Conductor(
        VEHICLES,
        duration_ns=end_at - clock.now(),
        continues_without_failed=False,
        gather_until=end_at,
    )
    for name in VEHICLES:
        conductor.note_presence(name, alive=True, at=clock.now())
    conductor.advance(clock.now() - SECOND // 2, connected=True)
    own: Counter[str] = Counter()
    live = LiveRun(scenario)
    run = RunLog(
        scenario,
        folder,
        clock="virtual",
        run_id="x",
        live=live,
        observers=(
            conductor,
            live,
            OnMessage(lambda _, message: own.update([message.vehicle])),
            *observers,
        ),
    )
    member = Membership(bus, "x", VEHICLE, "v1", Fingerprint.of(scenario), run_id="x")
    announced = RunAnnouncements(bus, member, clock.now)
    start = run.start(clock.now(), clock.now())
    bus.publish(key(RUN_SENDER, TOPICS["start"]), start)
    own.clear()
    before = run.recorder.recorded
    honest: Counter[str] = Counter()
    hostile: Counter[str] = Counter()
    received: list[Put] = []
    stranger = Stranger(Random(7), VEHICLES, clock.now())
    flushes = 3 * 90  # at 75 instants of control and 30 of GNSS, of which 15 are both
    each, left = -(-count // flushes), count
    updating = Timer(SECOND // 2)

    def take(where: str, data: bytes) -> None:
        run.recorder.accept(where, data, clock.now())

    def receive(where: str, data: bytes) -> None:
        if not disturbing:
            honest[where] += 1
            received.append((where, data))
            del received[:-KEPT]

    disturbing: list[bool] = []

    def disturb() -> None:
        nonlocal left
        disturbing.append(True)
        for _ in range(min(each, left)):
            where, data = draw(stranger, received)
            hostile[where] += 1
            bus.publish(where, data)
        left -= min(each, left)
        disturbing.clear()
        conductor.advance(clock.now(), connected=True)
        if updating.is_due(clock.now()) and run.update(clock.now()):
            for watcher in watchers:
                watcher.update(live)

    bus.subscribe(EVERYTHING, take)
    bus.subscribe(EVERYTHING, receive)
    nodes = convoy.build(lambda name: AttackedSink(name, bus, disturb))
    convoy.run()
    for node in nodes.values():
        node.outbox.publish_health(clock.now(), final=True)
        node.inbox.take(clock.now() + 120 * SECOND)  # so that nothing is waiting any more
    conductor.advance(clock.now(), connected=True)
    # Without the recorder's own messages about the foreign sender.
    recorded = run.recorder.recorded - before - own[RUN_SENDER]
    run.end(clock.now(), "")
    summary = run.close(clock.now())
    return Attacked(folder, summary, nodes, honest, hostile, recorded, announced, conductor)


@pytest.fixture(scope="module")
def calm(tmp_path_factory: pytest.TempPathFactory) -> Attacked:
    """The run without a stranger."""
    return drive(tmp_path_factory.mktemp("calm"), Stranger.refusable, 0)


@pytest.mark.campaign(3_000, 100_000)
def test_messages_of_no_run_change_only_counters(
    calm: Attacked, tmp_path: Path, campaign: int
) -> None:
    run = drive(tmp_path, Stranger.refusable, campaign)
    assert run.hostile.total() == campaign
    assert run.recorded == run.honest.total()
    refused = run.summary.recorder_rejected_messages
    # A stranger may repeat the last counters of a vehicle as the vehicle does.
    assert campaign - campaign // 1000 <= sum(refused.values()) <= campaign
    assert set(refused) <= set(REASONS)
    assert_inboxes_add_up(run)
    for name, node in run.nodes.items():
        senders = {"v1": ("v2",), "v2": ("v1",), "v3": ("v1", "v2")}[name]
        requested = sum(run.hostile[key(sender, TOPICS["gps"])] for sender in senders)
        assert node.inbox.rejected.total() == requested
        assert node.inbox.delivered == calm.nodes[name].inbox.delivered
    assert reported(run) == reported(calm)
    assert figures(run) == figures(calm)
    assert (run.conductor.phase, run.conductor.reason) == (Phase.OVER, "")
    assert run.announced.start is not None
    assert run.announced.end is None


def assert_inboxes_add_up(run: Attacked) -> None:
    """What came under the keys that a vehicle listens to was judged or refused, each once."""
    for node in run.nodes.values():
        came = sum(run.honest[where] + run.hostile[where] for where in node.inbox.keys)
        assert node.inbox.delivered + node.inbox.dropped + node.inbox.rejected.total() == came
        assert set(node.inbox.rejected) <= set(REASONS)


def reported(run: Attacked) -> list[bytes]:
    """Messages of vehicles, without counters and texts about refusals."""
    return [encode(m) for m in run.messages if not isinstance(m, Health | LogText)]


def figures(run: Attacked) -> list[object]:
    """Figures of the summary that nothing refused may change."""
    vehicles = [
        {name: getattr(row, name) for name in row.__slots__ if name != "rejected_messages"}
        for row in run.summary.vehicles
    ]
    return [vehicles, run.summary.links, run.summary.events, run.summary.outcome]


@pytest.mark.campaign(3_000, 100_000)
def test_plausible_messages_are_used_or_counted(tmp_path: Path, campaign: int) -> None:
    def anything(stranger: Stranger, received: Sequence[Put]) -> Put:
        drawn = stranger.plausible(received)
        return drawn if len(drawn[1]) % 2 else stranger.refusable(received)

    display = DisplayOptions(rerun=f"save={tmp_path / 'run.rrd'}")
    with displays(trial(), display, tmp_path, []) as (receivers, watchers):
        run = drive(tmp_path, anything, campaign, receivers, watchers)
    came = run.honest.total() + run.hostile.total()
    counted = run.recorded + sum(run.summary.recorder_rejected_messages.values())
    # A stranger may repeat the last counters of a vehicle as the vehicle does.
    assert came - campaign // 1000 <= counted <= came
    assert run.recorded >= 0.9 * run.honest.total()
    assert_inboxes_add_up(run)
    log = LogReader(run.folder / "run.mcap")
    assert (log.damage, log.truncated) == ("", False)
    texts = [message.text for message in run.messages if isinstance(message, LogText)]
    assert all(text.isprintable() for text in texts)
    written = from_json((run.folder / "summary.json").read_text())
    assert to_json(written) == to_json(run.summary)


def test_unknown_members_are_ignored_or_named_in_one_line() -> None:
    chance, scenario = Random(3), load_scenario("lane_change")
    own = Fingerprint.of(scenario)
    odd = [
        *TEXTS,
        "~",
        "~~~",
        "a~b~c~d~e",
        own.chunk,
        own.chunk[1:],
        "\x1b[31m~1~0.1~x",
        "x" * 5000,
    ]
    for _ in range(300):
        network = MemoryNetwork()
        member = Membership(MemoryBus(network), "run", VEHICLE, "v1", own)
        member.join(sleep=lambda _: None)
        role = chance.choice(["recorder", "vehicle", *TEXTS])
        name, fingerprint = chance.choice(["v2", "v1", *odd]), chance.choice(odd)
        MemoryBus(network).announce(role, name, fingerprint)
        expected = {name} if (role, fingerprint) == ("vehicle", own.chunk) else set()
        assert member.vehicles == expected
        line = refusal(Membership(MemoryBus(network), "run", VEHICLE, "v3", own))
        for text in (line, *member.new_warnings()):
            assert text.isprintable()
            assert len(text) < 500


def refusal(member: Membership) -> str:
    """Say why a member may not join; nothing if it may."""
    try:
        member.join(sleep=lambda _: None)
    except BusError as error:
        return str(error)
    return ""
