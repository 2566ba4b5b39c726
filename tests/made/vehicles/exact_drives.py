"""Cars with exact receivers, and sources with exact poses."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

from tests.made.vehicles.driving import advance
from vehicles.car.dynamics import Body
from vehicles.car.gnss import Fix, to_message
from vehicles.car.imu import Motion
from vehicles.car.parameters import LINCOLN_MKZ as CAR
from vehicles.car.path_history import PathHistory
from vehicles.driver.decision import Decision
from vehicles.geometry.geodesy import LocalPlane, Origin
from vehicles.geometry.sampled_path import NO_HISTORY, PathPoint, SampledPath
from vehicles.messages import GpsPose
from vehicles.received_pose import ReceivedPose, receive
from vehicles.schedule import SECOND, Cadence, instant

START = 1_790_000_000 * SECOND
CONTROL_HZ, GNSS_HZ = 50.0, 20.0
GNSS = Cadence(START, GNSS_HZ)
PLANE = LocalPlane(Origin(30.638, -96.481, 80.0))
LATENCY_NS = SECOND // 50


@dataclass(frozen=True)
class Step:
    now: int
    body: Body
    decision: Decision

    @property
    def seconds(self) -> float:
        return (self.now - START) / SECOND


def measured(body: Body, now: int) -> Fix | None:
    seq = GNSS.index(now)
    if seq is None:
        return None
    return Fix(seq, now, body.east, body.north, body.yaw, body.speed, body.yaw_rate)


def instants(seconds: float, control_hz: float = CONTROL_HZ) -> list[int]:
    end = START + round(seconds * SECOND)
    all_instants = {
        instant(START, k, rate)
        for rate in (control_hz, GNSS_HZ)
        for k in range(math.ceil(seconds * rate) + 1)
    }
    return sorted(at for at in all_instants if at <= end)


class Decides(Protocol):
    """A driver, or something that compares several."""

    def step(
        self,
        now: int,
        fix: Fix | None,
        motion: Motion | Body | None,
        received: Sequence[ReceivedPose],
    ) -> Decision: ...


def drive(
    driver: Decides,
    body: Body,
    seconds: float,
    receive_at: Callable[[int], Sequence[ReceivedPose]] = lambda _: (),
    *,
    control_hz: float = CONTROL_HZ,
    fix: Callable[[Body, int], Fix | None] = measured,
) -> list[Step]:
    steps = []
    ticks = instants(seconds, control_hz)
    for now, after in pairwise(ticks):
        decision = driver.step(now, fix(body, now), body, receive_at(now))
        steps.append(Step(now, body, frozen(decision)))
        body = advance(body, decision.actuation, (after - now) / SECOND, CAR)
    return steps


def frozen(decision: Decision) -> Decision:
    """Copy with the state of the sources, which the follower updates in place."""
    now = decision.situation
    situation = replace(
        now,
        lead=replace(now.lead),
        predecessor=replace(now.predecessor),
        others={name: replace(state) for name, state in now.others.items()},
    )
    return replace(decision, situation=situation)


def on(path: SampledPath, station: float, speed: float, left: float = 0.0) -> Body:
    """A car on `path`, or `left` (m) of it."""
    point = path.at(station)
    return Body(*point_at(point, left), yaw=point.yaw, speed=speed)


def point_at(point: PathPoint, left: float) -> tuple[float, float]:
    return point.east - left * math.sin(point.yaw), point.north + left * math.cos(point.yaw)


@dataclass
class Source:
    """A vehicle that drives exactly along `path`, received with a latency of `LATENCY_NS`.

    `delivered` are the spans (s, from and until) in which its messages are delivered. They carry
    the path `history` if there is one.
    """

    name: str
    path: SampledPath
    station: float
    speed: float
    delivered: Sequence[tuple[float, float]] = ((0.0, math.inf),)
    history: PathHistory | None = None
    _next: int = 0

    def place(self, now: int) -> float:
        """Station (m) at instant `now`."""
        return self.station + self.speed * (now - START) / SECOND

    def message(self, seq: int) -> GpsPose:
        at = instant(START, seq, GNSS_HZ)
        point = self.path.at(self.place(at))
        turning = self.speed * point.curvature
        fix = Fix(seq, at, point.east, point.north, point.yaw, self.speed, turning)
        place = point.east, point.north, 0.0
        history = NO_HISTORY
        if self.history is not None:
            self.history.record(fix, on_path=True)
            history = self.history.deltas()
        return to_message(
            fix, self.name, PLANE, seq=seq, sent_at=at, true_position=place, history=history
        )

    def messages_by(self, now: int) -> Iterator[GpsPose]:
        while (at := instant(START, self._next, GNSS_HZ)) + LATENCY_NS <= now:
            seconds = (at - START) / SECOND
            message = self.message(self._next)
            if any(since <= seconds < until for since, until in self.delivered):
                yield message
            self._next += 1


def received_from(*sources: Source) -> Callable[[int], list[ReceivedPose]]:
    return lambda now: [
        receive(message, PLANE, now) for source in sources for message in source.messages_by(now)
    ]
