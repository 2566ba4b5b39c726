"""Figures of the runs of `convoy paper reproduce`: errors, norms, and linear theory's predictions.

Lengths are in m, angles in rad, times in s, frequencies in rad/s. The *tracking error* is a car's
distance from the trajectory that it has fitted; the *true error* is that from the lead's path.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import pi, tau

import numpy as np

from scenarios.results.tables import RunTables
from scenarios.studies.paper.drives import Drive, Trial
from scenarios.studies.paper.runs import BASE_SPEED, LANE, PERIODS, SINES, SPACING, at_sine
from transport.columns import Floats
from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS, Loading, loaded
from vehicles.preview.curve_fit import Trajectory
from vehicles.theory.linear_model import Transfer, chain_offsets, trace_propagation

TOLERANCE_M = 0.001
"""Largest errors that differ by less (m) count as equal."""

# ---- Findings: the runs with one kind of trajectory


@dataclass(frozen=True, slots=True)
class SampleFigures:
    """Largest number of samples ahead of a car from each source, and error of the two-sample rule.

    `rule_error` (rad) is the largest difference between the car's true heading and the line
    through its closest and second closest sample, the paper's rule for θ_R.
    """

    lead: int = 0
    predecessor: int = 0
    rule_error: float = 0.0


@dataclass
class Findings:
    """Runs by key, sample figures of the base case, and the names of other cases that were run."""

    trajectory: Trajectory = "fitted"
    trials: dict[str, Trial] = field(default_factory=dict)
    samples: SampleFigures = SampleFigures()
    parts: frozenset[str] = frozenset()

    def has(self, *needs: str) -> bool:
        return all(need in self.trials or need in self.parts for need in needs)

    def noisy(self, key: str) -> list[Trial]:
        """Runs with receiver noise, one per seed."""
        return [trial for name, trial in self.trials.items() if name.startswith(f"{key}/noise/")]

    def moved(self, key: str) -> list[Trial]:
        """The exact run, and its repetitions on a road shifted by less than the sample distance."""
        names = [name for name in self.trials if name.startswith(f"{key}/phase/")]
        return [self.trials[name] for name in (key, *names) if name in self.trials]

    def ratios(self, preview_s: float) -> tuple[Floats, Floats]:
        """Frequencies (rad/s) of the sine, and amplitudes over the car ahead's (n, cars)."""
        frequencies = SINES[preview_s]
        sizes = np.array(
            [np.abs(amplitudes(self.trials[at_sine(preview_s, w)], w)) for w in frequencies]
        )
        return np.array(frequencies), sizes[:, 1:] / sizes[:, :-1]


INITIAL_LINE_LEFT = 100.0
"""Distance (m) after which a follower has left its initial straight line.

The line replaces poses from before the start; beyond it all samples were received.
"""


def sample_figures(run: RunTables) -> SampleFigures:
    """Figures of the samples of all trajectories of a run, from lead and predecessor."""
    counts, rule_error = np.zeros(2, dtype=int), 0.0
    for name in run.followers:
        truth, fits = run.table(name, "truth"), run.table(name, "trajectory")
        at = np.searchsorted(truth.at_ns, fits.at_ns, side="right") - 1
        driven, yaw = truth["distance_m"][at], truth["yaw_rad"][at]
        position = np.column_stack([truth["east_m"][at], truth["north_m"][at]])
        east, north, source = (
            fits.lists[f"sample_{field}"] for field in ("east_m", "north_m", "source")
        )
        for row in np.flatnonzero(driven > INITIAL_LINE_LEFT):
            part = slice(east.offsets[row], east.offsets[row + 1])
            delta = np.column_stack([east.values[part], north.values[part]]) - position[row]
            along = delta @ (np.cos(yaw[row]), np.sin(yaw[row]))
            sources = source.values[part]
            counts = np.maximum(counts, np.bincount(sources[along > 0.0], minlength=2)[:2])
            if len(set(sources.tolist())) == 2:
                first, second = np.argsort(np.hypot(*delta.T), kind="stable")[:2]
                sign = 1.0 if along[second] >= along[first] else -1.0
                line = sign * (delta[second] - delta[first])
                turn = float(np.arctan2(line[1], line[0]) - yaw[row])
                rule_error = max(rule_error, abs((turn + pi) % tau - pi))
    return SampleFigures(int(counts[0]), int(counts[1]), rule_error)


def amplitudes(trial: Trial, frequency: float) -> list[complex]:
    """Complex amplitude (m) of each vehicle's path at one frequency (rad/s), the lead first.

    A sine and a straight line are fitted by least squares over the same section of road, the last
    PERIODS that all vehicles drove.
    """
    speed = float(trial.lead.speed.mean())
    end = min(float(drive.east[-1]) for drive in trial.drives)
    begin = end - PERIODS * 2.0 * pi * speed / frequency
    fitted = []
    for drive in trial.drives:
        on = (drive.east >= begin) & (drive.east <= end)
        angle, along = frequency * drive.east[on] / speed, drive.east[on] - begin
        basis = np.column_stack([np.cos(angle), -np.sin(angle), np.ones_like(along), along])
        real, imaginary = np.linalg.lstsq(basis, drive.north[on], rcond=None)[0][:2]
        fitted.append(complex(real, imaginary))
    return fitted


# ---- Measures of one run


def largest_tracking(run: Trial) -> float:
    return max(run.tracking)


def largest_true(*runs: Trial) -> float:
    return max(max(run.cross_track) for run in runs)


def growth(errors: Sequence[float]) -> float:
    """Largest increase from a follower to the next one (Definition 1: none)."""
    return max((behind - ahead for ahead, behind in pairwise(errors)), default=0.0)


def tracking_growth(run: Trial) -> float:
    return growth(run.tracking)


def true_growth(*runs: Trial) -> float:
    return max(growth(run.cross_track) for run in runs)


def excess_of_last_step(run: Trial) -> float:
    """Step of the true error to the last car beyond half the second follower's; ≤ 0: levels off."""
    steps = np.diff(run.cross_track)
    return float(steps[-1] - max(0.5 * steps[0], TOLERANCE_M))


def step_against(with_data: Trial, without: Trial) -> float:
    """Last step of the true error over a tenth of that without data, or last error over last."""
    steps = [run.cross_track[-1] - run.cross_track[-2] for run in (with_data, without)]
    return max(10.0 * steps[0] / steps[1], with_data.cross_track[-1] / without.cross_track[-1])


SPACING_S = 0.5
"""Time (s) between the centres of mass of two successive cars."""
CURVATURE_CHANGES = np.array([5.0, 6.0, 7.0, 8.0, 20.0, 21.0, 22.0, 23.0])
"""Times (s) at which the lead of the base case reaches a change of curvature."""


def largest_lag(run: Trial) -> float:
    """Largest time (s) between a car's largest error and the nearest change of curvature."""
    lags = []
    for place, drive in enumerate(run.followers, start=1):
        peak_at = float(drive.at[int(np.argmax(np.abs(drive.lateral_error)))])
        lags.append(float(np.abs(peak_at - place * SPACING_S - CURVATURE_CHANGES).min()))
    return max(lags)


def definition_1_growth(run: Trial) -> float:
    """Growth of ‖(e_lat, θ̃)‖∞, the larger of both maxima, in m and rad."""
    errors = [(drive.lateral_error, drive.heading_error) for drive in run.followers]
    return growth([float(np.abs(pair).max()) for pair in errors])


def rms_along_the_road(run: Trial, measure: str = "cross_track") -> tuple[float, ...]:
    """Root mean square (m) of each follower, over the part of the lead's path that all have driven.

    `measure` names an array of a `Drive`: `cross_track` or `lateral_error` (tracking).
    """
    begin = max(float(drive.station[0]) for drive in run.followers)
    end = min(float(drive.station[-1]) for drive in run.followers)
    places = np.arange(begin, end, SPACING)
    errors = [
        np.interp(places, drive.station, getattr(drive, measure)[: len(drive.station)])
        for drive in run.followers
    ]
    return tuple(np.sqrt(np.mean(np.square(errors), axis=1)).tolist())


def rms_growth(run: Trial) -> float:
    return growth(rms_along_the_road(run))


SLOWED = 0.9
"""Share of the lead's speed below which a follower does not keep up."""


def tracking_at_speed(run: Trial) -> float:
    """Largest tracking error; infinite if a follower slows down."""
    slowest = min(float(drive.speed.min()) for drive in run.followers)
    return largest_tracking(run) if slowest >= SLOWED * run.lead.speed.min() else np.inf


def rms_after(seconds: float, *runs: Trial) -> tuple[float, ...]:
    """Root mean square (m) of the true error of each follower over runs, from an instant on."""
    squares = [
        [float(np.mean(_after(seconds, drive) ** 2)) for drive in run.followers] for run in runs
    ]
    return tuple(np.sqrt(np.mean(squares, axis=0)).tolist())


def _after(seconds: float, drive: Drive) -> Floats:
    return drive.cross_track[drive.at[: len(drive.cross_track)] >= seconds]


AFTER_START_S, SETTLING_S = 5.0, 10.0
"""Times (s) after which noise on a straight is stationary, and initial errors have decayed."""


def noise_growth(*runs: Trial) -> float:
    """Rms true error of the last of eight cars over that of the third, on a straight."""
    rms = rms_after(AFTER_START_S, *runs)
    return rms[-1] / rms[1]


def settled_growth(run: Trial) -> float:
    """Growth of the rms true error from PL2 to PL3 once initial errors have decayed."""
    rms = rms_after(SETTLING_S, run)
    return rms[-1] - rms[0]


LANE_MARGIN = 0.5 * (LANE - LINCOLN_MKZ.width)
"""Distance (m) from each side of a car to the edge of its lane."""
FIELD_ROAD = np.arange(5.0, 650.0, 0.5)
"""Places (m) that all runs of the field experiment cover."""


def share_farther_off(run: Trial) -> float:
    """Share of the road on which the last car is farther off the lead's path than the first."""
    ahead, behind = (
        np.abs(np.interp(FIELD_ROAD, drive.station[: len(drive.cross_track)], drive.cross_track))
        for drive in (run.followers[0], run.followers[-1])
    )
    return float(np.mean(behind > ahead + TOLERANCE_M))


def excess_of_share(run: Trial, without: Trial) -> float:
    """Share `without` initial errors beyond half of that with them."""
    return share_farther_off(without) - 0.5 * share_farther_off(run)


def more_than(measure: Callable[[Trial], float]) -> Callable[[Trial, Trial], float]:
    """Difference of a measure between a second and a first run."""
    return lambda first, second: measure(second) - measure(first)


def head_to_tail(run: Trial) -> float:
    """True error of the last follower over that of the first."""
    return run.cross_track[-1] / run.cross_track[0]


def relative_difference(heavy: Trial, light: Trial) -> float:
    """Largest difference of tracking errors over a tenth of the largest, which is at least 2 mm."""
    difference = max(abs(a - b) for a, b in zip(heavy.tracking, light.tracking, strict=True))
    return difference / max(2.0 * TOLERANCE_M, 0.1 * max(heavy.tracking))


# ---- Errors predicted by linear theory


SAMPLES = 4096
"""Number of samples of the lead's path; a power of two for the FFT."""
BASE_CAR = (BASE_SPEED, Loading(front_passengers=1, rear_passengers=3))
CARS = {
    "a": (10.0, Loading(front_passengers=1, rear_passengers=2)),
    "b": (10.0, Loading(front_passengers=1)),
    "c": (20.0, Loading(front_passengers=1)),
    "d": (30.0, Loading(front_passengers=1, rear_passengers=2)),
}
"""Speed (m/s) and load of the cars of a case (in D, of the first two), if not the base case's."""
EMPTY = trace_propagation(LINCOLN_MKZ, NOMINAL_GAINS, BASE_SPEED)
"""F(jω) of empty cars at the speed of the base case."""


def transfer(key: str = "base") -> Transfer:
    """F(jω) of a case: a car's own path over the path it follows, with the load unknown to it."""
    speed, loading = CARS.get(key, BASE_CAR)
    car = loaded(LINCOLN_MKZ, loading)
    return trace_propagation(car, NOMINAL_GAINS, speed, assumed=LINCOLN_MKZ)


def predict_case(findings: Findings, key: str) -> tuple[list[float], list[float]]:
    """Predict the largest tracking and true errors (m) of the followers of a case."""
    alpha = 1.0 if key == "no_lead_data" else 0.5
    return predict_errors(findings.trials[key].lead, transfer(key), alpha, 3)


def predict_errors(
    lead: Drive, transfer: Transfer, alpha: float, followers: int
) -> tuple[list[float], list[float]]:
    """Predict the largest tracking and true errors (m) of each follower.

    Neglects sampling, fit and noise. The lead drives east at constant speed and ends on its initial
    line. Follower i follows r_i = α y_(i−1) + (1 − α) y_0 with y_i = F r_i (`transfer`). Its true
    error is d_i = y_i − y_0. With r_i − y_0 = α d_(i−1), its tracking error is
    y_i − r_i = d_i − α d_(i−1).
    """
    span = float(lead.at[-1] - lead.at[0])
    times = np.linspace(0.0, span, SAMPLES, endpoint=False)
    east = lead.east[0] + (lead.east[-1] - lead.east[0]) * times / span
    path = np.fft.rfft(np.interp(east, lead.east, lead.north))
    frequencies: Floats = 2.0 * np.pi / span * np.arange(SAMPLES // 2 + 1, dtype=np.float64)
    offsets = path * chain_offsets(transfer, frequencies, alpha, followers)
    ahead = np.vstack([np.zeros_like(path), offsets[:-1]])
    tracking, true = (
        np.abs(np.fft.irfft(errors)).max(axis=1).tolist()
        for errors in (offsets - alpha * ahead, offsets)
    )
    return tracking, true


def largest_gains(transfer: Transfer, alpha: float, followers: int) -> list[float]:
    """Gain in L2 from the lead's offset to the true error of each follower.

    The largest magnitude of `chain_offsets` over frequencies from 0.01 to 200 rad/s.
    """
    frequencies = np.geomspace(0.01, 200.0, 4000)
    gains: list[float] = (
        np.abs(chain_offsets(transfer, frequencies, alpha, followers)).max(axis=1).tolist()
    )
    return gains
