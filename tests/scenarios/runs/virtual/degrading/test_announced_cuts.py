"""Everything is cut at a random instant of the double lane change, and heals again."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from random import Random

import pytest

from tests.made.convoys.driven import Driven, driven
from vehicles.messages import Command, LogText, Mode, Tracking, TruePose
from vehicles.schedule import SECOND

RATE, CONTROL_S = 1.18, 0.02
SLOWING: tuple[Mode, ...] = ("coast", "stop")
ROAD_M = 1110.0


@dataclass
class Cut:
    """A convoy of which nothing is sent from `cut_s` to `back_s`."""

    run: Driven
    cut_s: float
    back_s: float

    def instants(self, name: str) -> Iterator[tuple[TruePose, Tracking, Command]]:
        """Messages of a follower at its control instants."""
        of = self.run.of
        return zip(of(name, TruePose), of(name, Tracking), of(name, Command), strict=True)

    def seconds(self, results: Tracking) -> float:
        return (results.decided_at_ns - self.run.scenario.start_at_ns) / SECOND

    def off(self, name: str) -> list[float]:
        """True distance (m) from the road at each control instant."""
        route = self.run.scenario.route
        near, found = route.start_station(int(name[1:]) - 1), []
        for pose in self.run.of(name, TruePose):
            foot = route.path.project(pose.east_m, pose.north_m, near)
            near = foot.station
            found.append(foot.lateral)
        return found


@lru_cache(maxsize=12)
def cut(case: int) -> Cut:
    chance = Random(case)
    speed, gap = chance.uniform(8.0, 30.0), chance.choice([3.0, 10.0, 25.0])
    cut_s = chance.uniform(2.0, 720.0 / speed)
    back_s = cut_s + chance.uniform(0.6, 12.0)
    off = f"[{{from_s={cut_s:.3f}, to_s={back_s:.3f}}}]"
    run = driven(
        "lane_change",
        *(f"speed.set_mps={speed:.3f}", f"convoy.gap_m={gap}", f"seed={case}"),
        f"duration_s={min(back_s + 22.0, ROAD_M / speed):.1f}",
        *(f"vehicle.v{k}.transmitter_off={off}" for k in (1, 2, 3)),
    )
    return Cut(run, cut_s, back_s)


@pytest.mark.campaign(3, 200)
def test_inside_the_known_path_cars_keep_to_the_road_and_commands_to_their_limits(
    case: int,
) -> None:
    ran = cut(case)
    for name in ran.run.followers:
        for (truth, tracking, command), off in zip(ran.instants(name), ran.off(name), strict=True):
            assert math.isfinite(command.steering_rad + command.acceleration_mps2)
            hard = command.override in {"contact", "announced stop"}
            assert hard or command.acceleration_mps2 >= -6.0 - 1e-9
            assert truth.friction_ratio <= 1.0 + 1e-9
            silent = ran.seconds(tracking) < ran.back_s
            if tracking.mode in SLOWING and tracking.known_m > 0.0 and silent:
                assert abs(off) <= 0.3, (name, ran.seconds(tracking))
        for before, command in pairwise(ran.run.of(name, Command)):
            turned = command.steering_rad - before.steering_rad
            assert abs(turned) <= RATE * CONTROL_S + 1e-12


@pytest.mark.campaign(3, 200)
def test_modes_change_for_a_reason_once_and_all_come_back(case: int) -> None:
    ran = cut(case)
    for name in ran.run.followers:
        entered: dict[Mode, float] = {}
        texts = [one.text for one in ran.run.of(name, LogText)]
        lines = iter(text for text in texts if text.startswith("mode "))
        next(lines)
        for before, tracking in pairwise(ran.run.of(name, Tracking)):
            if tracking.mode == before.mode:
                continue
            now = ran.seconds(tracking)
            assert next(lines) == f"mode {tracking.mode} ({tracking.reason})"
            assert " s" in tracking.reason
            assert " m " in tracking.reason
            assert now - entered.get(tracking.mode, -math.inf) >= 1.0 - 1e-9
            entered[tracking.mode] = now
        assert next(lines, None) is None
        usual = "lead" if name == "v2" else "composite"
        last = ran.run.of(name, Tracking)[-1]
        assert last.mode == usual
        if ran.seconds(last) > ran.back_s + 10.0:
            assert ran.run.speeds(name)[-1] > 3.0


@pytest.mark.campaign(3, 200)
def test_a_stop_ends_inside_the_known_path_or_where_predicted(case: int) -> None:
    """The blind distance is the one predicted when the sources were lost, to 5 %."""
    ran = cut(case)
    for name in ran.run.followers:
        began: Tracking | None = None
        for truth, tracking, _ in ran.instants(name):
            if ran.seconds(tracking) > ran.back_s:
                break
            if tracking.mode in SLOWING:
                began = began or tracking
                if truth.speed_mps == 0.0:
                    driven = max(-tracking.known_m, 0.0)
                    assert driven == pytest.approx(began.blind_m, rel=0.05, abs=0.2)
                    break


def test_some_cuts_end_inside_and_some_beyond() -> None:
    """Else the tests above would have nothing to find."""
    stood, blind = 0, []
    for case in range(3):
        run = cut(case).run
        for name in run.followers:
            stood += 0.0 in run.speeds(name)
            rows = run.of(name, Tracking)
            blind.append(max(one.blind_m for one in rows if one.mode in SLOWING))
    assert stood > 2
    assert min(blind) == 0.0
    assert max(blind) > 20.0
