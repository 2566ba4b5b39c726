"""Laws of a link as tables of a scenario file."""

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
    judged_by: ClassVar[JudgedBy] = "chance"
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


def described_parameters(law: LinkLaw) -> str:
    fields = {key: getattr(law, key) for key in type(law).model_fields} | (law.model_extra or {})
    keys = [f"{key} {value}" for key, value in fields.items() if key not in {"use", "order"}]
    return ", ".join([type(law).__name__, *keys])
