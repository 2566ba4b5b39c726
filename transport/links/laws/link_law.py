"""A law of a link as a table of a scenario file: its keys, their limits, and what it does."""

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from math import nan
from typing import Annotated, Any, ClassVar, Self

from pydantic import BaseModel, ConfigDict, Field

from transport.links.laws.effect import Effect, JudgedBy
from transport.links.laws.stage import StageLaw
from transport.links.laws.vehicles_between import VehiclesBetween, no_vehicles
from transport.reasons import DropReason
from vehicles.geometry.geodesy import LocalPlane

Problem = tuple[str, str]
"""A key within the table of a law, and what is wrong with it."""

Ratio = Annotated[float, Field(ge=0, le=1)]


class InvalidKeyError(ValueError):
    """A key of a law that does not fit the others, and what is wrong with it."""

    def __init__(self, key: str, why: str) -> None:
        self.key, self.why = key, why
        super().__init__(f"{key}: {why}")


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkSetting:
    """What laws of a link need to know of its run beside their own keys.

    start_at          the run's first instant (ns)
    sender_station    station (m) of each end then, from the path's first point on
    receiver_station
    plane             the scenario's
    radio_off         windows in which the sender's transmitter or the receiver's receiver is off
    between           returns the vehicles between sender and receiver
    latency           least delay of the link (ns)
    source_rate_hz    messages a second that the sender sends at most
    place             place of the law among those of its key
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
    """A table of keys: unknown keys and wrong types are refused, values are frozen.

    `setting` is neutral but on a link of a run.
    """

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
    setting: ClassVar[LinkSetting] = LinkSetting()

    def __copy__(self) -> Self:
        """Copy the keys alone, not what was derived from them and cached."""
        keys = {name: self.__dict__[name] for name in type(self).model_fields}
        return self.model_construct(set(self.model_fields_set), **keys)

    def for_link(self, setting: LinkSetting) -> Self:
        """Return a copy that knows its setting, for one link: what it remembers belongs to that."""
        own = copy(self)
        own.__dict__["setting"] = setting
        return own


class LinkLaw(Effect, LawTable):
    """Base of the laws that a scenario file requests by a table.

    Keys that an entry about one link may inherit are optional; `check` finds those missing.
    `replaces_others` is true of a law that takes the place of all other keys of the link.
    """

    key: ClassVar[str]
    reason: ClassVar[DropReason | None] = None
    judged_by: ClassVar[JudgedBy] = "chance"
    replaces_others: ClassVar[bool] = False

    def check(self) -> None:
        """Raise Unfit for the first key that does not fit the others."""

    def problems(self) -> Iterator[Problem]:
        try:
            self.check()
        except InvalidKeyError as unfit:
            yield unfit.key, unfit.why

    def plane_problems(self, plane: LocalPlane) -> Iterator[Problem]:
        """Return the keys that do not fit the scenario's plane."""
        return iter(())

    def effects(self, setting: LinkSetting) -> tuple[Effect, ...]:
        """Return the effects on one link of a run: by default a copy of the law."""
        return (self.for_link(setting),)

    @property
    def stages(self) -> tuple[StageLaw, ...]:
        return ()

    def required(self, key: str, why: str = "") -> Any:
        """Return the value of a key; raises Unfit where it is missing."""
        value = getattr(self, key)
        if value is None:
            raise InvalidKeyError(key, f"missing{why}")
        return value
