"""Every message that was sent over a link is accounted for, by what the log holds."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from random import Random

import pytest

from scenarios.definition.channel.presets import presets
from scenarios.definition.library import drills
from scenarios.definition.scenario import Scenario, load_scenario, scenario_from_text
from scenarios.results.link_account import LinkAccount, accounts, contradictions
from scenarios.results.links import channel_warnings, link_summaries, silent_links
from scenarios.results.tables import RunTables
from scenarios.runs.virtual import run_tables
from tests.made.scenarios.messages import MS, STRAIGHT, at, gps, health, verdict
from tests.made.scenarios.recorded_run import (
    CONVOY,
    LINKS,
    POSES,
    SECONDS,
    MadeRun,
    Recorded,
    convoy,
    tables_of,
)
from vehicles.messages import Health, LinkVerdict, RunStart

Link = tuple[str, str]


def balanced(run: RunTables) -> dict[Link, LinkAccount]:
    """Accounts of a run, each of which balances."""
    counted = accounts(run)
    assert list(contradictions(counted)) == []
    for account in counted.values():
        assert account.sent == len(account.verdicts) + sum(account.fates.values())
    return counted


def warnings_of(run: RunTables) -> list[str]:
    return list(channel_warnings(run, accounts(run)))


def made(
    lost: Iterable[tuple[str, str, int]] = (),
    unrecorded: Iterable[tuple[str, str, int]] = (),
    cut_off: Sequence[str] = (),
    down: range = range(0),
) -> MadeRun:
    """A run in which messages do not arrive, and v3 takes no decisions at some control steps."""
    run = MadeRun()
    run.lost, run.unrecorded_verdicts = set(lost), set(unrecorded)
    run.decided["v3"] = [k for k in range(50 * SECONDS) if k not in down]
    for name in cut_off:
        run.cut_off(name, 60, 120)
    return run


def to_v3(numbers: range) -> list[tuple[str, str, int]]:
    return [(sender, "v3", k) for sender in ("v1", "v2") for k in numbers]


FIRST, SECOND_LINK = ("v1", "v2"), ("v2", "v3")


@pytest.mark.parametrize(
    ("run", "fates"),
    [
        (made(lost=[("v1", "v2", k) for k in range(40, 97)]), {FIRST: {"unknown": 57}}),
        (made(lost=[("v1", "v2", k) for k in range(7)]), {FIRST: {"late_start": 7}}),
        (
            made(cut_off=["v2"]),
            {FIRST: {"cut_off": 60}, SECOND_LINK: {"cut_off": 60}, ("v1", "v3"): {}},
        ),
        (made(cut_off=CONVOY.vehicle_names), {link: {"router_away": 60} for link in LINKS}),
        (
            made(lost=to_v3(range(40, 80)), down=range(100, 200)),
            {SECOND_LINK: {"receiver_down": 40}, FIRST: {}},
        ),
        # the receiver numbered these verdicts, or its final counters include them
        (made(unrecorded=to_v3(range(40, 60))), {SECOND_LINK: {"unrecorded": 20}, FIRST: {}}),
        (made(unrecorded=to_v3(range(170, POSES))), {SECOND_LINK: {"unrecorded": 30}}),
    ],
    ids=["loss", "late", "cut off", "router", "down", "hole", "hole at the end"],
)
def test_the_fate_of_messages_without_a_verdict_is_found(
    run: MadeRun, fates: Mapping[Link, Mapping[str, int]]
) -> None:
    counted = balanced(run.tables())
    for link, expected in fates.items():
        known = {fate: n for fate, n in counted[link].fates.items() if fate != "in_flight"}
        assert (counted[link].sent, known) == (POSES, expected)
        is_lost = not expected.keys() <= {"receiver_down", "unrecorded"}
        assert counted[link].missing.is_lost.any() == is_lost


def test_loss_is_the_share_of_sent_messages() -> None:
    """57 of 200 messages never arrive: a loss of 28.5 %, not of 0."""
    run = made(lost=[("v1", "v2", k) for k in range(40, 97)]).tables()
    rows = {(row.sender, row.receiver): row for row in link_summaries(run, accounts(run))}
    assert rows["v1", "v2"].loss_ratio == pytest.approx(57 / 200)
    assert rows["v1", "v2"].burst_messages_max == 57


def test_the_vehicle_that_was_cut_off_is_named() -> None:
    lines = warnings_of(made(cut_off=["v2"]).tables())
    assert any("v2 cut off" in line and "3.00 to 5.95 s" in line for line in lines)


def with_last_look(waiting: str, delay: int) -> Iterator[Recorded]:
    """The messages of a run with arrivals `delay` (ns) after sending and a last list of `waiting`.

    Verdicts on the last three messages are missing.
    """
    for when, one in MadeRun().recorded():
        if isinstance(one, LinkVerdict):
            if one.pose_seq < POSES - 3:
                yield when, replace(one, arrived_at_ns=one.sent_at_ns + delay)
        elif isinstance(one, Health):
            senders, listed = (2, "") if one.vehicle == "v3" else (1, waiting)
            yield when, replace(one, received=senders * (POSES - 3), waiting=listed)
        else:
            yield when, one


@pytest.mark.parametrize(
    ("delay_ms", "in_flight", "lost"), [(1, 2, 1), (99, 2, 1), (200, 3, 0)], ids=str
)
def test_messages_in_flight_are_those_that_had_arrived(
    delay_ms: int, in_flight: int, lost: int
) -> None:
    """Of the others, only those may be under way that the slowest message so far allows."""
    listed = f"v1 {POSES - 3} {POSES - 3},v1 {POSES - 1} {POSES - 1},v9 x"
    run = tables_of(with_last_look(listed, delay_ms * MS))
    counted = balanced(run)
    assert counted["v1", "v2"].fates.get("in_flight") == in_flight
    assert sum(counted["v1", "v2"].not_arrived.values()) == lost
    assert counted["v1", "v3"].fates.get("in_flight", 0) == (0 if delay_ms < 150 else 2)
    rows = {(row.sender, row.receiver): row for row in link_summaries(run, counted)}
    assert rows["v1", "v2"].transport_ms_mean == delay_ms


def test_a_vehicle_that_was_cut_off_for_good_is_named() -> None:
    """Nothing of it is recorded after 4 s: it sent on, and was sent to."""
    cut_at, made = at(4.0), MadeRun()
    made.lost = {("v2", "v3", k) for k in range(80, POSES)}
    recorded = [
        (when, one) for when, one in made.recorded() if when < cut_at or one.vehicle != "v2"
    ]
    run = tables_of([*recorded, (cut_at, health("v2", seconds=4.0))])
    counted = balanced(run)
    for link in (("v1", "v2"), ("v2", "v3")):
        assert set(counted[link].not_arrived) == {"cut_off"}
        assert sum(counted[link].fates.values()) == POSES - 80
        assert counted[link].fates.get("in_flight", 0) <= 4
        assert counted[link].sent == POSES
    assert counted["v1", "v3"].not_arrived == {}
    assert any("v2 cut off" in line for line in warnings_of(run))


def test_a_vehicle_whose_poses_came_very_late_is_named() -> None:
    made = MadeRun()
    made.transit = {("v2", k): 1500 * MS for k in range(40, 60)}
    (line,) = warnings_of(made.tables())
    assert line.startswith("v2 was out of reach")
    assert "2.00 to 2.95 s" in line
    made.transit = {(name, k): 1500 * MS for k in range(40, 60) for name in CONVOY.vehicle_names}
    (line,) = warnings_of(made.tables())
    assert line.startswith("every vehicle was out of reach")


@pytest.mark.parametrize("pose_seq", [7, POSES + 50])
def test_verdicts_that_contradict_the_account_fail_the_run(pose_seq: int) -> None:
    """A second verdict on one message, and one on a message that was never sent."""
    forged = verdict("v1", "v2", pose_seq, number=10_000)
    run = tables_of([*MadeRun().recorded(), (at(5.0), forged)])
    (line,) = contradictions(accounts(run))
    assert line.startswith("v1 → v2: the account does not balance")


# ---- The account depends on the messages only


def test_messages_in_another_order_or_doubled_change_nothing() -> None:
    random, unrecorded = Random(3), [("v1", "v3", k) for k in range(20, 30)]
    recorded = list(made(cut_off=["v2"], unrecorded=unrecorded).recorded())
    run = tables_of(recorded)
    others = recorded + random.sample(recorded, 200)
    random.shuffle(others)
    other = tables_of(others)
    assert link_summaries(other, accounts(other)) == link_summaries(run, accounts(run))
    assert warnings_of(other) == warnings_of(run)


def test_a_pose_numbered_far_ahead_of_its_schedule_is_not_counted() -> None:
    """58 s ahead, at 7 s of the run: it adds neither messages nor losses, nor a later end."""
    forged = gps("v1", 1300)
    recorded = [*MadeRun().recorded(), (at(7.0), forged)]
    expected = balanced(MadeRun().tables())
    for messages in (recorded, [row for row in recorded if not isinstance(row[1], Health)]):
        counted = balanced(tables_of(messages))
        assert {link: row.sent for link, row in counted.items()} == dict.fromkeys(expected, POSES)
        assert not any(row.missing.is_lost.any() for row in counted.values())


def test_a_link_without_arrivals_is_silent_and_has_no_latency() -> None:
    made = MadeRun()
    made.lost = {("v1", "v2", k) for k in range(POSES)}
    run = made.tables()
    counted = balanced(run)
    assert silent_links(run, counted) == f"v1 → v2 delivered none of {POSES} poses"
    rows = {(row.sender, row.receiver): row for row in link_summaries(run, counted)}
    empty = rows["v1", "v2"]
    assert empty.latency_ms_mean is empty.latency_ms_max is None
    lossy = tables_of(made.recorded(), convoy("links.loss_ratio=0.1"))
    assert silent_links(lossy, accounts(lossy)) == ""


def test_without_a_start_or_any_message_the_account_balances() -> None:
    recorded = [row for row in MadeRun().recorded() if not isinstance(row[1], RunStart)]
    assert balanced(tables_of(recorded))["v1", "v2"].is_delivered.sum() == POSES
    assert balanced(tables_of([]))["v1", "v2"].sent == 0


# ---- Virtual runs

CHANGES = """
[[change]]
kind = "crash"
at_s = 1.33
vehicle = "v2"
for_s = 1.0
[[change]]
kind = "leave"
at_s = 2.0
vehicle = "v3"
[[change]]
kind = "join"
at_s = 3.51
vehicle = "v3"
[[change]]
kind = "stall"
at_s = 2.6
vehicle = "v4"
for_s = 1.1
"""


def receivers_down(scenario: Scenario) -> set[str]:
    """Check the account of a virtual run; returns the receivers that did not run at times."""
    run, _ = run_tables(scenario)
    counted = balanced(run)
    assert all(
        account.fates.keys() <= {"receiver_down", "in_flight"} for account in counted.values()
    )
    return {link[1] for link, account in counted.items() if account.not_arrived}


@pytest.mark.parametrize("name", [*presets(), *drills()][::4])
def test_in_virtual_time_all_messages_arrive(name: str) -> None:
    if name in presets():
        overrides = ["duration_s=5", f'links.preset="{name}"']
        assert receivers_down(load_scenario("lane_change", overrides)) == set()
    else:
        receivers_down(load_scenario(name))


def test_the_account_balances_with_software_that_does_not_run() -> None:
    text = f"{STRAIGHT}{CHANGES}".replace("duration_s = 20.0", "duration_s = 5.0")
    slow = scenario_from_text(text, overrides=["links.latency_ms=120", "links.jitter_ms=80"])
    assert receivers_down(slow) == {"v2", "v3"}
