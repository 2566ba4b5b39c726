"""What a test can do to interpreted code alone."""

import inspect

import pytest

from vehicles.driver.degradation.sources import SourcePair

interpreted_only = pytest.mark.skipif(
    not inspect.isfunction(SourcePair.stops_at),
    reason="compiled code looks up neither methods nor constants that a test replaces",
)
