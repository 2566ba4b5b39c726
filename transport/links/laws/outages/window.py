"""An outage for a time."""

from typing import Literal

from transport.links.laws.outages.span import SpanOutage


class WindowOutage(SpanOutage):
    """An outage for a time."""

    kind: Literal["window"] = "window"
