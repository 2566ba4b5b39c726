"""`convoy record`: gathers the convoy, starts it, writes its log and ends it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue

from scenarios.definition.scenario import Scenario
from scenarios.results.summary import RunSummary
from scenarios.runs.processes.conductor import Conductor, Phase
from scenarios.runs.recorder import Listener
from scenarios.runs.run_log import RunLog
from scenarios.runs.stop import Stop
from transport.bus.zenoh_bus import ZenohBus
from transport.clock import WallClock
from transport.topics import CONDUCTOR, TOPICS, key
from vehicles.schedule import SECOND

POLL_S = 0.02
FLUSH_NS = SECOND * 2 // 5
"""Between two flushes of the log; a kill loses at most half a second."""
ANNOUNCE_NS = SECOND // 4
"""Between two announcements of the start, which late ears need."""
EVERYTHING = "convoy/**"
GATHER_S = 60.0
LAST_WORDS_NS = SECOND
"""How long the recorder of a run that ends early waits for what the vehicles still say."""
Arrival = tuple[int, str, bytes]


@dataclass(slots=True)
class Chores:
    """What is done every so often, each with the instant (ns) when it is due next."""

    due: dict[str, int] = field(default_factory=dict)

    def are_due(self, name: str, now: int, period_ns: int) -> bool:
        """Whether the chore `name` is due; if so the next is due a period later."""
        if now < self.due.get(name, 0):
            return False
        self.due[name] = now + period_ns
        return True


class Recording:
    """The loop of the recorder's process: arrivals into the log, time to the conductor."""

    def __init__(
        self,
        scenario: Scenario,
        bus: ZenohBus,
        folder: Path,
        stop: Stop,
        *,
        gather_s: float = GATHER_S,
        listeners: Sequence[Listener] = (),
    ) -> None:
        """Open the log in `folder` and listen to everything of the convoy."""
        self._clock = WallClock()
        self._bus = bus
        self._stop = stop
        self._conductor = Conductor(
            scenario.vehicle_names,
            duration_ns=round(scenario.duration_s * SECOND),
            goes_on_without_the_dead=scenario.goes_on_without_the_dead,
            gather_until=self._clock.now() + round(gather_s * SECOND),
        )
        self._run = RunLog(
            scenario,
            folder,
            clock="wall",
            run_id=folder.name,
            listeners=(self._conductor.listen, *listeners),
        )
        self._chores = Chores()
        self._own: list[tuple[str, bytes]] = []
        self._arrivals: SimpleQueue[Arrival] = SimpleQueue()
        self._presences: SimpleQueue[tuple[str, bool]] = SimpleQueue()
        bus.subscribe(EVERYTHING, self._arrive)
        bus.watch(lambda vehicle, alive: self._presences.put((vehicle, alive)))

    def carry_on(self) -> RunSummary:
        """Record until the run is over and complete the log; returns the summary."""
        while self._conductor.phase is not Phase.OVER:
            self._record_arrivals()
            self._conduct()
        end = self._run.end(self._clock.now(), self._conductor.reason)
        ending = self._own_message("end", end)
        if self._conductor.reason:
            self._bus.publish(*ending, urgent=True)
            self._await_last_words()
        return self._run.close(self._clock.now())

    def dismiss(self) -> None:
        """Say that the log is complete: now everyone may go."""
        self._bus.publish(*self._own[-1], urgent=True)

    def _await_last_words(self) -> None:
        until = self._clock.now() + LAST_WORDS_NS
        while self._clock.now() < until and self._conductor.awaits_last_words():
            self._record_arrivals()

    def _own_message(self, topic: str, data: bytes) -> tuple[str, bytes]:
        """Return a message of the run's own with its key; it will not be taken from the bus."""
        own = key(CONDUCTOR, TOPICS[topic]), data
        self._own.append(own)
        return own

    def _arrive(self, heard_key: str, data: bytes) -> None:
        self._arrivals.put((self._clock.now(), heard_key, data))

    def _record_arrivals(self) -> None:
        """Record what waits; without anything, wait a moment for something.

        What comes meanwhile is left for the next time: in a flood there would be no end to it, and
        the run has to be conducted and the log flushed.
        """
        for _ in range(max(1, self._arrivals.qsize())):
            try:
                at, heard_key, data = self._arrivals.get(timeout=POLL_S)
            except Empty:
                return
            if (heard_key, data) not in self._own:
                self._run.recorder.accept(heard_key, data, at)

    def _conduct(self) -> None:
        now = self._clock.now()
        while not self._presences.empty():
            vehicle, alive = self._presences.get()
            self._conductor.presence(vehicle, alive=alive, at=now)
        if self._stop.asked:
            self._conductor.stop(self._stop.reason)
        for line in self._conductor.advance(now, connected=self._bus.connected()):
            self._run.recorder.say(now, line)
        if self._conductor.phase is Phase.RUNNING:
            if not self._own:
                self._own_message("start", self._run.start(now, self._conductor.start_at))
            if self._chores.are_due("announce", now, ANNOUNCE_NS):
                self._bus.publish(*self._own[0], urgent=True)
            if self._chores.are_due("health", now, SECOND):
                self._run.recorder.report_health(now)
        if self._chores.are_due("flush", now, FLUSH_NS):
            self._run.flush()
