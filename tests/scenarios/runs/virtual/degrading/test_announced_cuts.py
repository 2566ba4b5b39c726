"""Everything is cut at a random instant of the double lane change, and heals again."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from random import Random

import pytest

from scenarios.definition.scenario import Scenario, load_scenario
from scenarios.runs.observer import OnMessage
from scenarios.runs.virtual import drive
from vehicles.messages import Command, LogText, Message, Mode, Tracking, TruePose
from vehicles.schedule import SECOND

RATE, CONTROL_S = 1.18, 0.02
SLOWING: tuple[Mode, ...] = ("coast", "stop")
ROAD_M = 1110.0


@dataclass
class Told:
    """Messages of one follower at its control instants."""

    truth: list[TruePose] = field(default_factory=list)
    tracking: list[Tracking] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)

    def instants(self) -> Iterator[tuple[TruePose, Tracking, Command]]:
        return zip(self.truth, self.tracking, self.commands, strict=True)


@dataclass
class Cut:
    """A convoy of which nothing is sent from `cut_s` to `back_s`."""

    scenario: Scenario
    cut_s: float
    back_s: float
    followers: dict[str, Told]

    def seconds(self, results: Tracking) -> float:
        return (results.decided_at_ns - self.scenario.start_at_ns) / SECOND

    def off(self, name: str) -> list[float]:
        """True distance (m) from the road at each control instant."""
        near = self.scenario.route.start_station(int(name[1:]) - 1)
        found = []
        for pose in self.followers[name].truth:
            foot = self.scenario.route.path.project(pose.east_m, pose.north_m, near)
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
    scenario = load_scenario(
        "lane_change",
        [
            *(f"speed.set_mps={speed:.3f}", f"convoy.gap_m={gap}", f"seed={case}"),
            f"duration_s={min(back_s + 22.0, ROAD_M / speed):.1f}",
            *(f"vehicle.v{k}.transmitter_off={off}" for k in (1, 2, 3)),
        ],
    )
    followers = {name: Told() for name in ("v2", "v3", "v4")}

    def record(_at: int, message: Message) -> None:
        results = followers.get(message.vehicle, Told())
        match message:
            case TruePose():
                results.truth.append(message)
            case Tracking():
                results.tracking.append(message)
            case Command():
                results.commands.append(message)
            case LogText():
                results.lines.append(message.text)

    drive(scenario, [OnMessage(record)]).raise_fault()
    return Cut(scenario, cut_s, back_s, followers)


@pytest.mark.campaign(3, 200)
def test_inside_the_known_path_cars_keep_to_the_road_and_commands_to_their_limits(
    case: int,
) -> None:
    ran = cut(case)
    for name, results in ran.followers.items():
        for (truth, tracking, command), off in zip(results.instants(), ran.off(name), strict=True):
            assert math.isfinite(command.steering_rad + command.acceleration_mps2)
            hard = command.override in {"contact", "announced stop"}
            assert hard or command.acceleration_mps2 >= -6.0 - 1e-9
            assert truth.friction_ratio <= 1.0 + 1e-9
            silent = ran.seconds(tracking) < ran.back_s
            if tracking.mode in SLOWING and tracking.known_m > 0.0 and silent:
                assert abs(off) <= 0.3, (name, ran.seconds(tracking))
        for before, command in pairwise(results.commands):
            turned = command.steering_rad - before.steering_rad
            assert abs(turned) <= RATE * CONTROL_S + 1e-12


@pytest.mark.campaign(3, 200)
def test_modes_change_for_a_reason_once_and_all_come_back(case: int) -> None:
    ran = cut(case)
    for name, results in ran.followers.items():
        entered: dict[Mode, float] = {}
        lines = iter(one for one in results.lines if one.startswith("mode "))
        next(lines)
        for before, tracking in pairwise(results.tracking):
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
        assert results.tracking[-1].mode == usual
        if ran.seconds(results.tracking[-1]) > ran.back_s + 10.0:
            assert results.truth[-1].speed_mps > 3.0


@pytest.mark.campaign(3, 200)
def test_a_stop_ends_inside_the_known_path_or_where_predicted(case: int) -> None:
    """The blind distance is the one predicted when the sources were lost, to 5 %."""
    ran = cut(case)
    for results in ran.followers.values():
        began: Tracking | None = None
        for truth, tracking, _ in results.instants():
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
        for results in cut(case).followers.values():
            stood += any(one.speed_mps == 0.0 for one in results.truth)
            blind.append(max(one.blind_m for one in results.tracking if one.mode in SLOWING))
    assert stood > 2
    assert min(blind) == 0.0
    assert max(blind) > 20.0
