"""A bus with a router on virtual time: leases, liveliness and losses as measured of Zenoh.

A session that is cut off or frozen keeps its messages until its lease expires: shorter cuts lose
nothing, and everything arrives at once afterwards. Then its tokens disappear everywhere, and it
reports the loss of its router. The end of a process is seen within milliseconds; the end of the
router takes all tokens with it.
"""

from collections import Counter, defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from threading import Event

from tests.scenarios.runs.simulation.scheduler import Action, Role, Scheduler
from transport.bus.bus import (
    AliveHandler,
    Answer,
    ArrivalHandler,
    BusError,
    Fetch,
    Handler,
    Member,
    MemoryNetwork,
)
from transport.bus.zenoh_options import ZenohOptions
from transport.closing import Closing
from vehicles.schedule import MILLISECOND, SECOND

MEMBERS_NS = 2 * SECOND
NOTICED_NS = 2 * MILLISECOND
"""From the end of a process or a router to its notice by the others."""
CONNECT_NS = 5 * MILLISECOND


@dataclass(frozen=True, slots=True, kw_only=True)
class NetworkSettings:
    """How a network behaves; times in ns.

    Loss, duplication and reordering concern messages, not tokens and queries.
    """

    delay: int = MILLISECOND // 4
    jitter: int = MILLISECOND // 4
    loss_ratio: float = 0.0
    duplicate_ratio: float = 0.0
    reorder_ratio: float = 0.0
    query_loss_ratio: float = 0.0
    lease: int = 10 * SECOND
    retry: int = 500 * MILLISECOND


class SimulatedNetwork:
    """A router and its sessions."""

    def __init__(self, scheduler: Scheduler, settings: NetworkSettings) -> None:
        self.scheduler = scheduler
        self.settings = settings
        self.router = MemoryNetwork()
        self.answers: dict[str, tuple[SimulatedBus, Answer]] = {}
        self.is_up = False
        self.frozen_until = 0
        self.sessions: list[SimulatedBus] = []
        self.disturbed: set[str] = set()
        """Roles whose link was cut or lost while they ran."""
        self.published: defaultdict[str, list[tuple[int, bytes]]] = defaultdict(list)
        """Messages of the roles by key, with the true instant of sending."""
        self.received: defaultdict[str, list[tuple[int, bytes]]] = defaultdict(list)
        """Messages that reached the recorder, likewise."""
        self.states: Counter[str] = Counter()

    def start_router(self) -> None:
        self.is_up = True

    def stop_router(self) -> None:
        """End the router: every session loses its link."""
        if not self.is_up:
            return
        self.is_up = False
        self.states["router ended"] += 1
        for session in list(self.sessions):
            session.lose_link(NOTICED_NS)

    def freeze_router(self, span: int) -> None:
        self.frozen_until = self.scheduler.now + span
        for session in list(self.sessions):
            session.block(span)

    def open(self, role: Role, options: ZenohOptions) -> "SimulatedBus":
        deadline = self.scheduler.now + round(options.connect_timeout_s * SECOND)
        while not self.is_up or self.scheduler.now < self.frozen_until:
            if self.scheduler.now >= deadline:
                raise BusError("cannot join through the simulated router; is a router there?")
            role.wait(50 * MILLISECOND)
        role.wait(CONNECT_NS)
        return SimulatedBus(self, role)


class SimulatedBus(Closing):
    """A session of one role (`transport.bus.bus.Bus`)."""

    def __init__(self, network: SimulatedNetwork, role: Role) -> None:
        self.close_timeout_s = 1.0
        self.zid = f"{network.scheduler.random.getrandbits(64):016x}"
        self.role = role
        self._network = network
        self._scheduler = network.scheduler
        self._declared: list[Action] = []
        self._watchers: list[Callable[[], None]] = []
        self._link = 0  # number of the present link to the router
        self._is_linked = True
        self._is_closed = False
        self._blocked_until = 0
        self._block = 0
        self._held: list[tuple[int, Action]] = []
        self._up_at = self._down_at = 0
        network.sessions.append(self)
        role.on_end.append(self._note_end)

    # ---- The link

    def block(self, span: int) -> None:
        """Cut the link, or freeze one of its ends, for `span` (ns)."""
        until = self._scheduler.now + span
        if self._is_closed or until <= self._blocked_until:
            return
        self._network.disturbed.add(self.role.name)
        began = self._blocked_until <= self._scheduler.now
        self._blocked_until = until
        if began:
            self._block += 1
            lease, block = self._network.settings.lease, self._block
            self._scheduler.after(lease, lambda: self._expire(block))
        self._scheduler.at(until, self._unblock)

    def _is_blocked(self) -> bool:
        return self._scheduler.now < self._blocked_until

    def _expire(self, block: int) -> None:
        if self._is_blocked() and self._block == block and self._is_linked:
            self._network.states["lease expired"] += 1
            self.lose_link(0)

    def _unblock(self) -> None:
        if self._is_blocked():
            return
        held, self._held = self._held, []
        for link, action in held:
            if link == self._link:
                action()
        if self._is_closed:
            self._scheduler.after(NOTICED_NS, lambda: self.lose_link(0))

    def lose_link(self, noticed: int) -> None:
        """Drop the link: messages on it are lost, tokens disappear, later it is restored."""
        if not self._is_linked:
            return
        self._is_linked = False
        self._link += 1
        self._held.clear()
        self._network.router.leave(self)
        self._drop_answers()
        if self._is_closed or self.role.ended:
            return
        self._network.disturbed.add(self.role.name)
        self._scheduler.after(noticed, self._report_loss)
        self._scheduler.after(self._retry_ns(), self._reconnect)

    def _retry_ns(self) -> int:
        retry = self._network.settings.retry
        return self._scheduler.random.randrange(retry // 10, retry)

    def _report_loss(self) -> None:
        """Report all members as gone, when the process runs again."""
        if self._scheduler.now < self.role.paused_until:
            self._scheduler.at(self.role.paused_until, self._report_loss)
            return
        if not self._is_linked and not self._is_closed and not self.role.ended:
            for forget in self._watchers:
                forget()

    def _reconnect(self) -> None:
        if self._is_closed or self.role.ended or self._is_linked:
            return
        frozen = self._scheduler.now < self._network.frozen_until
        if not self._network.is_up or frozen or self._is_blocked():
            self._scheduler.after(self._retry_ns(), self._reconnect)
            return
        self._network.states["reconnected"] += 1
        self._is_linked = True
        for declare in self._declared:
            self._up(declare)

    def _note_end(self) -> None:
        """Let the router notice the end of the process."""
        if self._is_closed:
            return
        self._is_closed = True
        if self._is_blocked():
            return  # noticed when the lease expires
        self._scheduler.after(NOTICED_NS, lambda: self.lose_link(0))

    def _up(self, action: Action, *, is_data: bool = False) -> None:
        """Carry out an action at the router."""
        self._carry(action, is_data=is_data, up=True)

    def down(self, action: Action, *, is_data: bool = False) -> None:
        """Carry out an action in the process, called by the router."""

        def arrive() -> None:
            if self._is_closed or self.role.ended:
                return
            if self._scheduler.now < self.role.paused_until:
                self._hold(self.role.paused_until, arrive)
                return
            action()
            self.role.notice()

        self._carry(arrive, is_data=is_data, up=False)

    def _hold(self, until: int, action: Action) -> None:
        link = self._link
        self._scheduler.at(until, lambda: action() if link == self._link else None)

    def _carry(self, action: Action, *, is_data: bool, up: bool) -> None:
        if not self._is_linked:
            return
        settings, random = self._network.settings, self._scheduler.random
        copies = 1
        if is_data:
            if settings.loss_ratio and random.random() < settings.loss_ratio:
                self._network.states["message lost"] += 1
                return
            if settings.duplicate_ratio and random.random() < settings.duplicate_ratio:
                copies = 2
        for _ in range(copies):
            delay = settings.delay + round(random.random() * settings.jitter)
            at = self._scheduler.now + delay
            if is_data and settings.reorder_ratio and random.random() < settings.reorder_ratio:
                at += delay + random.randrange(100 * MILLISECOND)
            elif up:
                self._up_at = at = max(at, self._up_at)
            else:
                self._down_at = at = max(at, self._down_at)
            self._scheduler.at(at, partial(self._arrive, self._link, action))

    def _arrive(self, link: int, action: Action) -> None:
        if link != self._link:
            return
        if self._is_blocked():
            self._held.append((link, action))
            return
        action()

    # ---- The bus

    def connected(self) -> bool:
        return self._is_linked

    def publish(self, key: str, data: bytes, *, urgent: bool = False) -> None:  # noqa: ARG002
        if self._is_closed or self.role.killed:
            return
        if self.role.name != "stranger":
            self._network.published[key].append((self._scheduler.now, data))
        self._up(lambda: self._network.router.publish(key, data), is_data=True)

    def subscribe(self, key_expression: str, handler: Handler) -> None:
        def take(key: str, data: bytes) -> None:
            if self.role.name == "recorder":
                self._network.received[key].append((self._scheduler.now, data))
            handler(key, data)

        def receive(key: str, data: bytes) -> None:
            self.down(lambda: take(key, data), is_data=True)

        self._declare(lambda: self._network.router.subscribe(self, key_expression, receive))

    def collect(
        self, key: str, handler: ArrivalHandler, most: int, now: Callable[[], int]
    ) -> Fetch:
        kept: list[tuple[bytes, int]] = []

        def keep(_key: str, data: bytes) -> None:
            kept.append((data, now()))
            del kept[:-most]

        def fetch() -> bool:
            taken, kept[:] = list(kept), []
            for data, arrived_at in taken:
                handler(key, data, arrived_at)
            return len(taken) >= most

        self.subscribe(key, keep)
        return fetch

    def answer(self, key: str, answer: Answer) -> None:
        def declare() -> None:
            self._network.answers[key] = self, answer

        self._declare(declare)

    def request(
        self, key: str, handler: Callable[[bytes], None], timeout_s: float, payload: bytes = b""
    ) -> None:
        settings, random = self._network.settings, self._scheduler.random
        if settings.query_loss_ratio and random.random() < settings.query_loss_ratio:
            self._network.states["query lost"] += 1
            return
        deadline = self._scheduler.now + round(timeout_s * SECOND)

        def deliver(data: bytes) -> None:
            if self._scheduler.now <= deadline:
                handler(data)

        def ask() -> None:
            asked = self._network.answers.get(key)
            if asked is None:
                return
            server, answer = asked
            server.down(
                lambda: server._reply(
                    answer(payload), lambda data: self.down(lambda: deliver(data))
                )
            )

        self._up(ask)

    def _reply(self, data: bytes, send: Callable[[bytes], None]) -> None:
        self._up(lambda: send(data))

    def query(self, key: str, timeout_s: float, payload: bytes = b"") -> bytes | None:
        received: list[bytes] = []
        came = Event()

        def receive(data: bytes) -> None:
            received.append(data)
            came.set()

        self.request(key, receive, timeout_s, payload)
        self.role.wait(round(timeout_s * SECOND), came)
        return received[0] if received else None

    def announce(self, role: str, name: str, fingerprint: str) -> None:
        member = Member(role, name, fingerprint, self.zid)
        self._declare(lambda: self._network.router.announce(self, member))

    def watch(self, handler: AliveHandler) -> None:
        """Report each change once; on the loss of the router all members disappear."""
        alive: set[Member] = set()

        def note(member: Member, is_alive: bool) -> None:
            if is_alive != (member in alive):
                (alive.add if is_alive else alive.discard)(member)
                handler(member, is_alive)

        def forget() -> None:
            for member in sorted(alive, key=lambda each: each.session):
                note(member, False)

        def receive(member: Member, is_alive: bool) -> None:
            self.down(lambda: note(member, is_alive))

        self._watchers.append(forget)
        self._declare(lambda: self._network.router.watch(self, receive))

    def members(self) -> set[Member]:
        received: list[set[Member]] = []
        came = Event()

        def receive(alive: set[Member]) -> None:
            received.append(alive)
            came.set()

        def look() -> None:
            alive = self._network.router.alive
            self.down(lambda: receive(alive))

        self._up(look)
        self.role.wait(MEMBERS_NS, came)
        return received[0] if received else set()

    def close(self) -> None:
        """Wait until the router has received everything, then leave."""
        if self._is_closed:
            return
        if self.role.killed:
            return
        flushed = Event()
        if self._is_linked:
            self._up(lambda: self.down(flushed.set))
        self.role.wait(round(self.close_timeout_s * SECOND), flushed)
        self._is_closed = True
        if self._is_blocked():
            return
        self.lose_link(0)

    def _declare(self, declare: Action) -> None:
        self._declared.append(declare)
        self._up(declare)

    def _drop_answers(self) -> None:
        answers = self._network.answers
        for key in [key for key, (bus, _) in answers.items() if bus is self]:
            del answers[key]
