"""What a vehicle says: its pose to the convoy, everything else to the log."""

from collections import Counter
from collections.abc import Callable

from scenarios.runs.node.probe import Probe
from transport.bus.bus import Bus
from transport.codec import encode
from transport.links.inbox import Inbox
from transport.topics import TOPIC_OF, Topic, key
from vehicles import messages
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix, to_message
from vehicles.driver.decision import Decision
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import Message
from vehicles.schedule import SECOND

Witness = Callable[[Topic, bytes, Message], None]
"""Sees each message as it is sent, with its bytes: the recorder of a run in virtual time."""


def nobody(topic: Topic, data: bytes, message: Message) -> None:
    """Witness nothing: between processes only the bus carries messages."""


class Outbox:
    """Numbers, encodes and publishes the messages of one vehicle."""

    def __init__(
        self,
        *,
        vehicle: str,
        bus: Bus,
        plane: LocalPlane,
        inbox: Inbox,
        probe: Probe,
        start_at: int,
        witness: Witness = nobody,
    ) -> None:
        """`probe` tells of the process; health goes out once a second from `start_at` (ns) on."""
        self._vehicle = vehicle
        self._bus = bus
        self._witness = witness
        self._plane = plane
        self._inbox = inbox
        self._probe = probe
        self._health_due = start_at
        self._places: dict[type[Message], tuple[str, Topic]] = {
            kind: (key(vehicle, topic), topic) for kind, topic in TOPIC_OF.items()
        }
        self._next: Counter[type[Message]] = Counter()
        self._ticks = 0
        self._late_ticks = 0
        self._mode = ""
        self._waiting: list[tuple[str, bytes, bool]] = []

    def publish(self, now: int, body: Body, fix: Fix | None, decision: Decision) -> None:
        """Publish what came about at tick `now` (ns)."""
        self._ticks += 1
        if fix is not None:
            self._send(to_message(fix, self._vehicle, self._plane))
        for verdict in self._inbox.verdicts():
            self._send(verdict)
        if decision.fresh:
            self._publish_truth(now, body)
            self._publish_decision(now, decision)
        if now >= self._health_due:  # not every schedule has a tick at each whole second
            self._health_due += SECOND
            self._say_health(now, final=False)
        self._hand_over()

    def publish_health(self, now: int, *, final: bool = False) -> None:
        """Publish the counters; the last ones of a run are `final`."""
        self._say_health(now, final=final)
        self._hand_over()

    def _say(self, now: int, text: str, level: messages.Level = "info") -> None:
        """Say a line of text for the log."""
        self._send(
            messages.LogText(
                vehicle=self._vehicle,
                seq=self._next[messages.LogText],
                logged_at_ns=now,
                level=level,
                text=text,
            )
        )

    def _say_health(self, now: int, *, final: bool) -> None:
        usage = self._probe.read()
        for reason, count in self._inbox.rejections():
            self._say(now, f"{count} messages refused: {reason}", "warning")
        if usage.late_ticks > self._late_ticks:
            late = usage.late_ticks - self._late_ticks
            worst = usage.lateness_ms_max
            self._say(now, f"{late} ticks came late, the worst so far {worst:.1f} ms", "warning")
            self._late_ticks = usage.late_ticks
        self._send(
            messages.Health(
                vehicle=self._vehicle,
                seq=self._next[messages.Health],
                reported_at_ns=now,
                ticks=self._ticks,
                late_ticks=usage.late_ticks,
                lateness_ms_max=usage.lateness_ms_max,
                heard=self._inbox.heard,
                dropped=self._inbox.dropped,
                late_messages=self._inbox.late,
                rejected_messages=self._inbox.rejected.total(),
                published=sum(self._next.values()),
                memory_bytes=usage.memory_bytes,
                cpu_ratio=usage.cpu_ratio,
                final=final,
            )
        )

    def _publish_truth(self, now: int, body: Body) -> None:
        self._send(
            messages.TruePose(
                vehicle=self._vehicle,
                seq=self._next[messages.TruePose],
                true_at_ns=now,
                east_m=body.east,
                north_m=body.north,
                yaw_rad=body.yaw,
                speed_mps=body.speed,
                lateral_speed_mps=body.lateral_speed,
                yaw_rate_radps=body.yaw_rate,
                steering_rad=body.steering,
                distance_m=body.distance,
            )
        )

    def _publish_decision(self, now: int, decision: Decision) -> None:
        for message in decision.messages(self._vehicle, self._next[messages.Tracking], now):
            self._send(message)
        if decision.mode != self._mode:
            self._mode = decision.mode
            why = f" ({decision.reason})" if decision.reason else ""
            self._say(now, f"steers along: {decision.mode}{why}")

    def _send(self, message: Message) -> None:
        kind = type(message)
        where, topic = self._places[kind]
        self._next[kind] += 1
        data = encode(message)
        self._waiting.append((where, data, topic.urgent))
        self._witness(topic, data, message)

    def _hand_over(self) -> None:
        """Publish what waits, in one go: on the wire several messages then share a packet."""
        for where, data, urgent in self._waiting:
            self._bus.publish(where, data, urgent=urgent)
        self._waiting.clear()
