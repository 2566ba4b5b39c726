"""Base of radio laws, whose losses follow from the true distance between both antennas.

The message carries the position of the sender; the receiving node knows its own. A message without
a position is out of range.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import hypot

from transport.links.laws.effect import TransmissionContext
from transport.links.laws.link_law import LinkLaw, Problem

PURPOSE = "radio"  # Purpose of the draws of deliveries


class Radio(LinkLaw):
    """Base of radio laws; the loss in the long run is a function of the distance."""

    key = "radio"
    reason = "range"


def distance_of(context: TransmissionContext) -> float:
    """Distance (m) between sender and receiver when a message was sent."""
    sender, receiver = context.sender, context.receiver
    return hypot(sender.east - receiver.east, sender.north - receiver.north)


def curve_problems(
    within: str, x: tuple[str, Sequence[float]], y: tuple[str, Sequence[float]]
) -> Iterator[Problem]:
    """Yield different lengths of the lists `x` and `y` (key, values), and an `x` not increasing."""
    (x_key, xs), (y_key, ys) = x, y
    if len(xs) != len(ys):
        yield f"{within}{y_key}", f"given {len(ys)} numbers, allowed {len(xs)} as {within}{x_key}"
    for index, (before, after) in enumerate(pairwise(xs), 1):
        if after <= before:
            why = f"given {after}, allowed more than {before}, the previous entry"
            yield f"{within}{x_key}[{index}]", why
