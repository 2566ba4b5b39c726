"""Wait for messages of a bus, and collect them."""

import time
from collections.abc import Callable

from transport.bus.bus import Bus


def until(holds: Callable[[], bool], seconds: float = 5.0) -> bool:
    """Wait until `holds()`, at most `seconds`; returns whether it does."""
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.002)
    return holds()


def connect(sender: Bus, received: list[tuple[str, bytes]], key: str = "convoy/x/log") -> None:

    def arrives() -> bool:
        sender.publish(key, b"hello")
        return bool(received)

    assert until(arrives)
    time.sleep(0.05)
    received.clear()


class ReceivedMessages(list[tuple[str, bytes]]):
    def __call__(self, key: str, data: bytes) -> None:
        self.append((key, data))
