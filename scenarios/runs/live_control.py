"""Answers of a vehicle to change requests."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from math import ceil

from pydantic import TypeAdapter, ValidationError

from scenarios.definition.changes import ChangeRequest, concerns, describe_change, read_change
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario
from scenarios.definition.schema.change_tables import AnyChange
from scenarios.runs.end_confirmation import content_of
from scenarios.runs.node.outbox import DueChange, PendingChanges
from transport.bus.bus import Bus
from transport.topics import control_key
from vehicles.schedule import SECOND, instant, nanoseconds

PERIODS_AHEAD = 2
"""Control periods from a request to its effect: that tick has not begun yet."""
FARTHEST_NS = 20 * SECOND
"""A requested instant lies at most this far ahead."""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """Answer of a vehicle to a request: what it does, and from when on (s after the start).

    `does` is empty if the change does not concern the vehicle. `refused` lists the reasons of a
    refusal. If only the instant is refused, `from_s` is the first possible one.
    """

    vehicle: str
    from_s: float = 0.0
    does: str = ""
    refused: tuple[str, ...] = ()

    @property
    def text(self) -> bytes:
        return json.dumps(asdict(self)).encode()

    @property
    def can_be_later(self) -> bool:
        return bool(self.refused) and self.from_s > 0.0

    @classmethod
    def of(cls, answer: bytes) -> "Confirmation":
        """Parse an answer; raises ValueError."""
        try:
            return _READER.validate_json(answer)
        except ValidationError as error:
            raise ValueError("no answer of a vehicle") from error


_READER = TypeAdapter(Confirmation)


class LiveControl:
    """Takes changes for one vehicle on a thread of the bus and schedules them.

    A change is first promised and then confirmed for one instant, at which all vehicles make it. It
    comes after all changes promised before, so that all vehicles make them in one order.
    """

    def __init__(self, scenario: Scenario, vehicle: str, now: Callable[[], int]) -> None:
        """`now` reads the vehicle's clock (ns)."""
        self._scenario = scenario
        self._vehicle = vehicle
        self._now = now
        self._under_way: tuple[int, PendingChanges] | None = None
        self._promised: dict[int, AnyChange | None] = {}
        self._made: list[AnyChange] = []

    def listen(self, bus: Bus, run_id: Callable[[], str]) -> None:
        """Answer requests to the run with the identifier that `run_id` returns."""

        def answer(request: bytes) -> bytes:
            content = content_of(request, run_id())
            return b"" if content is None else self.answer(content).text

        bus.answer(control_key(self._vehicle), answer)

    def begin(self, start_at: int, pending_changes: PendingChanges) -> None:
        """Accept changes for the run that starts at `start_at` (ns)."""
        self._under_way = start_at, pending_changes

    def answer(self, text: bytes) -> Confirmation:
        """Promise, confirm or refuse a change; without one, return the first possible instant."""
        try:
            return self._answer(ChangeRequest.of(text))
        except ScenarioError as error:
            return Confirmation(self._vehicle, refused=tuple(str(error).splitlines()))

    def _answer(self, request: ChangeRequest) -> Confirmation:
        if self._under_way is None:
            raise ScenarioError([f"{self._vehicle} has not started yet"])
        start_at, pending_changes = self._under_way
        now, rate_hz = self._now(), self._scenario.control_rate_hz
        first = first_instant(max(now, max(self._promised, default=0)), start_at, rate_hz)
        at = first if request.at_s is None else start_at + nanoseconds(request.at_s)
        if max(at, first) - start_at >= nanoseconds(self._scenario.duration_s):
            raise ScenarioError(["the run is over"])
        from_s, first_s = (at - start_at) / SECOND, (first - start_at) / SECOND
        too_late = at < now + round(SECOND / rate_hz)
        if request.confirms:
            return self._confirmed(at, from_s, pending_changes, too_late=too_late)
        if not request.entry:
            return Confirmation(self._vehicle, first_s)
        if too_late or at > now + FARTHEST_NS or at <= max(self._promised, default=0):
            line = f"{self._vehicle}: no change is possible {from_s:.2f} s after the start"
            return Confirmation(self._vehicle, first_s, refused=(line,))
        return self._promise(request, at, from_s)

    def _promise(self, request: ChangeRequest, at: int, from_s: float) -> Confirmation:
        scenario = self._scenario
        so_far = scenario.tables.model_copy(
            update={"change": (*scenario.tables.change, *self._made)}
        )
        change = read_change(request.entry, from_s, so_far, scenario.duration_s)
        mine = concerns(change, self._vehicle, scenario.tables, scenario.links)
        self._promised[at] = change if mine else None
        return Confirmation(self._vehicle, from_s, describe_change(change) if mine else "")

    def _confirmed(
        self, at: int, from_s: float, pending_changes: PendingChanges, *, too_late: bool
    ) -> Confirmation:
        """Schedule the change promised for the instant `at` (ns)."""
        if too_late or at not in self._promised:
            raise ScenarioError([f"{self._vehicle}: the confirmation came too late"])
        change, self._promised[at] = self._promised[at], None
        if change is None:
            return Confirmation(self._vehicle)
        self._made.append(change)
        pending_changes.add(DueChange(at, change, by_hand=True))
        return Confirmation(self._vehicle, from_s, describe_change(change))


def first_instant(now: int, start_at: int, rate_hz: float) -> int:
    """First instant (ns) of control that lies PERIODS_AHEAD control periods after `now`."""
    earliest = now + round(PERIODS_AHEAD * SECOND / rate_hz)
    k = max(ceil((earliest - start_at) * rate_hz / SECOND) - 1, 0)
    while (at := instant(start_at, k, rate_hz)) < earliest:
        k += 1
    return at
