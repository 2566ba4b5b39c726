"""A recorded vehicle put back on the bus: its poses from the log of a run, shifted in time.

The followers behind it are live and cannot tell: the same messages come over the same links. What
the log knows of the car's true state is published along with it, for the new log and its figures.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import cos, hypot, sin
from pathlib import Path

from scenarios.runs.node.sink import Sink
from scenarios.runs.step_order import Stepper
from transport.clock import Tick
from transport.log.mcap_log import LogError, LogReader
from transport.topics import instant
from vehicles.car.gnss import from_message
from vehicles.geometry.geodesy import LocalPlane
from vehicles.messages import GpsPose, RunStart, TruePose

SEARCHED = 150.0
"""A place is sought on so much (m) of the start of a recorded drive, so not on a later lap."""


@dataclass(frozen=True, slots=True)
class Replay:
    """The messages of one replayed vehicle, in order of time, with the instants of the new run."""

    vehicle: str
    messages: tuple[GpsPose | TruePose, ...]

    def stepper(self, sink: Sink) -> Stepper:
        """Send each message at its instant, as the vehicle itself would."""
        messages = iter(self.messages)

        def step(_: Tick) -> None:
            sink.send(next(messages))
            sink.flush()

        return Stepper(self.vehicle, self._ticks, step)

    def _ticks(self) -> Iterator[Tick]:
        return (Tick(instant(message), 0.0) for message in self.messages)


@dataclass(frozen=True, slots=True)
class Record:
    """What a log holds of one vehicle: its poses and true states, and when its run started (ns)."""

    started_at: int
    poses: tuple[GpsPose, ...]
    truth: tuple[TruePose, ...]

    def replay(self, *, start_at: int, ahead: float = 0.0, vehicle: str | None = None) -> Replay:
        """Put the record into a run that starts at `start_at` (ns), as `vehicle`.

        At the start the vehicle is where it was `ahead` (s) after the start of its own run; what
        it said before that is left out, and its messages are numbered anew.
        """
        name = vehicle or self.poses[0].vehicle
        shift = start_at - self.started_at - round(ahead * 1e9)
        poses = [p for p in self.poses if p.measured_at_ns + shift >= start_at]
        truth = [t for t in self.truth if t.true_at_ns + shift >= start_at]
        said: list[GpsPose | TruePose] = [
            replace(p, vehicle=name, seq=seq, measured_at_ns=p.measured_at_ns + shift)
            for seq, p in enumerate(poses)
        ]
        said += [
            replace(t, vehicle=name, seq=seq, true_at_ns=t.true_at_ns + shift)
            for seq, t in enumerate(truth)
        ]
        return Replay(name, tuple(sorted(said, key=instant)))


def read_record(log: Path, vehicle: str) -> Record:
    """Read what `log` holds of `vehicle`; raises LogError if that is nothing."""
    reader = LogReader(log)
    poses: list[GpsPose] = []
    truth: list[TruePose] = []
    started_at: int | None = None
    for _, _, message in reader.messages(topics=("gps", "truth", "start")):
        if isinstance(message, RunStart):
            started_at = message.start_at_ns
        elif isinstance(message, GpsPose) and message.vehicle == vehicle:
            poses.append(message)
        elif isinstance(message, TruePose) and message.vehicle == vehicle:
            truth.append(message)
    if not poses:
        known = ", ".join(sorted({name for name, topic in reader.counts if topic == "gps"}))
        raise LogError(f"{log}: holds no poses of {vehicle!r}, but of {known or 'nobody'}")
    start = poses[0].measured_at_ns if started_at is None else started_at
    return Record(start, tuple(poses), tuple(truth))


def head_start(record: Record, plane: LocalPlane, place: tuple[float, float], gap: float) -> float:
    """Time (s) after its start at which the recorded vehicle was `gap` (m) ahead of `place`.

    `place` (east, north, m) is where the vehicle behind it will start, beside the first part of
    the recorded way or behind it. 0 if the record begins further ahead than that already.
    """
    fixes = [from_message(pose, plane) for pose in record.poses]
    first = fixes[0]
    way = [0.0]
    for before, after in pairwise(fixes):
        way.append(way[-1] + hypot(after.east - before.east, after.north - before.north))
    beginning = [k for k, station in enumerate(way) if station <= SEARCHED]
    nearest = min(
        beginning, key=lambda k: hypot(fixes[k].east - place[0], fixes[k].north - place[1])
    )
    station = way[nearest]
    if nearest == 0:
        along = (cos(first.yaw), sin(first.yaw))
        station = (place[0] - first.east) * along[0] + (place[1] - first.north) * along[1]
    return max(_time_at(way, [fix.measured_at for fix in fixes], station + gap, record), 0.0)


def _time_at(way: Sequence[float], at: Sequence[int], station: float, record: Record) -> float:
    """Time (s) from the start of the recorded run at which `station` (m) of the way was reached."""
    for k in range(1, len(way)):
        if way[k] >= station and way[k] > way[k - 1]:
            share = (station - way[k - 1]) / (way[k] - way[k - 1])
            reached = at[k - 1] + share * (at[k] - at[k - 1])
            return (reached - record.started_at) * 1e-9
    raise ValueError(f"the recorded drive is shorter than {station:.1f} m")
