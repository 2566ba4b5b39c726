"""The vehicles between sender and receiver of a link, and the road along which they drive."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from transport.links.laws.effect import TransmissionContext


@dataclass(frozen=True, slots=True)
class Road:
    """Places (m) every `step` metres along the road that the convoy drives, from station 0 on.

    Straight lines join them; with 2 m steps they lie within 0.1 m of a bend of 5 m radius.
    """

    step: float
    east: Sequence[float]
    north: Sequence[float]

    def places(self, station: float, step: float, count: int) -> Iterator[tuple[float, float]]:
        """Give east and north (m) at `count` stations (m), each `step` on from the one before.

        The first is `step` on from `station`; beyond an end the road goes straight on.
        """
        easts, norths, last = self.east, self.north, len(self.east) - 2
        place, on = station / self.step, step / self.step
        for _ in range(count):
            place += on
            node = int(place)
            node = 0 if node < 0 else min(node, last)
            share = place - node
            rest = 1.0 - share
            yield (
                rest * easts[node] + share * easts[node + 1],
                rest * norths[node] + share * norths[node + 1],
            )


@dataclass(frozen=True, slots=True)
class VehiclesBetween:
    """The `count` vehicles between sender and receiver, and which of them are in the way.

    The receiver does not receive from all of them, so it places them evenly along the road between
    the two. Each node knows the road; the true places of both ends come with the message and from
    the receiver itself, so every clock gives the same. Their places follow from the stations
    of both ends on the `road`: that of each at its start plus the metres that it has driven.

    A vehicle is in the way if its circle of `radius` m (ETSI TR 103 257: 1.5 m) cuts the line of
    sight between the true places of both ends. On a straight all are, around a bend they are not.
    """

    count: int
    road: Road
    sender_start: float
    receiver_start: float
    radius: float = 1.5

    def count_obstructing(self, context: TransmissionContext, most: int) -> int:
        sender, receiver = context.sender, context.receiver
        station = self.receiver_start + receiver.travelled
        step = (self.sender_start + sender.travelled - station) / (self.count + 1)
        here_east, here_north = receiver.east, receiver.north
        way_east, way_north = sender.east - here_east, sender.north - here_north
        length = way_east * way_east + way_north * way_north  # squared
        reach = self.radius * self.radius * length  # of the cross product, squared
        found = 0
        for east, north in self.road.places(station, step, self.count):
            ahead, aside = east - here_east, north - here_north
            cross = way_east * aside - way_north * ahead
            # One beside the line counts where its foot lies between the two ends.
            if cross * cross < reach and 0.0 < way_east * ahead + way_north * aside < length:
                found += 1
                if found == most:
                    break
        return found


def no_vehicles() -> VehiclesBetween:
    return VehiclesBetween(0, Road(1.0, (0.0, 0.0), (0.0, 0.0)), 0.0, 0.0)
