"""Where the messages of one vehicle go: onto the bus, or wherever a run needs them."""

from collections.abc import Callable
from typing import Protocol

from transport.bus.bus import Bus
from transport.codec import encode
from transport.topics import TOPIC_OF, Topic, key
from vehicles.messages import Message

OnSent = Callable[[Topic, bytes, Message], None]
"""Is given each message as it is sent, with its bytes: the recorder of a run in virtual time."""


class Sink(Protocol):
    """Takes the numbered messages of one vehicle."""

    def send(self, message: Message) -> None:
        """Take one message; it may wait until `flush`."""
        ...

    def flush(self) -> None:
        """Deliver what waits: the messages of a tick are complete."""
        ...

    def reads(self, kind: type[Message]) -> bool:
        """Whether anybody reads messages of a kind; those of another need not be made."""
        ...


class BusSink:
    """Encodes messages and publishes them on a bus."""

    def __init__(self, vehicle: str, bus: Bus, on_sent: OnSent | None = None) -> None:
        """`on_sent` is called for each message, in the order in which they are sent."""
        self._bus = bus
        self._on_sent = on_sent
        self._addresses: dict[type[Message], tuple[str, Topic]] = {
            kind: (key(vehicle, topic), topic) for kind, topic in TOPIC_OF.items()
        }
        self._waiting: list[tuple[str, bytes, bool]] = []

    def send(self, message: Message) -> None:
        """Encode `message`; it is published by `flush`."""
        address, topic = self._addresses[type(message)]
        data = encode(message)
        self._waiting.append((address, data, topic.urgent))
        if self._on_sent is not None:
            self._on_sent(topic, data, message)

    def flush(self) -> None:
        """Publish what waits, in one go: on the wire several messages then share a packet."""
        for address, data, urgent in self._waiting:
            self._bus.publish(address, data, urgent=urgent)
        self._waiting.clear()

    def reads(self, kind: type[Message]) -> bool:  # noqa: ARG002 - whoever listens may read all
        """Everything may be read."""
        return True
