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
from transport.columns import Array, Columns, Flags, Integers
from vehicles.schedule import MILLISECOND, SECOND

Link = tuple[str, str]
"""Sender and receiver."""
Fate = Literal[
    "receiver_down", "late_start", "cut_off", "router_away", "unknown", "in_flight", "unrecorded"
]
CAUSE_WORDS: Mapping[Fate, str] = {
    "receiver_down": "receiver did not run",
    "late_start": "late start",
    "cut_off": "cut off",
    "router_away": "router away",
    "unknown": "unknown cause",
}
"""Fates of messages that did not arrive, as text."""
TRANSPORT_CAUSES = ("late_start", "cut_off", "router_away", "unknown")
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


class Missing(NamedTuple):
    """Messages without a recorded verdict in the order of their numbers; shapes (N).

    Instants of sending are ns. `fate` is a Fate, `vehicle` the one that was cut off, else "".
    """

    number: Integers
    sent_at: Integers
    fate: Array
    vehicle: Array

    @property
    def is_lost(self) -> Flags:
        """Whether the real transport lost each message."""
        return np.isin(self.fate, TRANSPORT_CAUSES)


NOTHING = Missing(np.zeros(0, int), np.zeros(0, int), np.zeros(0, str), np.zeros(0, str))


@dataclass(frozen=True)
class LinkAccount:
    """Messages of one link; `verdicts` are in the order of the receiver's decisions."""

    link: Link
    sent: int
    verdicts: Columns
    missing: Missing = NOTHING

    @cached_property
    def is_delivered(self) -> Flags:
        """Whether each verdict is on a delivered message."""
        delivered: Flags = self.verdicts["outcome"] == "delivered"
        return delivered

    @cached_property
    def fates(self) -> Mapping[Fate, int]:
        """Number of messages without a verdict by their fate."""
        return Counter(self.missing.fate.tolist())

    @property
    def not_arrived(self) -> dict[str, int]:
        return {cause: self.fates[cause] for cause in CAUSE_WORDS if cause in self.fates}

    @cached_property
    def delays(self) -> Integers:
        """Times (ns) from sending until the receiver could use the message of each verdict."""
        rows = self.verdicts
        usable_at = np.where(rows["late"], rows["received_at_ns"], rows["visible_at_ns"])
        delays: Integers = usable_at - rows["sent_at_ns"]
        return delays

    @cached_property
    def latencies(self) -> Integers:
        """Delays (ns) of the delivered messages."""
        return self.delays[self.is_delivered]

    @cached_property
    def transport_delays(self) -> Integers:
        """Times (ns) of messages on the real transport, none in virtual time."""
        arrived_at, sent_at = self.verdicts["arrived_at_ns"], self.verdicts["sent_at_ns"]
        delays: Integers = (arrived_at - sent_at)[arrived_at != 0]
        return delays[np.abs(delays) < LONGEST_NS]


@once
def accounts(run: RunTables) -> dict[Link, LinkAccount]:
    """Accounts of all links, by receiver and then sender from the lead on."""
    result = dict[Link, LinkAccount]()
    for receiver in run.names:
        links = [(name, receiver) for name in run.names if (name, receiver) in run.scenario.links]
        own = [_without_verdict(run, link) for link in links]
        for account, hidden in zip(own, _unrecorded(run, receiver, own), strict=True):
            result[account.link] = _with_fates(run, account, hidden)
    return result


def contradictions(counted: Mapping[Link, LinkAccount]) -> Iterator[str]:
    """Yield a line per link whose counts contradict each other."""
    for (sender, receiver), account in counted.items():
        missing = len(account.missing.number)
        listed = len(account.verdicts) + missing
        if listed != account.sent:
            yield (
                f"{sender} → {receiver}: the account does not balance: {account.sent} messages "
                f"sent, {listed} accounted for ({len(account.verdicts)} verdicts on "
                f"{account.sent - missing} of them)"
            )


# ---- What the log shows of sending and receiving


def sending_instants(run: RunTables, name: str, count: int) -> Integers:
    """Instants (ns) of sending of the first `count` messages; interpolated where not recorded.

    Without any recorded pose they are the beginning of the run.
    """
    poses = poses_of(run, name)
    known, at = poses["seq"], poses.at_ns
    if not len(known):
        return np.full(count, run.beginning, np.int64)
    numbers = np.arange(count)
    since = np.interp(numbers, known, at - at[0])
    if len(known) > 1:
        period = float(np.median(np.diff(at) / np.diff(known)))
        since += period * np.maximum(numbers - known[-1], 0)
    instants: Integers = at[0] + np.round(since).astype(np.int64)
    inside = known < count
    instants[known[inside]] = at[inside]
    return instants


def _newest(run: RunTables, name: str) -> int:
    return int(poses_of(run, name)["seq"].max(initial=-1))


@once
def _away(run: RunTables, name: str) -> tuple[Integers, Integers]:
    """Instants (ns) of sending, and before each how many poses were missing or late so far."""
    poses, count = poses_of(run, name), _newest(run, name) + 1
    is_away = np.ones(count, bool)
    is_away[poses["seq"]] = is_late(poses)
    return sending_instants(run, name, count), np.append(0, np.cumsum(is_away))


def _is_away(run: RunTables, name: str, at: Integers) -> Flags:
    """Whether one of the poses of a vehicle around each instant (ns) was missing or late.

    A vehicle that was cut off at the end is away after its last pose.
    """
    sent_at, before = _away(run, name)
    place, last = np.searchsorted(sent_at, at), len(sent_at)
    begin, end = np.maximum(place - NEIGHBOURHOOD, 0), np.minimum(place + NEIGHBOURHOOD, last)
    is_after = at > poses_of(run, name).at_ns[-1]
    found: Flags = (before[end] > before[begin]) | (is_after & (name in cut_off(run)))
    return found


def _decided_at(run: RunTables, name: str) -> int | None:
    """Instant (ns) of the last decision; the first one is due at the start."""
    at = run.table(name, "tracking").at_ns
    return int(at[-1]) if len(at) else run.start_at


def _is_down(run: RunTables, account: LinkAccount, due_at: Integers) -> Flags:
    """Whether the receiver's software did not run when a message should have arrived."""
    name, sent_at = account.link[1], account.missing.sent_at
    tracking, decided_at = run.table(name, "tracking"), _decided_at(run, name)
    physical, step = is_physical(run), round(LONGEST_STEP * SECOND / run.scenario.control_rate_hz)
    latest = due_at if physical else np.full(len(sent_at), FOREVER)
    number, at = tracking["seq"], tracking.at_ns
    if run.start_at is not None:
        number, at = np.append(-1, number), np.append(run.start_at, at)
    is_down = np.zeros(len(sent_at), bool)
    for row in np.flatnonzero((np.diff(number) == 1) & (np.diff(at) > step)):
        is_down |= (at[row] <= latest) & (sent_at < at[row + 1])
    if decided_at is None:
        return is_down | (not len(run.table(name, "verdict")))
    if end_of_record(run) - decided_at > (SECOND if physical else step):
        is_down |= decided_at <= latest
    return is_down


# ---- Messages without a verdict


def _without_verdict(run: RunTables, link: Link) -> LinkAccount:
    """Count the messages of a link, and find those without a verdict.

    Messages after the sender's last recorded pose are known by its schedule or, without its final
    counters, by verdicts. A sender that was cut off sent until the end of the run.
    """
    name, receiver = link
    table = run.table(receiver, "verdict")
    verdicts = table.of(table["sender"] == name)
    judged = verdicts["pose_seq"]
    due = scheduled(run, name, pose_rate_hz(run, name), whole_run=name in cut_off(run))
    sent = max(due, _newest(run, name) + 1)
    if final_health(run, name) is None:
        is_possible = possible(run, name, judged, verdicts.logged_at_ns)
        sent = max(sent, int(judged[is_possible].max(initial=-1)) + 1)
    is_missing = np.ones(sent, bool)
    is_missing[judged[(judged >= 0) & (judged < sent)]] = False
    numbers = np.flatnonzero(is_missing)
    none = np.full(len(numbers), "", object)
    sent_at = sending_instants(run, name, sent)[numbers]
    return LinkAccount(link, sent, verdicts, Missing(numbers, sent_at, none, none))


def _due_at(account: LinkAccount) -> Integers:
    """Instants (ns) at which messages were due by the largest delay of the link."""
    largest = int(account.latencies.max(initial=0)) + TRANSIT_NS
    return account.missing.sent_at + largest


def _unrecorded(run: RunTables, receiver: str, own: Sequence[LinkAccount]) -> list[Flags]:
    """Whether the verdict on each message is missing in the log, by the numbers of verdicts.

    Of the messages that were due while verdicts are missing, the first ones have these verdicts.
    """
    none, by_name = np.zeros(0, np.int64), sorted(own, key=lambda account: account.link)
    sent_at = np.concatenate([none, *(account.missing.sent_at for account in by_name)])
    due_at = np.concatenate([none, *map(_due_at, by_name)])
    hidden, order = np.zeros(len(sent_at), bool), np.argsort(sent_at, kind="stable")
    final = final_health(run, receiver)
    expected = final.received + final.dropped if final else 0
    for gap in gaps(run.table(receiver, "verdict"), expected, end=FOREVER):
        is_due = (gap.before <= due_at) & (sent_at < gap.after) & ~hidden
        hidden[order[is_due[order]][: gap.size]] = True
    ends = np.cumsum([len(account.missing.number) for account in by_name])
    parts = {row.link: part for row, part in zip(by_name, np.split(hidden, ends), strict=False)}
    return [parts[account.link] for account in own]


def _with_fates(run: RunTables, account: LinkAccount, hidden: Flags) -> LinkAccount:
    """Find the fate of each message without a verdict: the first condition that holds decides."""
    if not len(account.missing.number):
        return account
    (sender, receiver), (numbers, sent_at, *_) = account.link, account.missing
    due_at, delays, final = _due_at(account), account.transport_delays, final_health(run, receiver)
    decided_at, physical = _decided_at(run, receiver), is_physical(run)
    lists_arrivals = final is not None and len(delays) > 0
    may_arrive = due_at >= end_of_record(run) - TRANSIT_NS
    if final is not None and lists_arrivals:  # the last report lists what had arrived
        longest = delays.max() // RESOLUTION_NS * RESOLUTION_NS
        may_arrive = sent_at + longest >= final.reported_at_ns + LAST_LOOK_NS
    begun_at = run.start_at or end_of_record(run)
    is_before_first = numbers < account.verdicts["pose_seq"].min(initial=FOREVER)
    is_before_first &= len(account.verdicts) > 0
    after_last = due_at >= (FOREVER if decided_at is None else decided_at)
    cases: list[tuple[Fate, str, Any]] = [
        ("in_flight", "", _waiting(final.waiting if final else "", sender, numbers)),
        ("unrecorded", "", hidden),
        ("cut_off", receiver, (due_at >= (decided_at or 0)) & (receiver in cut_off(run))),
        ("receiver_down", "", _is_down(run, account, due_at)),
        ("in_flight", "", may_arrive | (not physical)),
        ("unrecorded", "", after_last & (not lists_arrivals)),
        ("late_start", "", is_before_first & (sent_at < begun_at + LATE_START_NS)),
        *_transport_causes(run, account.link, sent_at),
    ]
    fates, vehicles, conditions = zip(*cases, strict=True)
    fate, vehicle = np.select(conditions, fates, "unknown"), np.select(conditions, vehicles, "")
    return replace(account, missing=Missing(numbers, sent_at, fate, vehicle))


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


def _transport_causes(
    run: RunTables, link: Link, sent_at: Integers
) -> Iterator[tuple[Fate, str, Flags]]:
    """Yield causes of losses by the vehicles that were away at the instants (ns) of sending."""
    seen = [name for name in run.names if len(poses_of(run, name))]
    away = {name: _is_away(run, name, sent_at) for name in seen}
    if len(away) > 1:
        yield "router_away", "", np.all(list(away.values()), axis=0)
    for name in reversed(link):
        yield "cut_off", name, away.get(name, np.full(len(sent_at), name in cut_off(run)))


# ---- Lines about messages that the real transport lost


def absence_lines(run: RunTables, counted: Mapping[Link, LinkAccount]) -> Iterator[str]:
    """Yield a line per cause and vehicle for messages that the real transport lost."""
    lost: dict[tuple[Fate, str], list[tuple[Link, Integers]]] = {}
    for link, account in counted.items():
        _, sent_at, fate, vehicle = account.missing
        rows = account.missing.is_lost
        for key in dict.fromkeys(zip(fate[rows].tolist(), vehicle[rows].tolist(), strict=True)):
            same = (fate == key[0]) & (vehicle == key[1])
            lost.setdefault(key, []).append((link, sent_at[same]))
    for (cause, name), found in lost.items():
        links = [f"{a} → {b}" for (a, b), _ in found]
        over = ", ".join(links[:MOST_LINKS]) + (", …" if len(links) > MOST_LINKS else "")
        at = np.concatenate([instants for _, instants in found])
        begin, end = run.seconds(at.min()), run.seconds(at.max())
        words = f"{name} {CAUSE_WORDS[cause]}" if name else CAUSE_WORDS[cause]
        count = "1 message" if len(at) == 1 else f"{len(at)} messages"
        yield f"{count} did not arrive over {over}, sent {begin:.2f} to {end:.2f} s: {words}"


@once
def away_spans(run: RunTables) -> dict[str, tuple[int, int]]:
    """First and last instant (ns) of the poses of a vehicle that reached the recorder very late."""
    tables = {name: poses_of(run, name) for name in run.names}
    late = {name: poses.at_ns[is_late(poses)] for name, poses in tables.items()}
    return {name: (int(at[0]), int(at[-1])) for name, at in late.items() if len(at)}


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
