"""Bus within one process, synchronous and deterministic, for virtual time and tests."""

from collections import deque
from collections.abc import Callable
from itertools import count

from transport.bus.bus import AliveHandler, Answer, ArrivalHandler, Fetch, Handler, Member
from transport.closing import Closing


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
