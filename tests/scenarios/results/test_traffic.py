"""Events of the traffic: falls behind, stranded, overspeed, hard braking, overridden."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from random import Random

import pytest

from scenarios.definition.scenario import load_scenario
from scenarios.results.run_event import RunEvent, run_events
from scenarios.results.summary import from_json, to_json
from scenarios.results.traffic import FIGURE_OF
from scenarios.results.vehicle_figures import vehicle_summaries
from scenarios.runs.virtual import run_unlogged
from tests.made.scenarios.messages import at, command, truth
from tests.made.scenarios.tables import LENGTH, run_of
from vehicles.driver.controller import SpacingPolicy
from vehicles.messages import Change, Command, Message, TruePose

OF_TRAFFIC = {*FIGURE_OF, "stranded"}
Speed = Callable[[float], float]
"""Speed (m/s) over time (s)."""
COLUMN_GAP = 10.0


def steady(_seconds: float) -> float:
    return 20.0


def braking(begin: float, rate: float, until: float) -> Speed:
    """20 m/s, and from `begin` on braking at `rate` for (v - until) / rate seconds."""
    return lambda seconds: max(20.0 - rate * max(seconds - begin, 0.0), until)


def convoy(speeds: Sequence[Speed], seconds: float, gap: float = COLUMN_GAP) -> list[TruePose]:
    """Poses at 50 Hz of vehicles on a straight road, at first `gap` m apart."""
    poses = []
    for place, speed in enumerate(speeds):
        east = -place * (LENGTH + gap)
        for seq in range(round(50 * seconds)):
            now = speed(seq / 50)
            poses.append(replace(truth(f"v{place + 1}", seq, east, 0.0), speed_mps=now))
            east += 0.5 * (now + speed((seq + 1) / 50)) / 50
    return sorted(poses, key=lambda pose: pose.true_at_ns)


def detected(
    messages: Sequence[Message], policy: SpacingPolicy | None = None, joins: str = ""
) -> tuple[RunEvent, ...]:
    """Events of the traffic, of followers with a spacing policy or with the lead's speed.

    The vehicle that `joins` is not in the convoy before its change.
    """
    overrides = []
    if policy is not None:
        keys = {"followers": "'gap'", "gap.standstill_m": policy.standstill}
        keys["gap.headway_s"] = policy.headway
        overrides += [f"speed.{key}={value}" for key, value in keys.items()]
    if joins:
        overrides.append(f'change=[{{kind="join", at_s=10.0, vehicle="{joins}"}}]')
    count = len({message.vehicle for message in messages})
    found = run_events(run_of(*messages, count=count, overrides=overrides))
    return tuple(event for event in found if event.kind in OF_TRAFFIC)


def change(vehicle: str, kind: str, seconds: float, table: str = "") -> Change:
    return Change(
        vehicle=vehicle, seq=0, effective_at_ns=at(seconds), kind=kind, by_hand=False, table=table
    )


def crash(lasts_s: float) -> Change:
    table = f'{{"kind": "crash", "at_s": 1.0, "vehicle": "v2", "for_s": {lasts_s}}}'
    return change("v2", "crash", 1.0, table)


def slower(seconds: float) -> float:
    return 20.0 if seconds < 1.0 else 16.0


def faster(seconds: float) -> float:
    return 20.0 if seconds < 5.0 else 24.0


def brief_stop(seconds: float) -> float:
    return 0.0 if 7.0 < seconds < 8.8 else 20.0


def column(place: int) -> Speed:
    """Drive, stop, and set off again 1.5 s after the vehicle ahead."""
    again = 12.0 + 1.5 * place

    def speed(seconds: float) -> float:
        if seconds < again:
            return max(20.0 - 1.4 * max(seconds - 1.0, 0.0), 0.0)
        return min(2.0 * (seconds - again), 20.0)

    return speed


STOPS, HARD_STOP = braking(1.0, 3.4, 0.0), braking(1.0, 6.0, 0.0)


@pytest.mark.parametrize(
    ("messages", "kind", "vehicles", "at_s", "figures"),
    [
        # 10 m at first: 10 + 10 + 1.5 × 16 m are allowed, reached after 8.5 s at 4 m/s
        (convoy([steady, slower], 20.0), "falls_behind", ["v2"], 9.5,
         {"gap_excess_m_max": 4.0 * 19.0 - 34.0, "duration_s": 10.4}),
        # v3, behind v2, has two more seconds
        (convoy([steady, STOPS, STOPS], 20.0), "stranded", ["v2", "v3"], 6.8, {"duration_s": 13.1}),
        (convoy([steady, faster], 8.0, gap=15.0), "overspeed", ["v2"], 5.0,
         {"speed_excess_mps_max": 24.0 - 22.5}),
        (convoy([steady, steady, braking(5.0, 4.0, 10.0), braking(5.5, 5.0, 10.0)], 8.0),
         "hard_braking", ["v3"], 5.0, {"braking_mps2_max": 4.0, "duration_s": 2.5}),
        (convoy([steady, braking(5.0, 2.1, 15.0)], 8.0), "hard_braking", ["v2"], 5.0, {}),
        # a planned fault explains a stop while it lasts
        ([crash(6.0), *convoy([steady, HARD_STOP], 20.0)], "stranded", ["v2"], 7.1, {}),
    ],
)  # fmt: skip
def test_an_event_of_the_traffic_has_vehicles_begin_and_figures(
    messages: list[Message], kind: str, vehicles: list[str], at_s: float, figures: dict[str, float]
) -> None:
    found = [event for event in detected(messages) if event.kind == kind]
    assert [event.vehicles for event in found] == [(name,) for name in vehicles]
    assert found[0].at_s == pytest.approx(at_s, abs=0.15)
    assert {name: found[0].figures[name] for name in figures} == pytest.approx(figures, abs=0.5)
    assert found[0].level == "warning"


EXIT_LANE = convoy([steady, braking(2.0, 1.0, 3.0), steady], 20.0)


@pytest.mark.parametrize(
    ("messages", "kinds"),
    [
        (convoy([steady, steady, steady], 20.0), OF_TRAFFIC),
        (convoy([steady, brief_stop], 12.0), {"stranded"}),
        (convoy([column(place) for place in range(5)], 60.0), {"stranded"}),
        ([crash(6.0), *convoy([steady, HARD_STOP], 20.0)], {"hard_braking"}),
        ([crash(60.0), *convoy([steady, HARD_STOP], 20.0)], {"stranded", "hard_braking"}),
        (convoy([steady, braking(5.0, 1.9, 15.0)], 8.0), OF_TRAFFIC),
        (convoy([braking(5.0, 3.0, 10.0), braking(6.0, 4.0, 10.0)], 10.0), OF_TRAFFIC),
        # behind a vehicle that has left, the gap is that to the next one
        ([change("v2", "leave", 2.0), *EXIT_LANE], OF_TRAFFIC),
    ],
    ids=[
        "steady", "brief stop", "column", "crash", "long crash", "comfortable", "caused", "left",
    ],
)  # fmt: skip
def test_what_is_no_event_of_the_traffic(messages: list[Message], kinds: set[str]) -> None:
    assert kinds.isdisjoint(event.kind for event in detected(messages))


def test_gaps_are_judged_by_the_spacing_policy() -> None:
    poses, wide = convoy([steady, slower], 20.0), SpacingPolicy(2.0, 6.0)
    assert "falls_behind" not in {one.kind for one in detected(poses, wide)}
    # far behind from the start, it has not fallen behind
    assert detected(convoy([steady, steady], 10.0, gap=200.0), SpacingPolicy(2.0, 0.5)) == ()
    # the lead stops; 15 s later the last one still drives as fast as the lead did there
    speeds = [braking(1.0, 1.4, 0.0), braking(16.0, 1.4, 0.0)]
    assert detected(convoy(speeds, 18.0, gap=400.0), SpacingPolicy(2.0, 10.0)) == ()


def test_a_vehicle_that_joins_later_is_judged_from_then_on() -> None:
    poses = convoy([steady, braking(1.0, 4.0, 0.0)], 20.0)
    assert detected(poses, joins="v2") == ()
    joined = detected([change("v2", "join", 10.0), *poses], joins="v2")
    assert "hard_braking" not in {one.kind for one in joined}  # before


def test_the_order_of_messages_does_not_matter() -> None:
    speeds = [steady, braking(2.0, 4.0, 0.0), braking(2.5, 6.0, 0.0), steady]
    poses = convoy(speeds, 20.0)
    expected = detected(poses)
    assert {one.kind for one in expected} == {"falls_behind", "hard_braking", "stranded"}
    assert detected(Random(3).sample(poses, len(poses))) == expected


# ---- Overrides


def commands(vehicle: str, overridden: Sequence[bool]) -> list[Command]:
    return [
        replace(command(vehicle, seq), override="alone" if one else "")
        for seq, one in enumerate(overridden)
    ]


def test_overrides_count_after_two_seconds_and_are_an_event_above_a_fifth() -> None:
    tenth = [True] * 100 + [seq % 10 == 0 for seq in range(1000)]
    third = [False] * 100 + [seq % 3 == 0 for seq in range(999)]
    messages: list[Message] = [*convoy([steady] * 3, 1.0)]
    messages += [*commands("v2", tenth), *commands("v3", third)]
    (event,) = detected(messages)
    assert (event.kind, event.vehicles) == ("overridden", ("v3",))
    assert event.at_s == pytest.approx(2.0)
    assert event.figures == pytest.approx({"overridden_ratio": 1 / 3, "duration_s": 333 / 50})


def test_the_share_of_overrides_is_in_the_summary_by_reason() -> None:
    rows = [*commands("v1", [False] * 200), *commands("v2", [seq % 4 == 0 for seq in range(500)])]
    lead, second, third = vehicle_summaries(run_of(*rows), {})
    assert lead.overridden_ratio is None
    assert second.overridden_ratio == pytest.approx(0.25)
    assert second.overrides == pytest.approx({"alone": 0.25})
    assert (third.overridden_ratio, third.overrides) == (None, {})


def test_a_convoy_without_loss_is_quiet_and_a_cut_one_is_not() -> None:
    quiet = run_unlogged(load_scenario("lane_change", ["duration_s=12.0"]))
    assert quiet.outcome_line.startswith("OK")
    assert [row.overridden_ratio is None for row in quiet.vehicles] == [True, False, False, False]
    cut = ['change=[{kind="cut", at_s=3.0, receiver="v3"}]', "limits.stranded_max=0"]
    summary = run_unlogged(load_scenario("lane_change", [*cut, "duration_s=25.0"]))
    assert {"stranded", "falls_behind"} <= {event.kind for event in summary.events}
    assert "limits.stranded_max" in summary.reason
    assert from_json(to_json(summary)).events == summary.events
