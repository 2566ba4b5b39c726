"""The account of a link: the fate of each message that was sent over it.

sent = delivered + dropped + not arrived + in flight + unrecorded. Messages without a verdict are
attributed to holes in the record, to the end of the run, or to times at which a vehicle did not run
or was out of reach. The receiver's last report lists those that had arrived at the end.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from scenarios.results.record import (
    AWAY_NS,
    LONGEST_STEP,
    LastReport,
    cut_off,
    end_of_record,
    expected_poses,
    gaps,
    is_late,
    is_physical,
    last_report,
    most_poses,
    pose_rate_hz,
    poses_of,
    ran_ns,
    scheduled,
)
from scenarios.results.tables import RunTables
from transport.columns import Columns, Integers
from vehicles.schedule import MILLISECOND, SECOND

Link = tuple[str, str]
"""Sender and receiver."""
Cause = Literal["receiver_down", "late_start", "cut_off", "router_away", "unknown"]
Fate = Cause | Literal["in_flight", "unrecorded"]
CAUSE_WORDS: dict[Fate, str] = {
    "receiver_down": "receiver did not run",
    "late_start": "late start",
    "cut_off": "cut off",
    "router_away": "router away",
    "unknown": "unknown cause",
}
"""Texts of the causes of messages that did not arrive."""
FATE_WORDS: Mapping[Fate, str] = {
    **CAUSE_WORDS,
    "in_flight": "in flight at the end",
    "unrecorded": "its fate is not in the log",
}
TRANSPORT_CAUSES: frozenset[Fate] = frozenset(CAUSE_WORDS) - {"receiver_down"}
"""Causes that lie in the real transport: such messages are lost."""
LATE_START_NS = 5 * SECOND
"""Time from the start in which messages before the first received one are due to a late start."""
MOST_LINKS = 4
"""Links named in one line."""
NEIGHBOURHOOD = 3
"""Number of messages around an instant that show whether a vehicle was away."""
TRANSIT_NS = SECOND // 10
"""Time that a message may take in addition to the link's largest delay."""
LAST_LOOK_NS = SECOND // 10
"""Time from the end of a vehicle to its last look at arrived messages, before its last report."""
LONGEST_NS = 3600 * SECOND
"""Delays beyond this are wrong time stamps."""
RESOLUTION_NS = MILLISECOND // 100
"""Resolution of delays and ages."""
FOREVER = 2**62
"""After every instant (ns)."""

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class MissingVerdict:
    """A message without a recorded verdict; `vehicle` is the one that was cut off."""

    number: int
    sent_at: int
    fate: Fate
    vehicle: str = ""

    @property
    def is_lost(self) -> bool:
        """Whether the real transport lost it."""
        return self.fate in TRANSPORT_CAUSES


@dataclass(frozen=True, slots=True)
class LinkAccount:
    """Messages of one link by their fate.

    `missing` are those without a verdict, in order. `problem` describes counts that contradict each
    other, empty if the account balances.
    """

    sent: int
    delivered: int = 0
    dropped: int = 0
    not_arrived: Mapping[str, int] = field(default_factory=dict)
    in_flight: int = 0
    unrecorded: int = 0
    missing: Sequence[MissingVerdict] = ()
    problem: str = ""

    @property
    def absent(self) -> list[MissingVerdict]:
        """Messages that the real transport lost."""
        return [message for message in self.missing if message.is_lost]


def accounts(run: RunTables) -> dict[Link, LinkAccount]:
    """Accounts of all links, by receiver and then sender from the lead on."""
    record, result = _record_of(run), dict[Link, LinkAccount]()
    for receiver in run.names:
        verdicts = verdicts_by_sender(run, receiver)
        missing = {
            link: _missing(record, link, verdicts[link[0]])
            for link in links_of(run)
            if link[1] == receiver
        }
        hidden = _unrecorded(record, receiver, missing)
        for link, messages in missing.items():
            result[link] = _account(record, link, verdicts[link[0]], messages, hidden[link])
    return result


def contradictions(counted: Mapping[Link, LinkAccount]) -> list[str]:
    """Lines on links whose messages are not accounted for."""
    return [account.problem for account in counted.values() if account.problem]


def links_of(run: RunTables) -> list[Link]:
    """Links of a run, by receiver and then sender from the lead on."""
    return [(a, b) for b in run.names for a in run.names if (a, b) in run.scenario.links]


def verdicts_by_sender(run: RunTables, receiver: str) -> dict[str, Columns]:
    """Verdicts of a receiver in the order of its decisions, by sender."""
    verdicts = run.table(receiver, "verdict")
    return {name: verdicts.of(verdicts["sender"] == name) for name in run.names}


def is_delivered(verdicts: Columns) -> Flags:
    delivered: Flags = verdicts["outcome"] == "delivered"
    return delivered


def latencies(verdicts: Columns) -> Integers:
    """Times (ns) from sending until the receiver could use each delivered message."""
    usable_at = np.where(verdicts["late"], verdicts["received_at_ns"], verdicts["visible_at_ns"])
    delays: Integers = (usable_at - verdicts["sent_at_ns"])[is_delivered(verdicts)]
    return delays


def transport_delays(verdicts: Columns) -> Integers:
    """Times (ns) of messages on the real transport, none in virtual time."""
    arrived_at, sent_at = verdicts["arrived_at_ns"], verdicts["sent_at_ns"]
    delays: Integers = (arrived_at - sent_at)[arrived_at != 0]
    return delays[np.abs(delays) < LONGEST_NS]


# ---- What the log shows of sending and receiving


class _Receiver(NamedTuple):
    """A receiver: its last decision, and the spans between two in which its software was down.

    `longest_step` is the time between two decisions of software that runs. Instants are ns.
    """

    decided_at: int | None
    down: list[tuple[int, int]]
    longest_step: int
    has_verdicts: bool
    report: LastReport | None

    @property
    def final_report(self) -> LastReport | None:
        return self.report if self.report is not None and self.report.is_final else None


class _Sender(NamedTuple):
    """A sender: its poses, and how many of those up to its newest were away.

    `away` counts, before each pose of `sent_at` (ns), those that were missing or late at the
    recorder. `due` is the count of poses by the schedule, 0 if it is unknown.
    """

    poses: Columns
    due: int
    sent_at: Integers
    away: Integers


@dataclass(frozen=True, slots=True)
class _Record:
    """Facts of a run that all of its links share."""

    run: RunTables
    cut_off: frozenset[str]
    is_physical: bool
    end_at: int
    senders: Mapping[str, _Sender]
    receivers: Mapping[str, _Receiver]


def _record_of(run: RunTables) -> _Record:
    lost = cut_off(run)
    return _Record(
        run,
        lost,
        is_physical(run),
        end_of_record(run),
        {name: _sender(run, name, name in lost) for name in run.names},
        {name: _receiver(run, name) for name in run.names},
    )


def _sender(run: RunTables, name: str, was_cut_off: bool) -> _Sender:
    """Vehicle as a sender; one that was cut off sent until the end of the run."""
    poses, rate_hz = poses_of(run, name), pose_rate_hz(run, name)
    due = scheduled(run, name, rate_hz)
    if was_cut_off and rate_hz is not None:
        due = expected_poses(ran_ns(run), rate_hz)
    numbers = poses["seq"]
    is_away = np.ones(int(numbers.max(initial=-1)) + 1, bool)
    is_away[numbers] = is_late(poses)
    sent_at = sending_instants(poses, len(is_away), 0)
    return _Sender(poses, due, sent_at, np.append(0, np.cumsum(is_away)))


def _receiver(run: RunTables, name: str) -> _Receiver:
    tracking, verdicts = run.table(name, "tracking"), run.table(name, "verdict")
    numbers, at = tracking["seq"], tracking.at_ns
    if run.start_at is not None:  # the first decision is due at the start
        numbers, at = np.append(-1, numbers), np.append(run.start_at, at)
    step = round(LONGEST_STEP * SECOND / run.scenario.control_rate_hz)
    rows = np.flatnonzero((np.diff(numbers) == 1) & (np.diff(at) > step))
    down = list(zip(at[rows].tolist(), at[rows + 1].tolist(), strict=True))
    decided_at = int(at[-1]) if len(at) else None
    return _Receiver(decided_at, down, step, len(verdicts) > 0, last_report(run, name))


def sending_instants(poses: Columns, count: int, start_at: int) -> Integers:
    """Instants (ns) of sending of the first `count` messages; interpolated where not recorded.

    Without any recorded pose they are `start_at`.
    """
    known, at = poses["seq"], poses.at_ns
    if not len(known):
        return np.full(count, start_at, np.int64)
    numbers = np.arange(count)
    since = np.interp(numbers, known, at - at[0])
    if len(known) > 1:
        period = float(np.median(np.diff(at) / np.diff(known)))
        since += period * np.maximum(numbers - known[-1], 0)
    instants: Integers = at[0] + np.round(since).astype(np.int64)
    inside = known < count
    instants[known[inside]] = at[inside]
    return instants


def _is_away(sender: _Sender, at: Integers) -> Flags:
    """Whether one of the poses of a vehicle around each instant (ns) was missing or late."""
    place, count = np.searchsorted(sender.sent_at, at), len(sender.sent_at)
    begin, end = np.maximum(place - NEIGHBOURHOOD, 0), np.minimum(place + NEIGHBOURHOOD, count)
    found: Flags = sender.away[end] > sender.away[begin]
    return found


# ---- Messages without a verdict


class _Missing(NamedTuple):
    """Messages of a link without a verdict, of `sent` in all; instants in ns.

    `due_at` is the instant of sending plus the largest delay of the link.
    """

    sent: int
    numbers: Integers
    sent_at: Integers
    due_at: Integers


def _count(record: _Record, link: Link, verdicts: Columns) -> int:
    """Count the messages sent over a link.

    Those after the sender's last recorded pose are known by its schedule or, without its final
    counters, by verdicts.
    """
    run, (name, receiver) = record.run, link
    sender, report = record.senders[name], record.receivers[name].final_report
    newest = len(sender.sent_at) - 1
    if report is None:
        judged = verdicts["pose_seq"]
        most = most_poses(run, name, run.table(receiver, "verdict"))
        newest = max(newest, int(judged[judged < most].max(initial=-1)))
    return max(sender.due, newest + 1)


def _missing(record: _Record, link: Link, verdicts: Columns) -> _Missing:
    count = _count(record, link, verdicts)
    is_missing, judged = np.ones(count, bool), verdicts["pose_seq"]
    is_missing[judged[(judged >= 0) & (judged < count)]] = False
    numbers = np.flatnonzero(is_missing)
    instants = sending_instants(record.senders[link[0]].poses, count, record.run.start_at or 0)[
        numbers
    ]
    largest = int(latencies(verdicts).max(initial=0)) + TRANSIT_NS
    return _Missing(count, numbers, instants, instants + largest)


def _unrecorded(
    record: _Record, receiver: str, missing: Mapping[Link, _Missing]
) -> dict[Link, Flags]:
    """Whether the verdict on each message is missing in the log, by the numbers of verdicts.

    Of the messages that were due while verdicts are missing, the first ones have these verdicts.
    """
    report, links = record.receivers[receiver].final_report, sorted(missing)
    expected = 0 if report is None else report.verdicts
    lengths = [len(missing[link].numbers) for link in links]
    sent_at = np.concatenate([np.zeros(0, np.int64), *(missing[link].sent_at for link in links)])
    due_at = np.concatenate([np.zeros(0, np.int64), *(missing[link].due_at for link in links)])
    hidden, order = np.zeros(len(sent_at), bool), np.argsort(sent_at, kind="stable")
    for gap in gaps(record.run.table(receiver, "verdict"), expected, end=FOREVER):
        is_due = (gap.before <= due_at) & (sent_at < gap.after) & ~hidden
        hidden[order[is_due[order]][: gap.size]] = True
    return dict(zip(links, np.split(hidden, np.cumsum(lengths))[:-1], strict=True))


def _account(
    record: _Record, link: Link, verdicts: Columns, missing: _Missing, hidden: Flags
) -> LinkAccount:
    fates, vehicles = _fates(record, link, verdicts, missing, hidden)
    causes, count = Counter[str](fates), missing.sent
    delivered = int(is_delivered(verdicts).sum())
    dropped = len(verdicts) - delivered
    not_arrived: dict[str, int] = {cause: causes[cause] for cause in CAUSE_WORDS if causes[cause]}
    accounted = delivered + dropped + len(missing.numbers)
    problem = ""
    if accounted != count or count - len(missing.numbers) != delivered + dropped:
        problem = (
            f"{link[0]} → {link[1]}: the account does not balance: {count} messages sent, "
            f"{accounted} accounted for ({delivered + dropped} verdicts on "
            f"{count - len(missing.numbers)} of them)"
        )
    rows = missing.numbers.tolist(), missing.sent_at.tolist(), fates, vehicles
    return LinkAccount(
        sent=count,
        delivered=delivered,
        dropped=dropped,
        not_arrived=not_arrived,
        in_flight=causes["in_flight"],
        unrecorded=causes["unrecorded"],
        missing=[MissingVerdict(*row) for row in zip(*rows, strict=True)],
        problem=problem,
    )


def _fates(
    record: _Record, link: Link, verdicts: Columns, missing: _Missing, hidden: Flags
) -> tuple[list[Any], list[Any]]:
    """Fate of each message without a verdict, and the vehicle that was cut off, if any.

    The first condition that holds decides.
    """
    run, (sender, receiver), due_at = record.run, link, missing.due_at
    decided_at, report = record.receivers[receiver].decided_at, record.receivers[receiver].report
    final, delays = record.receivers[receiver].final_report, transport_delays(verdicts)
    judged = verdicts["pose_seq"]
    lists_arrivals = final is not None and len(delays) > 0
    if final is not None and len(delays):
        longest = delays.max() // RESOLUTION_NS * RESOLUTION_NS
        may_arrive = missing.sent_at + longest >= final.at_ns + LAST_LOOK_NS
    else:
        may_arrive = due_at >= record.end_at - TRANSIT_NS
    begun_at = record.end_at if run.start_at is None else run.start_at
    is_before_first = missing.numbers < judged.min(initial=FOREVER if len(judged) else 0)
    causes, lost_by = _transport_causes(record, link, missing.sent_at)
    after_last = due_at >= (FOREVER if decided_at is None else decided_at)
    cases: list[tuple[Fate, str, Any]] = [
        ("in_flight", "", _waiting(report.waiting if report else "", sender, missing.numbers)),
        ("unrecorded", "", hidden),
        ("cut_off", receiver, (due_at >= (decided_at or 0)) & (receiver in record.cut_off)),
        ("receiver_down", "", _is_down(record, receiver, missing)),
        ("in_flight", "", may_arrive | (not record.is_physical)),
        ("unrecorded", "", after_last & (not lists_arrivals)),
        ("late_start", "", is_before_first & (missing.sent_at < begun_at + LATE_START_NS)),
    ]
    fates, vehicles, conditions = zip(*cases, strict=True)
    return (
        np.select(conditions, fates, causes).tolist(),
        np.select(conditions, vehicles, lost_by).tolist(),
    )


def _waiting(text: str, sender: str, numbers: Integers) -> Flags:
    """Whether messages of a sender had arrived at the end, by the receiver's last report."""
    waiting = np.zeros(len(numbers), bool)
    for row in text.split(","):
        name, *ends = row.rsplit(" ", 2)
        with suppress(ValueError):  # messages from the bus may be malformed
            first, last = map(int, ends)
            if name == sender:
                waiting |= (first <= numbers) & (numbers <= last)
    return waiting


def _is_down(record: _Record, name: str, missing: _Missing) -> Flags:
    """Whether the receiver's software did not run when a message should have arrived."""
    receiver, sent_at = record.receivers[name], missing.sent_at
    latest = missing.due_at if record.is_physical else np.full(len(sent_at), FOREVER)
    is_down = np.zeros(len(sent_at), bool)
    for begin, end in receiver.down:
        is_down |= (begin <= latest) & (sent_at < end)
    if receiver.decided_at is None:
        return is_down | (not receiver.has_verdicts)
    allowed = SECOND if record.is_physical else receiver.longest_step
    if record.end_at - receiver.decided_at > allowed:
        is_down |= receiver.decided_at <= latest
    return is_down


def _transport_causes(
    record: _Record, link: Link, sent_at: Integers
) -> tuple[NDArray[np.str_], NDArray[np.str_]]:
    """Cause of each loss by the vehicles that were away at the instant (ns) of sending."""
    away = {}
    for name, vehicle in record.senders.items():
        if len(vehicle.poses):
            is_gone = (name in record.cut_off) & (sent_at > vehicle.poses.at_ns[-1])
            away[name] = _is_away(vehicle, sent_at) | is_gone
    nobody = np.zeros(len(sent_at), bool)
    all_away = np.all([nobody, *away.values()][1:], axis=0) if len(away) > 1 else nobody
    away |= {name: ~nobody for name in record.cut_off if not len(record.senders[name].poses)}
    sender, receiver = (away.get(name, nobody) for name in link)
    conditions = [all_away, receiver, sender]
    causes = np.select(conditions, ["router_away", "cut_off", "cut_off"], "unknown")
    return causes, np.select(conditions, ["", link[1], link[0]], "")


# ---- Lines about messages that the real transport lost


def absence_lines(run: RunTables, counted: Mapping[Link, LinkAccount]) -> Iterator[str]:
    """Yield a line per cause and vehicle for messages that the real transport lost."""
    lost: dict[tuple[Fate, str], list[tuple[Link, int]]] = {}
    for link, account in counted.items():
        for message in account.absent:
            lost.setdefault((message.fate, message.vehicle), []).append((link, message.sent_at))
    for (fate, vehicle), messages in lost.items():
        links = [f"{a} → {b}" for a, b in dict.fromkeys(link for link, _ in messages)]
        over = ", ".join(links[:MOST_LINKS]) + (", …" if len(links) > MOST_LINKS else "")
        begin, end = (run.seconds(pick(at for _, at in messages)) for pick in (min, max))
        words = f"{vehicle} {FATE_WORDS[fate]}" if vehicle else FATE_WORDS[fate]
        count = "1 message" if len(messages) == 1 else f"{len(messages)} messages"
        yield f"{count} did not arrive over {over}, sent {begin:.2f} to {end:.2f} s: {words}"


def away_lines(run: RunTables) -> Iterator[str]:
    """Yield a line per vehicle whose poses reached the recorder very late."""
    late = {}
    for name in run.names:
        poses = poses_of(run, name)
        at = poses.at_ns[is_late(poses)]
        if len(at):
            late[name] = int(at[0]), int(at[-1])
    if len(late) == len(run.names) > 1:
        begins, ends = zip(*late.values(), strict=True)
        late = {"every vehicle": (min(begins), max(ends))}
    for name, (begin, end) in late.items():
        yield (
            f"{name} was out of reach for a while: poses of {run.seconds(begin):.2f} to "
            f"{run.seconds(end):.2f} s reached the recorder more than {AWAY_NS / SECOND:g} s late"
        )
