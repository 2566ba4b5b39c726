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


def test_a_steady_convoy_has_no_event() -> None:
    assert detected(convoy([steady, steady, steady], 20.0)) == ()


def test_a_gap_beyond_law_and_age_falls_behind() -> None:
    """v2 keeps 10 m at first: 10 + 10 + 1.5 × 16 m are allowed, reached after 8.5 s at 4 m/s."""
    slow: Speed = lambda seconds: 20.0 if seconds < 1.0 else 16.0  # noqa: E731
    (event,) = [one for one in detected(convoy([steady, slow], 20.0)) if one.kind == "falls_behind"]
    assert event.vehicles == ("v2",)
    assert event.at_s == pytest.approx(9.5, abs=0.15)
    assert event.figures["gap_excess_m_max"] == pytest.approx(4.0 * 19.0 - 34.0, abs=0.5)
    assert event.figures["duration_s"] == pytest.approx(10.4, abs=0.2)
    assert event.level == "warning"
    wide = SpacingPolicy(2.0, 6.0)
    assert "falls_behind" not in {one.kind for one in detected(convoy([steady, slow], 20.0), wide)}


def test_a_follower_far_behind_from_the_start_has_not_fallen_behind() -> None:
    assert detected(convoy([steady, steady], 10.0, gap=200.0), SpacingPolicy(2.0, 0.5)) == ()


def test_behind_a_vehicle_that_has_left_the_gap_is_that_to_the_next_one() -> None:
    exit_lane: Speed = lambda seconds: max(20.0 - 1.0 * max(seconds - 2.0, 0.0), 3.0)  # noqa: E731
    poses = convoy([steady, exit_lane, steady], 20.0)
    assert "falls_behind" in {one.kind for one in detected(poses)}
    assert detected([change("v2", "leave", 2.0), *poses]) == ()


def test_a_vehicle_that_joins_later_is_judged_from_then_on() -> None:
    poses = convoy([steady, braking(1.0, 4.0, 0.0)], 20.0)
    assert detected(poses, joins="v2") == ()
    joined = detected([change("v2", "join", 10.0), *poses], joins="v2")
    assert "hard_braking" not in {one.kind for one in joined}  # before


def test_a_follower_that_stands_while_the_lead_drives_is_stranded() -> None:
    """v2 stands from 6.9 s on; v3, behind it, has two more seconds."""
    stops = braking(1.0, 3.4, 0.0)
    found = detected(convoy([steady, stops, stops], 20.0))
    stranded = [one for one in found if one.kind == "stranded"]
    assert [one.vehicles for one in stranded] == [("v2",), ("v3",)]
    assert stranded[0].at_s == pytest.approx(6.8, abs=0.15)
    assert stranded[0].figures["duration_s"] == pytest.approx(13.1, abs=0.2)
    assert stranded[0].line.startswith("stranded: v2 stands although the lead drives, 6.")
    brief: Speed = lambda seconds: 0.0 if 7.0 < seconds < 8.8 else 20.0  # noqa: E731
    assert "stranded" not in {one.kind for one in detected(convoy([steady, brief], 12.0))}


def test_a_stop_of_all_and_a_column_that_sets_off_are_not_stranded() -> None:
    def late(delay: float) -> Speed:
        """Drive, stop, and set off again `delay` s after the lead."""

        def speed(seconds: float) -> float:
            if seconds < 12.0 + delay:
                return max(20.0 - 1.4 * max(seconds - 1.0, 0.0), 0.0)
            return min(2.0 * (seconds - 12.0 - delay), 20.0)

        return speed

    found = detected(convoy([late(1.5 * place) for place in range(5)], 60.0))
    assert "stranded" not in {one.kind for one in found}


def test_a_planned_fault_explains_a_stop_while_it_lasts() -> None:
    stops = braking(1.0, 6.0, 0.0)
    poses = convoy([steady, stops], 20.0)
    short = '{"kind": "crash", "at_s": 1.0, "vehicle": "v2", "for_s": 6.0}'
    long = '{"kind": "crash", "at_s": 1.0, "vehicle": "v2", "for_s": 60.0}'
    kinds = [one.kind for one in detected([change("v2", "crash", 1.0, short), *poses])]
    assert kinds.count("stranded") == 1
    assert "hard_braking" not in kinds
    kinds = [one.kind for one in detected([change("v2", "crash", 1.0, long), *poses])]
    assert "stranded" not in kinds


def test_a_follower_faster_than_the_lead_was_is_overspeed() -> None:
    fast: Speed = lambda seconds: 20.0 if seconds < 5.0 else 24.0  # noqa: E731
    (event,) = detected(convoy([steady, fast], 8.0, gap=15.0))
    assert (event.kind, event.vehicles) == ("overspeed", ("v2",))
    assert event.at_s == pytest.approx(5.0, abs=0.15)
    assert event.figures["speed_excess_mps_max"] == pytest.approx(24.0 - 22.5)


def test_a_follower_as_fast_as_the_lead_was_there_is_none() -> None:
    """The lead stops at 2 m/s²; 15 s later the last one still drives at 20 m/s."""
    found = detected(
        convoy([braking(1.0, 1.4, 0.0), braking(16.0, 1.4, 0.0)], 18.0, gap=400.0),
        SpacingPolicy(2.0, 10.0),
    )
    assert found == ()


def test_the_first_of_those_that_brake_hard_without_a_cause_is_named() -> None:
    hard = [steady, steady, braking(5.0, 4.0, 10.0), braking(5.5, 5.0, 10.0)]
    found = [one for one in detected(convoy(hard, 8.0)) if one.kind == "hard_braking"]
    assert [one.vehicles for one in found] == [("v3",)]
    (event,) = found
    assert event.at_s == pytest.approx(5.0, abs=0.15)
    assert event.figures["braking_mps2_max"] == pytest.approx(4.0)
    assert event.figures["duration_s"] == pytest.approx(2.5, abs=0.15)


@pytest.mark.parametrize(("rate", "events"), [(1.9, 0), (2.1, 1)])
def test_comfortable_braking_and_a_margin_are_no_event(rate: float, events: int) -> None:
    assert len(detected(convoy([steady, braking(5.0, rate, 15.0)], 8.0))) == events


def test_hard_braking_behind_a_lead_that_brakes_is_caused() -> None:
    assert detected(convoy([braking(5.0, 3.0, 10.0), braking(6.0, 4.0, 10.0)], 10.0)) == ()


def test_the_order_of_messages_of_different_vehicles_does_not_matter() -> None:
    speeds = [steady, braking(2.0, 4.0, 0.0), braking(2.5, 6.0, 0.0), steady]
    poses = convoy(speeds, 20.0)
    expected = detected(poses)
    assert {one.kind for one in expected} == {"falls_behind", "hard_braking", "stranded"}
    waiting = {
        name: [one for one in poses if one.vehicle == name] for name in ("v1", "v2", "v3", "v4")
    }
    random, mixed = Random(3), list[Message]()
    while any(waiting.values()):  # none is more than 9 s ahead of the others
        first = min(rows[0].true_at_ns for rows in waiting.values() if rows)
        near = [
            rows
            for rows in waiting.values()
            if rows and rows[0].true_at_ns < first + at(9.0) - at(0)
        ]
        mixed.append(random.choice(near).pop(0))
    assert detected(mixed) == expected


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
    assert "v3 stands for" in summary.outcome_line
    assert "limits.stranded_max = 0: stranded: v3 stands although the lead drives" in summary.reason
    assert from_json(to_json(summary)).events == summary.events
