"""Made runs of three vehicles in real time, as the tables that a log of them has."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.tables import Collector, RunTables
from tests.made.scenarios.messages import MS, STRAIGHT, at, gps, health, start, tracking, verdict
from vehicles.messages import LinkVerdict, Message
from vehicles.schedule import nanoseconds

SECONDS = 10
POSES = 20 * SECONDS
TRANSIT = 3 * MS
Recorded = tuple[int, Message]


def convoy(*overrides: str) -> Scenario:
    """Three vehicles on a straight road for 10 s; poses at 20 Hz, decisions at 50 Hz."""
    size = ["convoy.vehicles=3", f"duration_s={SECONDS}"]
    return scenario_from_text(STRAIGHT, overrides=[*size, *overrides])


CONVOY = convoy()
NAMES, LINKS = CONVOY.vehicle_names, list(CONVOY.links)


def tables_of(
    messages: Iterable[Recorded], scenario: Scenario = CONVOY, ran_s: float = SECONDS
) -> RunTables:
    """Tables of messages, each with its instant of recording (ns)."""
    collector = Collector()
    for recorded_at, message in messages:
        collector.listen(recorded_at, message)
    return RunTables(scenario, collector.tables(), nanoseconds(ran_s))


class MadeRun:
    """The messages of a run on the wall clock as the recorder receives them.

    `lost` messages reached no receiver, `unrecorded` poses and verdicts not the recorder. `transit`
    are the times (ns) that poses took to the recorder.
    """

    def __init__(self) -> None:
        self.lost: set[tuple[str, str, int]] = set()
        self.unrecorded: set[tuple[str, int]] = set()
        self.unrecorded_verdicts: set[tuple[str, str, int]] = set()
        self.decided: dict[str, Sequence[int]] = dict.fromkeys(NAMES, range(50 * SECONDS))
        self.transit: dict[tuple[str, int], int] = {}

    def cut_off(self, name: str, begin: int, end: int) -> None:
        """Cut a vehicle off from all others and the recorder, between two numbers of poses."""
        self.lost |= {(a, b, k) for a, b in LINKS if name in {a, b} for k in range(begin, end)}
        self.unrecorded |= {(name, k) for k in range(begin, end)}

    def recorded(self) -> Iterator[Recorded]:
        yield at(0.0), start()
        for name in NAMES:
            for k in range(POSES):
                if (name, k) not in self.unrecorded:
                    pose = gps(name, k)
                    yield pose.sent_at_ns + self.transit.get((name, k), TRANSIT), pose
            for seq, k in enumerate(self.decided[name]):
                yield at(k / 50), replace(tracking(name, seq), decided_at_ns=at(k / 50))
            verdicts = self._verdicts(name)
            for one in verdicts:
                if (one.sender, name, one.pose_seq) not in self.unrecorded_verdicts:
                    yield one.received_at_ns, one
            final = health(name, seconds=SECONDS, final=True, received=len(verdicts))
            yield at(SECONDS), final

    def tables(self) -> RunTables:
        return tables_of(self.recorded())

    def _verdicts(self, receiver: str) -> list[LinkVerdict]:
        """Verdicts of a receiver on the messages that reached it and were due before the end."""
        arrived = [
            verdict(sender, receiver, k)
            for k in range(POSES)
            for sender, to in LINKS
            if to == receiver and (sender, receiver, k) not in self.lost
        ]
        due = [one for one in arrived if one.visible_at_ns < at(SECONDS)]
        return [replace(one, seq=number) for number, one in enumerate(due)]
