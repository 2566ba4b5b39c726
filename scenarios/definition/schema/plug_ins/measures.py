"""Events and figures as plug-ins."""

from typing import Protocol

from scenarios.definition.schema.plug_ins.guards import PlugInError, called, finite
from scenarios.definition.schema.plug_ins.point import PlugInPoint
from vehicles.messages import TruePose
from vehicles.schedule import MILLISECOND

STEPS = 20
PERIOD = 20 * MILLISECOND


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
