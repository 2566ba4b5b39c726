"""Recorded decisions of a vehicle next to those of other software on the same inputs."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import hypot, pi
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenarios.definition.errors import ScenarioError
from scenarios.definition.scenario import Scenario, scenario_from_text
from scenarios.results.log_queries.session import session_of
from scenarios.results.log_summary import PARTIAL
from scenarios.runs.virtual.open_loop import Decisions, RecordedInputs, decide_again, read_inputs
from transport.log.reader import LogReader
from transport.log.records import LogError
from vehicles.schedule import SECOND

Floats = NDArray[np.float64]
SCHEMA = "convoy.recompute/1"
COMMANDS = (
    "steering_rad",
    "feedforward_rad",
    "feedback_rad",
    "acceleration_mps2",
    "target_speed_mps",
)
"""Compared fields of commands."""
TRACKING = ("lateral_error_m", "heading_error_rad", "curvature_per_m", "known_m")
"""Compared fields of self-estimates, which show another fusion or trajectory."""
PLOTTED = (
    ("steering_rad", "steering angle, °", 180.0 / pi),
    ("acceleration_mps2", "acceleration, m/s²", 1.0),
    ("lateral_error_m", "self-estimated error, m", 1.0),
)
"""Plotted fields, their labels, and the factors to the labels' units."""
TOPICS = ("gps", "verdict", "command", "start", "change")
"""Topics without which the inputs of a vehicle are unknown."""
OWN_KEYS = ("control.", "information_flow.")
FIXED = "control.rate_hz"
"""Key that would change the instants of decisions."""


@dataclass(frozen=True, slots=True)
class DecisionDifference:
    """Recomputed minus recorded values of one field; times are after the start of the run.

    `recorded` and `recomputed` are the values at the largest difference.
    """

    field: str
    rms: float
    largest: float
    largest_at_s: float
    recorded: float
    recomputed: float
    first_at_s: float | None
    count: int


@dataclass(frozen=True, slots=True, eq=False)
class Recomputation:
    """Recorded and recomputed decisions of one vehicle at the same instants.

    `recorded` and `recomputed` have an array (N) per field. `judged` messages had a verdict; for
    `judged_otherwise` of them it could not be repeated. `car_off_m_max` is the largest distance of
    the car from its recorded position. Both are 0 if the inputs are exactly those of the run.
    `faults` describes what the log lacks.
    """

    log: Path
    vehicle: str
    settings: tuple[str, ...]
    faults: str
    at_s: Floats
    recorded: Mapping[str, Floats]
    recomputed: Mapping[str, Floats]
    other_modes: int
    judged: int
    judged_otherwise: int
    car_off_m_max: float

    @property
    def differences(self) -> tuple[DecisionDifference, ...]:
        return tuple(self._difference(field) for field in self.recorded)

    @property
    def is_equal(self) -> bool:
        """Whether all decisions are equal to the bit."""
        return not self.other_modes and not any(one.count for one in self.differences)

    @property
    def inputs_are_exact(self) -> bool:
        return not self.judged_otherwise and not self.car_off_m_max

    def _difference(self, field: str) -> DecisionDifference:
        a, b = self.recorded[field], self.recomputed[field]
        (differing,) = np.nonzero(a.view(np.int64) != b.view(np.int64))
        error = np.where(a == b, 0.0, b - a)
        known = np.nan_to_num(np.abs(error), nan=0.0, posinf=0.0)
        row = int(known.argmax())
        return DecisionDifference(
            field=field,
            rms=float(np.sqrt(np.mean(np.square(known)))),
            largest=float(known[row]),
            largest_at_s=float(self.at_s[row]),
            recorded=float(a[row]),
            recomputed=float(b[row]),
            first_at_s=float(self.at_s[differing[0]]) if len(differing) else None,
            count=len(differing),
        )

    @property
    def sentence(self) -> str:
        """The result in one sentence."""
        count = len(self.at_s)
        if self.is_equal:
            return f"{self.vehicle}: all {count} recomputed decisions equal the recorded ones"
        differing = [one for one in self.differences if one.first_at_s is not None]
        if not differing:
            return f"{self.vehicle}: {self.other_modes} of {count} decisions have another mode"
        first = min(differing, key=lambda one: one.first_at_s or 0.0)
        row = int(np.searchsorted(self.at_s, first.first_at_s or 0.0))
        return (
            f"{self.vehicle}: decisions differ from {first.first_at_s:.3f} s on, where "
            f"{first.field} is {self.recorded[first.field][row]:.9g} in the log and "
            f"{self.recomputed[first.field][row]:.9g} recomputed"
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Lines about inputs that are not exactly those of the run."""
        lines = [self.faults] if self.faults else []
        if self.judged_otherwise:
            lines.append(
                f"{self.judged_otherwise} of {self.judged} messages are not received as recorded: "
                "was the log written by another version?"
            )
        if self.car_off_m_max:
            lines.append(
                f"the car is up to {self.car_off_m_max:.3g} m off its recorded position, and so "
                "are its measurements: was the log written by another version?"
            )
        return tuple(lines)


def recompute(
    log: Path,
    vehicle: str,
    *,
    controller: str = "",
    overrides: Sequence[str] = (),
    partial: bool = False,
) -> Recomputation:
    """Let a vehicle of a log decide again, with another `controller`, or other keys.

    These are keys of [control] and [information_flow].

    Raises LogError for a log without the inputs or the vehicle, and ScenarioError for an override
    that would change them.
    """
    reader = LogReader(log)
    if not partial:
        reader.refuse_faults(*TOPICS, remedy=PARTIAL)
    session = session_of(log, partial=partial)
    names = session.vehicle_names
    if vehicle not in names:
        raise LogError(f"{log}: no vehicle {vehicle!r}, allowed {', '.join(names)}")
    settings = settings_of(vehicle, controller, overrides)
    scenario = _with_settings(session, settings, log)
    setup = scenario.vehicle(vehicle)
    measured = setup.predecessor if setup.gap_sensor else None
    senders = _sources(session, scenario, vehicle)
    inputs = read_inputs(reader, vehicle, senders, measured or "")
    again = decide_again(scenario, vehicle, inputs)
    subject = _Subject(log, vehicle, settings, reader.faults_in(TOPICS))
    return _compared(subject, inputs, again)


def settings_of(vehicle: str, controller: str, overrides: Sequence[str]) -> tuple[str, ...]:
    """Overrides of one vehicle; raises ScenarioError for keys of other tables."""
    own = f"vehicle.{vehicle}."
    settings = [f"{own}control.controller={controller}"] if controller else []
    for text in overrides:
        bare = text.strip().removeprefix(own)
        name = text.partition("=")[0].strip()
        if not bare.startswith(OWN_KEYS) or name == FIXED:
            raise ScenarioError(
                [
                    f"--set: {name}: allowed keys of [control] except rate_hz, and of "
                    "[information_flow]; inputs are recorded"
                ]
            )
        settings.append(f"{own}{bare}")
    return tuple(settings)


def _sources(session: Scenario, scenario: Scenario, vehicle: str) -> Sequence[str]:
    """Return the sources of a vehicle; raises ScenarioError for one that it did not receive."""
    received, wanted = (one.vehicle(vehicle).senders for one in (session, scenario))
    for sender in wanted:
        if sender not in received:
            raise ScenarioError(
                [
                    f"--set: information_flow: {vehicle} did not receive {sender} in the log, "
                    f"allowed {', '.join(received)}"
                ]
            )
    return wanted


def _with_settings(session: Scenario, settings: Sequence[str], log: Path) -> Scenario:
    if not settings:
        return session
    return scenario_from_text(session.text, label=str(log), overrides=settings)


class _Subject(NamedTuple):
    """Log, vehicle, its settings, and the faults of the log."""

    log: Path
    vehicle: str
    settings: tuple[str, ...]
    faults: str


def _compared(subject: _Subject, inputs: RecordedInputs, again: Decisions) -> Recomputation:
    before = inputs.decisions
    instants = sorted(before.commands.keys() & again.commands.keys())
    if not instants:
        raise LogError(f"{subject.log}: no decision of {subject.vehicle} can be repeated")
    estimated = [at for at in instants if at in before.tracking and at in again.tracking]
    tables = [
        _columns(COMMANDS, side.commands, instants)
        # The log may be thinned.
        | (_columns(TRACKING, side.tracking, instants) if len(estimated) == len(instants) else {})
        for side in (before, again)
    ]
    judged = [key for key in before.verdicts if key in again.verdicts]
    return Recomputation(
        *subject,
        at_s=np.array([(at - inputs.start_at) / SECOND for at in instants]),
        recorded=tables[0],
        recomputed=tables[1],
        other_modes=sum(before.tracking[at].mode != again.tracking[at].mode for at in estimated),
        judged=len(before.verdicts),
        judged_otherwise=len(before.verdicts)
        - sum(_fate(before.verdicts[key]) == _fate(again.verdicts[key]) for key in judged),
        car_off_m_max=max(
            (
                hypot(a.east_m - b.east_m, a.north_m - b.north_m)
                for at, a in before.truth.items()
                if (b := again.truth.get(at)) is not None
            ),
            default=0.0,
        ),
    )


def _columns(
    names: Sequence[str], messages: Mapping[int, object], instants: Sequence[int]
) -> dict[str, Floats]:
    """Arrays (N) of fields of the messages at N instants."""
    return {
        name: np.array([float(getattr(messages[at], name)) for at in instants]) for name in names
    }


_fate = attrgetter("outcome", "reason", "visible_at_ns", "received_at_ns", "content")


def to_json(result: Recomputation) -> str:
    """Machine-readable differences and all decisions."""
    content = {
        "schema": SCHEMA,
        "log": str(result.log),
        "vehicle": result.vehicle,
        "settings": list(result.settings),
        "equal": result.is_equal,
        "decisions": len(result.at_s),
        "other_modes": result.other_modes,
        "messages": result.judged,
        "messages_judged_otherwise": result.judged_otherwise,
        "car_off_m_max": result.car_off_m_max,
        "log_faults": result.faults,
        "sentence": result.sentence,
        "differences": [asdict(one) for one in result.differences],
    }
    return json.dumps(content, indent=2) + "\n"
