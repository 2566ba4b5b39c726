"""Protocol bugs to plant, by name: the simulation has to find each of them."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace

import pytest

from scenarios.definition.changes import describe_change
from scenarios.results import limits, link_account, log_summary
from scenarios.runs.live_control import Confirmation, LiveControl, first_instant
from scenarios.runs.node.outbox import DueChange, PendingChanges
from scenarios.runs.processes import vehicle_process
from scenarios.runs.processes.arrivals import SendingOrder
from scenarios.runs.processes.conductor import Conductor
from scenarios.runs.processes.membership import ClockSync, Fingerprint, RecorderWatch, RouterWatch
from scenarios.runs.processes.recorder_process import RecorderProcess
from scenarios.runs.processes.vehicle_process import RunAnnouncements
from transport.codec import MessageNumbers, RefusedMessageError, decode, encode
from transport.log.writer import LogWriter
from transport.topics import TOPICS
from vehicles.messages import RunEnd
from vehicles.schedule import SECOND

Plant = Callable[[pytest.MonkeyPatch], None]
NEVER_NS = 10**9 * SECOND


def limits_pass_over_holes(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(limits, "judged_by_record", lambda figures, *_: tuple(figures))


def other_seeds_join(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Fingerprint, "difference", lambda *_: "")


def clocks_are_not_corrected(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(ClockSync, "_correct", lambda *_: None)


def missing_messages_are_not_counted(patch: pytest.MonkeyPatch) -> None:
    nothing = link_account.NOTHING
    patch.setattr(link_account, "_with_fates", lambda _, own, __: replace(own, missing=nothing))
    patch.setattr(log_summary, "contradictions", lambda _: ())  # else the run fails


def ends_of_other_runs_are_accepted(patch: pytest.MonkeyPatch) -> None:
    receive = RunAnnouncements._receive

    def receive_as_own(announced: RunAnnouncements, key_expression: str, data: bytes) -> None:
        with suppress(RefusedMessageError):
            end = decode(TOPICS["end"], data, exact=True)
            assert isinstance(end, RunEnd)
            data = encode(replace(end, run_id=announced._membership.run_id))
        receive(announced, key_expression, data)

    patch.setattr(RunAnnouncements, "_receive", receive_as_own)


def a_recorder_that_was_held_up_blames_vehicles(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Conductor, "_await_return", lambda *_: None)


def changes_take_effect_when_they_are_confirmed(patch: pytest.MonkeyPatch) -> None:
    def confirmed(
        control: LiveControl, at: int, _from_s: float, pending: PendingChanges, **_: bool
    ) -> Confirmation:
        assert control._under_way is not None
        start_at = control._under_way[0]
        change = control._promised.pop(at, None)
        if change is None:
            return Confirmation(control._vehicle)
        at = first_instant(control._now(), start_at, control._scenario.control_rate_hz)
        pending.add(DueChange(at, change, by_hand=True))
        return Confirmation(control._vehicle, _from_s, describe_change(change))

    patch.setattr(LiveControl, "_confirmed", confirmed)


def duplicates_are_recorded(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(MessageNumbers, "__contains__", lambda *_: False)


def the_last_messages_are_dropped(patch: pytest.MonkeyPatch) -> None:
    release = SendingOrder.until
    patch.setattr(
        SendingOrder,
        "until",
        lambda order, instant=None: [] if instant is None else release(order, instant),
    )


def a_full_disk_is_ignored(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(LogWriter, "_give_up", lambda *_: None)


def a_vehicle_waits_for_a_lost_recorder(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(RecorderWatch, "has_left", lambda *_: False)
    patch.setattr(vehicle_process, "END_NS", NEVER_NS)


def nobody_gives_up_a_lost_router(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(RouterWatch, "is_lost_for_good", lambda *_: False)


def final_counters_are_not_awaited(patch: pytest.MonkeyPatch) -> None:
    patch.setattr(Conductor, "_awaited", lambda _: set())


def the_end_is_announced_once(patch: pytest.MonkeyPatch) -> None:
    announce, announced = RecorderProcess._announce_end, set[RecorderProcess]()

    def announce_once(recorder: RecorderProcess) -> None:
        if recorder not in announced:
            announced.add(recorder)
            announce(recorder)

    patch.setattr(RecorderProcess, "_announce_end", announce_once)


PLANTED: Mapping[str, Plant] = {
    plant.__name__: plant
    for plant in (
        limits_pass_over_holes,
        other_seeds_join,
        clocks_are_not_corrected,
        missing_messages_are_not_counted,
        ends_of_other_runs_are_accepted,
        a_recorder_that_was_held_up_blames_vehicles,
        changes_take_effect_when_they_are_confirmed,
        duplicates_are_recorded,
        the_last_messages_are_dropped,
        a_full_disk_is_ignored,
        a_vehicle_waits_for_a_lost_recorder,
        nobody_gives_up_a_lost_router,
        final_counters_are_not_awaited,
        the_end_is_announced_once,
    )
}
