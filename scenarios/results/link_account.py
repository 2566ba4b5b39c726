"""The account of a link: the fate of each message that was sent over it.

sent = delivered + dropped + not arrived + in flight + unrecorded. Messages without a verdict are
attributed to holes in the record, to the end of the run, or to times at which a vehicle did not run
or was out of reach. The receiver's last report lists those that had arrived at the end.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np

from scenarios.results.record import (
    AWAY_NS,
    FOREVER,
    LONGEST_STEP,
    cut_off,
    end_of_record,
    final_health,
    gaps,
    is_late,
    is_physical,
    pose_rate_hz,
    poses_of,
    possible,
    scheduled,
)
from scenarios.results.tables import RunTables, once
from transport.columns import Columns, Flags, Integers
from vehicles.messages import Health
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


@dataclass(frozen=True)
class LinkAccount:
    """Messages of one link by their fate.

    `verdicts` are in the order of the receiver's decisions, `missing` are the messages without a
    verdict, in order of their numbers.
    """

    link: Link
    sent: int
    verdicts: Columns
    missing: Sequence[MissingVerdict] = ()

    @cached_property
    def is_delivered(self) -> Flags:
        """Whether each verdict is on a delivered message."""
        delivered: Flags = self.verdicts["outcome"] == "delivered"
        return delivered

    @property
    def delivered(self) -> int:
        return int(self.is_delivered.sum())

    @cached_property
    def fates(self) -> Mapping[Fate, int]:
        """Number of messages without a verdict by their fate."""
        return Counter(message.fate for message in self.missing)

    @property
    def not_arrived(self) -> dict[str, int]:
        return {cause: self.fates[cause] for cause in CAUSE_WORDS if cause in self.fates}

    @property
    def absent(self) -> list[MissingVerdict]:
        """Messages that the real transport lost."""
        return [message for message in self.missing if message.is_lost]

    @cached_property
    def latencies(self) -> Integers:
        """Times (ns) from sending until the receiver could use each delivered message."""
        rows = self.verdicts
        usable_at = np.where(rows["late"], rows["received_at_ns"], rows["visible_at_ns"])
        delays: Integers = (usable_at - rows["sent_at_ns"])[self.is_delivered]
        return delays

    @cached_property
    def transport_delays(self) -> Integers:
        """Times (ns) of messages on the real transport, none in virtual time."""
        arrived_at, sent_at = self.verdicts["arrived_at_ns"], self.verdicts["sent_at_ns"]
        delays: Integers = (arrived_at - sent_at)[arrived_at != 0]
        return delays[np.abs(delays) < LONGEST_NS]

    @property
    def problem(self) -> str:
        """Counts that contradict each other; empty if the account balances."""
        verdicts, missing = len(self.verdicts), len(self.missing)
        if verdicts + missing == self.sent:
            return ""
        return (
            f"{self.link[0]} → {self.link[1]}: the account does not balance: {self.sent} messages "
            f"sent, {verdicts + missing} accounted for ({verdicts} verdicts on "
            f"{self.sent - missing} of them)"
        )


@once
def accounts(run: RunTables) -> dict[Link, LinkAccount]:
    """Accounts of all links, by receiver and then sender from the lead on."""
    record, result = _record_of(run), dict[Link, LinkAccount]()
    for receiver in run.names:
        verdicts = run.table(receiver, "verdict")
        own = {
            link: _missing(record, LinkAccount(link, 0, verdicts.of(verdicts["sender"] == link[0])))
            for link in [(name, receiver) for name in run.names]
            if link in run.scenario.links
        }
        hidden = _unrecorded(record, receiver, own)
        for link, missing in own.items():
            rows = _fates(record, missing, hidden[link])
            result[link] = replace(missing.account, missing=rows)
    return result


def contradictions(counted: Mapping[Link, LinkAccount]) -> list[str]:
    """Lines on links whose messages are not accounted for."""
    return [account.problem for account in counted.values() if account.problem]


# ---- What the log shows of sending and receiving


class _Vehicle(NamedTuple):
    """A vehicle as sender and receiver; instants are ns.

    `due` counts its poses by the schedule, 0 if that is unknown. `away` counts, before each pose of
    `sent_at`, those that were missing or late at the recorder. `down` are the times between two
    decisions in which its software did not run. `final` are its final counters.
    """

    poses: Columns
    due: int
    sent_at: Integers
    away: Integers
    decided_at: int | None
    down: list[tuple[int, int]]
    final: Health | None


@dataclass(frozen=True, slots=True)
class _LinkRecord:
    """Facts of a run that all of its links share; `step` is the longest between decisions (ns)."""

    run: RunTables
    vehicles: Mapping[str, _Vehicle]
    cut_off: frozenset[str]
    is_physical: bool
    end_at: int
    step: int


def _record_of(run: RunTables) -> _LinkRecord:
    lost, step = cut_off(run), round(LONGEST_STEP * SECOND / run.scenario.control_rate_hz)
    vehicles = {name: _vehicle(run, name, step, was_cut_off=name in lost) for name in run.names}
    return _LinkRecord(run, vehicles, lost, is_physical(run), end_of_record(run), step)


def _vehicle(run: RunTables, name: str, step: int, *, was_cut_off: bool) -> _Vehicle:
    """Facts of a vehicle; one that was cut off sent until the end of the run."""
    poses = poses_of(run, name)
    is_away = np.ones(int(poses["seq"].max(initial=-1)) + 1, bool)
    is_away[poses["seq"]] = is_late(poses)
    sent_at = sending_instants(poses, len(is_away), 0)
    decisions = run.table(name, "tracking")
    numbers, at = decisions["seq"], decisions.at_ns
    if run.start_at is not None:  # the first decision is due at the start
        numbers, at = np.append(-1, numbers), np.append(run.start_at, at)
    rows = np.flatnonzero((np.diff(numbers) == 1) & (np.diff(at) > step))
    return _Vehicle(
        poses=poses,
        due=scheduled(run, name, pose_rate_hz(run, name), whole_run=was_cut_off),
        sent_at=sent_at,
        away=np.append(0, np.cumsum(is_away)),
        decided_at=int(at[-1]) if len(at) else None,
        down=list(zip(at[rows].tolist(), at[rows + 1].tolist(), strict=True)),
        final=final_health(run, name),
    )


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


def _is_away(vehicle: _Vehicle, at: Integers) -> Flags:
    """Whether one of the poses of a vehicle around each instant (ns) was missing or late."""
    place, count = np.searchsorted(vehicle.sent_at, at), len(vehicle.sent_at)
    begin, end = np.maximum(place - NEIGHBOURHOOD, 0), np.minimum(place + NEIGHBOURHOOD, count)
    found: Flags = vehicle.away[end] > vehicle.away[begin]
    return found


# ---- Messages without a verdict


class _Missing(NamedTuple):
    """Messages of a link without a verdict; instants in ns.

    `due_at` is the instant of sending plus the largest delay of the link.
    """

    account: LinkAccount
    numbers: Integers
    sent_at: Integers
    due_at: Integers


def _missing(record: _LinkRecord, account: LinkAccount) -> _Missing:
    """Count the messages of a link, and find those without a verdict.

    Messages after the sender's last recorded pose are known by its schedule or, without its final
    counters, by verdicts.
    """
    run, name = record.run, account.link[0]
    sender, judged = record.vehicles[name], account.verdicts["pose_seq"]
    sent = max(sender.due, len(sender.sent_at))
    if sender.final is None:
        is_possible = possible(run, name, judged, account.verdicts.logged_at_ns)
        sent = max(sent, int(judged[is_possible].max(initial=-1)) + 1)
    is_missing = np.ones(sent, bool)
    is_missing[judged[(judged >= 0) & (judged < sent)]] = False
    numbers = np.flatnonzero(is_missing)
    sent_at = sending_instants(sender.poses, sent, run.beginning)[numbers]
    largest = int(account.latencies.max(initial=0)) + TRANSIT_NS
    return _Missing(replace(account, sent=sent), numbers, sent_at, sent_at + largest)


def _unrecorded(
    record: _LinkRecord, receiver: str, missing: Mapping[Link, _Missing]
) -> dict[Link, Flags]:
    """Whether the verdict on each message is missing in the log, by the numbers of verdicts.

    Of the messages that were due while verdicts are missing, the first ones have these verdicts.
    """
    final, links = record.vehicles[receiver].final, sorted(missing)
    rows = [missing[link] for link in links]
    sent_at = np.concatenate([np.zeros(0, np.int64), *(row.sent_at for row in rows)])
    due_at = np.concatenate([np.zeros(0, np.int64), *(row.due_at for row in rows)])
    hidden, order = np.zeros(len(sent_at), bool), np.argsort(sent_at, kind="stable")
    expected = final.received + final.dropped if final else 0
    for gap in gaps(record.run.table(receiver, "verdict"), expected, end=FOREVER):
        is_due = (gap.before <= due_at) & (sent_at < gap.after) & ~hidden
        hidden[order[is_due[order]][: gap.size]] = True
    ends = np.cumsum([len(row.numbers) for row in rows])
    return dict(zip(links, np.split(hidden, ends)[:-1], strict=True))


def _fates(record: _LinkRecord, missing: _Missing, hidden: Flags) -> list[MissingVerdict]:
    """Fate of each message without a verdict: the first condition that holds decides."""
    run, account, sent_at, due_at = record.run, missing.account, missing.sent_at, missing.due_at
    (sender, receiver), delays = account.link, account.transport_delays
    decided_at, final = record.vehicles[receiver].decided_at, record.vehicles[receiver].final
    lists_arrivals = final is not None and len(delays) > 0
    may_arrive = due_at >= record.end_at - TRANSIT_NS
    if final is not None and lists_arrivals:  # the last report lists what had arrived
        longest = delays.max() // RESOLUTION_NS * RESOLUTION_NS
        may_arrive = sent_at + longest >= final.reported_at_ns + LAST_LOOK_NS
    begun_at, judged = run.start_at or record.end_at, account.verdicts["pose_seq"]
    is_before_first = missing.numbers < (judged.min() if len(judged) else 0)
    after_last = due_at >= (FOREVER if decided_at is None else decided_at)
    cases: list[tuple[Fate, str, Any]] = [
        ("in_flight", "", _waiting(final.waiting if final else "", sender, missing.numbers)),
        ("unrecorded", "", hidden),
        ("cut_off", receiver, (due_at >= (decided_at or 0)) & (receiver in record.cut_off)),
        ("receiver_down", "", _is_down(record, missing)),
        ("in_flight", "", may_arrive | (not record.is_physical)),
        ("unrecorded", "", after_last & (not lists_arrivals)),
        ("late_start", "", is_before_first & (sent_at < begun_at + LATE_START_NS)),
        *_transport_causes(record, account.link, sent_at),
    ]
    fates, vehicles, conditions = zip(*cases, strict=True)
    columns = (
        missing.numbers,
        sent_at,
        np.select(conditions, fates, "unknown"),
        np.select(conditions, vehicles, ""),
    )
    rows = zip(*(column.tolist() for column in columns), strict=True)
    return [MissingVerdict(*row) for row in rows]


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


def _is_down(record: _LinkRecord, missing: _Missing) -> Flags:
    """Whether the receiver's software did not run when a message should have arrived."""
    name, sent_at = missing.account.link[1], missing.sent_at
    receiver = record.vehicles[name]
    latest = missing.due_at if record.is_physical else np.full(len(sent_at), FOREVER)
    is_down = np.zeros(len(sent_at), bool)
    for begin, end in receiver.down:
        is_down |= (begin <= latest) & (sent_at < end)
    if receiver.decided_at is None:
        return is_down | (not len(record.run.table(name, "verdict")))
    allowed = SECOND if record.is_physical else record.step
    if record.end_at - receiver.decided_at > allowed:
        is_down |= receiver.decided_at <= latest
    return is_down


def _transport_causes(
    record: _LinkRecord, link: Link, sent_at: Integers
) -> Iterator[tuple[Fate, str, Flags]]:
    """Yield causes of losses by the vehicles that were away at the instants (ns) of sending."""
    away = {}
    for name, vehicle in record.vehicles.items():
        if len(vehicle.poses):
            is_gone = (name in record.cut_off) & (sent_at > vehicle.poses.at_ns[-1])
            away[name] = _is_away(vehicle, sent_at) | is_gone
    if len(away) > 1:
        yield "router_away", "", np.all(list(away.values()), axis=0)
    for name in reversed(link):
        yield "cut_off", name, away.get(name, np.full(len(sent_at), name in record.cut_off))


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


@once
def away_spans(run: RunTables) -> dict[str, tuple[int, int]]:
    """First and last instant (ns) of the poses of a vehicle that reached the recorder very late."""
    spans = {}
    for name in run.names:
        poses = poses_of(run, name)
        at = poses.at_ns[is_late(poses)]
        if len(at):
            spans[name] = int(at[0]), int(at[-1])
    return spans


def away_lines(run: RunTables) -> Iterator[str]:
    """Yield a line per vehicle whose poses reached the recorder very late."""
    late = away_spans(run)
    if len(late) == len(run.names) > 1:
        begins, ends = zip(*late.values(), strict=True)
        late = {"every vehicle": (min(begins), max(ends))}
    for name, (begin, end) in late.items():
        yield (
            f"{name} was out of reach from {run.seconds(begin):.2f} to {run.seconds(end):.2f} s: "
            f"poses reached the recorder more than {AWAY_NS / SECOND:g} s late"
        )
