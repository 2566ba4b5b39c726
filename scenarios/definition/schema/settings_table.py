"""Tables of a scenario file generated from the settings classes of `vehicles`."""

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from functools import reduce
from operator import or_
from types import GenericAlias, NoneType
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    ClassVar,
    Generic,
    Literal,
    TypeVar,
    get_args,
    get_origin,
    get_type_hints,
)

from pydantic import BaseModel, ConfigDict, Field, StringConstraints, create_model

from vehicles.setting import Setting

# ---- Base class of the tables of a scenario file


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


# ---- Settings table


S = TypeVar("S")
T = TypeVar("T", bound="SettingsTable[Any]")


@dataclass(frozen=True, slots=True)
class SettingField:
    """A field of a settings class; `kind` is its type without None, which `optional` fields allow.

    `whole` fields with a unit of time count nanoseconds.
    """

    name: str
    kind: Any
    optional: bool
    setting: Setting
    default: Any

    @property
    def key(self) -> str:
        return self.setting.key(self.name)

    @property
    def entry(self) -> Any:
        """Type of an entry of a list, else that of the field."""
        return get_args(self.kind)[0] if get_origin(self.kind) is tuple else self.kind

    @property
    def whole(self) -> bool:
        return self.entry is int


class SettingsTable(Table, Generic[S]):
    """The table of a settings class, whose keys have unit suffixes; `value` is in SI units.

    `SettingsTable[Gains]` is generated from `Gains`: fields, defaults, bounds and docstring.
    """

    settings: ClassVar[type[Any]]
    by_key: ClassVar[Mapping[str, SettingField]]

    if not TYPE_CHECKING:

        def __class_getitem__(cls, kind: type) -> type:
            """Return the generated table; type variables are for type checkers."""
            return table_of(kind) if is_dataclass(kind) else cls

    @property
    def value(self) -> S:
        made: S = self.settings(**self.values())
        return made

    def values(self) -> dict[str, Any]:
        """Fields of the settings in SI units."""
        return {one.name: _to_si(one, getattr(self, key)) for key, one in self.by_key.items()}


_GENERATED: dict[tuple[type[Any], str], type[SettingsTable[Any]]] = {}


def table_of(settings: type[Any], word: str = "") -> type[SettingsTable[Any]]:
    """Return the table of a settings class; `word` is its `kind` where there are several."""
    if (settings, word) not in _GENERATED:
        _GENERATED[settings, word] = generated(settings, SettingsTable, kind=word)
    return _GENERATED[settings, word]


def generated(settings: type[Any], base: type[T], **words: str) -> type[T]:
    """Generate a table of a settings class; `words` are the values of keys such as `kind`."""
    by_key = {one.key: one for one in fields_of(settings)}
    entries: dict[str, Any] = {key: (Literal[word], word) for key, word in words.items() if word}
    entries |= {key: _entry(one) for key, one in by_key.items()}
    made = create_model(settings.__name__, __base__=base, __doc__=settings.__doc__, **entries)
    made.settings, made.by_key = settings, by_key
    return made


def one_of(kinds: Mapping[str, type[S]]) -> type[SettingsTable[S]]:
    """Return the type of a table that is one of several, by its key `kind`."""
    either = reduce(or_, (table_of(settings, word) for word, settings in kinds.items()))
    made: type[SettingsTable[S]] = Annotated[either, Field(discriminator="kind")]  # type: ignore[assignment]
    return made


def table_with(value: S, kinds: Mapping[str, type] | None = None) -> SettingsTable[S]:
    """Return the table of `value`, with every key set."""
    words = {settings: word for word, settings in (kinds or {}).items()}
    table = table_of(type(value), words.get(type(value), ""))
    given = {key: _from_si(one, getattr(value, one.name)) for key, one in table.by_key.items()}
    return table.model_validate({key: one for key, one in given.items() if one is not None})


def keys_with(settings: type[Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return keys and values, in the units of keys, of some fields of a settings class."""
    result = {
        one.key: _from_si(one, values[one.name])
        for one in fields_of(settings)
        if one.name in values
    }
    return {key: one.model_dump() if isinstance(one, Table) else one for key, one in result.items()}


def fields_of(settings: type[Any]) -> Iterator[SettingField]:
    """Yield the fields of a settings class that its constructor takes, in order."""
    hints = get_type_hints(settings, include_extras=True)
    for one in fields(settings):
        if not one.init:
            continue
        kind, *extras = get_args(hints[one.name]) or [hints[one.name]]
        setting = next((extra for extra in extras if isinstance(extra, Setting)), None)
        kind = hints[one.name] if setting is None else kind
        parts = get_args(kind)
        if optional := NoneType in parts:
            kind = reduce(or_, [part for part in parts if part is not NoneType])
        made: Any = MISSING if one.default_factory is MISSING else one.default_factory()
        default = made if one.default is MISSING else one.default
        yield SettingField(one.name, kind, optional, setting or Setting(), default)


def _entry(one: SettingField) -> tuple[Any, Any]:
    """Return annotation and field of a key for Pydantic."""
    setting = one.setting
    given = {"ge": setting.minimum, "le": setting.maximum, "gt": setting.above}
    rules: dict[str, Any] = {word: bound for word, bound in given.items() if bound is not None}
    if setting.allow_infinite:
        rules["allow_inf_nan"] = True
    annotation = one.entry
    if setting.kinds is not None:
        annotation = one_of(setting.kinds)
    elif is_dataclass(annotation):
        annotation = table_of(one.entry)
    elif one.whole and setting.unit:
        annotation = float
    if get_origin(one.kind) is tuple:
        bounded = Annotated[annotation, Field(**rules)] if rules else annotation
        rules = {"strict": False} | ({"min_length": 1} if setting.nonempty else {})
        annotation = GenericAlias(tuple, (bounded, ...))
    if one.default is not MISSING:
        rules["default"] = _from_si(one, one.default)
    return (annotation | None if one.optional else annotation), Field(**rules)


def _to_si(one: SettingField, value: Any) -> Any:
    if isinstance(value, SettingsTable):
        return value.value
    if isinstance(value, tuple):
        return tuple(_to_si(one, entry) for entry in value)
    if isinstance(value, float):
        return one.setting.to_si(value, whole=one.whole)
    return value


def _from_si(one: SettingField, value: Any) -> Any:
    if is_dataclass(value):
        return table_with(value, one.setting.kinds)
    if isinstance(value, tuple):
        return tuple(_from_si(one, entry) for entry in value)
    if one.entry in {int, float} and one.setting.unit and value is not None:
        return one.setting.from_si(value, whole=one.whole)
    return value
