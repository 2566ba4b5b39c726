"""Settings of a GNSS receiver: its rate, white noise, and position errors.

A receiver error of its own is a field of `GnssSettings` whose type is an `ErrorTerm`.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from math import degrees, hypot, sqrt
from typing import Annotated, Any, Literal, get_args

from vehicles.car.positioning.bias import Bias
from vehicles.car.positioning.common_drift import CommonDrift
from vehicles.car.positioning.drift import Drift
from vehicles.car.positioning.error_term import ErrorTerm
from vehicles.car.positioning.fix_states import FIX_STATE_LAWS, FixStateLaw, ReceiverState
from vehicles.car.positioning.noise import GnssNoise
from vehicles.car.positioning.outages import OUTAGES, FixOutage
from vehicles.messages import FixState
from vehicles.schedule import MILLISECOND
from vehicles.setting import Problem, Setting

STATES_WITH_FIX: tuple[FixState, ...] = get_args(FixState)
NOISE = GnssNoise()
NO_DRIFT = Drift(0.0)
Preset = Literal["rtk_fixed", "rtk_float", "single", "none"]
PRESETS: Mapping[Preset, Mapping[str, Any]] = {
    "rtk_fixed": {
        "fix": "fixed",
        "position_noise": 0.006,
        "drift": Drift(0.016, 100.0),
        "entry_jump": None,
    },
    "rtk_float": {
        "fix": "float",
        "position_noise": 0.0,
        "drift": Drift(0.19, 100.0),
        "entry_jump": 0.5,
    },
    "single": {
        "fix": "single",
        "position_noise": 0.0,
        "drift": Drift(1.5, 300.0),
        "entry_jump": None,
    },
    "none": {"fix": "none"},
}
"""Fields of `GnssSettings` by preset.

RTK: a u-blox F9P on a car's roof, 75 min and 21 km, from the sample data of rtklib-py, was off by
17 mm rms when fixed, by 0.27 m when float, with a decorrelation (1/e) of 64 s in north and 184 s in
east. Single: the order of magnitude of positions by code alone, not measured.
"""
PRESET_OF_STATE: Mapping[FixState, Preset] = {
    "fixed": "rtk_fixed",
    "float": "rtk_float",
    "single": "single",
}
"""Preset of a fix state that is not the receiver's own."""


@dataclass(frozen=True, slots=True)
class StateErrors:
    """Errors of position in one fix state: white noise (m, per axis), Gauss–Markov drift.

    With `entry_jump` (m) the drift restarts when the state is entered; else it continues unseen
    while the receiver is in another state.
    """

    position_noise: Annotated[
        float, Setting("white noise of the position, per axis", "m", 0, 100)
    ] = NOISE.position
    drift: Annotated[
        Drift | None,
        Setting("drift of each receiver on its own: a Gauss–Markov process, the same at any rate"),
    ] = None
    entry_jump: Annotated[
        float | None,
        Setting(
            "the drift restarts, no further than this from 0, whenever the state is entered (also "
            "after an outage); left out: it continues",
            unit="m",
            minimum=0,
            maximum=1000,
            example=0.5,
        ),
    ] = None
    accuracy: Annotated[
        float,
        Setting(
            "accuracy that the receiver reports, over the true deviation: 1 is honest, 0.05 was "
            "measured of one solver",
            unit="ratio",
            above=0,
            maximum=100,
        ),
    ] = 1.0

    def entry_problems(self, key: str = "") -> Iterator[Problem]:
        """Report an entry jump without a drift; `key` is that of the table."""
        if self.entry_jump is not None and self.drift is None:
            yield f"{key}entry_jump_m", "given without drift, which begins anew with it"


@dataclass(frozen=True, slots=True)
class GnssSettings(StateErrors):
    """The emulated receiver: its rate, white noise, and position errors.

    Position errors given here are those of the state `fix`; other states have those of the preset
    of their name, changed by the tables `while_...`. A `preset` is laid under the other keys.
    """

    preset: Annotated[
        Preset | None,
        Setting(
            "default of the keys fix, position_noise_m, drift and entry_jump_m. "
            '"rtk_fixed" and "rtk_float": as a u-blox F9P on a car\'s roof (sample data of '
            'rtklib-py); "single": by code alone, an order of magnitude; "none": no fix at all',
            example="rtk_fixed",
        ),
    ] = None
    rate: Annotated[float, Setting("rate of fixes", "hz", 0.01, 100)] = 20.0
    heading_noise: Annotated[float, Setting("white noise of the heading", "deg", 0, 45)] = (
        NOISE.heading
    )
    speed_noise: Annotated[float, Setting("white noise of the speed", "mps", 0, 10)] = NOISE.speed
    yaw_rate_noise: Annotated[float, Setting("white noise of the yaw rate", "radps", 0, 1)] = (
        NOISE.yaw_rate
    )
    fix: Annotated[
        ReceiverState,
        Setting(
            'fix state: "fixed", "float", "single", or "none": then there is no fix and nothing is '
            "sent. A car whose first fix may come late, or not at all, knows where it starts"
        ),
    ] = "fixed"
    common_drift: Annotated[
        CommonDrift | None,
        Setting(
            "drift of all receivers alike (satellites, atmosphere), which leaves the distances "
            "between vehicles as they are"
        ),
    ] = None
    bias: Annotated[Bias | None, Setting("a constant error, given and drawn for each vehicle")] = (
        None
    )
    quantisation: Annotated[
        float, Setting("positions are rounded to multiples of this", "m", 0, 1000)
    ] = 0.0
    latency: Annotated[
        int, Setting("time until a fix is known to its own car and can be sent", "ms", 0, 5000)
    ] = 0
    fix_states: Annotated[
        FixStateLaw | None,
        Setting("fix states that change; it begins in `fix`", kinds=FIX_STATE_LAWS),
    ] = None
    while_fixed: Annotated[
        StateErrors | None, Setting("errors while fixed, if `fix` is another state: rtk_fixed with")
    ] = None
    while_float: Annotated[
        StateErrors | None, Setting("errors while float, if `fix` is another state: rtk_float with")
    ] = None
    while_single: Annotated[
        StateErrors | None, Setting("errors while single, if `fix` is another state: single with")
    ] = None
    outages: Annotated[
        tuple[FixOutage, ...], Setting("times and places without a fix", kinds=OUTAGES)
    ] = ()

    @property
    def noise(self) -> GnssNoise:
        """White noise."""
        return GnssNoise(
            self.position_noise, self.heading_noise, self.speed_noise, self.yaw_rate_noise
        )

    @property
    def error_terms(self) -> tuple[ErrorTerm, ...]:
        """Errors added to those of the fix state, own ones before shared ones."""
        values = (getattr(self, field.name) for field in fields(self))
        found = [value for value in values if isinstance(value, ErrorTerm)]
        return tuple(sorted(found, key=lambda error: error.shared))

    @property
    def has_only_white_noise(self) -> bool:
        """Whether there is nothing but white noise on every position."""
        return self.fix == "fixed" and not (
            self.drift
            or self.error_terms
            or self.quantisation
            or self.latency
            or self.fix_states
            or self.outages
            or self.accuracy != 1.0
        )

    @property
    def has_fix_every_instant(self) -> bool:
        """Whether there is a fix at every instant of measuring, known at once."""
        return not (self.fix == "none" or self.fix_states or self.outages or self.latency)

    def errors_in(self, state: FixState) -> StateErrors:
        """Errors in a state: the receiver's own in its `fix`, else those of the state."""
        if state == self.fix:
            return self
        own: StateErrors | None = getattr(self, f"while_{state}")
        usual = {
            key: value for key, value in PRESETS[PRESET_OF_STATE[state]].items() if key != "fix"
        }
        return own or StateErrors(**usual)

    def deviation(self, state: FixState, *, shared: bool = True) -> float:
        """True standard deviation (m) per axis in a state, of independent parts.

        Without those that are `shared` by all receivers, that of one relative to another's zero.
        Rounding adds a twelfth of its square; a given bias is unknown.
        """
        errors = self.errors_in(state)
        variance = errors.position_noise**2 + (errors.drift or NO_DRIFT).deviation ** 2
        common = 0.0
        for error in self.error_terms:
            if error.shared:
                common += error.variance
            else:
                variance += error.variance
        variance += self.quantisation**2 / 12.0 + (common if shared else 0.0)
        return sqrt(variance)

    @property
    def states(self) -> list[FixState]:
        """States with a fix that it can be in."""
        reached = self.fix_states.states() if self.fix_states else set[ReceiverState]()
        return [state for state in STATES_WITH_FIX if state in {self.fix, *reached}]

    @property
    def initial_deviation(self) -> float:
        """Standard deviation (m) per axis in the state that it begins in."""
        if self.has_only_white_noise or self.fix == "none":
            return self.position_noise
        return self.deviation(self.fix)

    @property
    def assumed_deviation(self) -> float:
        """Standard deviation (m) per axis for those who receive, in the worst state it can be in.

        Without what all have in common, which moves nobody against another. Errors that last are
        in it: two sources are that far apart, however smooth each of them is.
        """
        if self.has_only_white_noise:
            return self.position_noise
        found = [self.deviation(state, shared=False) for state in self.states]
        return max(found, default=self.position_noise)

    @property
    def lasting_deviation(self) -> float:
        """Standard deviation (m) per axis of drawn errors that last, in the worst state.

        Without white noise, which is averaged, and what all have in common.
        """
        drifts = [self.errors_in(state).drift or NO_DRIFT for state in self.states]
        own = [error.variance for error in self.error_terms if not error.shared]
        return hypot(max((one.deviation for one in drifts), default=0.0), sqrt(sum(own)))

    def problems(self) -> Iterator[Problem]:
        """Yield keys that contradict others."""
        given: dict[FixState, StateErrors] = {}
        for state in STATES_WITH_FIX:
            key = f"while_{state}"
            own: StateErrors | None = getattr(self, key)
            if own is None:
                continue
            given[state] = own
            if state == self.fix:
                yield key, f'given for fix = "{self.fix}", whose errors stand in gnss itself'
            elif self.fix_states is None:
                yield key, "given without fix_states, which it is about"
        yield from self.entry_problems()
        for state, errors in given.items():
            yield from errors.entry_problems(f"while_{state}.")
        if self.fix_states is not None:
            for key, why in self.fix_states.problems(self.fix):
                yield f"fix_states.{key}", why
        for index, outage in enumerate(self.outages):
            for key, why in outage.problems():
                yield f"outages[{index}].{key}", why

    def describe(self) -> Iterator[str]:
        """Short descriptions of its rate, noise and errors, for tables."""
        yield (
            f"{self.rate:g} Hz, noise {self.position_noise:g} m, {degrees(self.heading_noise):g}°, "
            f"{self.speed_noise:g} m/s, {self.yaw_rate_noise:g} rad/s"
        )
        if self.preset or self.fix != "fixed":
            yield f"{self.preset or 'fix'} ({self.fix})"
        if self.drift:
            yield f"drift {self.drift.deviation:g} m over {self.drift.time_constant:g} s"
        for error in reversed(self.error_terms):
            yield error.describe()
        if self.quantisation:
            yield f"steps of {self.quantisation:g} m"
        if self.latency:
            yield f"{self.latency / MILLISECOND:g} ms late"
        if self.fix_states:
            kind = next(
                word for word, law in FIX_STATE_LAWS.items() if law is type(self.fix_states)
            )
            yield f"fix states by {kind}"
        if self.outages:
            yield f"{len(self.outages)} outages"
        if self.accuracy != 1.0:
            yield f"says {self.accuracy:g} of its deviation"
