"""Norms of the errors along a string of vehicles, over the same places and times for all of them.

Three signals: the lateral error of each follower at equal arc length along the lead's path, the
spacing error of each follower over time, and the acceleration of each vehicle over time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isnan, nan, sqrt

from scenarios.definition.scenario import Scenario
from vehicles.driver.longitudinal.spacing import SpacingPolicy
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import TruePose
from vehicles.schedule import SECOND

CELL_M = 2.0
"""Length of the parts of the path over which lateral errors are averaged; a step at 50 Hz and
100 m/s."""
MOST_CELLS = 10_000
"""Parts of the path between the first and the last follower; then the oldest are dropped."""
MOST_FRAMES = 3000
"""Instants that wait for vehicles, 60 s at 50 Hz; then the oldest are dropped."""
LEAST_COUNT = 20
"""Parts of the path (40 m) or instants (0.4 s at 50 Hz) below which a norm is not known."""
LONGEST_STEP_NS = SECOND // 10
"""Longest time between two instants from which an acceleration is computed."""


@dataclass(slots=True)
class Norm:
    """Largest magnitude and root mean square of a signal over a common support.

    On a common support, ratios of root mean squares are ratios of L2 norms, and ratios of largest
    magnitudes are ratios of L-infinity norms.
    """

    largest: float = 0.0
    squares: float = 0.0
    count: int = 0

    def add(self, value: float) -> None:
        self.add_mean(value * value, abs(value))

    def add_mean(self, square: float, largest: float) -> None:
        """Take the mean square and the largest magnitude of a part of the support."""
        self.squares += square
        self.count += 1
        self.largest = max(self.largest, largest)

    @property
    def is_known(self) -> bool:
        return self.count >= LEAST_COUNT

    @property
    def rms(self) -> float:
        return sqrt(self.squares / self.count) if self.count else 0.0


@dataclass(slots=True)
class _Frame:
    """Stations (m) and speeds (m/s) of all vehicles at an instant, and how many are missing."""

    stations: list[float]
    speeds: list[float]
    missing: int


@dataclass(slots=True)
class _Cell:
    """Squares, largest magnitudes and counts of the lateral errors in a part of the path."""

    squares: list[float]
    largest: list[float]
    counts: list[int]


@dataclass(slots=True)
class VehicleNorms:
    """Norms of one vehicle; those of a signal that it does not have are empty."""

    lateral: Norm = field(default_factory=Norm)
    spacing: Norm = field(default_factory=Norm)
    acceleration: Norm = field(default_factory=Norm)


class StringNorms:
    """Gathers the norms of a run; its two methods take what the stream of figures passes.

    The lateral error counts in the parts of the path that all followers have driven, the spacing
    error and the acceleration at the instants at which all vehicles are known. The spacing error is
    arc length to the predecessor along the lead's path, minus standstill spacing and headway times
    own speed: positive if the gap is too wide. Without `policies` there is none.
    """

    def __init__(self, names: Sequence[str], policies: Sequence[SpacingPolicy] = ()) -> None:
        """Take the vehicles, lead first, and the spacing policy of each follower."""
        self._place = {name: place for place, name in enumerate(names)}
        self._count = len(names)
        self._policies = policies
        self._origin = nan
        self._frames: dict[int, _Frame] = {}
        self._before: _Frame | None = None
        self._before_at = 0
        self._cells: dict[int, _Cell] = {}
        self._at_cells: list[int | None] = [None] * (self._count - 1)
        self.norms = {name: VehicleNorms() for name in names}
        self._rows = list(self.norms.values())

    @classmethod
    def of(cls, scenario: Scenario) -> "StringNorms":
        names = scenario.vehicle_names
        followers = range(1, len(names)) if scenario.tables.speed.followers == "gap" else ()
        return cls(names, [scenario.spacing_policy(place) for place in followers])

    def add_truth(self, pose: TruePose) -> None:
        """Take the speed of a vehicle, and the station of the lead: its distance driven."""
        place = self._place[pose.vehicle]
        frame = self._frame(pose.true_at_ns)
        frame.speeds[place] = pose.speed_mps
        if not place:
            if isnan(self._origin):
                self._origin = pose.distance_m
            frame.stations[0] = pose.distance_m - self._origin
            frame.missing -= 1
        self._took(frame, pose.true_at_ns)

    def add_error(self, foot: CrossTrack) -> None:
        """Take the station and the lateral error of a follower."""
        place = self._place[foot.vehicle]
        frame = self._frame(foot.at_ns)
        frame.stations[place] = foot.station
        self._took(frame, foot.at_ns)
        self._add_lateral(place - 1, foot.station, foot.lateral)

    def _frame(self, at: int) -> _Frame:
        frame = self._frames.get(at)
        if frame is None:
            if len(self._frames) >= MOST_FRAMES:
                del self._frames[next(iter(self._frames))]
            unknown = [nan] * self._count
            frame = self._frames[at] = _Frame(unknown, unknown.copy(), 2 * self._count)
        return frame

    def _took(self, frame: _Frame, at: int) -> None:
        frame.missing -= 1
        if not frame.missing:
            del self._frames[at]
            self._add_frame(frame, at)

    def _add_frame(self, frame: _Frame, at: int) -> None:
        stations, speeds, before = frame.stations, frame.speeds, self._before
        for place, policy in enumerate(self._policies, 1):
            spacing = stations[place - 1] - stations[place]
            self._rows[place].spacing.add(spacing - policy.desired(speeds[place]))
        step = at - self._before_at
        if before is not None and 0 < step <= LONGEST_STEP_NS:
            for row, now, then in zip(self._rows, speeds, before.speeds, strict=True):
                row.acceleration.add((now - then) * SECOND / step)
        self._before, self._before_at = frame, at

    def _add_lateral(self, place: int, station: float, error: float) -> None:
        number = int(station // CELL_M)
        cell = self._cells.get(number)
        if cell is None:
            if len(self._cells) >= MOST_CELLS:
                del self._cells[next(iter(self._cells))]
            empty = [0.0] * (self._count - 1)
            cell = self._cells[number] = _Cell(empty, empty.copy(), [0] * len(empty))
        cell.squares[place] += error * error
        cell.counts[place] += 1
        cell.largest[place] = max(cell.largest[place], abs(error))
        before = self._at_cells[place]
        if before is None or number > before:
            self._at_cells[place] = number
            self._close_passed()

    def _close_passed(self) -> None:
        """Take the parts of the path that all followers have passed, in their order."""
        reached = [number for number in self._at_cells if number is not None]
        if len(reached) < len(self._at_cells):
            return
        for number in sorted(number for number in self._cells if number < min(reached)):
            self._add_cell(self._cells.pop(number))

    def _add_cell(self, cell: _Cell) -> None:
        if not all(cell.counts):
            return
        for row, square, largest, count in zip(
            self._rows[1:], cell.squares, cell.largest, cell.counts, strict=True
        ):
            row.lateral.add_mean(square / count, largest)
