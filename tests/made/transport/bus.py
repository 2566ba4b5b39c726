"""Waiting for what a bus brings, and keeping it."""

import time
from collections.abc import Callable

from transport.bus.bus import Bus


def until(holds: Callable[[], bool], seconds: float = 5.0) -> bool:
    """Wait until `holds()`, at most `seconds`; say whether it does."""
    end = time.monotonic() + seconds
    while not holds() and time.monotonic() < end:
        time.sleep(0.002)
    return holds()


def connect(sender: Bus, heard: list[tuple[str, bytes]], key: str = "convoy/x/log") -> None:
    """Publish until something is heard: a subscription takes its time to reach a sender."""

    def arrives() -> bool:
        sender.publish(key, b"hello")
        return bool(heard)

    assert until(arrives)
    time.sleep(0.05)
    heard.clear()


class Heard(list[tuple[str, bytes]]):
    """A handler that keeps what it is given."""

    def __call__(self, key: str, data: bytes) -> None:
        self.append((key, data))
