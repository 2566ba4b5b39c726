"""The observer that ends a run early, when a limit requires that."""

from scenarios.definition.schema.limit_tables import LimitsTable
from scenarios.results.limits.evaluation import broken_limits, collision_ends_run, failure_reason
from scenarios.results.metrics import Metrics
from vehicles.messages import Message, TruePose


class LimitWatch:
    """Observer that ends a run early after collisions that break a limit.

    `metrics` must receive each message first. `reason` is empty until the run has to end.
    """

    kinds: frozenset[type[Message]] = frozenset({TruePose})  # nothing else brings collisions

    def __init__(self, limits: LimitsTable, metrics: Metrics) -> None:
        self._limits = limits
        self._metrics = metrics
        self.reason = ""

    def listen(self, at: int, _pose: Message) -> None:
        collisions = self._metrics.events.collisions
        if collisions and not self.reason and collision_ends_run(self._limits, collisions):
            ran_ns = max(at - (self._metrics.start_at or 0), 0)
            self.reason = failure_reason("", self.broken(ran_ns))

    def broken(self, ran_ns: int) -> list[str]:
        """List the limits broken after `ran_ns`, a line each."""
        return broken_limits(
            self._limits,
            self._metrics.events.events(),
            self._metrics.vehicle_summaries(ran_ns),
            self._metrics.deadlines.figures(ran_ns),
            self._metrics.unseen(ran_ns),
        )
