"""The interface of a bus, which carries bytes between the vehicles of a convoy."""

from collections.abc import Callable
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

Handler = Callable[[str, bytes], None]
"""Is given a message's key and payload, on a thread of the bus; must be quick and never raise."""
Fetch = Callable[[], bool]
"""Gives what has come to a handler; says whether it may have been too much to keep."""


@dataclass(frozen=True, slots=True)
class Member:
    """A process that takes part in a run, as it announces itself.

    role         vehicle or recorder
    name         the vehicle's name
    fingerprint  what it takes part in, as one chunk of a key
    session      identifier of its bus, which tells two of the same name apart
    """

    role: str
    name: str
    fingerprint: str
    session: str


Answer = Callable[[bytes], bytes]
"""Answers what is asked, on a thread of the bus; must be quick and never raise."""
AliveHandler = Callable[[Member, bool], None]
"""Is given a member and whether it is alive; may be called twice with the same."""


class BusError(Exception):
    """The bus could not do what was asked: one line that says what, where, and what is allowed."""


class Bus(Protocol):
    """Publishes and subscribes bytes by key, and reports which members are alive."""

    @property
    def zid(self) -> str:
        """Identifier of this session, unlike that of any other."""

    def publish(self, key: str, data: bytes, *, urgent: bool = False) -> None:
        """Send `data` under `key`; never blocks for a slow or absent receiver."""

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        """Call `handler` for every message whose key matches (`*` one chunk, `**` any tail)."""

    def collect(self, key: str, handler: Handler, most: int) -> Fetch:
        """Keep what comes under `key` until it is fetched, the newest `most` of it.

        Returns what gives it all to `handler`, on the thread that calls it, and says whether some
        may have been lost because more came.
        """

    def connected(self) -> bool:
        """Whether anyone can be reached."""

    def answer(self, key: str, answer: Answer) -> None:
        """Answer each question for `key`, until this bus closes."""

    def ask(self, key: str, timeout_s: float, question: bytes = b"") -> bytes | None:
        """Return the answer to a question for `key`; None if nobody gives one in time."""

    def announce(self, role: str, name: str, fingerprint: str) -> None:
        """Announce a member as alive, until this bus closes or its process ends."""

    def watch(self, handler: AliveHandler) -> None:
        """Call `handler` for every member that is, becomes or ceases to be alive."""

    def members(self) -> set[Member]:
        """Return the members that are alive now; to be asked before `watch`, or without."""

    def close(self) -> None:
        """Deliver what was published, then leave the network."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...
