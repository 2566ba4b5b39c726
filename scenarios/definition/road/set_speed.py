"""The lead's speed after a change of its set speed, and the speed of a car that sets off."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

from scenarios.definition.road.lead_speed import Limits, slowed
from scenarios.definition.schema.change_tables import AnyChange, SpeedChangeTable
from vehicles.driver.speed import SpeedProfile
from vehicles.geometry.sampled_path import SampledPath


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SpeedPlan:
    """The speed of a convoy over the time (s) of a run.

    `wanted` is the configured speed, `profile` the lead's after it is lowered in curves. The lead
    starts at station `start` (m) of the `path`. The plan covers the time to `until` (s).
    """

    path: SampledPath
    start: float
    limits: Limits
    until: float
    wanted: SpeedProfile
    profile: SpeedProfile

    def changed(self, at: float, change: SpeedChangeTable) -> "SpeedPlan":
        """Plan another set speed from `at` (s) on."""
        return _changed(self, at, change)

    def setting_off(self, at: float, station: float, speed: float) -> SpeedProfile:
        """Return the speed of a car on its own that is at `station` (m) with `speed` (m/s) at `at`.

        It accelerates like the lead, and slows down before curves.
        """
        wanted = _from(self.wanted, at)
        onward = self.onward(wanted, at, (station, speed), self.limits.acceleration)
        return _from(onward, at)

    def onward(
        self, wanted: SpeedProfile, at: float, here: tuple[float, float], acceleration: float
    ) -> SpeedProfile:
        """Return the speed from `at` (s) on of a car that is `here` (station m, speed m/s)."""
        station, speed = here
        reached = approached(_shifted(wanted, -at), speed, acceleration)
        if station >= float(self.path.station[-1]):
            return _shifted(reached, at)
        span = max(self.until - at, 0.0)
        return _shifted(slowed(reached, self.path, station, self.limits, span), at)


@lru_cache(maxsize=16)
def _changed(plan: SpeedPlan, at: float, change: SpeedChangeTable) -> SpeedPlan:
    """Compute a changed plan; cached, since it takes tens of milliseconds on a road with curves."""
    wanted = _from(SpeedProfile((0.0,), (change.speed_mps,)), at)
    here = plan.start + plan.profile.distance(at), plan.profile.at(at)[0]
    onward = plan.onward(wanted, at, here, change.acceleration_mps2)
    return replace(
        plan,
        wanted=_joined(plan.wanted, wanted, at),
        profile=_joined(plan.profile, onward, at),
    )


def approached(wanted: SpeedProfile, speed: float, acceleration: float) -> SpeedProfile:
    """Return the speed from time 0 on of a car that changes evenly from `speed` to `wanted`."""
    first = wanted.at(0.0)[0]
    slope = math.copysign(acceleration, first - speed)
    corners = [0.0, *(time for time in wanted.times if time > 0.0)]
    for begin, end in pairwise((*corners, math.inf)):
        aim, change = wanted.at(begin)
        apart = aim - (speed + slope * begin)
        closing = slope - change
        if apart == 0.0:
            met = begin
        elif apart * closing <= 0.0:
            continue
        else:
            met = begin + apart / closing
        if met <= end:
            after = [time for time in corners if time > met]
            begins = [(0.0, speed)] if met > 0.0 else []
            knots = [*begins, *((time, wanted.at(time)[0]) for time in (met, *after))]
            return SpeedProfile(*map(tuple, zip(*knots, strict=True)))
    return wanted


def with_changes(plan: SpeedPlan, changes: Iterable[AnyChange]) -> SpeedPlan:
    speeds = [change for change in changes if isinstance(change, SpeedChangeTable)]
    for change in sorted(speeds, key=lambda one: one.at_s):
        plan = plan.changed(change.at_s, change)
    return plan


def _shifted(profile: SpeedProfile, by: float) -> SpeedProfile:
    # Knots closer than the resolution of the shifted times become one.
    knots = {t + by: v for t, v in zip(profile.times, profile.speeds, strict=True)}
    return SpeedProfile(tuple(knots), tuple(knots.values()))


def _from(profile: SpeedProfile, at: float) -> SpeedProfile:
    """Return the part of a profile from `at` (s) on."""
    later = [(t, v) for t, v in zip(profile.times, profile.speeds, strict=True) if t > at]
    knots = [(at, profile.at(at)[0]), *later]
    return SpeedProfile(*map(tuple, zip(*knots, strict=True)))


def _joined(before: SpeedProfile, after: SpeedProfile, at: float) -> SpeedProfile:
    knots = [(t, v) for t, v in zip(before.times, before.speeds, strict=True) if t < at]
    if not knots or after.at(at)[0] != before.at(at)[0]:
        # Profiles have no jumps, but corners a nanosecond apart.
        last = at - 1e-9
        knots = [one for one in knots if one[0] < last] + (
            [(last, before.at(last)[0])] if last > 0.0 else []
        )
    later = [(t, v) for t, v in zip(after.times, after.speeds, strict=True) if t > at]
    knots += [(at, after.at(at)[0]), *later]
    return SpeedProfile(*map(tuple, zip(*knots, strict=True)))
