"""Settings of a GNSS receiver: its rate, white noise, and position errors.

To add an error, add a kind to ERRORS. The model of these errors that an estimator may know follows
from the settings.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import exp, expm1, hypot, inf, radians, sqrt
from typing import Annotated, Any, Literal, get_args

from vehicles.car.gnss_error_terms import (
    FIX_STATE_LAWS,
    OUTAGES,
    Bias,
    CommonDrift,
    Drift,
    ErrorTerm,
    FixOutage,
    FixStateLaw,
    ReceiverState,
)
from vehicles.messages import FixState
from vehicles.schedule import SECOND
from vehicles.setting import Problem, Setting

STATES_WITH_FIX: tuple[FixState, ...] = get_args(FixState)
NO_DRIFT = Drift(0.0)
Preset = Literal["rtk_fixed", "rtk_float", "single", "none"]


def _preset(fix: FixState, noise: float, drift: Drift, jump: float | None = None) -> dict[str, Any]:
    return {"fix": fix, "position_noise": noise, "drift": drift, "entry_jump": jump}


PRESETS: Mapping[Preset, Mapping[str, Any]] = {
    "rtk_fixed": _preset("fixed", 0.006, Drift(0.016, 100.0)),
    "rtk_float": _preset("float", 0.0, Drift(0.19, 100.0), 0.5),
    "single": _preset("single", 0.0, Drift(1.5, 300.0)),
    "none": {"fix": "none"},
}
"""Fields of `GnssSettings` by preset.

RTK: a u-blox F9P on a car's roof, 75 min and 21 km, from the sample data of rtklib-py, had an rms
error of 17 mm when fixed and 0.27 m when float, with a decorrelation time (1/e) of 64 s in north
and 184 s in east. Single: order of magnitude of code-only positions, not measured.
"""
PRESET_OF_STATE: Mapping[FixState, Preset] = {
    row["fix"]: name for name, row in PRESETS.items() if name != "none"
}
ERRORS: Mapping[str, type[ErrorTerm]] = {"bias": Bias, "common_drift": CommonDrift}


@dataclass(frozen=True, slots=True)
class StateErrors:
    """Position errors in one fix state: white noise (m, per axis), Gauss–Markov drift.

    Omitted keys have the values of the preset of the state: rtk_fixed, rtk_float or single. With
    `entry_jump_m` the drift restarts within this distance of 0 when the state is entered, also
    after an outage. Without, it continues in the background while the receiver is in another state.
    An accuracy_ratio of 1 is correct; 0.05 was measured for one solver.
    """

    position_noise: Annotated[float, Setting("white noise, per axis", "m", 0, 100)] = 0.02
    drift: Annotated[Drift | None, Setting("drift of the receiver, independent of rate_hz")] = None
    entry_jump: Annotated[
        float | None,
        Setting(
            "restart the drift this near to 0 when the state begins", "m", 0, 1000, example=0.5
        ),
    ] = None
    accuracy: Annotated[
        float, Setting("reported accuracy over true deviation", "ratio", above=0, maximum=100)
    ] = 1.0


@dataclass(frozen=True, slots=True)
class GnssSettings(StateErrors):
    """The emulated receiver: its rate, white noise, and position errors.

    Position errors given here apply in the state `fix`. Other states use the preset of their name,
    or the table `while_...`. A `preset` provides defaults for other keys. White noise is given by
    standard deviations. By default that of the position is the paper's RTK receiver (Section
    III-A); the others are open-sky data of RTK-aided inertial units with two antennas and a MEMS
    gyroscope (yaw rate: 0.1 deg/s).
    """

    preset: Annotated[
        Preset | None,
        Setting(
            "defaults of fix, position_noise_m, drift and entry_jump_m. "
            '"rtk_fixed", "rtk_float": a u-blox F9P on a car\'s roof (sample data of rtklib-py); '
            '"single": code only, a rough estimate; "none": no fix',
            example="rtk_fixed",
        ),
    ] = None
    rate: Annotated[float, Setting("rate of fixes", "hz", 0.01, 100)] = 20.0
    heading_noise: Annotated[float, Setting("noise of the heading", "deg", 0, 45)] = radians(0.1)
    speed_noise: Annotated[float, Setting("noise of the speed", "mps", 0, 10)] = 0.03
    yaw_rate_noise: Annotated[float, Setting("noise of yaw rate", "radps", 0, 1)] = 0.00175
    fix: Annotated[
        ReceiverState,
        Setting(
            'fix state: "fixed", "float", "single", or "none" (no fix, and nothing is sent). A car '
            "whose first fix may be late or missing knows its initial position"
        ),
    ] = "fixed"
    common_drift: Annotated[
        CommonDrift | None, Setting("drift shared by all receivers, which keeps distances")
    ] = None
    bias: Annotated[Bias | None, Setting("a constant error per vehicle")] = None
    errors: Annotated[
        tuple[ErrorTerm, ...],
        Setting("further errors, also your own (convoy reference plug-ins)", kinds=ERRORS),
    ] = ()
    quantisation: Annotated[float, Setting("step of rounded positions", "m", 0, 1000)] = 0.0
    latency: Annotated[
        int, Setting("time until a fix is available to its own car and can be sent", "ms", 0, 5000)
    ] = 0
    fix_states: Annotated[
        FixStateLaw | None, Setting("changing states, the first is `fix`", kinds=FIX_STATE_LAWS)
    ] = None
    while_fixed: Annotated[StateErrors | None, Setting('errors in state "fixed"')] = None
    while_float: Annotated[StateErrors | None, Setting('errors in state "float"')] = None
    while_single: Annotated[StateErrors | None, Setting('errors in state "single"')] = None
    outages: Annotated[
        tuple[FixOutage, ...], Setting("times and places without a fix", kinds=OUTAGES)
    ] = ()

    @property
    def error_terms(self) -> tuple[ErrorTerm, ...]:
        """Errors added to those of the fix state, shared ones last."""
        terms = [term for term in (self.common_drift, self.bias, *self.errors) if term is not None]
        return tuple(sorted(terms, key=lambda term: term.shared))

    @property
    def has_fix_every_instant(self) -> bool:
        return not (self.fix == "none" or self.fix_states or self.outages or self.latency)

    def errors_in(self, state: FixState) -> StateErrors:
        """Errors in a state: these settings for `fix`, else `while_...` or the state's preset."""
        if state == self.fix:
            return self
        configured: StateErrors | None = getattr(self, f"while_{state}")
        preset = PRESETS[PRESET_OF_STATE[state]].items()
        return configured or StateErrors(**{key: value for key, value in preset if key != "fix"})

    def deviation(self, state: FixState, *, shared: bool = True) -> float:
        """True standard deviation (m) per axis in a state, of all independent random errors.

        Excludes errors shared by all receivers unless `shared`. Rounding to a step q has the
        variance q²/12. The configured bias is not included.
        """
        errors = self.errors_in(state)
        variance = errors.position_noise**2 + (errors.drift or NO_DRIFT).deviation ** 2
        own = sum([term.variance for term in self.error_terms if not term.shared], variance)
        common = sum([term.variance for term in self.error_terms if term.shared and shared])
        return sqrt(own + (self.quantisation**2 / 12.0 + common))

    @property
    def states(self) -> list[FixState]:
        """Possible states with a fix."""
        entered = self.fix_states.states() if self.fix_states else set[ReceiverState]()
        return [state for state in STATES_WITH_FIX if state in {self.fix, *entered}]

    @property
    def initial_deviation(self) -> float:
        """Standard deviation (m) per axis in the initial state."""
        return self.position_noise if self.fix == "none" else self.deviation(self.fix)

    @property
    def assumed_deviation(self) -> float:
        """Standard deviation (m) per axis that followers assume: that of the worst state.

        Excludes shared errors, which do not change relative positions. Includes drift, by which two
        sources differ even if each of them is smooth.
        """
        deviations = [self.deviation(state, shared=False) for state in self.states]
        return max(deviations, default=self.position_noise)

    @property
    def lasting_deviation(self) -> float:
        """Standard deviation (m) per axis of the random errors that averaging does not remove.

        That of the worst state, without white noise and shared errors.
        """
        drifts = [self.errors_in(state).drift or NO_DRIFT for state in self.states]
        own = [error.variance for error in self.error_terms if not error.shared]
        return hypot(max((drift.deviation for drift in drifts), default=0.0), sqrt(sum(own)))

    def problems(self) -> Iterator[Problem]:
        own = {state: getattr(self, f"while_{state}") for state in STATES_WITH_FIX}
        for state, errors in own.items():
            if errors is not None and state == self.fix:
                reason = f'given for fix = "{self.fix}", whose errors are keys of gnss itself'
                yield f"while_{state}", reason
            elif errors is not None and self.fix_states is None:
                yield f"while_{state}", "given without fix_states, so this state never occurs"
        for key, errors in (("", self), *((f"while_{state}.", own[state]) for state in own)):
            if errors is not None and errors.entry_jump is not None and errors.drift is None:
                yield f"{key}entry_jump_m", "given without drift, which it restarts"
        if self.fix_states is not None:
            for key, reason in self.fix_states.problems(self.fix):
                yield f"fix_states.{key}", reason
        for index, outage in enumerate(self.outages):
            for key, reason in outage.problems():
                yield f"outages[{index}].{key}", reason


# ---- The error model that a receiver states: what an estimator may know of its errors
#
# It is that of the settings, scaled by the ratio of the reported accuracy to the true one. A
# receiver that reports a wrong accuracy therefore misleads its estimator.


LEAST_NOISE = 0.001  # Least white noise (m) of a position: receivers report millimetres


@dataclass(frozen=True, slots=True)
class LastingError:
    """An error per axis that lasts from fix to fix: a stationary Gauss–Markov process.

    Standard deviation (m), time constant (s, infinite for a constant error). It is part of fixes in
    `states`, and restarts with `entry_deviation` (m), if given, when such a state is entered.
    """

    deviation: float
    time_constant: float
    states: frozenset[FixState]
    entry_deviation: float | None = None

    def kept(self, span: float) -> float:
        """Share of the error that is left after `span` (s): exp(-t / time constant)."""
        return exp(-span / self.time_constant)

    def growth(self, span: float) -> float:
        """Variance (m²) that is added in `span` (s); the stationary variance remains."""
        return -(self.deviation**2) * expm1(-2.0 * span / self.time_constant)


@dataclass(frozen=True, slots=True)
class StatedErrors:
    """Errors of a receiver's positions, per axis.

    `white` is the variance (m²) of the white noise by fix state, `period` (ns) that of fixes. The
    error shared by all receivers, which does not change relative positions, has `common_variance`
    (m²) and `common_density` (m²/s), its random walk, 2 σ²/τ of a Gauss–Markov process.
    """

    white: Mapping[FixState, float]
    lasting: tuple[LastingError, ...]
    common_variance: float
    common_density: float
    period: int


def stated_errors(settings: GnssSettings) -> StatedErrors:
    """Error model that a receiver with these settings states.

    A configured bias counts with its size, not its direction, as in a data sheet. Rounding to a
    step q has the variance q²/12.
    """
    white, lasting = {}, []
    for state in STATES_WITH_FIX:
        errors = settings.errors_in(state)
        noise = hypot(errors.position_noise, settings.quantisation / sqrt(12.0))
        white[state] = max(errors.accuracy * noise, LEAST_NOISE) ** 2
        if state in settings.states and errors.drift is not None and errors.drift.deviation > 0.0:
            drift, entry = errors.drift, errors.entry_jump
            deviation = errors.accuracy * drift.deviation
            entered = None if entry is None else deviation * _entry_share(entry / drift.deviation)
            lasting.append(
                LastingError(deviation, drift.time_constant, frozenset({state}), entered)
            )
    bias, common = settings.bias, settings.common_drift
    if bias is not None:
        size = hypot(bias.deviation, hypot(bias.east, bias.north) / sqrt(2.0))
        lasting.append(LastingError(settings.accuracy * size, inf, frozenset(STATES_WITH_FIX)))
    variance = (settings.accuracy * common.deviation) ** 2 if common else 0.0
    return StatedErrors(
        white,
        tuple(error for error in lasting if error.deviation > 0.0),
        variance,
        2.0 * variance / common.time_constant if common else 0.0,
        round(SECOND / settings.rate),
    )


def _entry_share(radius: float) -> float:
    """Deviation per axis of a drift that restarts within `radius` of 0, both over its deviation.

    The distance has Rayleigh's distribution, truncated: half its mean square is
    σ² (1 - u / (e^u - 1)) with u = r² / 2σ².
    """
    u = 0.5 * radius**2
    return sqrt(1.0 - u / expm1(u) if 0.0 < u < 700.0 else float(u > 0.0))
