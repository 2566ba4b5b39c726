"""The drives of one run as arrays: the paper's errors and the true ones."""

from collections import defaultdict
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.scenario import Scenario
from scenarios.results.stream import FigureStream
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import Message, Tracking, TruePose
from vehicles.schedule import SECOND

Array = NDArray[np.float64]
KINDS: frozenset[type[Message]] = frozenset((TruePose, Tracking))


@dataclass(frozen=True)
class Drive:
    """The drive of one vehicle, an entry per control instant (s from the start, m, m/s, rad).

    `lateral_error` and `heading_error` are the paper's: relative to the vehicle's own trajectory.
    `station` and `cross_track` are the true position along and across the lead's driven path and
    the straight before its start; empty for the lead.
    """

    name: str
    at: Array
    east: Array
    north: Array
    speed: Array
    lateral_error: Array
    heading_error: Array
    station: Array
    cross_track: Array

    @property
    def tracking_max(self) -> float:
        """Largest |e_lat| (m) relative to the own trajectory."""
        return _largest(self.lateral_error)

    @property
    def cross_track_max(self) -> float:
        """Largest true distance (m) from the lead's driven path."""
        return _largest(self.cross_track)


@dataclass(frozen=True)
class Trial:
    """The drives of one run, the lead first."""

    drives: tuple[Drive, ...]

    @property
    def lead(self) -> Drive:
        return self.drives[0]

    @property
    def followers(self) -> tuple[Drive, ...]:
        return self.drives[1:]

    @cached_property
    def tracking(self) -> tuple[float, ...]:
        """Largest |e_lat| (m) of each follower relative to its own trajectory."""
        return tuple(drive.tracking_max for drive in self.followers)

    @cached_property
    def cross_track(self) -> tuple[float, ...]:
        """Largest true cross-track error (m) of each follower."""
        return tuple(drive.cross_track_max for drive in self.followers)


def _largest(values: Array) -> float:
    return float(np.abs(values).max(initial=0.0))


class DriveRecorder:
    """Observer that keeps the messages of which drives are made."""

    kinds = KINDS

    def __init__(self, scenario: Scenario, stream: FigureStream) -> None:
        self._names = scenario.vehicle_names
        self._start_at = scenario.start_at_ns
        self._truth: defaultdict[str, list[TruePose]] = defaultdict(list)
        self._errors: defaultdict[str, list[tuple[float, float]]] = defaultdict(list)
        self._feet: defaultdict[str, list[CrossTrack]] = defaultdict(list)
        stream.on_foot(lambda foot: self._feet[foot.vehicle].append(foot))

    def listen(self, _at: int, message: Message) -> None:
        if isinstance(message, TruePose):
            self._truth[message.vehicle].append(message)
        elif isinstance(message, Tracking):
            errors = message.lateral_error_m, message.heading_error_rad
            self._errors[message.vehicle].append(errors)

    def trial(self) -> Trial:
        return Trial(tuple(self._drive(name) for name in self._names if name in self._truth))

    def _drive(self, name: str) -> Drive:
        truth, feet = self._truth[name], self._feet[name]
        errors = np.array(self._errors.get(name) or np.zeros((0, 2)), dtype=np.float64)
        return Drive(
            name=name,
            at=np.array([pose.true_at_ns - self._start_at for pose in truth]) / SECOND,
            east=np.array([pose.east_m for pose in truth]),
            north=np.array([pose.north_m for pose in truth]),
            speed=np.array([pose.speed_mps for pose in truth]),
            lateral_error=errors[:, 0],
            heading_error=errors[:, 1],
            station=np.array([foot.station for foot in feet]),
            cross_track=np.array([foot.lateral for foot in feet]),
        )
