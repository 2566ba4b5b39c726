from collections import defaultdict
from dataclasses import replace

import numpy as np

from scenarios.definition.schema.link_tables import LinkTable
from scenarios.runs.node.outbox import NoProbe, Outbox, Probe, Usage
from scenarios.runs.node.sink import BusSink, Sink
from tests.made.scenarios.messages import START, at, gps, truth
from tests.made.transport.links import inbox as inbox_of
from tests.made.vehicles.decision_messages import log_messages
from transport.bus.bus import MemoryBus
from transport.clock import ticks
from transport.codec import decode, encode
from transport.links.inbox import Inbox
from transport.links.true_poses import TruePoses
from transport.topics import TOPICS, key
from vehicles.car.dynamics import Actuation, Body, tyre_use
from vehicles.car.gnss import Fix
from vehicles.car.parameters import LINCOLN_MKZ
from vehicles.driver.controller import SourceState
from vehicles.driver.decision import Decision
from vehicles.driver.situation import Situation
from vehicles.driver.steering import SteeringCommand
from vehicles.driver.tracking import TrackingErrors
from vehicles.geometry.arc_spline import ArcSpline, Piece
from vehicles.geometry.geodesy import LocalPlane, Origin
from vehicles.messages import (
    Command,
    CompositeTrajectory,
    GpsPose,
    Health,
    LinkVerdict,
    LogText,
    Message,
    TruePose,
)
from vehicles.preview.trajectory import Fit
from vehicles.received_pose import receive
from vehicles.schedule import SECOND

PLANE = LocalPlane(Origin(30.638, -96.481, 80.0))
BODY = Body(
    east=10.0, north=-20.0, yaw=0.5, speed=15.0, lateral_speed=0.1, yaw_rate=0.02, steering=0.01,
    distance=33.0,
)  # fmt: skip
FIX = Fix(seq=4, measured_at=START, east=10.01, north=-20.02, yaw=0.51, speed=15.1, yaw_rate=0.03)
DECISION = Decision(
    at=0,
    actuation=Actuation(0.02, 0.5),
    steering=SteeringCommand(0.02, 0.015, 0.005),
    errors=TrackingErrors(0.1, 0.0, 0.0, 0.0),
    mode="lead",
    reason="v2 never received",
    estimated_gap=14.0,
    lateral_deviation=0.03,
    measured_gap=13.9,
    measured_gap_rate=-0.4,
    law_acceleration=0.5,
    situation=Situation(
        lead=SourceState(
            status="fresh", age=0.02, silence=0.01, period=0.05, share=1.0, known=28.0
        ),
        predecessor=SourceState(
            status="late", age=0.04, silence=0.03, period=0.05, share=0.9, known=12.0
        ),
        known=28.0,
        blind=0.0,
        predecessor_weight=0.5,
    ),
)
TYRES = tyre_use(BODY, 0.5, LINCOLN_MKZ)
HELD = replace(DECISION, fresh=False)


class UrgentBus(MemoryBus):
    """A memory bus that keeps the messages published, and what of them was urgent."""

    def __init__(self) -> None:
        super().__init__()
        self.published: list[Message] = []
        self.urgent: dict[str, set[bool]] = defaultdict(set)

    def publish(self, key: str, data: bytes, *, urgent: bool = False) -> None:
        _, vehicle, name = key.split("/")
        message = decode(TOPICS[name], data)
        assert message.vehicle == vehicle
        self.published.append(message)
        self.urgent[name].add(urgent)

    def of(self, kind: type[Message]) -> list[Message]:
        return [message for message in self.published if type(message) is kind]


class Slow:
    """A process whose ticks come late."""

    def __init__(self) -> None:
        self.usage = Usage(memory_bytes=60_000_000, cpu_ratio=0.03)

    def read(self) -> Usage:
        return self.usage


def receiving_inbox() -> Inbox:
    links = {"v1": LinkTable(latency_ms=20.0), "v2": LinkTable(loss_ratio=1.0)}
    return inbox_of("v3", links, start_at=START, origin=PLANE.origin)


def outbox(
    bus: MemoryBus,
    inbox: Inbox | None = None,
    probe: Probe | None = None,
    sink: Sink | None = None,
    target: TruePoses | None = None,
) -> Outbox:
    return Outbox(
        vehicle="v3",
        sink=sink or BusSink("v3", bus),
        plane=PLANE,
        parameters=LINCOLN_MKZ,
        inbox=inbox or receiving_inbox(),
        probe=probe or NoProbe(),
        start_at=START,
        target=target,
    )


def test_a_tick_sends_fix_truth_and_decision() -> None:
    bus = UrgentBus()
    outbox(bus).publish(at(0.1), BODY, FIX, DECISION)
    pose = bus.of(GpsPose)[0]
    assert isinstance(pose, GpsPose)
    back = receive(pose, PLANE, at(0.1))
    assert (back.message.seq, back.measured_at, back.speed) == (0, FIX.measured_at, FIX.speed)
    assert abs(back.east - FIX.east) + abs(back.north - FIX.north) < 1e-6
    assert bus.of(TruePose) == [
        TruePose(
            vehicle="v3", seq=0, true_at_ns=at(0.1), east_m=10.0, north_m=-20.0, yaw_rad=0.5,
            speed_mps=15.0, lateral_speed_mps=0.1, yaw_rate_radps=0.02, steering_rad=0.01,
            distance_m=33.0, lateral_acceleration_mps2=TYRES.lateral_acceleration,
            front_slip_rad=TYRES.front_slip, rear_slip_rad=TYRES.rear_slip,
            friction_ratio=TYRES.friction_share,
        )
    ]  # fmt: skip
    messages = log_messages(DECISION, "v3", 0, at(0.1))
    assert [message for message in bus.published if message in messages] == list(messages)


def test_every_verdict_is_sent_once() -> None:
    bus, inbox = UrgentBus(), receiving_inbox()
    box = outbox(bus, inbox)
    for seq in range(4):
        for name in ("v1", "v2"):
            inbox.on_bytes(key(name, TOPICS["gps"]), encode(gps(name, seq)))
    inbox.take(at(1.0))
    box.publish(at(1.0), BODY, None, DECISION)
    box.publish(at(1.02), BODY, None, DECISION)
    verdicts = [message for message in bus.of(LinkVerdict) if isinstance(message, LinkVerdict)]
    assert [(v.sender, v.pose_seq, v.outcome) for v in verdicts] == [
        (name, seq, "delivered" if name == "v1" else "dropped")
        for seq in range(4)
        for name in ("v1", "v2")
    ]


def reports(*rates_hz: float) -> list[float]:
    """Seconds at which health is sent on a schedule of these rates, over ten seconds."""
    bus = UrgentBus()
    box = outbox(bus)
    for tick in ticks(START, at(10.0), *rates_hz):
        box.publish(tick.at, BODY, None, HELD)
    return [
        (message.reported_at_ns - START) / SECOND
        for message in bus.of(Health)
        if isinstance(message, Health)
    ]


def test_health_is_sent_once_a_second_at_any_rates() -> None:
    for rates in ((7.3, 3.1), (33.3, 7.7), (5.0,)):
        results = reports(*rates)
        assert len(results) == 10
        for k, second in enumerate(results):
            assert k <= second < k + 1.0 / min(5.0, *rates)


def test_health_counts_ticks_and_messages() -> None:
    bus, inbox, slow = UrgentBus(), receiving_inbox(), Slow()
    box = outbox(bus, inbox, slow)
    for name in ("v1", "v2"):
        inbox.on_bytes(key(name, TOPICS["gps"]), encode(gps(name, 0)))
    inbox.on_bytes("convoy/v1/gps", b"rubbish")
    inbox.take(at(0.1))
    for k in range(5):
        box.publish(at(0.1 + k / 50), BODY, None, DECISION)
    slow.usage = replace(slow.usage, late_ticks=2, lateness_ms_max=14.0)
    box.publish_health(at(0.5), final=True)
    last = bus.of(Health)[-1]
    assert isinstance(last, Health)
    assert (last.ticks, last.late_ticks, last.lateness_ms_max) == (5, 2, 14.0)
    assert (last.received, last.dropped, last.rejected_messages) == (1, 1, 1)
    assert (last.memory_bytes, last.cpu_ratio, last.final) == (60_000_000, 0.03, True)
    assert last.published == len(bus.published) - 1  # all before itself


def texts(bus: UrgentBus) -> list[tuple[str, str]]:
    return [(m.level, m.text) for m in bus.of(LogText) if isinstance(m, LogText)]


def test_a_change_of_mode_is_logged_with_its_reason() -> None:
    bus = UrgentBus()
    box = outbox(bus)
    composite = replace(DECISION, mode="composite", reason="")
    for k, decision in enumerate([DECISION, DECISION, composite, composite, DECISION]):
        box.publish(at(k / 50), BODY, None, decision)
    assert texts(bus) == [
        ("info", "mode lead (v2 never received)"),
        ("info", "mode composite"),
        ("info", "mode lead (v2 never received)"),
    ]


def test_true_poses_too_late_for_the_gap_sensor_are_reported_once_and_counted() -> None:
    bus, target = UrgentBus(), TruePoses("v2")
    box = outbox(bus, target=target)
    target.newest_at(at(0.5))
    for seconds in (0.4, 0.5, 0.6):
        pose = replace(truth("v2", 0, 1.0, 0.0), true_at_ns=at(seconds))
        target.on_bytes(target.key, encode(pose))
    target.on_bytes(target.key, b"nonsense")
    for seconds in (1.0, 2.0):
        box.publish(at(seconds), BODY, None, HELD)
    health = [one for one in bus.published if isinstance(one, Health)]
    assert [(one.late_messages, one.rejected_messages) for one in health] == [(2, 1), (2, 1)]
    (line,) = [one for one in bus.published if isinstance(one, LogText)]
    assert line.level == "warning"
    assert line.text.startswith("2 ")


def test_refused_messages_are_reported_once_by_reason_and_counted() -> None:
    bus, inbox = UrgentBus(), receiving_inbox()
    box = outbox(bus, inbox)
    for k in range(100):
        if k == 10:
            inbox.on_bytes("convoy/v1/gps", b"rubbish")
            inbox.on_bytes("convoy/v1/gps", encode(replace(gps("v1", 0), latitude_deg=-10.0)))
            inbox.on_bytes("convoy/v1/gps", encode(replace(gps("v1", 0), speed_mps=180.0)))
        inbox.take(at(k * 0.02))
        box.publish(at(k * 0.02), BODY, None, DECISION)
    results = [one.text for one in bus.of(LogText) if isinstance(one, LogText)]
    assert [text for text in results if "refused" in text] == [
        "1 messages refused: absurd",
        "1 messages refused: far",
        "1 messages refused: garbage",
    ]
    healths = [one for one in bus.of(Health) if isinstance(one, Health)]
    assert [one.rejected_messages for one in healths] == [0, 3]


class Figures:
    """A sink without readers of commands and trajectories."""

    def __init__(self, sink: BusSink) -> None:
        self.send, self.flush = sink.send, sink.flush

    def reads(self, kind: type[Message]) -> bool:
        return kind not in {Command, CompositeTrajectory}


def test_unread_messages_are_not_built_but_counted() -> None:
    bus, all_messages = UrgentBus(), UrgentBus()
    box, other = outbox(bus, sink=Figures(BusSink("v3", bus))), outbox(all_messages)
    spline = ArcSpline((Piece(0.0, 0.0, 0.0, 0.0, 10.0),))
    none = np.zeros(0)
    fit = Fit(spline, none, none, none, np.zeros(0, np.int8), 0.0, 0.0, 0)
    for one in (box, other):
        one.publish(at(0.1), BODY, FIX, replace(DECISION, fit=fit))
        one.publish_health(at(0.2))
    unread = {Command, CompositeTrajectory}
    assert unread <= {type(message) for message in all_messages.published}
    results = [encode(message) for message in all_messages.published if type(message) not in unread]
    assert [encode(message) for message in bus.published] == results
    assert box.state == other.state
