"""Sinks for the messages of one vehicle."""

from collections.abc import Callable, Container, Mapping
from typing import Protocol
from zlib import crc32

from transport.bus.bus import Bus
from transport.bus.telemetry import BatchRecord, packed, records_key
from transport.codec import encode
from transport.topics import TOPIC_OF, Thinning, Topic, key, valid_at
from vehicles.messages import Command, CompositeTrajectory, Message
from vehicles.schedule import MILLISECOND

BATCH_NS = 100 * MILLISECOND
"""Longest time that a batched message waits."""
LOG_ONLY = {TOPIC_OF[kind].name for kind in (CompositeTrajectory, Command)}
"""Topics without figures."""

OnSent = Callable[[Topic, bytes, Message], None]
"""Receives each sent message with its bytes."""


class Sink(Protocol):
    """Takes the numbered messages of one vehicle."""

    def send(self, message: Message) -> None:
        """Take one message; it may wait until `flush`."""
        ...

    def flush(self) -> None: ...

    def reads(self, kind: type[Message]) -> bool:
        """Whether anything reads messages of a kind; others need not be built."""
        ...


class BusSink:
    def __init__(self, vehicle: str, bus: Bus, on_sent: OnSent | None = None) -> None:
        self._bus = bus
        self._on_sent = on_sent
        self._addresses: dict[type[Message], tuple[str, Topic]] = {
            kind: (key(vehicle, topic), topic) for kind, topic in TOPIC_OF.items()
        }
        self._waiting: list[tuple[str, bytes, bool]] = []

    def send(self, message: Message) -> None:
        address, topic = self._addresses[type(message)]
        data = encode(message)
        self._waiting.append((address, data, topic.urgent))
        if self._on_sent is not None:
            self._on_sent(topic, data, message)

    def flush(self) -> None:
        """Publish all waiting messages at once, so that they share packets on the wire."""
        for address, data, urgent in self._waiting:
            self._bus.publish(address, data, urgent=urgent)
        self._waiting.clear()

    def reads(self, kind: type[Message]) -> bool:  # noqa: ARG002 - any process may subscribe
        return True


def _record_of(message: Message) -> BatchRecord:
    topic = TOPIC_OF[type(message)]
    return BatchRecord(topic.name, valid_at(message), encode(message))


class BatchingSink:
    """Publishes urgent messages at once and others in batches; for the wall clock.

    Batched messages are encoded together, while the processor's caches are warm.
    """

    def __init__(
        self,
        vehicle: str,
        bus: Bus,
        now: Callable[[], int],
        on_sent: OnSent | None = None,
        *,
        logged_hz: Mapping[str, float] | None = None,
        unbatched: Container[str] = (),
    ) -> None:
        """`now` is the clock (ns); `on_sent` is called for each message that is sent alone.

        Topics in `logged_hz` that only the log reads are thinned to the rates of the log.
        `unbatched` topics are sent at once, because other vehicles wait for them.
        """
        self._vehicle = vehicle
        rates_hz = (logged_hz or {}).items()
        self._thinning = Thinning({name: rate for name, rate in rates_hz if name in LOG_ONLY})
        self._alone = BusSink(vehicle, bus, on_sent)
        self._bus = bus
        self._key = records_key(vehicle)
        self._now = now
        self._unbatched = unbatched
        self._waiting: list[Message] = []
        self._turn = crc32(vehicle.encode()) % BATCH_NS  # vehicles of a convoy take turns
        self._span = self._present_span()

    def send(self, message: Message) -> None:
        topic = TOPIC_OF[type(message)]
        if not topic.batched or topic.name in self._unbatched:
            self._alone.send(message)
        elif self._thinning.keeps(topic.name, self._vehicle, getattr(message, topic.instant)):
            self._waiting.append(message)

    def flush(self) -> None:
        self._alone.flush()
        if (span := self._present_span()) != self._span:
            self._span = span
            self._send_batch()

    def _present_span(self) -> int:
        return (self._now() - self._turn) // BATCH_NS

    def flush_all(self) -> None:
        self._alone.flush()
        self._send_batch()

    def _send_batch(self) -> None:
        for batch in packed(map(_record_of, self._waiting)):
            self._bus.publish(self._key, batch)
        self._waiting.clear()

    def reads(self, kind: type[Message]) -> bool:
        return not self._thinning.drops_all(TOPIC_OF[kind].name)
