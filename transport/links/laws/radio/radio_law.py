"""What all radios have in common: losses follow from the distance between both antennas.

The distance is the true one: the place of the sender comes with the message, that of the receiver
is known to the node that judges. A message without a place is out of range.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from math import hypot

from transport.links.laws.effect import TransmissionContext
from transport.links.laws.link_law import LinkLaw, Problem

PURPOSE = "radio"
"""The word under which the fates of messages are drawn."""


class Radio(LinkLaw):
    """Base of radios; the loss in the long run is known over a distance only."""

    key = "radio"
    reason = "range"


def distance_of(context: TransmissionContext) -> float:
    """Distance (m) between both ends when a message was sent."""
    sender, receiver = context.sender, context.receiver
    return hypot(sender.east - receiver.east, sender.north - receiver.north)


def curve_problems(
    within: str, over: tuple[str, Sequence[float]], numbers: tuple[str, Sequence[float]]
) -> Iterator[Problem]:
    """Find two lists of different lengths, and a first one that does not increase."""
    (key, given), (other_key, others) = over, numbers
    if len(given) != len(others):
        why = f"given {len(others)} numbers, allowed {len(given)} as radio.{within}{key}"
        yield f"{within}{other_key}", why
    for index, (before, after) in enumerate(pairwise(given), 1):
        if after <= before:
            why = f"given {after}, allowed more than {before}, the entry before"
            yield f"{within}{key}[{index}]", why
