"""What a scenario file may say of the GNSS receivers and the errors of their positions."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from scenarios.definition.schema.table import NotNegative, Table

Fix = Literal["fixed", "float", "single", "none"]
Preset = Literal["rtk_fixed", "rtk_float", "single", "none"]
Metres = Annotated[float, Field(ge=0, le=1000)]
Place = Annotated[float, Field(ge=-1_000_000, le=1_000_000)]
Moment = Annotated[float, Field(ge=0, le=86_400)]

PRESETS: Mapping[str, Mapping[str, Any]] = {
    "rtk_fixed": {
        "fix": "fixed",
        "position_noise_m": 0.006,
        "drift": {"deviation_m": 0.016, "time_constant_s": 100.0},
        "entry_jump_m": None,
    },
    "rtk_float": {
        "fix": "float",
        "position_noise_m": 0.0,
        "drift": {"deviation_m": 0.19, "time_constant_s": 100.0},
        "entry_jump_m": 0.5,
    },
    "single": {
        "fix": "single",
        "position_noise_m": 0.0,
        "drift": {"deviation_m": 1.5, "time_constant_s": 300.0},
        "entry_jump_m": None,
    },
    "none": {"fix": "none"},
}
"""What a preset stands for: keys of the table of a receiver.

RTK: a u-blox F9P on a car's roof, 75 min and 21 km, from the sample data of rtklib-py, was off by
17 mm rms when fixed, by 0.27 m when float, with a decorrelation (1/e) of 64 s in north and 184 s in
east. Single: the order of magnitude of positions by code alone, not measured.
"""
OF_STATE = {"while_fixed": "rtk_fixed", "while_float": "rtk_float", "while_single": "single"}
"""Preset from which a fix state has its errors, by the key that changes them."""


class DriftTable(Table):
    """First-order Gauss–Markov drift: steady deviation per axis, and time constant."""

    deviation_m: Metres
    time_constant_s: float = Field(default=100.0, ge=0.1, le=100_000)


class BiasTable(Table):
    """A constant error: drawn for each vehicle with a deviation per axis, and given."""

    deviation_m: Metres = 0.0
    east_m: float = Field(default=0.0, ge=-1000, le=1000)
    north_m: float = Field(default=0.0, ge=-1000, le=1000)


class StateErrorsTable(Table):
    """Errors of position while in a fix state: white noise and drift.

    With `entry_jump_m` the drift begins anew, no further than that from 0, whenever the state is
    entered. `accuracy_ratio` is what the receiver says of its accuracy over what it is.
    """

    position_noise_m: float = Field(default=0.02, ge=0, le=100)
    drift: DriftTable | None = None
    entry_jump_m: Metres | None = None
    accuracy_ratio: float = Field(default=1.0, gt=0, le=100)


class StatePoint(Table):
    """The fix state from a time after the start on."""

    at_s: NotNegative
    state: Fix


class ScheduledStates(Table):
    """Fix states by a list; before its first entry that of the receiver."""

    kind: Literal["schedule"]
    entries: Annotated[tuple[StatePoint, ...], Field(strict=False, min_length=1)]


class TransitionTable(Table):
    """A transition of the fix state, after a time with an exponential law of mean `mean_s`."""

    state: Fix
    to: Fix
    mean_s: float = Field(ge=0.01, le=1e9)


class ChainOfStates(Table):
    """Fix states by a Markov chain, drawn for each vehicle; it begins in that of the receiver."""

    kind: Literal["chain"]
    transitions: Annotated[tuple[TransitionTable, ...], Field(strict=False, min_length=1)]


StatesTable = Annotated[ScheduledStates | ChainOfStates, Field(discriminator="kind")]


class TimeOutageTable(Table):
    """No fix from a time after the start until another."""

    kind: Literal["time"]
    from_s: Moment
    to_s: Moment


class RoadOutageTable(Table):
    """No fix on a stretch of road, by the way driven from where the lead starts (laps count on)."""

    kind: Literal["road"]
    from_m: Place
    to_m: Place


class CircleOutageTable(Table):
    """No fix within a circle of the plane."""

    kind: Literal["circle"]
    east_m: Place
    north_m: Place
    radius_m: float = Field(gt=0, le=1_000_000)


OutageOfFix = Annotated[
    TimeOutageTable | RoadOutageTable | CircleOutageTable, Field(discriminator="kind")
]


class GnssTable(StateErrorsTable):
    """The emulated receiver: its rate, white noise, and what else is wrong with its positions.

    Position errors given here are those of the state `fix`; other states have those of the preset
    of their name, changed by the tables `while_...`. A `preset` is laid under the other keys.
    """

    preset: Preset | None = None
    rate_hz: float = Field(default=20.0, ge=0.01, le=100)
    heading_noise_deg: float = Field(default=0.1, ge=0, le=45)
    speed_noise_mps: float = Field(default=0.03, ge=0, le=10)
    yaw_rate_noise_radps: float = Field(default=0.00175, ge=0, le=1)
    fix: Fix = "fixed"
    common_drift: DriftTable | None = None
    bias: BiasTable | None = None
    quantisation_m: Metres = 0.0
    latency_ms: float = Field(default=0.0, ge=0, le=5000)
    fix_states: StatesTable | None = None
    while_fixed: StateErrorsTable | None = None
    while_float: StateErrorsTable | None = None
    while_single: StateErrorsTable | None = None
    outages: Annotated[tuple[OutageOfFix, ...], Field(strict=False)] = ()

    @model_validator(mode="before")
    @classmethod
    def _lay_presets_under(cls, given: Any) -> Any:
        """Add what presets say and the file leaves out, so that the table says all of it."""
        if not isinstance(given, dict):
            return given
        name = given.get("preset")
        whole = _laid_over(PRESETS.get(name, {}) if isinstance(name, str) else {}, given)
        for key, preset in OF_STATE.items():
            if isinstance(whole.get(key), dict):
                under = {one: v for one, v in PRESETS[preset].items() if one != "fix"}
                whole[key] = _laid_over(under, whole[key])
        return whole

    @property
    def is_plain(self) -> bool:
        """Whether there is nothing but white noise on every position."""
        return self.fix == "fixed" and not (
            self.drift
            or self.common_drift
            or self.bias
            or self.quantisation_m
            or self.latency_ms
            or self.fix_states
            or self.outages
            or self.accuracy_ratio != 1.0
        )

    @property
    def is_punctual(self) -> bool:
        """Whether there is a fix at every instant of measuring, known at once."""
        sure = self.fix != "none" and not self.fix_states and not self.outages
        return sure and not self.latency_ms


def _laid_over(under: Mapping[str, Any], given: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of `under` that are not given, table by table, and all that are."""
    whole = {**under, **given}
    for key, value in under.items():
        if isinstance(value, dict) and isinstance(given.get(key), dict):
            whole[key] = {**value, **given[key]}
    return whole
