"""Interface of a bus, which carries bytes between the processes of a convoy."""

from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

from transport.texts import ConvoyError

Handler = Callable[[str, bytes], None]  # Key, payload; on a thread of the bus, never raises
ArrivalHandler = Callable[[str, bytes, int], None]  # Key, payload, arrival (ns)
Fetch = Callable[[], bool]  # Passes messages on; returns whether some may be lost


@dataclass(frozen=True, slots=True)
class Member:
    """A process that takes part in a run, as announced.

    role         vehicle or recorder
    name         name of the vehicle
    fingerprint  identifies the run, as one chunk of a key
    session      identifier of the bus, which distinguishes processes of the same name
    """

    role: str
    name: str
    fingerprint: str
    session: str


Answer = Callable[[bytes], bytes]  # On a thread of the bus; must be quick and never raise
AliveHandler = Callable[[Member, bool], None]  # May repeat a call


class BusError(ConvoyError):
    """A failure of the bus, in one line."""


class Bus(Protocol):
    """Publishes bytes by key, subscribes to them, and reports which members are alive.

    `close_timeout_s` limits the wait at closing for publications to be received.
    """

    close_timeout_s: float

    @property
    def zid(self) -> str:
        """Unique identifier of this session."""

    def publish(self, key: str, data: bytes, *, urgent: bool = False) -> None:
        """Send `data` under `key`; never blocks for slow or absent receivers."""

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        """Call `handler` for every message whose key matches: `*` one chunk, `**` any tail."""

    def collect(
        self, key: str, handler: ArrivalHandler, most: int, now: Callable[[], int]
    ) -> Fetch:
        """Buffer the newest `most` messages under `key` until they are fetched.

        The returned function passes them to `handler`, on the calling thread, each with the value
        of `now` at its arrival. It returns whether some may have been dropped because the buffer
        was full.
        """

    def connected(self) -> bool:
        """Whether another member can be reached."""

    def answer(self, key: str, answer: Answer) -> None:
        """Answer each query for `key`, until this bus closes."""

    def query(self, key: str, timeout_s: float, payload: bytes = b"") -> bytes | None:
        """Answer to a query for `key`; None after `timeout_s` without an answer."""

    def request(
        self, key: str, handler: Callable[[bytes], None], timeout_s: float, payload: bytes = b""
    ) -> None:
        """Send a query for `key` without waiting; `handler` takes each answer that comes.

        It is called on a thread of the bus; must be quick and never raise.
        """

    def announce(self, role: str, name: str, fingerprint: str) -> None:
        """Announce a member as alive until this bus closes or its process ends."""

    def watch(self, handler: AliveHandler) -> None:
        """Call `handler` for every member alive now, and at every change."""

    def members(self) -> set[Member]:
        """Members alive now; only for sessions that have not called `watch`."""

    def close(self) -> None:
        """Deliver pending publications, then leave the network."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...
