"""The table that selects a class or a function at a plug-in point and has its parameters."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, ClassVar, Literal, cast

from pydantic import (
    BaseModel,
    ConfigDict,
    SerializeAsAny,
    SerializerFunctionWrapHandler,
    ValidationError,
    ValidationInfo,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    create_model,
    model_serializer,
)
from pydantic_core import InitErrorDetails, PydanticCustomError

from scenarios.definition.schema.plug_ins.point import (
    InstantDraw,
    Parameters,
    PlugInError,
    PlugInPoint,
    called,
    guarded,
    line_of,
    parameters_of,
)
from scenarios.definition.schema.settings_table import SettingField, SettingsTable, generated

AS_ANY = cast("Any", SerializeAsAny)()
ERROR_TYPE = "plug_in"
"""Type of the errors of Pydantic that are about a class, not about its parameters."""


class PlugInTable(SettingsTable[Any]):
    """A class or a function at a plug-in point, and its parameters.

    use  short name of a shipped class, or your own class or function, "module.name"
    """

    use: str

    point: ClassVar[PlugInPoint]
    plugged: ClassVar[Any] = None
    parameters: ClassVar[Parameters]
    settings: ClassVar[type[Any]] = dict
    by_key: ClassVar[Mapping[str, SettingField]] = {}

    @model_serializer(mode="wrap")
    def _serialize(self, serialize: SerializerFunctionWrapHandler) -> dict[str, Any] | str:
        """Write a class without parameters as its name."""
        written: dict[str, Any] = serialize(self)
        return self.use if written.keys() <= {"use"} else written

    @property
    def is_own(self) -> bool:
        """Whether the class is the user's."""
        return self.use not in self.point.shipped

    @property
    def value(self) -> Any:
        """The table itself: it is built for each vehicle."""
        return self

    @property
    def word(self) -> str:
        """Name without the module, by which events and metrics are listed."""
        return self.use.rpartition(".")[2]

    def build(self, *arguments: object, draw: InstantDraw | None = None) -> Any:
        """Construct the class, which may draw random numbers, or call the function.

        What is the user's is guarded; raises PlugInError. Draws are by default those of no vehicle.
        """
        point, what = self.point, self.point.what(self.use)
        if self.plugged is None:
            raise PlugInError(f"{what} is neither in the working folder nor installed")
        parameters = self.parameters
        named: dict[str, Any] = self.values()
        if parameters.is_whole:
            settings = called(lambda: self.settings(**named), what, ": invalid parameters: ")
            arguments, named = (*arguments, settings), {}
        if parameters.draws:
            named["draw"] = (draw or InstantDraw(0, "")).of(point.key)
        if point.calls:
            return guarded(self.plugged, f"{what}:", point.results[""])(*arguments, **named)
        verb = f" cannot be built as {self.plugged.__name__}({', '.join(point.arguments)}, …): "
        return point.guard(called(lambda: self.plugged(*arguments, **named), what, verb), self.use)


class _KeepsKeys(BaseModel):
    model_config = ConfigDict(extra="allow")


RECORDED = {"recorded": True}
"""Context of the validation of a recorded scenario, whose own classes need not be here."""
_TABLES: dict[tuple[str, str], type[BaseModel]] = {}
_TABLE_OF_TAG: dict[str, type[BaseModel]] = {}
"""Generated tables by the tag that the location of an error has in front of a parameter."""


def tagged_table(tag: object) -> type[BaseModel] | None:
    """Return the table with a tag in the location of an error."""
    return _TABLE_OF_TAG.get(tag) if isinstance(tag, str) else None


def plug_in_table(point: PlugInPoint, use: str) -> type[BaseModel]:
    """Generate the table of a class, by its short or dotted name; raises PlugInError."""
    use = point.short_names.get(use, use)
    key = point.key, use
    if key not in _TABLES:
        plugged = point.load(use)
        make = _generated if point.base is None else _generated_from_itself
        made = called(lambda: make(point, plugged, use), point.what(use), ": invalid parameters: ")
        _TABLES[key] = _TABLE_OF_TAG[_tag(point, use)] = made
    return _TABLES[key]


def _tag(point: PlugInPoint, use: str) -> str:
    return f"{point.key}={use}"


def _generated(point: PlugInPoint, plugged: Any, use: str) -> type[PlugInTable]:
    """Generate the table of a class or a function by its signature."""
    parameters = parameters_of(point, plugged)
    made = generated(parameters.settings, PlugInTable, use=use)
    made.point, made.parameters = point, parameters
    made.plugged = staticmethod(plugged) if point.calls else plugged  # else it would be a method
    return made


def _generated_from_itself(point: PlugInPoint, plugged: type[Any], use: str) -> type[BaseModel]:
    """Generate the table of a class that is the dataclass or the model of its parameters.

    The methods of a user's model are guarded.
    """
    if not issubclass(plugged, BaseModel):
        return generated(plugged, SettingsTable, use=use)
    entry: dict[str, Any] = {"use": (Literal[use], use)}
    made = create_model(plugged.__name__, __base__=plugged, __doc__=plugged.__doc__, **entry)
    for name, result in point.results.items() if use not in point.shipped else ():
        method, what = getattr(made, name), f"{point.what(use)}: {name}()"
        if isinstance(method, property):
            setattr(made, name, property(guarded(cast("Any", method.fget), what, result)))
        elif callable(method):
            setattr(made, name, guarded(method, what, result))
    return made


def default_of(point: PlugInPoint) -> PlugInTable:
    """Return the table of the first shipped class, with default parameters."""
    use = next(iter(point.shipped))
    return cast("PlugInTable", plug_in_table(point, use).model_validate({"use": use}))


def own_classes(table: object) -> Iterator[str]:
    """Yield the dotted names of the user's classes and functions in a table, and inside it."""
    if "." in (use := str(getattr(table, "use", ""))):
        yield use
    inner: Iterable[object] = ()
    if isinstance(table, BaseModel):
        inner = table.__dict__.values()
    elif isinstance(table, Mapping):
        inner = table.values()
    elif isinstance(table, tuple):
        inner = table
    for one in inner:
        yield from own_classes(one)


def plug_in(point: PlugInPoint, shipped: Any = PlugInTable) -> Any:
    """Return the annotation of a key that selects a class: its name, or a table with `use`.

    Tables of `shipped` classes may have `kind` instead.
    """
    has_kinds = shipped is not PlugInTable

    def validate(given: object, usual: ValidatorFunctionWrapHandler, info: ValidationInfo) -> Any:
        table: Mapping[str, Any] = {}
        if isinstance(given, str) and (not has_kinds or "." in given):
            table = {"use": given}
        elif isinstance(given, Mapping):
            table = given
        use = table.get("use")
        if isinstance(given, Mapping) and "use" not in given and not has_kinds:
            text = f"use is missing, the class with the keys {', '.join(map(str, given))}"
            raise _custom_error(text, {"use": "", "names": list(point.shipped)})
        if not isinstance(use, str):
            return usual(given)  # an existing table, a `kind`, or an error
        if has_kinds and use in point.shipped:
            return usual({"kind": use, **{key: table[key] for key in table if key != "use"}})
        try:
            model = plug_in_table(point, use)
        except PlugInError as error:
            is_absent = isinstance(error.__cause__, ImportError)
            is_model = point.base is None or issubclass(point.base, BaseModel)
            if info.context == RECORDED and is_absent and is_model:
                return _absent(point).model_validate(table)
            raise _custom_error(str(error), {"use": use, "names": list(point.shipped)}) from error
        named = {**table, "use": point.short_names.get(use, use)}
        try:
            return _validated(model, named, point.what(use))
        except ValidationError as error:
            tag = _tag(point, named["use"])
            raise ValidationError.from_exception_data(use, list(_tagged(error, tag))) from error

    return Annotated[shipped, WrapValidator(validate), AS_ANY]


def _validated(model: type[BaseModel], named: Mapping[str, Any], what: str) -> BaseModel:
    """Validate a table, whose class may be a user's model that fails."""
    try:
        return model.model_validate(named)
    except ValidationError:
        raise
    except Exception as error:
        raise _custom_error(f"{what}: invalid parameters: {line_of(error)}", {}) from error


def _absent(point: PlugInPoint) -> type[BaseModel]:
    """Generate the table of a recorded class whose module is not here; it keeps all keys."""
    base: Any = PlugInTable if point.base is None else point.contract
    made: Any = create_model("Absent", __base__=(base, _KeepsKeys), use=(str, ...))
    if point.base is None:
        made.point = point
    return cast("type[BaseModel]", made)


def _tagged(error: ValidationError, tag: str) -> Iterator[InitErrorDetails]:
    """Yield the errors of a generated table with its tag in front of their locations."""
    for one in error.errors(include_url=False):
        kind: Any = one["type"]
        if kind in {"value_error", "assertion_error"}:
            kind = _custom_error(one["msg"], {})
        location = (tag, *one["loc"])
        yield InitErrorDetails(type=kind, loc=location, input=one["input"], ctx=one.get("ctx", {}))


def _custom_error(text: str, context: dict[str, Any]) -> PydanticCustomError:
    return PydanticCustomError(ERROR_TYPE, "{text}", {"text": text, **context})
