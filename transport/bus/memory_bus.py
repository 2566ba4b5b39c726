"""A bus within one process: synchronous and deterministic, for virtual time and for tests."""

from transport.bus.bus import AliveHandler, Closing, Handler


def matches(key_expression: str, key: str) -> bool:
    """Whether `key` is one of those that `key_expression` stands for.

    `*` stands for one chunk and a `**` at the end for any number of chunks; neither stands for a
    chunk that begins with `@`, as in Zenoh.
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
    """Shared by the memory buses of one process: their subscriptions, and the vehicles alive."""

    def __init__(self) -> None:
        self._subscriptions: list[tuple[object, str, Handler]] = []
        self._watchers: list[tuple[object, AliveHandler]] = []
        self._alive: dict[str, list[object]] = {}
        self._routes: dict[str, tuple[Handler, ...]] = {}

    def publish(self, key: str, data: bytes) -> None:
        """Deliver `data` to every subscription of `key`, in the order in which they were made."""
        route = self._routes.get(key)
        if route is None:
            route = tuple(h for _, wanted, h in self._subscriptions if matches(wanted, key))
            self._routes[key] = route
        for handler in route:
            handler(key, data)

    def subscribe(self, member: object, key_expression: str, handler: Handler) -> None:
        """Add a subscription of `member`."""
        self._subscriptions.append((member, key_expression, handler))
        self._routes.clear()

    def announce(self, member: object, vehicle: str) -> None:
        """Note that `vehicle` is alive until `member` leaves."""
        owners = self._alive.setdefault(vehicle, [])
        owners.append(member)
        if len(owners) == 1:
            self._tell(vehicle, alive=True)

    def watch(self, member: object, handler: AliveHandler) -> None:
        """Call `handler` for every vehicle that is alive, and at every change."""
        self._watchers.append((member, handler))
        for vehicle in self._alive:
            handler(vehicle, True)

    def leave(self, member: object) -> None:
        """Remove the subscriptions of `member`; its vehicles are alive no longer."""
        self._subscriptions = [row for row in self._subscriptions if row[0] is not member]
        self._watchers = [row for row in self._watchers if row[0] is not member]
        self._routes.clear()
        for vehicle, owners in list(self._alive.items()):
            owners[:] = [owner for owner in owners if owner is not member]
            if not owners:
                del self._alive[vehicle]
                self._tell(vehicle, alive=False)

    def _tell(self, vehicle: str, *, alive: bool) -> None:
        for _, handler in tuple(self._watchers):
            handler(vehicle, alive)


class MemoryBus(Closing):
    """One member of a `MemoryNetwork`; without one it is a network of its own."""

    def __init__(self, network: MemoryNetwork | None = None) -> None:
        self._network = network or MemoryNetwork()

    def publish(self, key: str, data: bytes, *, urgent: bool = False) -> None:  # noqa: ARG002
        """Deliver `data` to all subscriptions of `key` before this returns."""
        self._network.publish(key, data)

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        """Call `handler` for every message whose key matches (`*` one chunk, `**` any tail)."""
        self._network.subscribe(self, key_expression, handler)

    def announce(self, vehicle: str) -> None:
        """Announce that `vehicle` is alive, until this bus closes."""
        self._network.announce(self, vehicle)

    def watch(self, handler: AliveHandler) -> None:
        """Call `handler` for every vehicle that is, becomes or ceases to be alive."""
        self._network.watch(self, handler)

    def close(self) -> None:
        """Leave the network."""
        self._network.leave(self)
