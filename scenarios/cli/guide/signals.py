"""Receivers and sending described, for the table of `convoy check`."""

from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter

from scenarios.definition.schema.gnss import GnssTable
from scenarios.definition.schema.tables import SendingTable

Asked = Mapping[str, Any]
"""A table of a scenario, dumped."""


def receiver_in_words(asked: Asked) -> str:
    """Describe a receiver and its errors."""
    return "; ".join(GnssTable.model_validate(asked).value.describe())


def sending_in_words(asked: Asked) -> str:
    """Describe when a vehicle sends."""
    rule = TypeAdapter[SendingTable](SendingTable).validate_python(asked).value
    return f"{rule.describe()}; congestion control" if rule.dcc else rule.describe()
