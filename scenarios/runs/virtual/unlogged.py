"""A virtual run of which nothing is written: the same figures as those of a logged run."""

from collections.abc import Callable, Container

from scenarios.definition.scenario import Scenario
from scenarios.results.limits import broken_limits, collision_ends_run, why_failed
from scenarios.results.metrics import Metrics
from scenarios.results.summary import RunIdentity, RunSummary
from scenarios.results.summing_up import silent_links, summarise
from scenarios.runs.node.fault import VehicleFaultError
from scenarios.runs.node.sink import BusSink
from scenarios.runs.stop import EXIT_FAILED, Stop
from scenarios.runs.virtual.convoy import VirtualConvoy
from transport.bus.bus import Bus
from transport.topics import CONDUCTOR
from vehicles.messages import GpsPose, Message, RunStart
from vehicles.schedule import nanoseconds


class FiguresSink:
    """Publishes poses for the convoy and gives all messages to the figures, not encoded."""

    def __init__(
        self,
        vehicle: str,
        bus: Bus,
        take: Callable[[Message], None],
        kinds: Container[type[Message]] | None = None,
    ) -> None:
        """`kinds` are those of which the figures are made, if not all are taken."""
        self._to_convoy = BusSink(vehicle, bus)
        self._take = take
        self._kinds = kinds

    def send(self, message: Message) -> None:
        """Take one message; a pose waits until `flush`."""
        if isinstance(message, GpsPose):
            self._to_convoy.send(message)
        self._take(message)

    def flush(self) -> None:
        """Publish the poses that wait."""
        self._to_convoy.flush()

    def reads(self, kind: type[Message]) -> bool:
        """Whether a kind carries a figure, or is for the convoy."""
        return self._kinds is None or kind in self._kinds or kind is GpsPose


class UnloggedRun:
    """One run of a scenario in virtual time, without a log."""

    def __init__(self, scenario: Scenario) -> None:
        self.convoy = VirtualConvoy(scenario)
        self._scenario = scenario
        self._metrics = Metrics.of(scenario, plotted=False)
        self._stop = Stop()
        self._limits = scenario.tables.limits
        self._events = self._metrics.events

    def take(self, message: Message) -> None:
        """Take a message into the figures; a collision may end the run."""
        self._metrics.add(message)
        collisions = self._events.collisions
        if collisions and collision_ends_run(self._limits, collisions):
            self._stop.ask(why_failed("", self._broken()), EXIT_FAILED)

    def run(self) -> RunSummary:
        """Run to the end; the summary."""
        start_at, clock = self._scenario.start_at_ns, self.convoy.clock
        identity = RunIdentity.here(self._scenario, "virtual", self._scenario.virtual_run_id)
        self._metrics.add(
            RunStart(vehicle=CONDUCTOR, seq=0, start_at_ns=start_at, run_id=identity.run_id)
        )
        bus, kinds = self.convoy.bus, self._metrics.kinds
        nodes = self.convoy.build(lambda vehicle: FiguresSink(vehicle, bus, self.take, kinds))
        try:
            self.convoy.run(self._stop)
        except VehicleFaultError as fault:
            self._stop.ask(str(fault), EXIT_FAILED)
        for name, node in nodes.items():
            if name not in self.convoy.left:
                node.outbox.publish_health(clock.now(), final=True)
        self._metrics.events.finish()
        return summarise(
            identity,
            self._scenario,
            self._metrics,
            ran_ns=self._ran_ns,
            reason=self._stop.reason or silent_links(self._metrics, off=self._scenario.off_links),
            rejected={},
        )

    @property
    def _ran_ns(self) -> int:
        return min(
            self.convoy.clock.now() - self._scenario.start_at_ns,
            nanoseconds(self._scenario.duration_s),
        )

    def _broken(self) -> list[str]:
        vehicles = self._metrics.vehicle_summaries(self._ran_ns)
        deadlines = self._metrics.deadlines.figures(self._ran_ns)
        events = self._metrics.events.events()
        return broken_limits(self._limits, events, vehicles, deadlines)


def run_unlogged(scenario: Scenario) -> RunSummary:
    """Run `scenario` in virtual time; returns the summary that a logged run of it would have."""
    return UnloggedRun(scenario).run()
