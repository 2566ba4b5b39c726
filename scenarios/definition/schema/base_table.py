"""Base class of the tables of a scenario file."""

from typing import Annotated, TypeVar

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]{0,31}$"
"""Names are part of key expressions on the bus: letters, digits, _ and - only."""

Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
Ratio = Annotated[float, Field(ge=0, le=1)]
NotNegative = Annotated[float, Field(ge=0)]
Speed = Annotated[float, Field(ge=0, le=100)]


class Table(BaseModel):
    """A frozen table of a scenario file, without unknown keys or type conversions."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


AnyTable = TypeVar("AnyTable", bound=BaseModel)


def overlay(base: AnyTable, own: BaseModel | None) -> AnyTable:
    """Merge the keys given in `own` into `base`, table by table.

    A table of another kind replaces the one in `base`.
    """
    if own is None:
        return base
    fields = type(base).model_fields
    changes = {key: getattr(own, key) for key in own.model_fields_set if key in fields}
    for key, value in changes.items():
        if isinstance(value, BaseModel):
            below = getattr(base, key)
            changes[key] = overlay(below, value) if type(below) is type(value) else value
    return base.model_copy(update=changes)
