"""String stability figures: gains of the errors from vehicle to vehicle, and from head to tail."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import isnan, nan, sqrt
from typing import Literal, NamedTuple

from scenarios.definition.scenario import Scenario
from vehicles.driver.controller import SpacingPolicy
from vehicles.geometry.driven_path import CrossTrack
from vehicles.messages import TruePose
from vehicles.schedule import SECOND

# ---- String norms
#
# Norms of the errors along a string of vehicles, over the same places and times for all of them.
#
# Three signals: the lateral error of each follower at equal arc length along the lead's path, the
# spacing error of each follower over time, and the acceleration of each vehicle over time.


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

    The lateral error counts in the parts of the lead's path that all followers have driven, the
    spacing error and the acceleration at the instants at which all vehicles are known. The spacing
    error is arc length to the predecessor along the lead's path, minus standstill spacing and
    headway times own speed: positive if the gap is too wide. Without `policies` there is none.
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
        if foot.station >= 0.0:
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


# ---- String figures


LEAST_ERROR_M = 1e-3
"""Error below which there is no excitation, whatever the accuracy of the receivers."""
SIGMAS = 3.0
"""Largest error, in standard deviations, up to which noise alone explains it."""
LEAST_ACCELERATION_MPS2 = 0.1
"""Root mean square below which an acceleration is no excitation: noise and bends reach 0.06."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StringFigures:
    """Errors of one vehicle along the string, and their gains; None where they are not defined.

    All vehicles are compared over the same places (lateral error) or times (spacing error and
    acceleration). A gain of norms L2 or L∞ (`linf`) is the norm of the vehicle over that of the
    vehicle ahead, of the first follower, or of the lead. It is None if the denominator is at the
    level of the noise. See `convoy reference string-stability`.
    """

    lateral_error_m_rms: float | None = None
    """Root mean square of the true lateral error, over the path that all followers drove."""
    lateral_error_m_max: float | None = None
    """Largest lateral error on that path."""
    lateral_gain_l2: float | None = None
    """L2 gain of the lateral error from the vehicle ahead."""
    lateral_gain_linf: float | None = None
    """L∞ gain of the lateral error from the vehicle ahead."""
    lateral_gain_l2_from_first: float | None = None
    """L2 gain of the lateral error from the first follower; of the last vehicle: head to tail."""
    lateral_gain_linf_from_first: float | None = None
    """L∞ gain of the lateral error from the first follower."""
    lateral_growth_l2: float | None = None
    """Mean gain per vehicle: lateral_gain_l2_from_first to the power of 1 / vehicles between."""
    spacing_error_m_rms: float | None = None
    """Root mean square of the true spacing error, of followers that keep a gap."""
    spacing_error_m_max: float | None = None
    """Largest spacing error."""
    spacing_gain_l2: float | None = None
    """L2 gain of the spacing error from the vehicle ahead."""
    spacing_gain_linf: float | None = None
    """L∞ gain of the spacing error from the vehicle ahead."""
    spacing_gain_l2_from_first: float | None = None
    """L2 gain of the spacing error from the first follower; of the last vehicle: head to tail."""
    spacing_gain_linf_from_first: float | None = None
    """L∞ gain of the spacing error from the first follower."""
    spacing_growth_l2: float | None = None
    """Mean gain per vehicle: spacing_gain_l2_from_first to the power of 1 / vehicles between."""
    acceleration_mps2_rms: float | None = None
    """Root mean square of the true longitudinal acceleration."""
    acceleration_mps2_max: float | None = None
    """Largest magnitude of the acceleration."""
    acceleration_gain_l2: float | None = None
    """L2 gain of the acceleration from the vehicle ahead."""
    acceleration_gain_linf: float | None = None
    """L∞ gain of the acceleration from the vehicle ahead."""
    acceleration_gain_l2_from_lead: float | None = None
    """L2 gain of the acceleration from the lead; of the last vehicle: head to tail."""
    acceleration_gain_linf_from_lead: float | None = None
    """L∞ gain of the acceleration from the lead."""
    acceleration_growth_l2: float | None = None
    """Mean gain per vehicle: acceleration_gain_l2_from_lead to the power of 1 / vehicles."""


NO_STRING = StringFigures()
"""Of runs whose summary has none."""


@dataclass(frozen=True, slots=True)
class StringSignal:
    """A signal along the string, and its figures by their names.

    name      first part of the names of its fields
    quantity  what the signal is, in words
    unit      end of the names of its norms
    head      what gains from the head of the string refer to: the first follower, or the lead
    """

    name: str
    quantity: str
    unit: str
    head: Literal["first", "lead"]

    def rms(self, figures: StringFigures) -> float | None:
        value: float | None = getattr(figures, f"{self.name}_{self.unit}_rms")
        return value

    def gains(self, figures: StringFigures) -> tuple[float | None, float | None]:
        """L2 and L∞ gain from the vehicle ahead."""
        return self._pair(figures, "")

    def gains_from_head(self, figures: StringFigures) -> tuple[float | None, float | None]:
        """L2 and L∞ gain from the head of the string."""
        return self._pair(figures, f"_from_{self.head}")

    def has_gain(self, figures: StringFigures) -> bool:
        gains = (*self.gains(figures), *self.gains_from_head(figures))
        return any(gain is not None for gain in gains)

    def _pair(self, figures: StringFigures, reach: str) -> tuple[float | None, float | None]:
        name = f"{self.name}_gain"
        return getattr(figures, f"{name}_l2{reach}"), getattr(figures, f"{name}_linf{reach}")


LATERAL = StringSignal("lateral", "lateral error", "error_m", "first")
SPACING = StringSignal("spacing", "spacing error", "error_m", "first")
ACCELERATION = StringSignal("acceleration", "acceleration", "mps2", "lead")
STRING_SIGNALS = (LATERAL, SPACING, ACCELERATION)


class Excitation(NamedTuple):
    """A norm, and the noise below which it is no denominator of a gain.

    rms      least root mean square of the L2 gain
    largest  least largest magnitude of the L-infinity gain
    """

    norm: Norm
    rms: float
    largest: float


def string_figures(
    norms: Mapping[str, VehicleNorms], deviations_m: Mapping[str, float]
) -> dict[str, StringFigures]:
    """Compute the figures of all vehicles; `norms` has the lead first.

    `deviations_m` are standard deviations (m) of the vehicles' positions. Noise alone explains
    lateral errors with a root mean square of one and a largest value of three of them, and √2 times
    as much in the spacing, which has two positions.
    """
    lateral, spacing, acceleration = [], [], []
    for name, row in norms.items():
        noise = max(deviations_m.get(name, 0.0), LEAST_ERROR_M)
        lateral.append(Excitation(row.lateral, noise, SIGMAS * noise))
        noise *= sqrt(2.0)
        spacing.append(Excitation(row.spacing, noise, SIGMAS * noise))
        least = LEAST_ACCELERATION_MPS2
        acceleration.append(Excitation(row.acceleration, least, SIGMAS * least))
    signals = {
        **_values_of(LATERAL, lateral[1:]),
        **_values_of(SPACING, spacing[1:]),
    }
    followers = _rows(signals, len(norms) - 1)
    motions = _rows(_values_of(ACCELERATION, acceleration), len(norms))
    rows = [motion | error for motion, error in zip(motions, [{}, *followers], strict=True)]
    return {name: StringFigures(**row) for name, row in zip(norms, rows, strict=True)}


Values = Sequence[float | None]


def _rows(signals: Mapping[str, Values], count: int) -> list[dict[str, float | None]]:
    return [{name: values[place] for name, values in signals.items()} for place in range(count)]


def _values_of(signal: StringSignal, chain: Sequence[Excitation]) -> dict[str, Values]:
    """Return the figures of a signal by field, each with a value per vehicle of the chain."""
    known = [one.norm if one.norm.is_known else None for one in chain]
    rms = [None if norm is None else norm.rms for norm in known]
    largest = [None if norm is None else norm.largest for norm in known]
    of_rms = _gains(rms, [one.rms for one in chain])
    of_largest = _gains(largest, [one.largest for one in chain])
    growth = [
        gain ** (1.0 / steps) if steps and gain is not None else None
        for steps, gain in enumerate(of_rms.from_head)
    ]
    name, unit, head = signal.name, signal.unit, signal.head
    return {
        f"{name}_{unit}_rms": rms,
        f"{name}_{unit}_max": largest,
        f"{name}_gain_l2": of_rms.from_ahead,
        f"{name}_gain_linf": of_largest.from_ahead,
        f"{name}_gain_l2_from_{head}": of_rms.from_head,
        f"{name}_gain_linf_from_{head}": of_largest.from_head,
        f"{name}_growth_l2": growth,
    }


class SignalGains(NamedTuple):
    """SignalGains of each vehicle from the vehicle ahead, and from the head of the chain."""

    from_ahead: list[float | None]
    from_head: list[float | None]


def _gains(values: Values, least: Sequence[float]) -> SignalGains:
    """Divide each value by the one before and by the first, where these are at least `least`."""
    if not values:
        return SignalGains([], [])
    excited = [
        value if value is not None and value >= floor else None
        for value, floor in zip(values, least, strict=True)
    ]
    ahead = [None, *excited[:-1]]
    head = [None, *[excited[0]] * (len(values) - 1)]
    return SignalGains(
        [_ratio(value, other) for value, other in zip(values, ahead, strict=True)],
        [_ratio(value, other) for value, other in zip(values, head, strict=True)],
    )


def _ratio(value: float | None, reference: float | None) -> float | None:
    return value / reference if value is not None and reference is not None else None
