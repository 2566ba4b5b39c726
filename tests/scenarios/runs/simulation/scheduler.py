"""Runs the roles of a run one at a time, each on a thread of its own, on a virtual clock."""

import heapq
import sys
import traceback
from collections.abc import Callable
from itertools import count
from random import Random
from threading import Event, Lock, Thread

from vehicles.schedule import MILLISECOND, SECOND

Action = Callable[[], object]


class KilledError(BaseException):
    """Unwinds the thread of a killed role."""


class Scheduler:
    """Virtual time (ns): carries out actions in order, and lets one role run at a time."""

    def __init__(self, random: Random) -> None:
        self.random = random
        self.now = 0
        self.busy_until = 0
        """Until then sleeps are as short as requested."""
        self.current: Role | None = None
        self.roles: list[Role] = []
        self.switches = 0
        self._actions: list[tuple[int, int, Action]] = []
        self._numbers = count()
        self._returned = Lock()
        self._returned.acquire()

    def at(self, instant: int, action: Action) -> None:
        heapq.heappush(self._actions, (max(instant, self.now), next(self._numbers), action))

    def after(self, span: int, action: Action) -> None:
        self.at(self.now + span, action)

    def keep_busy(self, span: int) -> None:
        self.busy_until = max(self.busy_until, self.now + span)

    def run(self, until: int) -> bool:
        """Run to the end of all roles; False if some still run at the instant `until`."""
        while any(not role.ended for role in self.roles):
            if not self._actions or self._actions[0][0] > until:
                return False
            instant, _, action = heapq.heappop(self._actions)
            self.now = instant
            action()
        return True

    def switch_to(self, role: "Role") -> None:
        """Let a role run until it waits or ends."""
        self.current = role
        self.switches += 1
        role.baton.release()
        self._returned.acquire()
        self.current = None

    def give_back(self) -> None:
        """Called by a role that waits or has ended."""
        self._returned.release()

    def unwind(self) -> None:
        """End all threads."""
        for role in self.roles:
            role.killed = True
            if not role.ended:
                self.switch_to(role)


class Role:
    """One process of a run: a function on a thread that holds the baton or waits for it."""

    def __init__(self, scheduler: Scheduler, name: str, work: Callable[[], int]) -> None:
        self.scheduler = scheduler
        self.name = name
        self.killed = False
        self.ended = False
        self.exit_code: int | None = None
        self.crash = ""
        """Traceback of an unexpected error."""
        self.paused_until = 0
        self.on_end: list[Action] = []
        self.baton = Lock()
        self.baton.acquire()
        self._work = work
        self._turn = 0
        self._event: Event | None = None
        self._thread = Thread(target=self._run, name=name, daemon=True)
        scheduler.roles.append(self)

    def start(self) -> None:
        self._thread.start()
        self._turn += 1
        self._wake_at(self.scheduler.now, self._turn)

    def _run(self) -> None:
        self.baton.acquire()
        try:
            if not self.killed:
                self.exit_code = self._work()
        except KilledError:
            pass
        except SystemExit as end:
            self.exit_code = int(end.code or 0)
        except BaseException:  # noqa: BLE001 - reported by the invariants
            self.crash = traceback.format_exc()
            self.exit_code = 70
        finally:
            if self.killed and self.exit_code is None:
                self.exit_code = -9
            self.ended = True
            for action in self.on_end:
                self.scheduler.after(0, action)
            self.scheduler.give_back()

    def waits_in(self) -> str:
        """Functions in which the role waits, innermost last."""
        frame = sys._current_frames().get(self._thread.ident or 0)
        stack = traceback.extract_stack(frame) if frame is not None else []
        return " > ".join(entry.name for entry in stack[-8:])

    @property
    def is_running(self) -> bool:
        return self.scheduler.current is self

    def wait(self, span: int, event: Event | None = None) -> None:
        """Wait for `span` (ns of true time) or for an event; called by the role itself."""
        if self.killed:
            raise KilledError
        if event is not None and event.is_set():
            return
        self._event = event
        self._turn += 1
        self._wake_at(self.scheduler.now + span, self._turn)
        self.scheduler.give_back()
        self.baton.acquire()
        self._event = None
        if self.killed:
            raise KilledError

    def notice(self) -> None:
        """Wake the role if the event that it waits for is set."""
        if self._event is not None and self._event.is_set():
            self._wake_at(self.scheduler.now, self._turn)

    def pause(self, span: int) -> None:
        self.paused_until = max(self.paused_until, self.scheduler.now + span)

    def kill(self) -> None:
        if not self.ended and not self.killed:
            self.killed = True
            self.paused_until = 0
            self._wake_at(self.scheduler.now, self._turn)

    def _wake_at(self, instant: int, turn: int) -> None:
        self.scheduler.at(instant, lambda: self._wake(turn))

    def _wake(self, turn: int) -> None:
        if self.ended or turn != self._turn:
            return
        if self.scheduler.now < self.paused_until:
            self._wake_at(self.paused_until, turn)
            return
        self._turn += 1
        self.scheduler.switch_to(self)


class HostClock:
    """Clocks of a host: off by `offset` (ns), running faster by the share `drift`."""

    def __init__(self, scheduler: Scheduler, *, offset: int = 0, drift: float = 0.0) -> None:
        self._scheduler = scheduler
        self._offset = offset
        self._rate = 1.0 + drift
        self._booted = scheduler.random.randrange(10**6 * MILLISECOND)

    def monotonic(self) -> int:
        return self._booted + round(self._scheduler.now * self._rate)

    def unix(self) -> int:
        return self.unix_at(self._scheduler.now)

    def unix_at(self, instant: int) -> int:
        """Unix time (ns) by this clock at a true instant."""
        return BEGUN_AT + self._offset + round(instant * self._rate)

    def true_span(self, seconds: float) -> int:
        """True time (ns) of a time by this clock."""
        return round(seconds * SECOND / self._rate)


BEGUN_AT = 1_790_000_000 * SECOND
"""True Unix time (ns) at the instant 0."""
