"""What is kept of one vehicle while a run goes on."""

from collections import Counter
from dataclasses import dataclass, field
from math import inf, sqrt

from scenarios.results.completeness.holes import EdgeInstants
from scenarios.results.degradation.reaction import Reaction
from transport.message_numbers import MOST_RANGES, MessageNumbers
from vehicles.car.tyres import SLIDING_SHARE
from vehicles.geometry.driven_path import MOST_WAITING
from vehicles.messages import Health, TruePose


@dataclass(slots=True)
class Extremes:
    """Latest value, largest magnitude and root mean square of a signal, value by value."""

    latest: float = 0.0
    largest: float = 0.0
    largest_at: int = 0
    squares: float = 0.0
    count: int = 0

    def add(self, value: float, at: int = 0) -> None:
        """Take one value, and its instant (ns) where that is asked for."""
        self.latest = value
        if value > self.largest:
            self.largest, self.largest_at = value, at
        elif -value > self.largest:
            self.largest, self.largest_at = -value, at
        self.squares += value * value
        self.count += 1

    @property
    def rms(self) -> float:
        """Root mean square, 0 without values."""
        return sqrt(self.squares / self.count) if self.count else 0.0


@dataclass(slots=True)
class BelievedErrors:
    """Lateral errors as a vehicle believes them beside the true ones, at equal instants."""

    off: Extremes = field(default_factory=Extremes)
    believed: dict[int, float] = field(default_factory=dict)
    true: dict[int, float] = field(default_factory=dict)

    def add_believed(self, at: int, error: float) -> None:
        """Take what the vehicle believes at instant `at` (ns)."""
        true = self.true.pop(at, None)
        if true is not None:
            self.off.add(error - true, at)
        else:
            self._keep(self.believed, at, error)

    def add_true(self, at: int, error: float) -> None:
        """Take the true error at instant `at` (ns)."""
        believed = self.believed.pop(at, None)
        if believed is not None:
            self.off.add(believed - error, at)
        else:
            self._keep(self.true, at, error)

    def _keep(self, waiting: dict[int, float], at: int, error: float) -> None:
        waiting[at] = error
        if len(waiting) > MOST_WAITING:
            del waiting[next(iter(waiting))]


@dataclass(slots=True)
class TyreFigures:
    """Largest magnitudes of what the tyres of one vehicle did, and how many poses it slid in.

    m/s², rad, and the share of the friction; plain numbers, because every true pose changes them.
    """

    lateral_acceleration: float = 0.0
    front_slip: float = 0.0
    rear_slip: float = 0.0
    friction: float = 0.0
    poses: int = 0
    sliding: int = 0

    def add(self, pose: TruePose) -> None:
        """Take the next true pose."""
        across, share = pose.lateral_acceleration_mps2, pose.friction_ratio
        front, rear = pose.front_slip_rad, pose.rear_slip_rad
        self.poses += 1
        # Comparisons take a quarter of the time of calls of max and abs.
        if not -self.lateral_acceleration <= across <= self.lateral_acceleration:
            self.lateral_acceleration = max(self.lateral_acceleration, abs(across))
        if not -self.front_slip <= front <= self.front_slip:
            self.front_slip = max(self.front_slip, abs(front))
        if not -self.rear_slip <= rear <= self.rear_slip:
            self.rear_slip = max(self.rear_slip, abs(rear))
        if share > self.friction:  # noqa: PLR1730 - twice as fast as max
            self.friction = share
        if share >= SLIDING_SHARE:
            self.sliding += 1


@dataclass(slots=True)
class VehicleFigures:
    """What one vehicle did."""

    numbers: MessageNumbers = field(default_factory=MessageNumbers)
    edges: EdgeInstants = field(default_factory=EdgeInstants)
    first_sent_at: int | None = None
    true_numbers: MessageNumbers = field(default_factory=lambda: MessageNumbers(MOST_RANGES))
    last_at: int = 0
    distance: float = 0.0
    speed: float = 0.0
    mode: str = ""
    lateral_error: Extremes = field(default_factory=Extremes)
    heading_error: Extremes = field(default_factory=Extremes)
    tyres: TyreFigures = field(default_factory=TyreFigures)
    cross_track_error: Extremes = field(default_factory=Extremes)
    belief: BelievedErrors = field(default_factory=BelievedErrors)
    gap_min: float = inf
    modes: Counter[str] = field(default_factory=Counter)
    reaction: Reaction = field(default_factory=Reaction)
    health: Health | None = None
    memory_max: int = 0
    cpu_sum: float = 0.0
    cpu_count: int = 0

    @property
    def poses(self) -> int:
        """GPS poses recorded."""
        return self.numbers.count
