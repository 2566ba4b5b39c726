"""All plug-in points."""

from typing import Protocol

from scenarios.definition.schema.plug_ins.channel import DELAY, LOSS
from scenarios.definition.schema.plug_ins.path import FUSION, LATERAL, LONGITUDINAL, REACTION
from scenarios.definition.schema.plug_ins.point import (
    PlugInError,
    PlugInPoint,
    called,
    dotted_name,
    finite,
    own_name,
)
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.gnss_error_terms import ErrorProcess, ErrorTerm, ReceiverContext
from vehicles.car.gnss_settings import ERRORS
from vehicles.car.sending_rules import RULES, SendingContext, SendingRule, SendingTrigger
from vehicles.messages import TruePose
from vehicles.schedule import MILLISECOND

# ---- Sending rules and errors of receivers as plug-ins


PERIOD = 20 * MILLISECOND
SENDING_STEPS = 50
"""Number of control instants before a run at which a rule and an error are called."""


class GuardedTrigger:
    """Wraps the trigger of a user's sending rule, and converts its faults to PlugInError."""

    def __init__(self, trigger: SendingTrigger, name: str) -> None:
        self._trigger = trigger
        self._what = f"sending rule {name!r}"

    def due(self, now: int, unsent: Fix | None, allowed_from: int) -> bool:
        what = f"{self._what}: due()"
        is_due: object = called(lambda: self._trigger.due(now, unsent, allowed_from), what)
        if not isinstance(is_due, bool):
            raise PlugInError(f"{what} returned {is_due!r}, expected True or False")
        return is_due

    def sent(self, now: int, fix: Fix) -> None:
        called(lambda: self._trigger.sent(now, fix), f"{self._what}: sent()")


def begin_rule(rule: SendingRule, context: SendingContext) -> SendingTrigger:
    """Begin a rule; the trigger of a user's rule is guarded. Raises PlugInError."""
    name = own_name(rule)
    if not name:
        return rule.begin(context)
    trigger = called(lambda: rule.begin(context), f"sending rule {name!r}: begin()")
    return GuardedTrigger(trigger, name)


def try_rule(rule: SendingRule, context: SendingContext) -> list[bool]:
    """Drive straight for a second with 20 fixes; returns when the rule sends."""
    what = f"sending rule {own_name(rule)!r}"
    finite(called(lambda: rule.max_rate(20.0), f"{what}: max_rate()"), what, "rate (Hz)")
    nominal = called(lambda: rule.nominal_rate(20.0, 20.0), f"{what}: nominal_rate()")
    finite(nominal, f"{what}: nominal_rate() returned", "rate (Hz)")
    trigger = begin_rule(rule, context)
    sends = []
    for step in range(SENDING_STEPS):
        now = context.start_at + step * PERIOD
        fix = Fix(step, now, 20.0 * step, 0.0, 0.0, 20.0, 0.0)
        sends.append(trigger.due(now, fix, now))
        if sends[-1]:
            trigger.sent(now, fix)
    return sends


class GuardedError:
    """Wraps a user's position error, and converts its faults to PlugInError."""

    def __init__(self, process: ErrorProcess, name: str) -> None:
        self._process = process
        self._what = f"error {name!r}: at()"

    def at(self, body: Body, now: int) -> tuple[float, float]:
        result: object = called(lambda: self._process.at(body, now), self._what)
        if not isinstance(result, tuple) or len(result) != 2:
            raise PlugInError(f"{self._what} returned {result!r}, expected east and north (m)")
        east, north = (finite(one, f"{self._what} returned", "number of metres") for one in result)
        return east, north


def begin_error(term: ErrorTerm, context: ReceiverContext) -> ErrorProcess:
    """Begin an error; that of a user's class is guarded. Raises PlugInError."""
    name = own_name(term)
    if not name:
        return term.begin(context)
    return GuardedError(called(lambda: term.begin(context), f"error {name!r}: begin()"), name)


def try_error(term: ErrorTerm, context: ReceiverContext) -> list[tuple[float, float]]:
    """Return the errors over a second of straight driving."""
    what = f"error {own_name(term)!r}"
    finite(called(lambda: term.variance, f"{what}: variance"), f"{what}: variance", "variance (m²)")
    process = begin_error(term, context)
    bodies = [Body(20.0 * step, 0.0, 0.0, 20.0) for step in range(SENDING_STEPS)]
    return [process.at(one, context.start_at + k * PERIOD) for k, one in enumerate(bodies)]


SENDING = PlugInPoint(
    name="sending rule",
    title="sending rule",
    key="sending",
    shipped={kind: dotted_name(rule) for kind, rule in RULES.items()},
    contract=SendingRule,
    methods={},
    types=(SendingTrigger, SendingContext),
    base=SendingRule,
    trial=try_rule,
)
RECEIVER_ERROR = PlugInPoint(
    name="error",
    title="position error of a receiver",
    key="gnss.errors",
    shipped={kind: dotted_name(error) for kind, error in ERRORS.items()},
    contract=ErrorTerm,
    methods={},
    types=(ErrorProcess, ReceiverContext),
    base=ErrorTerm,
    trial=try_error,
)


# ---- Events and figures as plug-ins


STEPS = 20


class EventDetector(Protocol):
    """Interface of an event of your own, listed in `[[event]]`.

    Each vehicle has its own instance, constructed as `Class()`, with its `settings` if it has any.
    `holds` is called with each true pose of the vehicle, in order. The event begins when it first
    returns True, and ends when it has not done so for a second. It is listed in log, summary and
    picture under the name of the class, with its duration.
    """

    def holds(self, pose: TruePose) -> bool:
        """Whether the event holds at a true pose."""
        ...


class RunFigure(Protocol):
    """Interface of a figure of your own, listed in `[[figure]]`.

    Each vehicle has its own instance, constructed as `Class()`, with its `settings` if it has any.
    `add` is called with each true pose of the vehicle, in order. The value is in the summary, in
    `own_figures` of the vehicle, under the name of the class. For a class SteeringEffort,
    [limits.own_figures] has the keys SteeringEffort_max and SteeringEffort_min, `--limit` takes
    SteeringEffort_max=0.02, and `convoy sweep --metric` takes own_figures.SteeringEffort. Limits
    judge the value at the end of the run.
    """

    def add(self, pose: TruePose) -> None:
        """Take a true pose."""
        ...

    def value(self) -> float | None:
        """Figure of the run so far; None if there is none."""
        ...


class GuardedDetector:
    """Wraps a user's event, and converts its faults to PlugInError."""

    def __init__(self, detector: EventDetector, name: str) -> None:
        self._detector = detector
        self._what = f"event {name!r}: holds()"

    def holds(self, pose: TruePose) -> bool:
        holds: object = called(lambda: self._detector.holds(pose), self._what)
        if not isinstance(holds, bool):
            raise PlugInError(f"{self._what} returned {holds!r}, expected True or False")
        return holds


class GuardedFigure:
    """Wraps a user's figure, and converts its faults to PlugInError."""

    def __init__(self, figure: RunFigure, name: str) -> None:
        self._figure = figure
        self._what = f"figure {name!r}"

    def add(self, pose: TruePose) -> None:
        called(lambda: self._figure.add(pose), f"{self._what}: add()")

    def value(self) -> float | None:
        value: object = called(self._figure.value, f"{self._what}: value()")
        if value is None:
            return None
        return finite(value, f"{self._what}: value() returned", "number, or None")


def _poses() -> list[TruePose]:
    """True poses of a straight drive at 20 m/s."""
    return [
        TruePose(
            vehicle="v1",
            seq=seq,
            true_at_ns=seq * PERIOD,
            east_m=0.4 * seq,
            north_m=0.0,
            yaw_rad=0.0,
            speed_mps=20.0,
            lateral_speed_mps=0.0,
            yaw_rate_radps=0.0,
            steering_rad=0.0,
            distance_m=0.4 * seq,
            lateral_acceleration_mps2=0.0,
            front_slip_rad=0.0,
            rear_slip_rad=0.0,
            friction_ratio=0.0,
        )
        for seq in range(STEPS)
    ]


def try_event(detector: EventDetector) -> list[bool]:
    return [detector.holds(pose) for pose in _poses()]


def try_figure(figure: RunFigure) -> list[float | None]:
    values = [figure.value()]
    for pose in _poses():
        figure.add(pose)
    return [*values, figure.value()]


EVENT = PlugInPoint(
    name="event",
    title="event",
    key="event",
    shipped={},
    contract=EventDetector,
    methods={"holds": "pose"},
    types=(TruePose,),
    guard=GuardedDetector,
    trial=try_event,
)
FIGURE = PlugInPoint(
    name="figure",
    title="figure",
    key="figure",
    shipped={},
    contract=RunFigure,
    methods={"add": "pose", "value": ""},
    types=(),
    guard=GuardedFigure,
    trial=try_figure,
)


# ---- Points


POINTS: tuple[PlugInPoint, ...] = (
    LATERAL,
    LONGITUDINAL,
    FUSION,
    REACTION,
    LOSS,
    DELAY,
    SENDING,
    RECEIVER_ERROR,
    EVENT,
    FIGURE,
)
