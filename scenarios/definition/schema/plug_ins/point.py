"""A plug-in point, and the classes that fit it."""

import re
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, is_dataclass
from functools import cached_property
from importlib import import_module
from inspect import signature
from math import isfinite
from pathlib import Path
from typing import Any, TypeVar, cast

from pydantic import BaseModel

from transport.links.link import keyed_draw
from transport.texts import ConvoyError

# ---- Calls of user-defined classes, with faults in one line


T = TypeVar("T")


class PlugInError(ConvoyError, ValueError):
    """A class violates the contract of its plug-in point; the message is one line."""


def described(error: BaseException) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())


def called(call: Callable[[], T], what: str, verb: str = " raised ") -> T:
    """Return the result of `call`; raises PlugInError, beginning with `what`, for any fault."""
    try:
        return call()
    except PlugInError:
        raise
    except (Exception, SystemExit) as error:
        raise PlugInError(f"{what}{verb}{described(error)}") from error


OWN_PACKAGES = {"vehicles", "transport", "scenarios"}


def own_name(value: object) -> str:
    """Dotted name of the class of a value if it is the user's, else empty."""
    kind = type(value)
    shipped = kind.__module__.partition(".")[0] in OWN_PACKAGES
    return "" if shipped else f"{kind.__module__}.{kind.__qualname__}"


def finite(value: object, what: str, wanted: str) -> float:
    """Return a finite number, which may be a NumPy scalar, as a float; raises PlugInError."""
    if isinstance(value, int | float) and isfinite(value):
        return float(value)
    sign = "" if what.endswith("returned") else "= "
    raise PlugInError(f"{what} {sign}{value!r}, expected a finite {wanted}")


# ---- Point


_CLASS = re.compile(r"^class (\w+)", re.MULTILINE)


@dataclass(frozen=True)
class PlugInPoint:
    """A place in a scenario that selects a class.

    name       noun for messages
    title      noun for documentation
    key        key of a scenario that selects the class
    shipped    dotted names of the shipped classes by their short names
    contract   class that documents the interface
    methods    methods that a class must have, with their arguments
    types      documented types of the arguments
    trial      calls a guarded instance before a run and returns the results; raises PlugInError
    base       class that the class must inherit from; if it has one, the class itself is the
               dataclass or the Pydantic model of its parameters
    arguments  arguments of the constructor of a class without base; `settings` may follow
    guard      wraps an instance of a user's class without base, named by its dotted name
    draws      whether the constructor of a user's class may have a parameter `draw`, for random
               numbers of the control instant
    """

    name: str
    title: str
    key: str
    shipped: Mapping[str, str]
    contract: type
    methods: Mapping[str, str]
    types: tuple[type, ...]
    trial: Callable[..., object]
    base: type | None = None
    arguments: str = ""
    guard: Callable[[Any, str], Any] | None = None
    draws: bool = False

    @cached_property
    def short_names(self) -> Mapping[str, str]:
        """Short names of the shipped classes by their dotted names."""
        return {dotted: short for short, dotted in self.shipped.items()}

    def load(self, use: str) -> type[Any]:
        """Import the class of a short or dotted name; raises PlugInError if it does not fit."""
        module_name, _, class_name = self.shipped.get(use, use).rpartition(".")
        if not module_name or not class_name:
            raise PlugInError(f"{self.name} {use!r}: give a dotted name, package.module.Class")
        try:
            module = import_module(module_name)
        except ModuleNotFoundError as error:
            where = f"{error}, neither in the working folder nor installed"
            raise PlugInError(f"{self.name} {use!r}: {where}") from error
        except ImportError as error:
            raise PlugInError(f"{self.name} {use!r}: {error}") from error
        except (Exception, SystemExit) as error:
            raise PlugInError(f"{self.name} {use!r}: {described(error)}") from error
        if not hasattr(module, class_name):
            what = f"module {module_name!r} has no class {class_name!r}"
            raise PlugInError(f"{self.name} {use!r}: {what}")
        found: object = getattr(module, class_name)
        if not self._fits(found):
            wanted = [f"a method {one}({given})" for one, given in self.methods.items()]
            if self.base is not None:
                wanted = [f"the base {dotted_name(self.base)}"]
            raise PlugInError(f"{self.name} {use!r}: not a class with {' and '.join(wanted)}")
        return cast("type[Any]", found)

    def own_names(self, use: str) -> Iterator[str]:
        """Yield names that a dotted name may have been meant to be.

        These are the classes of its module that fit or, without such a module, all classes in the
        modules of the working folder.
        """
        name = use.rpartition(".")[0]
        if (module := sys.modules.get(name)) is not None:
            for one, value in vars(module).items():
                if self._fits(value) and value.__module__ == name:
                    yield f"{name}.{one}"
            return
        for path in sorted(Path().glob("*.py")):
            with suppress(OSError):
                for one in _CLASS.findall(path.read_text(encoding="utf-8", errors="replace")):
                    yield f"{path.stem}.{one}"

    def _fits(self, found: object) -> bool:
        if not isinstance(found, type):
            return False
        if self.base is not None:
            return issubclass(found, self.base)
        return all(callable(getattr(found, one, None)) for one in self.methods)

    def build(
        self, plugged: type[Any], use: str, *arguments: object, draw: "InstantDraw | None" = None
    ) -> Any:
        """Construct a class; an instance of a user's class is guarded. Raises PlugInError.

        A user's class may take `draw`; by default that of no vehicle.
        """
        is_own = use not in self.shipped
        draws = is_own and self.draws and takes_draw(plugged)
        keywords = {"draw": (draw or InstantDraw(0, "")).of(self.key)} if draws else {}
        parts = (self.arguments, "settings" * has_settings(plugged), "draw=draw" * draws)
        given = ", ".join(filter(None, parts))
        what = f"{self.name} {use!r}: cannot be built as {plugged.__name__}({given})"
        made = called(lambda: plugged(*arguments, **keywords), what, ": ")
        return self.guard(made, use) if is_own and self.guard is not None else made


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


def takes_draw(plugged: type[Any]) -> bool:
    """Whether the constructor of a class has a parameter `draw`."""
    try:
        return "draw" in signature(plugged).parameters
    except (TypeError, ValueError):  # of a class of an extension module
        return False


def dotted_name(kind: type) -> str:
    return f"{kind.__module__}.{kind.__qualname__}"


def has_settings(plugged: type[Any]) -> bool:
    """Whether a class names a dataclass or a Pydantic model of its parameters, as `Settings`."""
    return getattr(plugged, "Settings", None) is not None


def settings_class(point: PlugInPoint, plugged: type[Any], use: str) -> type[Any] | None:
    """Return the class of the parameters, if there is one; raises PlugInError for others."""
    settings = getattr(plugged, "Settings", None)
    is_model = isinstance(settings, type) and issubclass(settings, BaseModel)
    if settings is None or is_model or (isinstance(settings, type) and is_dataclass(settings)):
        return settings
    raise PlugInError(f"{point.name} {use!r}: Settings is not a dataclass or a Pydantic model")
