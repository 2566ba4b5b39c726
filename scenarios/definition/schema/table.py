"""What the tables of a scenario file have in common."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

NAME_PATTERN = r"^[A-Za-z][A-Za-z0-9_-]{0,31}$"
"""Names become part of a key expression on the bus, so they keep to letters, digits, _ and -."""

Name = Annotated[str, StringConstraints(pattern=NAME_PATTERN)]
Ratio = Annotated[float, Field(ge=0, le=1)]
NotNegative = Annotated[float, Field(ge=0)]
Speed = Annotated[float, Field(ge=0, le=100)]


class Table(BaseModel):
    """A table of a scenario file: unknown keys and wrong types are refused, values are frozen."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)
