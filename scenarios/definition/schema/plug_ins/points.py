"""All plug-in points."""

from collections.abc import Iterable, Mapping
from math import isfinite
from numbers import Real
from typing import Any, Protocol, get_args

from scenarios.definition.schema.plug_ins.point import (
    ANY_RESULT,
    NUMBER,
    YES_OR_NO,
    PlugInPoint,
    Result,
    dotted_name,
    is_finite,
)
from transport.links.laws.burst_losses import BaseLoss
from transport.links.laws.delays import BaseDelay
from transport.links.laws.link_law import LinkLaw, Position, TransmissionContext
from transport.links.laws.registry import DelayLaw, LossLaw
from transport.topics import REASONS
from vehicles.car.gnss_error_terms import ErrorProcess, ErrorTerm, ReceiverContext
from vehicles.car.gnss_settings import ERRORS
from vehicles.car.parameters import Gains, VehicleParameters
from vehicles.car.sending_rules import RULES, SendingContext, SendingRule, SendingTrigger
from vehicles.driver.controller import (
    LongitudinalController,
    LongitudinalSetup,
    OwnMotion,
    SourceState,
    VehiclesAhead,
)
from vehicles.driver.reactions import CHOSEN, ReactionPolicy
from vehicles.driver.steering import LateralController, SteeringCommand
from vehicles.driver.tracking import TrackingErrors
from vehicles.preview.fusion import SourceFusion
from vehicles.preview.trajectory import Fit, SourceWindow

# ---- Results of methods


def all_finite(*values: object) -> bool:
    return all(map(is_finite, values))


COMMAND = Result(
    "a SteeringCommand of finite angles (rad)",
    lambda value, *_: (
        isinstance(value, SteeringCommand)
        and all_finite(value.steering, value.feedforward, value.feedback)
    ),
)
FUSED = Result(
    "a list of tuples (share, Fit)",
    lambda value, *_: (
        isinstance(value, list | tuple)
        and all(
            isinstance(entry, tuple) and is_finite(entry[0]) and isinstance(entry[-1], Fit)
            for entry in value
        )
    ),
)
MODE = Result(
    f"the usual mode or one of {', '.join(CHOSEN)}",
    lambda value, _situation, usual, _speed: value in (usual, *CHOSEN),
)
VERDICT = Result(
    'a whole number of ns of at least 0, or the reason of a drop, such as "loss"',
    lambda value, *_: (
        value in REASONS and REASONS[value].is_drop
        if isinstance(value, str)
        else type(value) is int and value >= 0
    ),
)
POSITION = Result(
    "a tuple of two finite numbers: east and north (m)",
    lambda value, *_: isinstance(value, tuple) and len(value) == 2 and all_finite(*value),
)
SPANS = Result("tuples (vehicle, first ns, last ns)", lambda value, *_: isinstance(value, Iterable))
FIGURES = Result(
    "a finite number, or one or None by vehicle",
    lambda value, *_: (
        all(one is None or (isinstance(one, Real) and isfinite(one)) for one in value.values())
        if isinstance(value, Mapping)
        else isinstance(value, Real) and isfinite(value)
    ),
)


# ---- Control of a vehicle


LATERAL = PlugInPoint(
    name="controller",
    key="control.controller",
    shipped={
        "slip_compensated": "vehicles.driver.steering.SlipCompensated",
        "feedforward_feedback": "vehicles.driver.steering.FeedforwardFeedback",
        "stanley": "vehicles.driver.steering.Stanley",
        "pure_pursuit": "vehicles.driver.steering.PurePursuit",
    },
    contract=LateralController,
    results={"steer": COMMAND},
    arguments=("parameters", "gains"),
    types=(TrackingErrors, SteeringCommand, VehicleParameters, Gains),
)
LONGITUDINAL = PlugInPoint(
    name="controller",
    key="control.longitudinal",
    shipped={
        name: f"vehicles.driver.longitudinal_laws.{law}"
        for name, law in (
            ("gap", "GapLaw"),
            ("acc", "Acc"),
            ("cacc", "Cacc"),
            ("ploeg", "Ploeg"),
            ("flatbed", "Flatbed"),
            ("consensus", "Consensus"),
        )
    },
    contract=LongitudinalController,
    results={"acceleration": NUMBER},
    arguments=("setup",),
    types=(LongitudinalSetup, VehiclesAhead, OwnMotion, SourceState),
)
FUSION = PlugInPoint(
    name="fusion",
    key="control.fusion",
    shipped={
        "composite": "vehicles.preview.fusion.CompositeFusion",
        "blend": "vehicles.preview.fusion.BlendFusion",
    },
    contract=SourceFusion,
    results={"fuse": FUSED},
    types=(SourceWindow,),
)
REACTION = PlugInPoint(
    name="reaction",
    key="control.degradation.reaction",
    shipped={
        "degrade": "vehicles.driver.reactions.Degrade",
        "extrapolate": "vehicles.driver.reactions.Extrapolate",
        "hold": "vehicles.driver.reactions.Hold",
        "straight": "vehicles.driver.reactions.Straight",
    },
    contract=ReactionPolicy,
    results={"mode": MODE, "steering": COMMAND, "acceleration": NUMBER},
    types=(SteeringCommand,),
)


# ---- Links, sending and receivers


def _shipped(laws: Any) -> dict[str, str]:
    """Dotted names of the laws of a union by their kinds."""
    union = get_args(get_args(laws)[0])
    return {law.model_fields["kind"].default: dotted_name(law) for law in union}


EFFECT: Mapping[str, Result] = {
    "judge": VERDICT,
    "effects": ANY_RESULT,
    "losses": ANY_RESULT,
    "delays": ANY_RESULT,
}
LOSS = PlugInPoint(
    name="law",
    key="links.loss",
    shipped=_shipped(LossLaw),
    contract=BaseLoss,
    results=EFFECT,
    types=(TransmissionContext, Position),
    base=LinkLaw,
)
DELAY = PlugInPoint(
    name="law",
    key="links.delay",
    shipped=_shipped(DelayLaw),
    contract=BaseDelay,
    results=EFFECT,
    base=BaseDelay,
)
SENDING = PlugInPoint(
    name="sending rule",
    key="sending",
    shipped={kind: dotted_name(rule) for kind, rule in RULES.items()},
    contract=SendingRule,
    results={"due": YES_OR_NO, "sent": ANY_RESULT},
    types=(SendingTrigger, SendingContext),
    base=SendingRule,
)
RECEIVER_ERROR = PlugInPoint(
    name="error",
    key="gnss.errors",
    shipped={kind: dotted_name(error) for kind, error in ERRORS.items()},
    contract=ErrorTerm,
    results={"at": POSITION},
    types=(ErrorProcess, ReceiverContext),
    base=ErrorTerm,
)


# ---- Events and metrics of a run


class OwnEvent(Protocol):
    """A function that returns the times of an event of your own, listed in `[[event]]`.

    `run` has the messages of a whole run as NumPy arrays, as `convoy.open(LOG).tables`:
    `run.names` are the vehicles, `run.table(name, "truth")` the true poses of one of them, with the
    fields of `convoy reference topics`. The result has, or yields, tuples (vehicle, first and last
    instant in ns). `run.spans(name, holds)` makes them of an array of True and False, one for each
    true pose: a break of up to a second does not end an event. It is listed in log, summary and
    picture under the name of the function, with its duration.
    """

    def __call__(self, run: Any) -> Iterable[tuple[str, int, int]]:
        """Return the times in which the event held."""
        ...


class OwnFigure(Protocol):
    """A function that returns a metric of your own, listed in `[[figure]]`.

    `run` is that of an event. The result is a number or None for each vehicle, by its name, or one
    number for all of them. It is in the summary, in `own_figures` of the vehicles, under the name
    of the function. For a function steering_effort, [limits.own_figures] has the keys
    steering_effort_max and steering_effort_min, `--limit` takes steering_effort_max=0.02, and
    `convoy sweep --metric` takes own_figures.steering_effort. Limits judge it at the end of the
    run.
    """

    def __call__(self, run: Any) -> Mapping[str, float | None] | float:
        """Return the metric of a run."""
        ...


EVENT = PlugInPoint(
    name="event",
    key="event",
    shipped={},
    contract=OwnEvent,
    results={"": SPANS},
    arguments=("run",),
    calls=True,
)
FIGURE = PlugInPoint(
    name="figure",
    key="figure",
    shipped={},
    contract=OwnFigure,
    results={"": FIGURES},
    arguments=("run",),
    calls=True,
)

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
