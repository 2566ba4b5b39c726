"""Interface of a bus, which carries bytes between the processes of a convoy."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count
from types import TracebackType
from typing import Protocol, Self

from transport.closing import Closing
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


# ---- Bus within one process, synchronous and deterministic, for virtual time and tests


def matches(key_expression: str, key: str) -> bool:
    """Whether `key` matches: `*` one chunk, `**` at the end any number of chunks.

    As in Zenoh, neither matches chunks that begin with `@`.
    """
    wanted, chunks = key_expression.split("/"), key.split("/")
    if wanted[-1] == "**":
        wanted.pop()
        tail, chunks = chunks[len(wanted) :], chunks[: len(wanted)]
        if any(chunk.startswith("@") for chunk in tail):
            return False
    return len(wanted) == len(chunks) and all(
        want == chunk or (want == "*" and not chunk.startswith("@"))
        for want, chunk in zip(wanted, chunks, strict=True)
    )


class MemoryNetwork:
    """Subscriptions and members of the memory buses of one process."""

    def __init__(self) -> None:
        self._subscriptions: list[tuple[object, str, Handler]] = []
        self._watchers: list[tuple[object, AliveHandler]] = []
        self._alive: dict[Member, object] = {}
        self._answers: dict[str, tuple[object, Answer]] = {}
        self._sessions = count()
        self._routes: dict[str, tuple[Handler, ...]] = {}

    @property
    def alive(self) -> set[Member]:
        return set(self._alive)

    def new_session(self) -> str:
        return f"{next(self._sessions):x}"

    def publish(self, key: str, data: bytes) -> None:
        """Deliver `data` to every matching subscription, in the order of subscription."""
        route = self._routes.get(key)
        if route is None:
            route = tuple(h for _, wanted, h in self._subscriptions if matches(wanted, key))
            self._routes[key] = route
        for handler in route:
            handler(key, data)

    def subscribe(self, bus: object, key_expression: str, handler: Handler) -> None:
        self._subscriptions.append((bus, key_expression, handler))
        self._routes.clear()

    def answer(self, bus: object, key: str, answer: Answer) -> None:
        self._answers[key] = bus, answer

    def query(self, key: str, payload: bytes) -> bytes | None:
        return self._answers[key][1](payload) if key in self._answers else None

    def announce(self, bus: object, member: Member) -> None:
        if member not in self._alive:
            self._alive[member] = bus
            self._notify(member, alive=True)

    def watch(self, bus: object, handler: AliveHandler) -> None:
        self._watchers.append((bus, handler))
        for member in self._alive:
            handler(member, True)

    def leave(self, bus: object) -> None:
        """Remove the subscriptions, answers and members of `bus`."""
        self._subscriptions = [row for row in self._subscriptions if row[0] is not bus]
        self._watchers = [row for row in self._watchers if row[0] is not bus]
        self._routes.clear()
        self._answers = {key: row for key, row in self._answers.items() if row[0] is not bus}
        for member in [member for member, owner in self._alive.items() if owner is bus]:
            del self._alive[member]
            self._notify(member, alive=False)

    def _notify(self, member: Member, *, alive: bool) -> None:
        for _, handler in tuple(self._watchers):
            handler(member, alive)


class MemoryBus(Closing):
    """A bus (`transport.bus.bus.Bus`) on a `MemoryNetwork`, by default on a new one."""

    def __init__(self, network: MemoryNetwork | None = None) -> None:
        self._network = network or MemoryNetwork()
        self.zid = self._network.new_session()
        self.close_timeout_s = 0.0

    def connected(self) -> bool:
        return True

    def publish(self, key: str, data: bytes, *, urgent: bool = False) -> None:
        self._network.publish(key, data)

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        self._network.subscribe(self, key_expression, handler)

    def collect(
        self, key: str, handler: ArrivalHandler, most: int, now: Callable[[], int]
    ) -> Fetch:
        kept: deque[tuple[bytes, int]] = deque(maxlen=most)
        self.subscribe(key, lambda _, data: kept.append((data, now())))

        def fetch() -> bool:
            is_full = len(kept) == most
            while kept:
                handler(key, *kept.popleft())
            return is_full

        return fetch

    def answer(self, key: str, answer: Answer) -> None:
        self._network.answer(self, key, answer)

    def query(self, key: str, timeout_s: float, payload: bytes = b"") -> bytes | None:
        return self._network.query(key, payload)

    def request(
        self, key: str, handler: Callable[[bytes], None], timeout_s: float, payload: bytes = b""
    ) -> None:
        answer = self._network.query(key, payload)
        if answer is not None:
            handler(answer)

    def announce(self, role: str, name: str, fingerprint: str) -> None:
        self._network.announce(self, Member(role, name, fingerprint, self.zid))

    def watch(self, handler: AliveHandler) -> None:
        self._network.watch(self, handler)

    def members(self) -> set[Member]:
        return self._network.alive

    def close(self) -> None:
        self._network.leave(self)
