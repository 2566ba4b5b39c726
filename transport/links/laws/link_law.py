"""Laws of a link as tables of a scenario file."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from math import inf, nan
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Protocol, Self

from pydantic import BaseModel, ConfigDict, Field

from transport.topics import DropReason
from vehicles.geometry.geodesy import LocalPlane

# ---- Moments of the losses and delays of a link in the long run


_ROUNDING = 1e-9


class Losses(NamedTuple):
    """Mean loss ratio of a stationary law, and mean burst (messages).

    The burst is None if it is unknown or nothing is lost.
    """

    loss: float
    burst: float | None = None

    @classmethod
    def independent(cls, loss: float) -> "Losses":
        """Independent losses, whose bursts are geometric."""
        if not loss:
            return cls(0.0)
        return cls(loss, 1.0 / (1.0 - loss) if loss < 1.0 else inf)

    @property
    def has_memory(self) -> bool:
        return self.burst is None or abs(self.burst * (1.0 - self.loss) - 1.0) > _ROUNDING

    @property
    def both_delivered(self) -> float | None:
        """Probability that a message and the next one are delivered; None if unknown."""
        return None if self.burst is None else 1.0 - self.loss - self.loss / self.burst


class Delays(NamedTuple):
    """Mean (ns) and variance (ns²) of a delay."""

    mean: float
    variance: float


# ---- Interface of an effect of a link: input, verdict and properties


Draw = Callable[[str, int], float]
"""Returns the random number in (0, 1) of a purpose and a message number.

It does not depend on earlier draws.
"""


class Position(NamedTuple):
    """True position of a vehicle (m), for the channel only: east, north, distance travelled."""

    east: float = nan
    north: float = nan
    travelled: float = nan


UNKNOWN_POSITION = Position()


class TransmissionContext(NamedTuple):
    """Transmission of a message: number, instant of sending (ns), size (bytes), positions.

    `sender` is the true position of the antenna at sending, carried by the message; `receiver` is
    the true position of the receiving node at its last tick before. Both are the same on every
    clock.
    """

    seq: int
    sent_at: int
    size: int = 0
    sender: Position = UNKNOWN_POSITION
    receiver: Position = UNKNOWN_POSITION


class Effect:
    """One impairment of a link; delays of several effects add up, any drop wins.

    A verdict must not depend on which messages arrived before. The state of an effect with memory
    follows from the keyed draws of all numbers up to the message, whether or not they arrived.

    Except for `judge`, the defaults are those of an effect without loss and delay.
    `key` is the key of a link that requests the effect, `reason` the reason of its drops.
    `by_number` if the verdict depends on the number of the message only.
    """

    __slots__ = ()

    key: ClassVar[str]
    reason: ClassVar[DropReason | None] = None
    by_number: ClassVar[bool] = False

    def judge(self, draw: Draw, context: TransmissionContext) -> int | DropReason:
        """Delay (ns) of this effect, or the reason of a drop."""
        raise NotImplementedError

    def losses(self, distance_m: float | None) -> Losses | None:
        """Losses in the long run (of a radio: over a distance); None if they depend on more."""
        return Losses(0.0)

    @property
    def delays(self) -> Delays | None:
        """Moments of the delay; None if they depend on more than the law."""
        return Delays(0.0, 0.0)


# ---- Stages: effects of the messages of a link on each other (queue, arrival in order)
#
# The verdict depends on the surrounding messages, by their instants of sending and sizes, but not
# on when bytes arrive from the bus. A stage takes messages in the order of their numbers and
# returns each one as soon as its verdict is final.
#
# Given all messages sent until an instant t, a stage decides about messages that begin to be sent,
# or are removed from the queue, until t. None of them is visible before t + floor, where the floor
# is the minimum latency of the link. At the tick at `now` the receiver therefore lets the stages
# decide until now − floor. If the bus is faster than the floor, all messages sent until then have
# arrived, and all that are visible by `now` are decided, on the wall clock as in virtual time.
# Slower messages count as late.


UNSENT: frozenset[str] = frozenset({"rate", "transmitter_off"})  # Do not enter a queue


@dataclass(frozen=True, slots=True)
class StagedMessage:
    """A message between stages: when it is visible (ns), and the reason if it is dropped.

    A dropped message has the instant at which it would have been visible.
    """

    context: TransmissionContext
    visible_at: int
    reason: DropReason | Literal[""] = ""


class Stage(Protocol):
    """State of a stage of one link."""

    def carry(self, arrived: Iterable[StagedMessage], until: int) -> list[StagedMessage]:
        """Add the messages sent until instant `until` (ns); returns those now decided."""


class StageLaw(Protocol):
    """Law of a stage; `key` is the key of a link that requests it."""

    key: ClassVar[str]

    def stage(self) -> Stage:
        """New, empty state."""


@dataclass(frozen=True, slots=True)
class InOrder:
    """Messages wait until all earlier delivered messages are visible."""

    key: ClassVar[str] = "delay"

    def stage(self) -> Stage:
        return _Order()


@dataclass(slots=True)
class _Order:
    latest: int = 0

    def carry(self, arrived: Iterable[StagedMessage], until: int) -> list[StagedMessage]:
        decided = []
        for message in arrived:
            visible_at = max(message.visible_at, self.latest)
            if not message.reason:
                self.latest = visible_at
            decided.append(StagedMessage(message.context, visible_at, message.reason))
        return decided


# ---- Vehicles between sender and receiver of a link, and the road on which they drive


@dataclass(frozen=True, slots=True)
class Road:
    """Polyline of the road: points (m) every `step` metres from station 0.

    With steps of 2 m it deviates by less than 0.1 m from a bend of 5 m radius.
    """

    step: float
    east: Sequence[float]
    north: Sequence[float]

    def points(self, station: float, step: float, count: int) -> Iterator[tuple[float, float]]:
        """Yield east and north (m) at `station` + k `step` (m) for k from 1 to `count`.

        Beyond both ends the road continues straight.
        """
        easts, norths, last = self.east, self.north, len(self.east) - 2
        position, increment = station / self.step, step / self.step
        for _ in range(count):
            position += increment
            node = int(position)
            node = 0 if node < 0 else min(node, last)
            share = position - node
            rest = 1.0 - share
            yield (
                rest * easts[node] + share * easts[node + 1],
                rest * norths[node] + share * norths[node + 1],
            )


@dataclass(frozen=True, slots=True)
class VehiclesBetween:
    """The `count` vehicles between sender and receiver, some of which obstruct the link.

    They are assumed at equal distances along the `road` between both ends, because the receiver
    does not receive poses of all of them. The station of an end is its station at the start plus
    the distance travelled, which is the same on every clock.

    A vehicle obstructs the link if its circle of `radius` m (ETSI TR 103 257: 1.5 m) cuts the line
    of sight: on a straight all do, around a bend they do not.
    """

    count: int
    road: Road
    sender_start: float
    receiver_start: float
    radius: float = 1.5

    def count_obstructing(self, context: TransmissionContext, most: int) -> int:
        sender, receiver = context.sender, context.receiver
        station = self.receiver_start + receiver.travelled
        step = (self.sender_start + sender.travelled - station) / (self.count + 1)
        line_east, line_north = sender.east - receiver.east, sender.north - receiver.north
        length_squared = line_east * line_east + line_north * line_north
        cross_limit = self.radius * self.radius * length_squared  # of the squared cross product
        obstructing = 0
        for east, north in self.road.points(station, step, self.count):
            to_east, to_north = east - receiver.east, north - receiver.north
            cross = line_east * to_north - line_north * to_east
            along = line_east * to_east + line_north * to_north
            if cross * cross < cross_limit and 0.0 < along < length_squared:
                obstructing += 1
                if obstructing == most:
                    break
        return obstructing


def no_vehicles() -> VehiclesBetween:
    return VehiclesBetween(0, Road(1.0, (0.0, 0.0), (0.0, 0.0)), 0.0, 0.0)


# ---- Link law


Problem = tuple[str, str]  # A key of the table of a law, and what is wrong with its value

Ratio = Annotated[float, Field(ge=0, le=1)]


class InvalidKeyError(ValueError):
    """A key of a law that does not fit the other keys."""

    def __init__(self, key: str, why: str) -> None:
        self.problem: Problem = key, why
        super().__init__(f"{key}: {why}")


def problems_of(derive: Callable[[], object]) -> Iterator[Problem]:
    """Yield the problem that `derive` raises as InvalidKeyError, if it does."""
    try:
        derive()
    except InvalidKeyError as error:
        yield error.problem


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSetting:
    """Properties of the run and the link that laws need in addition to their keys.

    start_at          first instant of the run (ns)
    sender_station    station (m) of the sender at the start, from the first point of the path
    receiver_station  station (m) of the receiver at the start
    plane             local plane of the scenario
    radio_off         windows in which the sender's transmitter or the receiver's radio is off
    between           returns the vehicles between sender and receiver
    latency           minimum delay of the link (ns)
    source_rate_hz    maximum rate of the sender's messages
    place             index of the law among those of its key
    """

    start_at: int = 0
    sender_station: float = nan
    receiver_station: float = nan
    plane: LocalPlane | None = None
    radio_off: "Sequence[LinkLaw]" = ()
    between: Callable[[], VehiclesBetween] = no_vehicles
    latency: int = 0
    source_rate_hz: float = 20.0
    place: int = 0

    @property
    def off(self) -> bool:
        return bool(self.radio_off)


class LawTable(BaseModel):
    """A table of keys, frozen; unknown keys and wrong types are refused."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
    setting: ClassVar[LinkSetting] = LinkSetting()

    def __copy__(self) -> Self:
        """Copy the keys only, not the cached values derived from them."""
        keys = {name: self.__dict__[name] for name in type(self).model_fields}
        return self.model_construct(set(self.model_fields_set), **keys)

    def for_link(self, setting: LinkSetting) -> Self:
        """Copy for one link, with its setting and caches of its own."""
        own = copy(self)
        own.__dict__["setting"] = setting
        return own


class LinkLaw(Effect, LawTable):
    """Base of the laws that a scenario file requests with a table.

    Keys that the table of a single link may inherit are optional; `problems` reports missing ones.
    A law with `replaces_others` replaces all other keys of the link.
    """

    key: ClassVar[str]
    reason: ClassVar[DropReason | None] = None
    by_number: ClassVar[bool] = False
    replaces_others: ClassVar[bool] = False

    def problems(self) -> Iterator[Problem]:
        """Yield the keys that do not fit the other keys."""
        return iter(())

    def plane_problems(self, plane: LocalPlane) -> Iterator[Problem]:
        """Yield the keys that do not fit the scenario's plane."""
        return iter(())

    def effects(self, setting: LinkSetting) -> tuple[Effect, ...]:
        """Effects on one link of a run, by default a copy of the law."""
        return (self.for_link(setting),)

    @property
    def stages(self) -> tuple[StageLaw, ...]:
        return ()

    def required(self, key: str, why: str = "") -> Any:
        """Value of a key; raises InvalidKeyError if it is missing."""
        value = getattr(self, key)
        if value is None:
            raise InvalidKeyError(key, f"missing{why}")
        return value
