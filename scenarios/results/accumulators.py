"""Running extremes and means of signals."""

from dataclasses import dataclass, field
from math import sqrt

from vehicles.car.tyres import SLIDING_SHARE
from vehicles.geometry.driven_path import MAX_WAITING
from vehicles.messages import TruePose


@dataclass(slots=True)
class Extremes:
    """Latest value, largest magnitude and root mean square of a signal."""

    latest: float = 0.0
    largest: float = 0.0
    largest_at: int = 0
    squares: float = 0.0
    count: int = 0

    def add(self, value: float, at: int = 0) -> None:
        self.latest = value
        if value > self.largest:
            self.largest, self.largest_at = value, at
        elif -value > self.largest:
            self.largest, self.largest_at = -value, at
        self.squares += value * value
        self.count += 1

    @property
    def rms(self) -> float:
        return sqrt(self.squares / self.count) if self.count else 0.0


@dataclass(slots=True)
class SelfEstimateErrors:
    """Differences of self-estimated and true lateral errors at equal instants."""

    difference: Extremes = field(default_factory=Extremes)
    estimated: dict[int, float] = field(default_factory=dict)
    true: dict[int, float] = field(default_factory=dict)

    def add_estimate(self, at: int, error: float) -> None:
        true = self.true.pop(at, None)
        if true is not None:
            self.difference.add(error - true, at)
        else:
            self._keep(self.estimated, at, error)

    def add_true(self, at: int, error: float) -> None:
        estimate = self.estimated.pop(at, None)
        if estimate is not None:
            self.difference.add(estimate - error, at)
        else:
            self._keep(self.true, at, error)

    def _keep(self, waiting: dict[int, float], at: int, error: float) -> None:
        waiting[at] = error
        if len(waiting) > MAX_WAITING:
            del waiting[next(iter(waiting))]


@dataclass(slots=True)
class TyreFigures:
    """Largest magnitudes of a vehicle's tyres (m/s², rad, friction share), and sliding poses."""

    lateral_acceleration: float = 0.0
    front_slip: float = 0.0
    rear_slip: float = 0.0
    friction: float = 0.0
    poses: int = 0
    sliding: int = 0

    def add(self, pose: TruePose) -> None:
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
