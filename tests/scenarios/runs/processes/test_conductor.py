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


# ---- Gathering and starting


def test_a_run_starts_when_all_are_present_with_time_to_prepare() -> None:
    outcome = play(*ALL_COME, until=5.0)
    assert outcome.conductor.phase is Phase.RUNNING
    assert outcome.started == pytest.approx(STARTED)
    assert outcome.lines == ["all 3 vehicles are present"]
    assert outcome.conductor.end_at - outcome.conductor.start_at == DURATION_S * SECOND


def test_a_vehicle_that_does_not_come_in_time_is_named() -> None:
    outcome = play(ALL_COME[0], ALL_COME[2])
    assert outcome.started is None
    assert outcome.reason == "not present in time: v2"
    assert outcome.over == pytest.approx(GATHER_S, abs=0.11)


def test_missing_vehicles_are_reported_after_a_while_and_on_change() -> None:
    outcome = play((1.0, "v1 comes"), (5.0, "v2 comes"), (8.0, "v3 comes"), until=9.0)
    assert outcome.lines == ["waiting for v2, v3", "waiting for v3", "all 3 vehicles are present"]


# ---- Ending as planned


def test_a_run_is_over_when_all_have_finished() -> None:
    outcome = play(*ALL_COME, *ALL_FINISH)
    assert outcome.over == pytest.approx(ENDED + 0.1, abs=0.06)
    assert outcome.reason == ""
    assert not outcome.conductor.awaits_final_counters()


def test_a_vehicle_without_final_counters_is_reported() -> None:
    outcome = play(*ALL_COME, ALL_FINISH[0], ALL_FINISH[2])
    assert outcome.reason == "no final counters from v2"
    assert outcome.over == pytest.approx(ENDED + 0.1 + FINAL_COUNTERS_NS / SECOND, abs=0.11)


@pytest.mark.parametrize(("frozen_s", "reason"), [(11.0, ""), (13.0, "no final counters from ")])
def test_a_router_that_does_not_respond_at_the_end_is_awaited(frozen_s: float, reason: str) -> None:
    late = [(ENDED + frozen_s + k / 10, f"{name} ends") for k, name in enumerate(CONVOY)]
    assert play(*ALL_COME, *late).reason == reason + ", ".join(CONVOY) * bool(reason)


def test_a_vehicle_that_leaves_early_ends_the_run() -> None:
    leave = [(10.0, "v3 finishes"), (10.0, "v2 finishes"), (10.4, "v3 goes"), (10.5, "v2 goes")]
    outcome = play(*ALL_COME, *leave)
    assert outcome.over == pytest.approx(10.4 + LEFT_S, abs=0.1)
    assert outcome.reason == "left before the end: v2, v3"
    assert outcome.conductor.awaits_final_counters()  # of v1


def test_the_convoy_continues_without_leavers_if_requested() -> None:
    outcome = play(*ALL_COME, (STARTED + 7.0, "v2 finishes"), (STARTED + 7.1, "v2 goes"),
                ALL_FINISH[0], ALL_FINISH[2], continues=True)  # fmt: skip
    assert outcome.lines[1:] == ["v2 left 7.0 s after the start; the convoy continues without it"]
    assert outcome.reason == ""
    assert outcome.over == pytest.approx(ENDED + 0.1, abs=0.06)


@pytest.mark.parametrize(
    ("last", "after_s"), [("goes", FAILED_S), ("finishes", FINAL_COUNTERS_NS / SECOND)]
)
def test_a_convoy_whose_vehicles_all_left_or_failed_ends(last: str, after_s: float) -> None:
    history = [(10.0, "v1 finishes"), (12.0, "v2 finishes"), (14.0, f"v3 {last}")]
    history += [(10.2, "v1 goes"), (12.2, "v2 goes")]
    outcome = play(*ALL_COME, *history, continues=True)
    assert outcome.reason == "all vehicles failed or left"
    assert outcome.over == pytest.approx(14.0 + after_s, abs=0.11)


# ---- Dying


def test_a_vehicle_that_fails_ends_the_run() -> None:
    outcome = play(*ALL_COME, (STARTED + 7.0, "v2 goes"))
    assert outcome.reason == "v2 failed 7.0 s after the start"
    assert outcome.over == pytest.approx(STARTED + 7.0 + FAILED_S, abs=0.06)
    assert outcome.conductor.awaits_final_counters()


def test_the_convoy_continues_without_failed_vehicles_if_requested() -> None:
    outcome = play(
        *ALL_COME, (STARTED + 7.0, "v2 goes"), ALL_FINISH[0], ALL_FINISH[2], continues=True
    )
    assert outcome.lines[1:] == ["v2 failed 7.0 s after the start; the convoy continues without it"]
    assert outcome.reason == ""
    assert outcome.over == pytest.approx(ENDED + 0.1, abs=0.06)


# ---- Losing the router: everyone seems to vanish


def vanish(seconds: float) -> list[Event]:
    return [(seconds, f"{name} goes") for name in CONVOY]


def reappear(seconds: float) -> list[Event]:
    return [(seconds, f"{name} comes") for name in CONVOY]


@pytest.mark.parametrize("noticed_after", [-0.1, 0.0, 0.3])
@pytest.mark.parametrize("continues", [True, False])
def test_no_vehicle_has_failed_after_a_short_router_outage(
    noticed_after: float, *, continues: bool
) -> None:
    outcome = play(
        *ALL_COME,
        *vanish(6.0),
        (6.0 + noticed_after, "router vanishes"),
        (9.0, "router returns"),
        *reappear(9.2),
        *ALL_FINISH,
        continues=continues,
    )
    assert outcome.reason == ""
    assert outcome.lines[1:] == [f"the router was out of reach for {3.0 - noticed_after:.1f} s"]
    assert outcome.over == pytest.approx(ENDED + 0.1, abs=0.06)


def test_a_vehicle_that_does_not_return_after_an_outage_has_failed() -> None:
    outcome = play(
        *ALL_COME,
        *vanish(6.0),
        (6.0, "router vanishes"),
        (9.0, "router returns"),
        (9.2, "v1 comes"),
        (9.2, "v3 comes"),
    )
    assert outcome.reason == f"v2 failed {9.0 + RETURN_S - STARTED:.1f} s after the start"
    assert outcome.over == pytest.approx(9.0 + RETURN_S + FAILED_S, abs=0.06)


def test_a_router_that_stays_away_ends_the_run() -> None:
    outcome = play(*ALL_COME, *vanish(6.0), (6.0, "router vanishes"))
    assert outcome.reason == f"the router was lost {ENDED - 6.0:.1f} s before the end"
    assert outcome.over == pytest.approx(6.0 + ROUTER_LOST_AFTER_NS / SECOND, abs=0.11)


@pytest.mark.parametrize(
    ("lost_s", "when"),
    [
        (ENDED - 0.5, "0.5 s before the end"),
        (ENDED + 0.1, "0.1 s after the end"),
    ],
)
def test_a_router_lost_before_the_final_counters_fails_the_run(lost_s: float, when: str) -> None:
    outcome = play(*ALL_COME, *vanish(lost_s), (lost_s, "router vanishes"))
    assert outcome.reason == f"the router was lost {when}"
    assert outcome.over == pytest.approx(lost_s + ROUTER_LOST_AFTER_NS / SECOND, abs=0.11)


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


def test_a_vehicle_that_left_again_is_waited_for() -> None:
    outcome = play(
        (0.5, "v1 comes"), (1.0, "v1 goes"), (1.1, "v2 comes"), (1.2, "v3 comes"), until=9
    )
    assert outcome.conductor.phase is Phase.GATHERING
    assert outcome.conductor.missing() == ["v1"]
    again = play((0.5, "v1 comes"), (0.7, "v1 goes"), *ALL_COME, until=5.0)
    assert again.started == pytest.approx(STARTED)


def test_strangers_count_for_nothing() -> None:
    outcome = play(
        (0.5, "v9 comes"), *ALL_COME, (5.0, "v9 goes"), (6.0, "v9 finishes"), *ALL_FINISH
    )
    assert outcome.reason == ""
    assert outcome.lines == ["all 3 vehicles are present"]


def test_only_the_last_word_of_health_finishes_a_vehicle() -> None:
    outcome = play(*ALL_COME, until=5.0)
    for name in CONVOY:
        outcome.conductor.listen(at(5.0), health(name, seconds=30.0))
        outcome.conductor.listen(at(5.0), tracking(name, 0))
    assert outcome.conductor.advance(at(5.0), connected=True) == []
    assert outcome.conductor.phase is Phase.RUNNING
    assert outcome.conductor.awaits_final_counters()


def test_a_convoy_without_remaining_vehicles_ends() -> None:
    failures = [(STARTED + 3.0 + k, f"{name} goes") for k, name in enumerate(CONVOY)]
    outcome = play(*ALL_COME, *failures, continues=True)
    assert len(outcome.lines) == 1 + 3
    assert outcome.reason == "all vehicles failed"
    assert outcome.over == pytest.approx(STARTED + 5.0 + FAILED_S, abs=0.06)


def test_the_first_reason_to_stop_stays() -> None:
    outcome = play(*ALL_COME, until=5.0)
    outcome.conductor.stop("stopped by SIGINT")
    outcome.conductor.stop("something else")
    assert outcome.conductor.phase is Phase.OVER
    assert outcome.reason == "stopped by SIGINT"
    assert outcome.conductor.advance(at(60.0), connected=False) == []
    assert outcome.reason == "stopped by SIGINT"


def test_a_router_that_is_away_at_the_end_is_waited_for_and_then_the_final_counters() -> None:
    back = ENDED + 4.5
    outcome = play(
        *ALL_COME,
        *vanish(ENDED - 2.0 + 2.5),
        (ENDED - 0.2, "router vanishes"),
        (back, "router returns"),
        *reappear(back + 0.6),
        *[(back + FINAL_COUNTERS_NS / SECOND - 0.2, f"{name} ends") for name in CONVOY],
    )
    assert outcome.reason == ""
    assert outcome.over == pytest.approx(back + FINAL_COUNTERS_NS / SECOND - 0.2, abs=0.06)


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


def test_a_token_that_is_soon_back_is_no_death() -> None:
    blink = [(5.0, "v2 goes"), (5.0 + 0.8 * FAILED_S, "v2 comes")]
    outcome = play(*ALL_COME, *blink, *ALL_FINISH)
    assert outcome.reason == ""
    assert outcome.lines == ["all 3 vehicles are present"]


def test_a_vehicle_that_leaves_before_the_start_is_reported() -> None:
    outcome = play(*ALL_COME, (STARTED - 0.3, "v3 finishes"), continues=True)
    assert outcome.lines[1:] == ["v3 left before the start; the convoy continues without it"]
