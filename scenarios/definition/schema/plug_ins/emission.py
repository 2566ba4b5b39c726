"""Sending rules and errors of receivers as plug-ins."""

from scenarios.definition.schema.plug_ins.guards import (
    PlugInError,
    called,
    finite,
    own_name,
)
from scenarios.definition.schema.plug_ins.point import PlugInPoint, dotted_name
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix
from vehicles.car.positioning.error_term import ErrorProcess, ErrorTerm, ReceiverContext
from vehicles.car.positioning.gnss_settings import ERRORS
from vehicles.car.sending.rule import SendingContext, SendingRule, SendingTrigger
from vehicles.car.sending.sending_rules import RULES
from vehicles.schedule import MILLISECOND

PERIOD = 20 * MILLISECOND
STEPS = 50
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
    called(rule.describe, f"{what}: describe()")
    trigger = begin_rule(rule, context)
    sends = []
    for step in range(STEPS):
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
    called(term.describe, f"{what}: describe()")
    process = begin_error(term, context)
    bodies = [Body(20.0 * step, 0.0, 0.0, 20.0) for step in range(STEPS)]
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
