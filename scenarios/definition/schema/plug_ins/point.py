"""A plug-in point, the classes and functions that fit it, and their one guard."""

import traceback
from collections.abc import Callable, Mapping
from dataclasses import dataclass, is_dataclass, make_dataclass
from functools import cached_property, wraps
from importlib import import_module
from inspect import Parameter, isfunction, signature
from math import isfinite
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast, get_type_hints

from transport.links.link import keyed_draw
from transport.texts import ConvoyError

# ---- The guard of users' classes and functions: a fault is one line with its file and line


T = TypeVar("T")


class PlugInError(ConvoyError, ValueError):
    """A user's class or function failed, or violates its contract; the message is one line."""


OWN_PACKAGES = {"vehicles", "transport", "scenarios"}
ROOT = Path(__file__).parents[4]


def line_of(error: BaseException) -> str:
    """Type, text and place of an error in one line: where the user's file failed."""
    text, frames = str(error), traceback.extract_tb(error.__traceback__)
    places = [(frame.filename, frame.lineno) for frame in frames if _is_users(frame.filename)]
    places = [place for place in places if place[0] == places[0][0]]
    if isinstance(error, SyntaxError):
        text, places = error.msg, [(error.filename or "", error.lineno)]
    where = "".join(f" ({Path(file).name}, line {number})" for file, number in places[-1:])
    return " ".join(f"{type(error).__name__}: {text}{where}".split())


def _is_users(file: str) -> bool:
    if file.startswith("<") or file == import_module.__code__.co_filename:
        return False
    return not any(Path(file).is_relative_to(ROOT / package) for package in OWN_PACKAGES)


def is_finite(value: object) -> bool:
    return isinstance(value, int | float) and isfinite(value)


class Result(NamedTuple):
    """What a method has to return: as text, and as a test of the result and the arguments."""

    words: str
    fits: Callable[..., bool]


ANY_RESULT = Result("", lambda *_: True)
NUMBER = Result("a finite number", lambda value, *_: is_finite(value))
YES_OR_NO = Result("True or False", lambda value, *_: isinstance(value, bool))


def called(call: Callable[[], T], what: str, verb: str = " raised ") -> T:
    """Return the result of `call`; raises PlugInError, beginning with `what`, for any fault."""
    try:
        return call()
    except PlugInError:
        raise
    except (Exception, SystemExit) as error:
        raise PlugInError(f"{what}{verb}{line_of(error)}") from error


def guarded(call: Callable[..., Any], what: str, result: Result = ANY_RESULT) -> Any:
    """Wrap a user's function; it raises PlugInError for an exception or an unfit result."""

    @wraps(call)
    def checked(*given: Any, **named: Any) -> Any:
        value = called(lambda: call(*given, **named), what)
        if result.fits(value, *given):
            return value
        code = getattr(call, "__code__", None)
        place = f" ({Path(code.co_filename).name}, line {code.co_firstlineno})" if code else ""
        raise PlugInError(f"{what} returned {value!r}, expected {result.words}{place}")

    return checked


class Guard:
    """A user's object whose methods are guarded; its other attributes are its own."""

    __slots__ = ("_made", "_results", "_what")

    def __init__(self, made: object, what: str, results: Mapping[str, Result]) -> None:
        self._made, self._what, self._results = made, what, results

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # as looked up by copy and pickle
            raise AttributeError(name)
        value = getattr(self._made, name)
        if name not in self._results:
            return value
        return guarded(value, f"{self._what}: {name}()", self._results[name])


def own_name(value: object) -> str:
    """Dotted name of the class of a value if it is the user's, else empty."""
    kind = type(value)
    shipped = kind.__module__.partition(".")[0] in OWN_PACKAGES
    return "" if shipped else dotted_name(kind)


# ---- Random numbers of classes


class InstantDraw:
    """Random numbers of one vehicle at the control instant `now` (ns).

    A number depends on the seed, the vehicle, the class, the purpose and the time since the start
    of the run, `start_at` (ns), only, not on other draws. So a decision can be computed alone, and
    again.
    """

    def __init__(self, seed: int, vehicle: str) -> None:
        self.numbers = keyed_draw(seed, vehicle, "")
        self.now = self.start_at = 0

    def of(self, point: str) -> Callable[[str], float]:
        """Draws of the class at a plug-in point: the number in (0, 1) of a purpose."""

        def draw(purpose: str) -> float:
            return self.numbers(f"{point} {purpose}", self.now - self.start_at)

        return draw


# ---- Point


@dataclass(frozen=True)
class PlugInPoint:
    """A place in a scenario that selects a class or a function.

    name       noun for messages
    key        key of a scenario that selects it
    shipped    dotted names of the shipped classes by their short names
    contract   class that documents the interface
    results    methods that are guarded, with what they return
    arguments  names of the first arguments of the constructor, or of the function
    types      documented types of the arguments
    base       class that the class must inherit from; if it has one, the class itself is the
               dataclass or the Pydantic model of its parameters
    calls      whether it selects a function, whose result is that of `results[""]`
    """

    name: str
    key: str
    shipped: Mapping[str, str]
    contract: type
    results: Mapping[str, Result]
    arguments: tuple[str, ...] = ()
    types: tuple[type, ...] = ()
    base: type | None = None
    calls: bool = False

    @cached_property
    def short_names(self) -> Mapping[str, str]:
        """Short names of the shipped classes by their dotted names."""
        return {dotted: short for short, dotted in self.shipped.items()}

    def what(self, use: str) -> str:
        return f"{self.name} {use!r}"

    def load(self, use: str) -> Any:
        """Import the class or function of a name; raises PlugInError if it does not fit."""
        module_name, _, name = self.shipped.get(use, use).rpartition(".")
        if not module_name or not name:
            raise PlugInError(f"{self.what(use)}: give a dotted name, package.module.name")
        try:
            module = import_module(module_name)
        except ModuleNotFoundError as error:
            where = f"{error}, neither in the working folder nor installed"
            raise PlugInError(f"{self.what(use)}: {where}") from error
        except (Exception, SystemExit) as error:
            raise PlugInError(f"{self.what(use)}: {line_of(error)}") from error
        found = getattr(module, name, None)
        if not self._fits(found):
            has = "is not" if hasattr(module, name) else f"is not in {module_name}; expected"
            raise PlugInError(f"{self.what(use)}: {name} {has} {self.wanted}")
        return found

    @property
    def wanted(self) -> str:
        """Description of what fits."""
        if self.calls:
            return f"a function {signature_of(self.contract, '__call__')}"
        if self.base is not None:
            return f"a class with the base {dotted_name(self.base)}"
        methods = [f"{one}{signature_of(self.contract, one)}" for one in self.results]
        return f"a class with the methods {', '.join(methods)}"

    def _fits(self, found: object) -> bool:
        if self.calls:
            return isfunction(found)
        if not isinstance(found, type):
            return False
        if self.base is not None:
            return issubclass(found, self.base)
        return all(callable(getattr(found, one, None)) for one in self.results)

    def guard(self, made: Any, use: str) -> Any:
        """Guard an instance of a user's class; shipped ones are returned as they are."""
        return made if use in self.shipped else Guard(made, self.what(use), self.results)


def begin(point: PlugInPoint, chosen: Any, context: object) -> Any:
    """Begin a sending rule or an error of a receiver for one run; that of a user is guarded."""
    name = own_name(chosen)
    if not name:
        return chosen.begin(context)
    what = point.what(name)
    return Guard(guarded(chosen.begin, f"{what}: begin()")(context), what, point.results)


def dotted_name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def signature_of(contract: type, method: str) -> str:
    """Names of the arguments of a method, in parentheses."""
    _, *names = signature(getattr(contract, method)).parameters
    return f"({', '.join(names)})"


# ---- Parameters by the signature of a constructor or a function


@dataclass(frozen=True, slots=True)
class Parameters:
    """Dataclass of the parameters, whether it is passed as one argument, and whether to draw."""

    settings: type[Any]
    is_whole: bool
    draws: bool


def parameters_of(point: PlugInPoint, plugged: Any) -> Parameters:
    """Parameters of a class or function: its arguments after those of the point.

    A single one whose annotation is a dataclass stands for the fields of that. The type of an
    argument without annotation is that of its default.
    """
    names = list(signature(plugged).parameters.values())[len(point.arguments) :]
    variable = (Parameter.VAR_POSITIONAL, Parameter.VAR_KEYWORD)
    own = [one for one in names if one.kind not in variable and one.name != "draw"]
    draws = any(one.name == "draw" for one in names)
    hints = get_type_hints(plugged if isfunction(plugged) else plugged.__init__, None, None, True)
    kinds = [hints.get(one.name, _kind_of(one.default)) for one in own]
    if len(own) == 1 and is_dataclass(kinds[0]):
        return Parameters(cast("type[Any]", kinds[0]), True, draws)
    entries = [
        (one.name, kind) if one.default is Parameter.empty else (one.name, kind, one.default)
        for one, kind in zip(own, kinds, strict=True)
    ]
    made = make_dataclass(plugged.__name__, entries, frozen=True, kw_only=True)
    made.__doc__ = plugged.__doc__
    return Parameters(made, False, draws)


def _kind_of(default: object) -> Any:
    return Any if default in (None, Parameter.empty) else type(default)
