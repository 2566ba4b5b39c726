"""Mark of tests that need interpreted code."""

import inspect

import pytest

from vehicles.driver.degradation.sources import SourcePair

interpreted_only = pytest.mark.skipif(
    not inspect.isfunction(SourcePair.stops_at),
    reason="compiled code ignores replaced methods and constants",
)
