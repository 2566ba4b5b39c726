"""Results of the runs of `convoy reproduce`, for claims, tables and plots."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from math import atan2, ceil, cos, hypot, pi, remainder, sin, tau
from typing import NamedTuple

import numpy as np

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.definition.schema.path_tables import PointsPath
from scenarios.results.drives import Drive, Trial
from scenarios.runs.virtual import drive_trial
from scenarios.studies.paper.experiments import (
    FIELD_WITH,
    NO_LEAD_DATA,
    A,
    B,
    C,
    D,
    Need,
    Part,
    RunKey,
    Variant,
)
from transport.columns import Floats
from vehicles.car.parameters import LINCOLN_MKZ, NOMINAL_GAINS, Loading, loaded
from vehicles.messages import CompositeTrajectory, Message, TruePose
from vehicles.preview.curve_fit import Trajectory
from vehicles.theory.linear_model import Transfer, chain_offsets, trace_propagation
from vehicles.theory.string_stability import LANE_CHANGE_BAND, amplified_band, is_string_stable

# ---- Samples to which the followers of a logged run fit their trajectories


LEAD, PREDECESSOR = 0, 1

INITIAL_LINE_LEFT = 100.0
"""Distance (m) after which a follower has left its initial straight line.

The line replaces poses from before the start; beyond it all samples were received.
"""


@dataclass(slots=True)
class SampleFigures:
    """Largest number of samples ahead from each source, and heading error of the two-sample rule.

    `rule_error` (rad) is the largest difference between the car's true heading and the line
    through its closest and second closest sample, the paper's rule for θ_R. The true heading
    deviates from the path's by up to 0.02 rad.
    """

    lead: int = 0
    predecessor: int = 0
    rule_error: float = 0.0


class SampleCounter:
    """Observer of a run that counts the samples of every trajectory."""

    kinds: frozenset[type[Message]] = frozenset((CompositeTrajectory, TruePose))

    def __init__(self) -> None:
        self.figures = SampleFigures()
        self._pose: dict[str, TruePose] = {}

    def listen(self, _at: int, message: Message) -> None:
        if isinstance(message, TruePose):
            self._pose[message.vehicle] = message
        elif isinstance(message, CompositeTrajectory):
            ego = self._pose.get(message.vehicle)
            if ego is not None and ego.distance_m > INITIAL_LINE_LEFT:
                self._count(message, ego)

    def _count(self, trajectory: CompositeTrajectory, ego: TruePose) -> None:
        ux, uy = cos(ego.yaw_rad), sin(ego.yaw_rad)
        counts = [0, 0]
        distances = []
        places = zip(trajectory.sample_east_m, trajectory.sample_north_m, strict=True)
        for source, (east, north) in zip(trajectory.sample_source, places, strict=True):
            dx, dy = east - ego.east_m, north - ego.north_m
            counts[source] += dx * ux + dy * uy > 0.0
            distances.append((hypot(dx, dy), dx * ux + dy * uy, east, north))
        figures = self.figures
        figures.lead = max(figures.lead, counts[LEAD])
        figures.predecessor = max(figures.predecessor, counts[PREDECESSOR])
        if len(distances) < 2 or len(set(trajectory.sample_source)) < 2:
            return
        (_, a1, e1, n1), (_, a2, e2, n2) = sorted(distances)[:2]
        sign = 1.0 if a2 >= a1 else -1.0
        heading = atan2(sign * (n2 - n1), sign * (e2 - e1))
        figures.rule_error = max(figures.rule_error, abs(remainder(heading - ego.yaw_rad, tau)))


# ---- Frequency response of the emulated convoy, from fitted amplitudes behind a lead on a sine
#
# The closed forms are in `vehicles.theory.linear_model`. In the paper's G(jω) a follower steers by
# the difference of both cars' states at the same instant; in F(jω) it steers along its
# predecessor's path.


FREQUENCIES = (0.8, 1.2, 1.8, 2.5, 3.5, 5.0, 7.0, 10.0)
"""Frequencies (rad/s) of the sine, from a slow lane change to beyond a car's bandwidth."""

SHORT_FREQUENCIES = FREQUENCIES[2:]
"""Frequencies simulated with the short preview; lower ones do not depend on the preview."""

PREVIEW_S = 0.8
SHORT_PREVIEW_S = 0.25
"""The paper's preview (s), and a short preview that smooths little."""

MAX_AMPLITUDE = 0.5
"""Limit of the lead's amplitude (m)."""

MAX_ACCELERATION = 1.5
"""Limit of the lead's lateral acceleration (m/s²)."""

PERIODS = 3
"""Number of evaluated periods."""

TRANSIENT = 4.0
"""Least time (s) before the evaluation, which is at least one period."""

SPACING = 0.5
"""Distance between the points of the lead's path (m)."""

STRAIGHT = 1.5
"""Time (s) on a straight before the sine begins."""

RISE = 2.0
"""Time (s) over which the sine grows to its amplitude."""


@dataclass(frozen=True)
class SineResponse:
    """Complex amplitude (m) of each vehicle's path at one frequency (rad/s), the lead first."""

    frequency: float
    preview_s: float
    amplitudes: tuple[complex, ...]

    @property
    def ratios(self) -> tuple[float, ...]:
        sizes = np.abs(self.amplitudes)
        return tuple((sizes[1:] / sizes[:-1]).tolist())


def drive_sine(
    frequency: float, preview_s: float = PREVIEW_S, trajectory: Trajectory = "fitted"
) -> SineResponse:
    """Simulate a convoy behind a lead on a sine of `frequency` (rad/s)."""
    scenario = sine_scenario(frequency, preview_s, trajectory)
    return SineResponse(frequency, preview_s, amplitudes(drive_trial(scenario), frequency))


def sine_scenario(
    frequency: float, preview_s: float = PREVIEW_S, trajectory: Trajectory = "fitted"
) -> Scenario:
    """The paper's base case with empty cars, no lead data, and a lead that drives a sine."""
    alone = (
        'information_flow.lateral="predecessor"',
        f'control.trajectory="{trajectory}"',
        "loading.front_passengers=0",
        "loading.rear_passengers=0",
    )
    base = load_scenario("paper_base", (*alone, f"control.preview_s={preview_s}"))
    speed = base.tables.speed.set_mps
    convoy = sum(base.route.spacings)
    transient = STRAIGHT + RISE + max(TRANSIENT, 2.0 * pi / frequency)
    duration = ceil(transient + PERIODS * 2.0 * pi / frequency + convoy / speed) + 1.0
    east = np.arange(0.0, speed * duration + 60.0, SPACING)
    since = east / speed - STRAIGHT
    rise = np.clip(since / RISE, 0.0, 1.0)
    height = min(MAX_AMPLITUDE, MAX_ACCELERATION / frequency**2) * rise * rise * (3.0 - 2.0 * rise)
    path = PointsPath(
        kind="points",
        source="sine",
        east_m=tuple(east.tolist()),
        north_m=tuple((height * np.sin(frequency * since)).tolist()),
        smoothing_m=2.0,
    )
    return Scenario(base.tables.model_copy(update={"path": path, "duration_s": duration}))


def amplitudes(trial: Trial, frequency: float) -> tuple[complex, ...]:
    """Fit a sine and a straight line to each vehicle's path by least squares (m).

    All paths are fitted over the same section of road, the last PERIODS that all vehicles drove.
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
    return tuple(fitted)


# ---- Findings


TOLERANCE_M = 0.001
"""Largest errors that differ by less (m) count as equal."""


ALTERNATIVES: dict[Variant, str] = {
    "slip_compensated": "slip compensation",
    "stanley": "Stanley's law",
    "pure_pursuit": "pure pursuit",
}
"""Steering laws that a row names if they do better than the paper's."""

LOST_M = 10.0
"""Errors (m) of cars that have lost their path; larger ones are not printed."""


class Tally(NamedTuple):
    """Number of runs in which a claim holds; `kind` names what differs between the runs."""

    holding: int
    runs: int
    kind: str = "phases"


@dataclass
class Findings:
    """Results with one kind of trajectory, by key.

    `samples` holds the logged runs only; `field_logs` holds the folder names of the logs of the
    field experiment.
    """

    trajectory: Trajectory = "fitted"
    trials: dict[RunKey, Trial] = field(default_factory=dict)
    samples: dict[RunKey, SampleFigures] = field(default_factory=dict)
    sine_responses: list[SineResponse] = field(default_factory=list)
    field_logs: tuple[str, ...] = ()
    gains_pictures: tuple[str, ...] | None = None

    def has(self, need: Need) -> bool:
        match need:
            case RunKey():
                return need in self.trials
            case Part.PROPAGATION:
                return bool(self.sine_responses)
            case Part.FIELD:
                return FIELD_WITH in self.trials
            case Part.GAINS:
                return self.gains_pictures is not None

    def ratios(self, preview_s: float) -> tuple[Floats, Floats]:
        """Frequencies (rad/s, ascending) simulated with a preview, and ratios (n, followers)."""
        responses = [
            response for response in self.sine_responses if response.preview_s == preview_s
        ]
        responses.sort(key=lambda response: response.frequency)
        return (
            np.array([response.frequency for response in responses]),
            np.array([response.ratios for response in responses]),
        )

    def noisy(self, key: RunKey) -> list[Trial]:
        """Runs with receiver noise, one per seed."""
        return [
            trial
            for candidate, trial in self.trials.items()
            if candidate.seed is not None and candidate.exact == key
        ]

    def moved(self, key: RunKey) -> list[Trial]:
        """The exact run, and its repetitions on a road shifted by less than the sample distance."""
        repeated = [
            trial
            for candidate, trial in self.trials.items()
            if candidate.phase is not None and candidate.exact == key
        ]
        return [self.trials[key], *repeated]

    def seeds(self, holds: Callable[..., bool], *keys: RunKey) -> Tally | None:
        """Count the noisy runs of `keys` in which `holds` is true; None without such runs."""
        tally = _tally(holds, *map(self.noisy, keys))
        return tally and tally._replace(kind="seeds")

    def phases(self, holds: Callable[..., bool], *keys: RunKey) -> Tally | None:
        """Count the exact runs of `keys` in which `holds` is true; None for a single run."""
        tally = _tally(holds, *map(self.moved, keys))
        return tally if tally and tally.runs > 1 else None


def _tally(holds: Callable[..., bool], *runs: Sequence[Trial]) -> Tally | None:
    groups = list(zip(*runs, strict=False))
    return Tally(sum(holds(*trials) for trials in groups), len(groups)) if groups else None


def better_laws(findings: Findings, key: RunKey, measure: str = "tracking") -> str:
    """Name other steering laws whose largest errors in a case are smaller, with their errors.

    `measure` is `tracking` or `cross_track`, an attribute of a `Trial`.
    """
    own = max(getattr(findings.trials[key], measure))
    found = []
    for law, name in ALTERNATIVES.items():
        trial = findings.trials.get(key.with_variant(law))
        if trial is not None and max(getattr(trial, measure)) < own - TOLERANCE_M:
            found.append(f"{name} {in_cm(getattr(trial, measure))}")
    return f". Better: {'; '.join(found)}" if found else ""


def non_increasing(maxima: tuple[float, ...]) -> bool:
    """Whether no largest error (m) exceeds that of the car ahead by more than TOLERANCE_M."""
    return is_string_stable(maxima, TOLERANCE_M)


def in_cm(maxima: tuple[float, ...]) -> str:
    """Format the largest errors (m) of the followers, front to back."""
    texts = (f"{100.0 * m:.1f}" if m < LOST_M else f"over {100.0 * LOST_M:.0f}" for m in maxima)
    return ", ".join(texts) + " cm"


def cm(value: float) -> str:
    return f"{100.0 * value:z.1f} cm" if value < LOST_M else in_cm((value,))


# ---- Errors of the paper's cases predicted by linear theory, and reasons for their growth


SAMPLES = 4096
"""Number of samples of the lead's path; a power of two for the FFT."""

BASE_CAR = (30.0, Loading(front_passengers=1, rear_passengers=3))
CARS = {
    A: (10.0, Loading(front_passengers=1, rear_passengers=2)),
    B: (10.0, Loading(front_passengers=1)),
    C: (20.0, Loading(front_passengers=1)),
    D: (30.0, Loading(front_passengers=1, rear_passengers=2)),
}
"""Speed (m/s) and load of the cars of a case (in D, of the first two), if not the base case's."""


def transfer(key: RunKey) -> Transfer:
    """F(jω) of a case: a car's own path over the path it follows, with the load unknown to it."""
    speed, loading = CARS.get(key, BASE_CAR)
    return trace_propagation(
        loaded(LINCOLN_MKZ, loading), NOMINAL_GAINS, speed, assumed=LINCOLN_MKZ
    )


def empty_transfer() -> Transfer:
    """F(jω) of empty cars at the speed of the base case."""
    return trace_propagation(LINCOLN_MKZ, NOMINAL_GAINS, BASE_CAR[0])


def predict_case(findings: Findings, key: RunKey) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Predict the largest tracking and true errors (m) of the followers of a case."""
    alpha = 1.0 if key == NO_LEAD_DATA else 0.5
    return predict_errors(findings.trials[key].lead, transfer(key), alpha, 3)


def explain_growth(key: RunKey, findings: Findings) -> str:
    tracking, _ = predict_case(findings, key)
    low, high = amplified_band(transfer(key))[0]
    wide = "cars with the paper's law run wide in curves, and " if low == 0.0 else ""
    bands = f"{low:.1f} to {min(high, LANE_CHANGE_BAND):.1f}"
    shape = (
        "The composite trajectory combines two paths centimetres apart, which no single curve fits"
        if findings.trajectory == "fitted"
        else "One line or circle is fitted to a preview that is partly straight and partly curved"
    )
    text = (
        f"two effects. (1) {wide}each path oscillates more than the path ahead where |F| > 1, in a "
        f"lane change from {bands} rad/s; linear theory predicts {in_cm(tracking)}. (2) {shape}"
    )
    if findings.has(key.with_variant("blend")):
        blend = findings.trials[key.with_variant("blend")].tracking
        text += (
            f"; with one trajectory for each source (blend): {in_cm(blend)} in the first lane "
            "change"
        )
    return text


def predict_errors(
    lead: Drive, transfer: Transfer, alpha: float, followers: int
) -> tuple[tuple[float, ...], tuple[float, ...]]:
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
    tracking, cross_track = (
        tuple(np.abs(np.fft.irfft(errors)).max(axis=1).tolist())
        for errors in (offsets - alpha * ahead, offsets)
    )
    return tracking, cross_track
