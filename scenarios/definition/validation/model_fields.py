"""The fields of the scenario's pydantic models at the location of an error."""

from collections.abc import Iterator, Sequence
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from scenarios.definition.schema.plug_ins.table import tagged_table
from scenarios.definition.schema.scenario_tables import ScenarioTables

Location = tuple[str | int, ...]


def models_of(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from models_of(part)


def models_by_name(table: type[BaseModel]) -> Iterator[type[BaseModel]]:
    """Yield the models of tables named after vehicles, next to the table's own keys."""
    return models_of(table.__annotations__.get("__pydantic_extra__"))


def walk(location: Location) -> tuple[Location, list[type[BaseModel]]]:
    """Follow a location; returns its key without union tags, and the models there.

    The kind of a table, or the tag of a plug-in, is between its key and those inside it. Names of
    vehicles and list indices are skipped.
    """
    key: Location = ()
    models: list[type[BaseModel]] = [ScenarioTables]
    for part in location:
        if (table := tagged_table(part)) is not None:
            models = [table]
            continue
        of_kind = [model for model in models if part in kinds_of([model])]
        if len(models) > 1 and of_kind:
            models = of_kind
            continue
        key = (*key, part)
        for model in models:
            if part in model.model_fields:
                models = list(models_of(model.model_fields[str(part)].annotation))
                break
        else:
            models = [other for model in models for other in models_by_name(model)] or models
    return key, models


def kinds_of(models: Sequence[type[BaseModel]]) -> list[str]:
    return [
        word
        for model in models
        if "kind" in model.model_fields
        for word in get_args(model.model_fields["kind"].annotation)
    ]


def fields_of_table(location: Location) -> dict[str, FieldInfo]:
    """Return the keys that the table at a location may have, of all kinds that it may be."""
    _, models = walk(location)
    return {name: field for model in models for name, field in model.model_fields.items()}


def field_at(location: Location) -> FieldInfo:
    """Return the field at a location; for an entry of a list, the type of its entries."""
    if isinstance(location[-1], int):
        return FieldInfo.from_annotation(get_args(field_at(location[:-1]).annotation)[0])
    return fields_of_table(location[:-1])[str(location[-1])]


def bounds_of(field: FieldInfo) -> dict[str, Any]:
    """Return the bounds of a number by operator: ge, gt, le, lt."""
    return {
        name: bound
        for limit in (*field.metadata, *_metadata(field.annotation))
        for name in ("ge", "gt", "le", "lt")
        if (bound := getattr(limit, name, None)) is not None
    }


def _metadata(annotation: Any) -> Iterator[Any]:
    for item in getattr(annotation, "__metadata__", ()):
        yield from item.metadata if isinstance(item, FieldInfo) else (item,)
    for part in get_args(annotation):
        yield from _metadata(part)
