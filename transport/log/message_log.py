"""What whoever records a run asks of its log, whichever process writes the file."""

from collections.abc import Mapping
from typing import Protocol

from transport.topics import Topic
from vehicles.messages import Message


class MessageLog(Protocol):
    """A log to be written; the methods are those of `LogWriter`, and raise LogError as that does.

    Once it is `broken` the file cannot be written any more, and every call does nothing. It is
    `fast` unless the mcap package allows no faster way to add messages.
    """

    @property
    def broken(self) -> bool: ...

    @property
    def fast(self) -> bool: ...

    def write(  # noqa: PLR0917 - as in LogWriter
        self,
        topic: Topic,
        vehicle: str,
        data: bytes | None,
        log_time: int,
        publish_time: int | None = None,
        message: Message | None = None,
    ) -> None:
        """Log one message."""
        ...

    def write_deviation(
        self, log_time: int, vehicle: str, true_at: int, error: float, gap: float
    ) -> None:
        """Log true error and gap (m) of a vehicle at an instant (ns)."""
        ...

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file into the log."""
        ...

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Put named text values into the log."""
        ...

    def flush(self) -> None:
        """Hand everything written so far to the operating system."""
        ...

    def close(self) -> None:
        """Complete the log."""
        ...
