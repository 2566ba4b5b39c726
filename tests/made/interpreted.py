"""Mark of tests that need interpreted code."""

import inspect

import pytest

from vehicles.driver.sources import Sources

interpreted_only = pytest.mark.skipif(
    not inspect.isfunction(Sources.stops_at),
    reason="compiled code ignores replaced methods and constants",
)
