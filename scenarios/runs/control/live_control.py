"""Answers of a vehicle to change requests."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from math import ceil

from scenarios.definition.changing.link_changes import concerns
from scenarios.definition.changing.live_change import ChangeRequest, describe_change, read_change
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.change_tables import AnyChange
from scenarios.runs.node.pending_changes import DueChange, PendingChanges
from transport.bus.bus import Bus
from transport.topics import control_key
from vehicles.schedule import SECOND, Cadence, instant, nanoseconds

PERIODS_AHEAD = 2
"""Control periods from a request to its effect: that tick has not begun yet."""
FARTHEST_NS = SECOND
"""A requested instant lies at most this far ahead."""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """Answer of a vehicle to a change: what it does, and from when on (s after the start).

    `does` is empty if the change is not about the vehicle; `refused` lists why nothing is done.
    """

    vehicle: str
    from_s: float = 0.0
    does: str = ""
    refused: tuple[str, ...] = ()

    @property
    def text(self) -> bytes:
        return json.dumps(asdict(self)).encode()

    @classmethod
    def of(cls, answer: bytes) -> "Confirmation":
        """Parse an answer; raises ValueError."""
        try:
            fields = json.loads(answer)
            return cls(
                str(fields["vehicle"]),
                float(fields["from_s"]),
                str(fields["does"]),
                tuple(map(str, fields["refused"])),
            )
        except (KeyError, TypeError, RecursionError) as error:
            raise ValueError("no answer of a vehicle") from error


class LiveControl:
    """Takes changes for one vehicle on a thread of the bus and schedules them."""

    def __init__(self, scenario: Scenario, vehicle: str, now: Callable[[], int]) -> None:
        """`now` reads the vehicle's clock (ns)."""
        self._scenario = scenario
        self._vehicle = vehicle
        self._now = now
        self._under_way: tuple[int, PendingChanges] | None = None
        self._made: list[AnyChange] = []

    def listen(self, bus: Bus) -> None:
        bus.answer(control_key(self._vehicle), lambda question: self.answer(question).text)

    def begin(self, start_at: int, pending_changes: PendingChanges) -> None:
        """Accept changes for the run that starts at `start_at` (ns)."""
        self._under_way = start_at, pending_changes

    def answer(self, text: bytes) -> Confirmation:
        """Accept or refuse a change; without one, return the first possible instant."""
        try:
            return self._taken(ChangeRequest.of(text))
        except ScenarioError as error:
            return Confirmation(self._vehicle, refused=tuple(str(error).splitlines()))

    def _taken(self, question: ChangeRequest) -> Confirmation:
        if self._under_way is None:
            raise ScenarioError([f"{self._vehicle} has not started yet"])
        (start_at, pending_changes), scenario = self._under_way, self._scenario
        at = self._effective_at(start_at, question.at_s)
        if at - start_at >= nanoseconds(scenario.duration_s):
            raise ScenarioError(["the run is over"])
        from_s = (at - start_at) / SECOND
        if not question.entry:
            return Confirmation(self._vehicle, from_s)
        so_far = scenario.tables.model_copy(
            update={"change": (*scenario.tables.change, *self._made)}
        )
        change = read_change(question.entry, from_s, so_far, scenario.duration_s)
        if not concerns(change, self._vehicle, scenario.tables, scenario.links):
            return Confirmation(self._vehicle)
        self._made.append(change)
        pending_changes.add(DueChange(at, change, by_hand=True))
        return Confirmation(self._vehicle, from_s, describe_change(change))

    def _effective_at(self, start_at: int, wanted_s: float | None) -> int:
        """Return the requested instant (ns) if it is still possible, else the first safe one."""
        now, rate_hz = self._now(), self._scenario.control_rate_hz
        if wanted_s is not None:
            wanted, soonest = start_at + nanoseconds(wanted_s), now + round(SECOND / rate_hz)
            in_reach = soonest <= wanted <= soonest + FARTHEST_NS
            if in_reach and Cadence(start_at, rate_hz).due(wanted):
                return wanted
        return first_instant(now, start_at, rate_hz)


def first_instant(now: int, start_at: int, rate_hz: float) -> int:
    """First instant (ns) of control that lies PERIODS_AHEAD control periods after `now`."""
    earliest = now + round(PERIODS_AHEAD * SECOND / rate_hz)
    k = max(ceil((earliest - start_at) * rate_hz / SECOND) - 1, 0)
    while (at := instant(start_at, k, rate_hz)) < earliest:
        k += 1
    return at
