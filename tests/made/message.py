"""Messages of which a test gives the fields that matter to it."""

from dataclasses import MISSING, fields
from typing import Any, TypeVar, get_type_hints

from vehicles.messages import GpsPose

Made = TypeVar("Made")
_ZEROS: dict[Any, Any] = {float: 0.0, int: 0, bool: False}


def _rest(kind: Any) -> dict[str, Any]:
    """Zero, False or an empty text for each field without a default."""
    hints = get_type_hints(kind)
    required = [one.name for one in fields(kind) if one.default is MISSING]
    return {name: _ZEROS.get(hints[name], "") for name in required}


def message(kind: type[Made], vehicle: str, seq: int, **given: Any) -> Made:
    """A message of `kind`; fields that are not given are zero, False, empty or their default."""
    return kind(**{**_rest(kind), "vehicle": vehicle, "seq": seq, **given})


def pose(vehicle: str, seq: int, at_ns: int, **given: Any) -> GpsPose:
    """A pose that is measured and sent at an instant (ns), by an exact receiver."""
    usual = {"fix": "fixed", "mode": "path", "position_accuracy_m": 0.02, "path_offset_m": 0.0}
    instants = {"measured_at_ns": at_ns, "sent_at_ns": at_ns}
    return message(GpsPose, vehicle, seq, **{**usual, **instants, **given})
