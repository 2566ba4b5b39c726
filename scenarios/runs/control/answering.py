"""A vehicle that answers what it is asked to change while it drives."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from math import ceil

from scenarios.definition.changing.asked import in_words, read_entry
from scenarios.definition.changing.concerned import concerns
from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario
from scenarios.runs.node.agenda import Agenda, Due
from transport.bus.bus import Bus
from transport.topics import control_key
from vehicles.schedule import SECOND, instant, nanoseconds

PERIODS_AHEAD = 2
"""A change takes effect at the first instant of control that lies so many periods ahead: all that
was sent before is judged as before, and the vehicle has not begun that tick."""


@dataclass(frozen=True, slots=True)
class Confirmation:
    """What a vehicle says to a change: from when on (s after the start) it does what.

    `does` is empty if the change is not about it, `refused` says in lines why nothing is done.
    """

    vehicle: str
    from_s: float = 0.0
    does: str = ""
    refused: tuple[str, ...] = ()

    @property
    def text(self) -> bytes:
        """The answer."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def of(cls, answer: bytes) -> "Confirmation":
        """Read an answer; raises ValueError if it is none."""
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
    """Takes changes for one vehicle, on a thread of the bus, and puts them on its agenda."""

    def __init__(self, scenario: Scenario, vehicle: str, now: Callable[[], int]) -> None:
        """`now` reads the vehicle's clock (ns)."""
        self._scenario = scenario
        self._vehicle = vehicle
        self._now = now
        self._under_way: tuple[int, Agenda] | None = None

    def listen(self, bus: Bus) -> None:
        """Answer from now on."""
        bus.answer(control_key(self._vehicle), lambda question: self.answer(question).text)

    def begin(self, start_at: int, agenda: Agenda) -> None:
        """Let changes be made in the run that starts at `start_at` (ns)."""
        self._under_way = start_at, agenda

    def answer(self, question: bytes) -> Confirmation:
        """Take one change, or say why not."""
        if self._under_way is None:
            return self._refused("the run has not started yet")
        start_at, agenda = self._under_way
        effective_at = first_instant(self._now(), start_at, self._scenario.control_rate_hz)
        after = effective_at - start_at
        if after >= nanoseconds(self._scenario.duration_s):
            return self._refused("the run is over")
        try:
            change = read_entry(question, after / SECOND, self._scenario.tables)
        except ScenarioError as error:
            return self._refused(*str(error).splitlines())
        names, links = self._scenario.vehicle_names, self._scenario.links
        if not concerns(change, self._vehicle, names, links):
            return Confirmation(self._vehicle)
        if self._vehicle in self._scenario.replays:
            return self._refused(f"{self._vehicle} moves as it was recorded, whatever is asked")
        agenda.add(Due(effective_at, change, by_hand=True))
        return Confirmation(self._vehicle, change.at_s, in_words(change))

    def _refused(self, *lines: str) -> Confirmation:
        return Confirmation(self._vehicle, refused=lines)


def first_instant(now: int, start_at: int, rate_hz: float) -> int:
    """First instant (ns) of control, of a run from `start_at`, enough periods ahead of `now`."""
    earliest = now + round(PERIODS_AHEAD * SECOND / rate_hz)
    k = max(ceil((earliest - start_at) * rate_hz / SECOND) - 1, 0)
    while (at := instant(start_at, k, rate_hz)) < earliest:
        k += 1
    return at
