"""`convoy record`: gathers the convoy, starts it, writes its log and ends it."""

from collections.abc import Sequence
from contextlib import suppress
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
from transport.log.records import LogError
from transport.topics import CONDUCTOR, TOPICS, key
from vehicles.schedule import SECOND, Timer

POLL_S = 0.02
FLUSH_NS = SECOND * 2 // 5
"""Between two flushes of the log; a kill loses at most half a second."""
ANNOUNCE_NS = SECOND // 4
"""Between two announcements of the start, for vehicles whose subscription came late."""
EVERYTHING = "convoy/**"
GATHER_S = 60.0
CANCELLED_NS = SECOND
"""How long the recorder of a run that ends early waits for the vehicles' final counters."""
Arrival = tuple[int, str, bytes]


class RecorderProcess:
    """The recorder as a process: logs what arrives, and starts and ends the run."""

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
        """Open the log in `folder` and subscribe to everything that the convoy publishes."""
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
        self._announcing, self._reporting = Timer(ANNOUNCE_NS), Timer(SECOND)
        self._flushing = Timer(FLUSH_NS)
        self._own: list[tuple[str, bytes]] = []
        self._arrivals: SimpleQueue[Arrival] = SimpleQueue()
        self._presences: SimpleQueue[tuple[str, bool]] = SimpleQueue()
        bus.subscribe(EVERYTHING, self._arrive)
        bus.watch(lambda vehicle, alive: self._presences.put((vehicle, alive)))

    def record_until_over(self) -> RunSummary:
        """Record until the run is over and complete the log; returns the summary."""
        while self._conductor.phase is not Phase.OVER:
            try:
                self._record_arrivals()
                self._advance()
            except LogError as error:  # the disk is full, or the log was removed
                self._conductor.stop(str(error))
        end = self._run.end(self._clock.now(), self._conductor.reason)
        ending = self._own_message("end", end)
        if self._conductor.reason:
            self._bus.publish(*ending, urgent=True)
            self._await_final_counters()
        return self._run.close(self._clock.now())

    def announce_completion(self) -> None:
        """Announce that the log is complete, for which the vehicles wait before they end."""
        self._bus.publish(*self._own[-1], urgent=True)

    def _await_final_counters(self) -> None:
        until = self._clock.now() + CANCELLED_NS
        while self._clock.now() < until and self._conductor.awaits_final_counters():
            with suppress(LogError):  # the run has a reason to end already
                self._record_arrivals()

    def _own_message(self, topic: str, data: bytes) -> tuple[str, bytes]:
        """Return a message of the run's own with its key; it is not recorded from the bus again."""
        own = key(CONDUCTOR, TOPICS[topic]), data
        self._own.append(own)
        return own

    def _arrive(self, key_expression: str, data: bytes) -> None:
        self._arrivals.put((self._clock.now(), key_expression, data))

    def _record_arrivals(self) -> None:
        """Record what has arrived; if nothing has, wait at most `POLL_S` for something.

        What arrives meanwhile is left for the next call: under a flood of messages this would not
        return, and the run has to be advanced and the log flushed.
        """
        for _ in range(max(1, self._arrivals.qsize())):
            try:
                at, key_expression, data = self._arrivals.get(timeout=POLL_S)
            except Empty:
                return
            if (key_expression, data) not in self._own:
                self._run.recorder.accept(key_expression, data, at)

    def _advance(self) -> None:
        now = self._clock.now()
        while not self._presences.empty():
            vehicle, alive = self._presences.get()
            self._conductor.presence(vehicle, alive=alive, at=now)
        if self._stop.asked:
            self._conductor.stop(self._stop.reason)
        elif reason := self._run.must_end:
            self._conductor.stop(reason)
        for line in self._conductor.advance(now, connected=self._bus.connected()):
            self._run.recorder.say(now, line)
        if self._conductor.phase is Phase.RUNNING:
            if not self._own:
                self._own_message("start", self._run.start(now, self._conductor.start_at))
            if self._announcing.is_due(now):
                self._bus.publish(*self._own[0], urgent=True)
            if self._reporting.is_due(now):
                self._run.recorder.report_health(now)
        if self._flushing.is_due(now):
            self._run.flush()
