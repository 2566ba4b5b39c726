"""What carries bytes between the processes of a convoy, whichever way."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import Protocol, Self

Handler = Callable[[str, bytes], None]
"""Is given a message's key and payload, on a thread of the bus; must be quick and never raise."""
AliveHandler = Callable[[str, bool], None]
"""Is given a vehicle's name and whether it is alive; may be told the same twice."""


class BusError(Exception):
    """The bus could not do what was asked: one line with what, where, and what would be right."""


class Closing(ABC):
    """Closes itself at the end of a `with`, also when that ends by an exception."""

    @abstractmethod
    def close(self) -> None:
        """Let go of everything; a second time changes nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


class Bus(Protocol):
    """Publishes and subscribes bytes by key, and says who is alive."""

    def publish(self, key: str, data: bytes, *, urgent: bool = False) -> None:
        """Send `data` under `key`; never blocks for a slow or absent receiver."""

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        """Call `handler` for every message whose key matches (`*` one chunk, `**` any tail)."""

    def announce(self, vehicle: str) -> None:
        """Say that `vehicle` is alive, until this bus closes or its process dies."""

    def watch(self, handler: AliveHandler) -> None:
        """Call `handler` for every vehicle that is, becomes or ceases to be alive."""

    def close(self) -> None:
        """Hand on what was published, then leave."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...
