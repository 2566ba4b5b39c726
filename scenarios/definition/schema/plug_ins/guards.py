"""Calls of user-defined classes, with faults in one line."""

from collections.abc import Callable
from math import isfinite
from typing import TypeVar

from transport.texts import ConvoyError

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
