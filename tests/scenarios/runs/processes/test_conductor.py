"""The conductor against histories of joining and leaving: its lines, reason and end."""

from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenarios.definition.schema.change_tables import CrashTable
from scenarios.runs.processes.conductor import (
    FAILED_AFTER_NS,
    FINAL_COUNTERS_NS,
    LEAD_TIME_NS,
    LEFT_AFTER_NS,
    RETURN_NS,
    Conductor,
    Phase,
)
from scenarios.runs.processes.membership import ROUTER_LOST_AFTER_NS
from tests.made.examples import examples
from tests.made.scenarios.messages import START, at, health, tracking
from vehicles.messages import Change
from vehicles.schedule import SECOND

PERIOD_NS = SECOND // 20
DURATION_S = 20.0
GATHER_S = 10.0
LEAD_TIME_S = LEAD_TIME_NS / SECOND
RETURN_S = RETURN_NS / SECOND
FAILED_S = FAILED_AFTER_NS / SECOND
LEFT_S = LEFT_AFTER_NS / SECOND
CONVOY = ("v1", "v2", "v3")
ALL_COME = [(1.0, "v1 comes"), (1.2, "v2 comes"), (2.0, "v3 comes")]
STARTED = 2.0 + LEAD_TIME_S
ENDED = STARTED + DURATION_S
ALL_FINISH = [(ENDED + 0.1, f"{name} finishes") for name in CONVOY]
Event = tuple[float, str]


@dataclass
class Told:
    """What became of a run: instants in s after the conductor began to gather."""

    conductor: Conductor
    started: float | None = None
    over: float | None = None
    lines: list[str] = field(default_factory=list)

    @property
    def reason(self) -> str:
        return self.conductor.reason


def play(*history: Event, continues: bool = False, until: float = 40.0) -> Told:
    """Advance a conductor every 50 ms through `history`."""
    conductor = Conductor(
        CONVOY,
        duration_ns=round(DURATION_S * SECOND),
        continues_without_failed=continues,
        gather_until=at(GATHER_S),
    )
    outcome = Told(conductor)
    waiting, connected = sorted(history), True
    for now in range(START, at(until), PERIOD_NS):
        while waiting and at(waiting[0][0]) <= now:
            when, event = waiting.pop(0)
            name, what = event.split()
            if what in {"comes", "goes"}:
                conductor.note_presence(name, alive=what == "comes", at=at(when))
            elif what == "finishes":
                conductor.listen(now, health(name, seconds=when, final=True))
            elif what == "ends":  # as planned, by its own word
                conductor.listen(now, health(name, seconds=ENDED, final=True))
            else:
                connected = what == "returns"
        outcome.lines += conductor.advance(now, connected=connected)
        if conductor.phase is Phase.RUNNING and outcome.started is None:
            outcome.started = (conductor.start_at - START) / SECOND
        if conductor.phase is Phase.OVER and outcome.over is None:
            outcome.over = (now - START) / SECOND
    return outcome


# ---- Histories and what becomes of them

PRESENT = "all 3 vehicles are present"
COUNTED_S = FINAL_COUNTERS_NS / SECOND
LOST_S = ROUTER_LOST_AFTER_NS / SECOND


def all_of(what: str, seconds: float) -> list[Event]:
    return [(seconds, f"{name} {what}") for name in CONVOY]


def outage(noticed_after: float) -> list[Event]:
    """The router is away from 6 to 9 s: everyone seems to vanish."""
    router = [(6.0 + noticed_after, "router vanishes"), (9.0, "router returns")]
    return [*all_of("goes", 6.0), *router, *all_of("comes", 9.2), *ALL_FINISH]


def lost(seconds: float) -> list[Event]:
    return [*all_of("goes", seconds), (seconds, "router vanishes")]


BACK = ENDED + 4.5
FROZEN = [(ENDED + 11.0 + k / 10, f"{name} ends") for k, name in enumerate(CONVOY)]
LEFT = "v2 left 7.0 s after the start; the convoy continues without it"
FAILED = "v2 failed 7.0 s after the start; the convoy continues without it"
TWO_FINISH = [ALL_FINISH[0], ALL_FINISH[2]]


@dataclass(frozen=True)
class History:
    """Events, and what must become of the run: reason, lines after the first, end (s)."""

    events: list[Event]
    reason: str = ""
    over: float = ENDED + 0.1
    lines: tuple[str, ...] | None = ()
    continues: bool = False


HISTORIES = {
    "all finish": History([*ALL_COME, *ALL_FINISH]),
    "one comes late": History([*ALL_COME[:2]], "not present in time: v3", GATHER_S, None),
    "no final counters": History(
        [*ALL_COME, *TWO_FINISH], "no final counters from v2", ENDED + 0.1 + COUNTED_S
    ),
    "a frozen router at the end": History([*ALL_COME, *FROZEN], "", ENDED + 11.2),
    "two leave early": History(
        [*ALL_COME, (10.0, "v3 finishes"), (10.0, "v2 finishes"), (10.4, "v3 goes"),
         (10.5, "v2 goes")],
        "left before the end: v2, v3",
        10.4 + LEFT_S,
        None,
    ),
    "one leaves": History(
        [*ALL_COME, (STARTED + 7.0, "v2 finishes"), (STARTED + 7.1, "v2 goes"), *TWO_FINISH],
        lines=(LEFT,),
        continues=True,
    ),
    "one leaves before the start": History(
        [*ALL_COME, (STARTED - 0.3, "v3 finishes"), *ALL_FINISH[:2]],
        lines=("v3 left before the start; the convoy continues without it",),
        continues=True,
    ),
    "one fails": History(
        [*ALL_COME, (STARTED + 7.0, "v2 goes")],
        "v2 failed 7.0 s after the start",
        STARTED + 7.0 + FAILED_S,
    ),
    "the others go on": History(
        [*ALL_COME, (STARTED + 7.0, "v2 goes"), *TWO_FINISH], lines=(FAILED,), continues=True
    ),
    "all fail": History(
        [*ALL_COME, *((STARTED + 3.0 + k, f"{name} goes") for k, name in enumerate(CONVOY))],
        "all vehicles failed",
        STARTED + 5.0 + FAILED_S,
        None,
        continues=True,
    ),
    "all fail or leave": History(
        [*ALL_COME, (10.0, "v1 finishes"), (12.0, "v2 finishes"), (14.0, "v3 goes"),
         (10.2, "v1 goes"), (12.2, "v2 goes")],
        "all vehicles failed or left",
        14.0 + FAILED_S,
        None,
        continues=True,
    ),
    "a token is soon back": History(
        [*ALL_COME, (5.0, "v2 goes"), (5.0 + 0.8 * FAILED_S, "v2 comes"), *ALL_FINISH]
    ),
    "strangers": History(
        [*ALL_COME, (0.5, "v9 comes"), (5.0, "v9 goes"), (6.0, "v9 finishes"), *ALL_FINISH]
    ),
    "a router outage": History(
        [*ALL_COME, *outage(0.0)], lines=("the router was out of reach for 3.0 s",)
    ),
    "a router outage noticed first": History(
        [*ALL_COME, *outage(-0.1)], lines=("the router was out of reach for 3.1 s",)
    ),
    "a router outage noticed later": History(
        [*ALL_COME, *outage(0.3)],
        lines=("the router was out of reach for 2.7 s",),
        continues=True,
    ),
    "one does not return": History(
        [*ALL_COME, *all_of("goes", 6.0), (6.0, "router vanishes"), (9.0, "router returns"),
         (9.2, "v1 comes"), (9.2, "v3 comes")],
        f"v2 failed {9.0 + RETURN_S - STARTED:.1f} s after the start",
        9.0 + RETURN_S + FAILED_S,
        None,
    ),
    "a router that stays away": History(
        [*ALL_COME, *lost(6.0)],
        f"the router was lost {ENDED - 6.0:.1f} s before the end",
        6.0 + LOST_S,
        None,
    ),
    "a router lost after the end": History(
        [*ALL_COME, *lost(ENDED + 0.1)],
        "the router was lost 0.1 s after the end",
        ENDED + 0.1 + LOST_S,
        None,
    ),
    "a router away at the end": History(
        [*ALL_COME, *all_of("goes", ENDED + 0.5), (ENDED - 0.2, "router vanishes"),
         (BACK, "router returns"), *all_of("comes", BACK + 0.6),
         *all_of("ends", BACK + COUNTED_S - 0.2)],
        "",
        BACK + COUNTED_S - 0.2,
        None,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HISTORIES)
def test_a_history_has_its_lines_reason_and_end(name: str) -> None:
    row = HISTORIES[name]
    outcome = play(*row.events, continues=row.continues)
    assert outcome.reason == row.reason
    assert outcome.over == pytest.approx(row.over, abs=0.11)
    if row.lines is not None:
        assert outcome.lines == [PRESENT, *row.lines]
        assert outcome.started == pytest.approx(STARTED)


def test_missing_vehicles_are_reported_after_a_while_and_on_change() -> None:
    again = (0.5, "v1 comes"), (0.6, "v1 goes")
    outcome = play(*again, (1.0, "v1 comes"), (5.0, "v2 comes"), (8.0, "v3 comes"), until=9.0)
    assert outcome.lines == ["waiting for v2, v3", "waiting for v3", PRESENT]


# ---- A recorder that was late


def test_a_recorder_that_caught_up_judges_like_one_that_was_never_late() -> None:
    outcome = play(*ALL_COME, until=STARTED + 7.0)
    gone, failed = at(STARTED + 7.0), at(STARTED + 7.0 + FAILED_S)
    outcome.conductor.note_presence("v2", alive=False, at=gone)
    for now in (7.5, 8.0, 8.5, 9.0):
        outcome.conductor.advance(
            at(STARTED + now), connected=True, recorded_until=failed - PERIOD_NS
        )
    assert outcome.conductor.phase is Phase.RUNNING
    outcome.conductor.advance(at(STARTED + 9.1), connected=True, recorded_until=failed)
    assert outcome.reason == "v2 failed 7.0 s after the start"


def test_a_recorder_that_was_suspended_waits_for_the_vehicles_to_return() -> None:
    """Its own session has expired: it sees no vehicle at first."""
    outcome = play(*ALL_COME, until=STARTED + 5.0)
    resumed = STARTED + 17.0
    for name in CONVOY:
        outcome.conductor.note_presence(name, alive=False, at=at(resumed - 1.0))
    lines = outcome.conductor.advance(at(resumed), connected=True)
    outcome.conductor.advance(at(resumed + 0.9), connected=True)
    assert outcome.conductor.phase is Phase.RUNNING
    for name in ("v1", "v3"):
        outcome.conductor.note_presence(name, alive=True, at=at(resumed + 0.9))
    for seconds in (1.5, 2.0):
        outcome.conductor.advance(at(resumed + seconds), connected=True)
    assert any("the recorder was held up for 12" in line for line in lines)
    assert "v2" in outcome.reason


@pytest.mark.parametrize("silent_s", [0.5, 10.0])
def test_a_cut_off_vehicle_is_told_from_a_failed_one_and_its_return_reported(
    silent_s: float,
) -> None:
    """The token of a vehicle that was cut off disappears with the lease of its session."""
    gone, back = STARTED + 15.0, STARTED + 17.0
    outcome = play(*ALL_COME, continues=True, until=gone - silent_s)
    conductor, lines = outcome.conductor, list[str]()
    for now in range(at(gone - silent_s), at(back + 1.0), PERIOD_NS):
        if now == at(gone - silent_s) or now >= at(back):
            conductor.listen(now, health("v2", seconds=(now - START) / SECOND))
        if now in {at(gone), at(back)}:
            conductor.note_presence("v2", alive=now == at(back), at=now)
        lines += conductor.advance(now, connected=True)
    lost, returned = lines
    assert ("cut off" in lost) == (silent_s > 1.0)
    assert f"{15.0 - (silent_s if silent_s > 1.0 else 0.0):.1f} s after the start" in lost
    assert float(returned.removeprefix("v2 is back after ").removesuffix(" s")) == pytest.approx(
        back - gone + silent_s, abs=0.11
    )
    for name in ("v1", "v3"):
        conductor.listen(at(ENDED), health(name, seconds=ENDED, final=True))
    conductor.advance(at(ENDED), connected=True)
    assert conductor.phase is Phase.RUNNING  # v2 counts again
    conductor.listen(at(ENDED), health("v2", seconds=ENDED, final=True))
    conductor.advance(at(ENDED), connected=True)
    assert conductor.reason == ""


# ---- Stopping


names = st.sampled_from(CONVOY)
anything = st.builds(
    lambda seconds, name, what: (round(seconds, 2), f"{name} {what}"),
    st.floats(0.0, 30.0),
    names,
    st.sampled_from(["comes", "goes", "finishes", "ends"]),
) | st.builds(
    lambda seconds, what: (round(seconds, 2), f"router {what}"),
    st.floats(0.0, 30.0),
    st.sampled_from(["vanishes", "returns"]),
)


@given(history=st.lists(anything, max_size=12), continues=st.booleans())
@examples(10, 60)
def test_every_run_ends(history: list[Event], *, continues: bool) -> None:
    longest = GATHER_S + LEAD_TIME_S + DURATION_S
    patience = (FINAL_COUNTERS_NS + ROUTER_LOST_AFTER_NS) / SECOND + 1.0
    outcome = play(*history, continues=continues, until=longest + patience)
    assert outcome.over is not None
    assert outcome.over <= longest + patience
    if outcome.reason == "":  # as planned: all who live have finished, and not all of them early
        finished = {event.split()[0] for _, event in history if event.endswith(("ends", "shes"))}
        failed = {line.split()[0] for line in outcome.lines if " failed " in line}
        assert finished | failed >= set(CONVOY)
        assert continues or not any(" left " in line for line in outcome.lines)


# ---- Requested crashes


def crash(vehicle: str, seconds: float, for_s: float | None, table: str = "") -> Change:
    change = CrashTable(kind="crash", vehicle=vehicle, at_s=1.0, for_s=for_s)
    return Change(
        vehicle=vehicle,
        seq=0,
        effective_at_ns=at(seconds),
        kind="crash",
        by_hand=False,
        table=table or change.model_dump_json(exclude_none=True),
    )


@pytest.mark.parametrize(
    ("reported", "back_s", "reason"),
    [
        (crash("v2", 6.0, 3.0), 9.5, ""),
        (crash("v2", 6.0, 3.0), None, "v2 failed"),
        (crash("v2", 6.0, None), 9.5, "v2 failed"),
        (crash("v3", 6.0, 3.0), 9.5, "v2 failed"),
        (crash("v2", 6.0, 3.0, table="nonsense"), 9.5, "v2 failed"),
    ],
    ids=["is back", "stays away", "for good", "another one", "nonsense"],
)
def test_a_vehicle_that_restarts_on_request_is_awaited(
    reported: Change, back_s: float | None, reason: str
) -> None:
    conductor = play(*ALL_COME, until=6.0).conductor
    conductor.listen(at(6.0), reported)
    conductor.note_presence("v2", alive=False, at=at(6.1))
    for now in range(at(6.0), at(20.0), PERIOD_NS):
        if back_s is not None and now == at(back_s):
            conductor.note_presence("v2", alive=True, at=now)
        conductor.advance(now, connected=True)
    assert conductor.reason.startswith(reason)
    assert (conductor.phase is Phase.OVER) == bool(reason)


def test_only_the_last_word_of_health_finishes_a_vehicle() -> None:
    outcome = play(*ALL_COME, until=5.0)
    for name in CONVOY:
        outcome.conductor.listen(at(5.0), health(name, seconds=30.0))
        outcome.conductor.listen(at(5.0), tracking(name, 0))
    assert outcome.conductor.advance(at(5.0), connected=True) == []
    assert outcome.conductor.phase is Phase.RUNNING
    assert outcome.conductor.awaits_final_counters()


def test_the_first_reason_to_stop_stays() -> None:
    outcome = play(*ALL_COME, until=5.0)
    outcome.conductor.stop("stopped by SIGINT")
    outcome.conductor.stop("something else")
    assert outcome.conductor.phase is Phase.OVER
    assert outcome.reason == "stopped by SIGINT"
    assert outcome.conductor.advance(at(60.0), connected=False) == []
    assert outcome.reason == "stopped by SIGINT"


def test_a_recorder_held_up_at_the_end_reads_the_messages_of_that_time() -> None:
    outcome = play(*ALL_COME, until=ENDED - 1.0)
    resumed = ENDED + FINAL_COUNTERS_NS / SECOND + 1.0
    outcome.conductor.advance(at(resumed), connected=True)
    assert outcome.conductor.phase is not Phase.OVER
    for name in CONVOY:
        outcome.conductor.listen(at(resumed), health(name, seconds=ENDED, final=True))
    outcome.conductor.advance(at(resumed + 0.05), connected=True)
    assert outcome.conductor.awaits_final_counters() is False
    assert outcome.reason == ""


def test_the_start_waits_for_slow_announcements_and_missing_vehicles_have_reasons() -> None:
    conductor = Conductor(
        ("v1", "v2"),
        duration_ns=SECOND,
        continues_without_failed=False,
        gather_until=at(GATHER_S),
    )
    conductor.note_presence("v1", alive=True, at=at(0.0))
    conductor.excluded = {"v2": "runs other sources"}
    assert conductor.advance(at(0.0), connected=True) == []
    assert conductor.advance(at(5.0), connected=True) == ["waiting for v2 (runs other sources)"]
    conductor.delivery_ns = 2 * SECOND
    conductor.note_presence("v2", alive=True, at=at(6.0))
    conductor.advance(at(6.0), connected=True)
    assert conductor.start_at == at(6.0) + LEAD_TIME_NS + 2 * SECOND
